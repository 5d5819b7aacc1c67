"""A job with a compensation that the library does not know: from its key to verify."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident import kinds

_TOY = Path(__file__).parent / "toy"
_RUN = """
import sys
from axcomp.ident import kinds

kinds.__path__.append(sys.argv[1])
kinds.NAMES = (*kinds.NAMES, "offset")

from axcomp.ident.cli import main

fit = main(["fit", "job.toml", "--out", "result"])
open("loaded.txt", "w").write("\\n".join(sys.modules))
lists = ["result/achskw1.lis", "result/achsmds1.lis"]
verify = main(["verify", *lists, "--log", "log.csv", "--json"])
sys.exit(f"fit {fit}, verify {verify}" if fit or verify else 0)
"""
"""The folder is added, and its name to the table, before anything else is loaded."""
_JOB = """
[axes.X]
number = 1
limits = [0.0, 90.0]
list = "achskw1.lis"
machine_data = "achsmds1.lis"

[measurements.laser]
file = "laser.csv"
active = ["leadscrew"]
columns = { "X.position" = "x", "X.error" = { column = "e", unit = "mm" } }
remove = "none"

[[fits]]
compensation = "offset"
axis = "X"
measurement = "laser"
"""
_SCREW = """kopf.achs_nr 1
kw.ssfk.unit 1
kw.ssfk.interval 1000000
kw.ssfk.kw_nr_max 2
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 1000
kw.ssfk.set_pos_without_comp 1
"""
_PLACES = np.linspace(0.0, 90.0, 10)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any]]:
    """Run job and verify in a library with one name more; return folder and verdicts.

    The truth is 12.3 µm off everywhere; the log is that of a controller that adds the
    offset of the new list to its leadscrew table.
    """
    folder = tmp_path_factory.mktemp("offset")
    (folder / "job.toml").write_text(_JOB)
    (folder / "achskw1.lis").write_text(_SCREW)
    (folder / "achsmds1.lis").write_text("kopf.achs_nr 1\nlr_param.ssfk 1\n")
    rows = [f"{x:.4f},-0.0123" for x in _PLACES]
    (folder / "laser.csv").write_text("\n".join(["x,e", *rows]) + "\n")
    rows = [f"{x:.4f},{0.0123 - 0.001 * x:.7f}" for x in _PLACES]
    (folder / "log.csv").write_text("\n".join(["A1.position,A1.offset", *rows]) + "\n")
    ran = subprocess.run(
        [sys.executable, "-c", _RUN, str(_TOY)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return folder, json.loads(ran.stdout[ran.stdout.index("[\n  {") :])


def test_new_kind_is_fitted_and_written_into_the_list(done: tuple[Path, Any]) -> None:
    listing = ListFile.read(done[0] / "result" / "achskw1.lis")
    assert listing.integer("kw.offset.value") == 123
    assert listing.integer("kw.ssfk.table[1].pos") == 1000
    machine = ListFile.read(done[0] / "result" / "achsmds1.lis")
    assert machine.integer("lr_param.offset") == 1


def test_fit_loads_no_fit_of_another_compensation(done: tuple[Path, Any]) -> None:
    start = f"{kinds.__name__}."
    parts = [
        name.removeprefix(start).split(".")
        for name in (done[0] / "loaded.txt").read_text().split()
        if name.startswith(start)
    ]
    others = {(one[0], one[-1]) for one in parts if one[0] != "offset"}
    heavy = {"plan", "_draft", "page", "effect", "_fit"}
    assert not {part for _, part in others} & heavy


def test_new_kind_has_its_result_and_its_steps(done: tuple[Path, Any]) -> None:
    result = json.loads((done[0] / "result" / "result.json").read_text())
    (fit,) = result["fits"]
    assert fit["parameters"] == {"offset": 0.0123}
    assert result["passed"]
    steps = [text for step in result["load_sheet"] for text in step.values()]
    assert "Switch on offset of X" in steps


def test_new_kind_is_judged_with_all_that_acts_on_its_axis(
    done: tuple[Path, Any],
) -> None:
    result = json.loads((done[0] / "result" / "result.json").read_text())
    whole = result["whole"]["X"]
    assert set(whole["compensations"]) == {"offset", "leadscrew"}
    # Both at the far end: 12.3 µm less the 90 µm of the table.
    assert whole["jump"] == pytest.approx(0.09 - 0.0123, abs=1e-9)


def test_report_shows_the_page_of_a_new_kind(done: tuple[Path, Any]) -> None:
    page = (done[0] / "result" / "report.html").read_text(encoding="utf-8")
    assert "Offset of X" in page
    assert "+12.3 µm, the same everywhere." in page


def test_verify_agrees_with_the_list_of_a_new_kind(done: tuple[Path, Any]) -> None:
    verdicts = {one["compensation"]: one["verdict"] for one in done[1]}
    assert verdicts["offset"] == ["agrees"]

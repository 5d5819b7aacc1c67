"""`axcomp fit`: summary, exit status, files, and no traceback for bad input."""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main

JOB = """
title = "Portal mill 7"
[axes.X]
number = 1
[measurements.laser]
file = "laser.csv"
remove = "none"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = true
smoothness = 1
start = 0.0
interval = 50.0
points = 5
"""


@pytest.fixture
def job(tmp_path: Path) -> Path:
    rng = np.random.default_rng(23)
    there = np.arange(0.0, 201.0, 50.0)
    lines = ["target,error,run,direction"]
    for run in (1, 2, 3):
        for sense in (1, -1):
            for place in there[::sense]:
                error = 2e-5 * place + 2e-3 * sense + 2e-4 * rng.standard_normal()
                lines.append(f"{place},{error:.7f},{run},{sense}")
    (tmp_path / "laser.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path / "job.toml"


def test_fit_writes_lists_report_and_result(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = job.parent / "out"
    start = time.monotonic()
    assert main(["fit", str(job), "--out", str(out)]) == 0
    waited = time.monotonic() - start
    shown = capsys.readouterr()
    stated = re.search(r"Done \(([0-9.]+) s\)", shown.out)
    assert stated is not None
    # The report and what is loaded are part of it, all but reading the command line.
    assert 0.7 * waited < float(stated[1]) < waited + 0.1
    assert shown.err == ""
    for word in ("leadscrew of X", "before", "predicted", "from file", "gate: passed"):
        assert word in shown.out
    assert "report.html" in shown.out
    names = {path.name for path in out.iterdir()}
    assert {"achskw1.lis", "result.json", "report.html"} <= names


def test_json_is_the_result_on_standard_output(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = job.parent / "out"
    assert main(["fit", str(job), "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "result.json").read_text())
    assert printed["fits"][0]["axis"] == "X"


def test_output_folder_is_relative_to_the_current_one(
    job: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert main(["fit", str(job)]) == 0
    assert (elsewhere / "axcomp-out" / "achskw1.lis").is_file()


def test_failed_gate_ends_with_1_and_says_so(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job.write_text(JOB + "[gate]\nmax_reversal = 0.001\n")
    out = job.parent / "out"
    assert main(["fit", str(job), "--out", str(out)]) == 1
    shown = capsys.readouterr().out
    assert "gate: FAILED max_reversal" in shown
    assert "NOT PASSED" in shown
    assert (out / "report.html").is_file()
    assert not (out / "achskw1.lis").exists()


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "laser.csv",
            "lasr.csv",
            "job.toml:6: measurements.laser.file: found 'lasr.csv'",
        ),
        ("bilateral", "bilaterl", "unknown key (nearest: 'bilateral')"),
        ("points = 5", "points = 1", "fits[0].points: found 1, expected "),
    ],
)
def test_bad_input_ends_with_1_and_one_line(
    job: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, line: str
) -> None:
    job.write_text(JOB.replace(old, new))
    out = job.parent / "out"
    assert main(["fit", str(job), "--out", str(out)]) == 1
    shown = capsys.readouterr().err.strip()
    assert line in shown
    assert len(shown.splitlines()) == 1
    assert list(out.glob("*")) == []


def test_missing_job_file_ends_with_1_and_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(tmp_path / "no.toml"), "--out", str(tmp_path / "o")]) == 1
    assert "no.toml: No such file or directory" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_fit_without_a_job_is_bad_usage() -> None:
    assert main(["fit"]) == 2


@pytest.mark.slow
def test_cache_is_kept_in_the_users_cache_folder_and_can_be_off(
    job: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = job.parent / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    arguments = ["fit", str(job), "--out", str(job.parent / "out")]
    assert main(arguments) == 0
    assert not (cache / "axcomp").exists()  # the tests run with AXCOMP_CACHE=off
    base = dict(os.environ)
    base.pop("AXCOMP_CACHE")
    command = [sys.executable, "-m", "axcomp", *arguments]
    subprocess.run(command, env=base, check=True, capture_output=True)
    assert list((cache / "axcomp").glob("**/*-cache"))
    # A cache that cannot be written is no failure.
    blocked = job.parent / "blocked"
    blocked.write_text("")
    base["XDG_CACHE_HOME"] = str(blocked)
    run = subprocess.run(command, env=base, check=True, capture_output=True, text=True)
    assert "UserWarning" not in run.stderr


def test_command_modules_import_neither_jax_nor_numpy() -> None:
    code = (
        "import sys, axcomp.ident.cli; "
        "sys.exit(any(name in sys.modules for name in ('jax', 'numpy', 'pydantic')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


DATA = Path(__file__).parents[2] / "../shared/data/iso230"


@pytest.fixture
def ess_b02(tmp_path: Path, no_drawing: None) -> Path:
    source = DATA / "ess_b02_X_9pos5cyc_ISO230.dat"
    if not source.is_file():
        pytest.skip("needs ../shared/data/iso230/ess_b02_X_9pos5cyc_ISO230.dat")
    text = JOB.replace("laser.csv", source.resolve().as_posix())
    nodes = "setpoints = [-20, -15, -10, -5, 0, 5, 10, 15, 20]"
    text = text.replace("start = 0.0\ninterval = 50.0\npoints = 5", nodes)
    (tmp_path / "job.toml").write_text(text)
    return tmp_path / "job.toml"


def _figures(job: Path) -> dict[str, dict[str, float]]:
    out = job.parent / "out"
    assert main(["fit", str(job), "--out", str(out)]) == 0
    found: dict[str, dict[str, float]] = json.loads((out / "result.json").read_text())[
        "fits"
    ][0]["error"]
    return found


def _mean_error_left(job: Path) -> np.ndarray:
    """Mean error per direction and target under the written list, in µm, (2, 9)."""
    from axcomp.data.measurements import measurement, read_table
    from axcomp.ident.exchange import offset_at
    from axcomp.ident.kinds.leadscrew.entries import leadscrew_from_list
    from axcomp.models import Conventions

    measured = measurement(read_table(DATA / "ess_b02_X_9pos5cyc_ISO230.dat"), axis="X")
    target, actual = measured.require("X.position"), measured.require("X.actual")
    direction = measured.require("X.direction")
    listing = ListFile.read(job.parent / "out" / "achskw1.lis")
    screw = leadscrew_from_list(listing, Conventions())
    left = actual - target + offset_at(screw, target[:, None], direction)
    return 1e3 * np.array(
        [
            [left[(direction == sense) & (target == place)].mean()
             for place in np.unique(target)]
            for sense in (1, -1)
        ]
    )  # fmt: skip


def test_real_run_table_has_its_published_figures_before(ess_b02: Path) -> None:
    before = _figures(ess_b02)["before"]
    known = {"A": 135.3, "R": 55.2, "B": 33.6, "E": 122.8, "M": 93.7, "B_mean": -25.4}
    for name, value in known.items():
        # Recomputed figures, given to 0.1 µm.
        assert 1e3 * before[name] == pytest.approx(value, abs=0.1)


def test_plain_means_leave_a_tenth_of_a_micron_of_a_real_run_table(
    ess_b02: Path,
) -> None:
    text = ess_b02.read_text().replace(
        "smoothness = 1", 'smoothness = 0\nloss = "gauss"'
    )
    ess_b02.write_text(text)
    _figures(ess_b02)
    # What the issue asks for; rounding alone is up to 0.05 µm.
    assert np.max(np.abs(_mean_error_left(ess_b02))) <= 0.1


def test_defaults_leave_a_real_run_table_inside_its_standard_error(
    ess_b02: Path,
) -> None:
    ess_b02.write_text(ess_b02.read_text().replace("smoothness = 1\n", ""))
    figures = _figures(ess_b02)
    left = _mean_error_left(ess_b02)
    result = json.loads((ess_b02.parent / "out" / "result.json").read_text())
    deviation = result["fits"][0]["standard_deviations"]["table"]
    allowed = 1e3 * np.array([deviation["pos"], deviation["neg"]])
    # Two standard errors at each of the 18 means, and rounding.
    assert np.all(np.abs(left) <= 2 * allowed + 0.05)
    # The scatter stays, the systematic part goes: predicted on cycles left out.
    assert figures["predicted"]["E"] < 0.1 * figures["before"]["E"]
    assert figures["predicted"]["R"] < figures["before"]["R"]


def test_a_job_loads_no_compensation_and_no_library_before_it_needs_them() -> None:
    code = (
        "import sys, axcomp.ident.job; print(*{'scipy.stats', 'scipy.signal',"
        " 'scipy.interpolate', 'axcomp.ident.kinds.temperature._alone',"
        " 'axcomp.ident.kinds.temperature.plan'} & set(sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == ""

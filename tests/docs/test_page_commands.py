"""The blocks of single pages run as they stand, one after the other, on files made for them."""

import json
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main
from axcomp.ident.diagnosis import SCOPE
from axcomp.ident.exchange import StoredConventions

from ..ident.external.test_verify import CROSS, diagdata
from ..ident.test_diagnosis import (
    CYCLE,
    LISTS,
    channels,
    export,
    moved,
    recorded,
)
from .conftest import write
from .test_pages import DOCS, ROOT, blocks, commands


def shown(page: str, *languages: str) -> list[str]:
    """Return the blocks of a page that are of some languages."""
    return [text for language, text in blocks(ROOT / page) if language in languages]


def typed(page: str) -> list[list[str]]:
    """Return the commands of a page, each as its words."""
    return [words for text in shown(page, "sh") for words in commands(text)]


def merged(*parts: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for part in parts:
        for key, value in part.items():
            both = isinstance(value, dict) and isinstance(found.get(key), dict)
            found[key] = merged(found[key], value) if both else value
    return found


def readme_job() -> dict[str, Any]:
    """Return the job of the first page, for an axis without a list."""
    (text,) = shown("README.md", "toml")
    job = tomllib.loads(text)
    del job["axes"]["X"]["list"]
    return job


def test_what_make_is_asked_for_in_the_readme_are_its_targets() -> None:
    first, *_ = shown("README.md", "sh")
    targets = (ROOT / "Makefile").read_text("utf-8")
    asked = [line.split()[1] for line in first.splitlines() if line.startswith("make")]
    assert asked
    assert all(f"\n{target}:" in targets for target in asked)


@pytest.mark.heavy
def test_the_page_on_diagnosis_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = moved()
    for name, text in LISTS.items():
        Path(name).write_text(text)
    look, verify = typed("docs/diagnosis.md")
    assert main(look) == 0
    names = [word for word in verify if word.endswith(".lis")]
    enabled = channels((tmp_path / look[-1] / SCOPE).read_bytes())
    log = recorded([ListFile.read(Path(name)) for name in names], path, 1.0)
    export(tmp_path / "export.csv", enabled, log)
    assert main(verify) == 0
    (events,) = shown("docs/diagnosis.md", "csv")
    Path("events.csv").write_text(events)
    Path("new").mkdir()
    shutil.copy("achskw3.lis", "new/achskw3.lis")
    time = CYCLE * np.arange(path.rows)
    places = {f"A{axis}.position": place for axis, place in path.positions.items()}
    write(Path("motion.csv"), ",".join(["time", *places]), time, *places.values())
    simulate = ["simulate", *names, "--motion", "motion.csv", "--events", "events.csv"]
    assert main([*simulate, "--out", "added.csv"]) == 0


@pytest.mark.heavy
def test_the_page_on_an_external_compensation_runs(
    files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = readme_job()
    job["fits"][0]["bilateral"] = False
    Path("job.toml").write_text(tomlkit.dumps(job), "utf-8")
    assert main(["fit", "job.toml"]) == 0
    Path("achskw1.lis").write_text(CROSS)
    for axis in (1, 2, 3):
        Path(f"achsmds{axis}.lis").write_text(
            f"kopf.achs_nr {axis}\nlr_param.crosscomp {int(axis == 1)}\n"
        )
    Path("achskw3.lis").write_text(CROSS.replace("achs_nr 1", "achs_nr 3"))
    Path("diagdata.txt").write_text(diagdata(2_500_001))
    place = np.linspace(0.0, 900.0, 200)
    added = np.rint(1e-4 * place / 1e-5)
    head = "time,A3.position,A1.EXTC[0].actual_offset"
    write(Path("export.csv"), head, 1e-3 * np.arange(200), place, added)
    for words in typed("docs/external.md"):
        assert main(words) == 0, words
    monkeypatch.chdir(files / "external")
    for line in "\n".join(shown("docs/external.md", "sh")).splitlines():
        if line.startswith("c"):
            subprocess.run(line.split(), check=True)


@pytest.mark.heavy
def test_the_page_on_measuring_again_and_the_keys_of_other_pages_run(
    files: Path,
) -> None:
    """One job with the blocks of several pages, and its list measured again."""
    pages = ("docs/first-run.md", "docs/conventions.md", "docs/whole-axis.md")
    keys = [tomllib.loads(text) for page in pages for text in shown(page, "toml")]
    Path("job.toml").write_text(tomlkit.dumps(merged(readme_job(), *keys)), "utf-8")
    Path(keys[1]["machine"]["conventions"]).write_bytes(
        StoredConventions().saved_over()
    )
    (after,) = shown("docs/measure-again.md", "toml")
    Path("after.toml").write_text(after, "utf-8")
    (words,) = typed("docs/measure-again.md")
    assert main(words[: words.index("--after")]) == 0  # what was loaded
    assert main(words) == 0
    result = json.loads(Path("result/result.json").read_text("utf-8"))
    assert result["fits"][0]["verdict"] == "good"
    assert "verified" in Path(keys[1]["machine"]["conventions"]).read_text("utf-8")
    assert "X1[COMP" in Path("result/first_run_2.nc").read_text("utf-8")
    (example,) = map(json.loads, shown("docs/whole-axis.md", "json"))
    assert set(example["Z"]) <= set(result["whole"]["X"])


@pytest.mark.heavy
def test_the_job_of_the_page_on_groups_makes_its_lists(files: Path) -> None:
    rng = np.random.default_rng(11)
    x = np.tile(
        np.concatenate([np.arange(0.0, 401.0, 25.0), np.arange(400.0, -1.0, -25.0)]), 6
    )
    way = np.tile(np.repeat([1.0, -1.0], 17), 6)
    time = 60.0 * np.arange(x.size)
    warm = 20.0 + 6.0 * np.sin(np.pi * time / time[-1]) ** 2
    error = 0.004 * np.sin(x / 60.0) - 0.003 * (way < 0) + 11e-6 * (warm - 20.0) * x
    error += 2e-4 * rng.normal(size=x.size)
    write(files / "probe.csv", "time,x,dx,way", time, x, error, way)
    clock = np.arange(-300.0, time[-1] + 300.0, 20.0)
    scale = np.interp(clock, time, warm)
    write(files / "logger.csv", "time,t_scale", clock, scale)
    (job,) = shown("docs/groups.md", "toml")
    Path("job.toml").write_text(f"[axes.X]\nnumber = 1\n\n{job}", "utf-8")
    assert main(["fit", "job.toml"]) == 0


@pytest.mark.slow
@pytest.mark.usefixtures("no_drawing")
def test_the_page_on_files_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runs = [(run, side) for run in range(1, 6) for side in ("hin", "rück")]
    lines = ["Positionsmessung nach ISO 230-2", "Achse: X", "Portal 7", ""]
    lines.append("Soll;" + ";".join(side for _, side in runs))
    lines.append(";" + ";".join(str(run) for run, _ in runs))
    lines.append("mm" + 10 * ";µm")
    for k in range(21):
        noise = [0.1 * ((k * run) % 7) + 2.0 * (side == "hin") for run, side in runs]
        cells = [
            f"{20 * k:.1f}",
            *(f"{4 * np.sin(k / 3) + each:.2f}" for each in noise),
        ]
        lines.append(";".join(cells).replace(".", ","))
    Path("laser.csv").write_text("\n".join(lines) + "\n", "cp1252")
    (words,) = typed("docs/instrument-files.md")
    assert main(words) == 0
    said = capsys.readouterr().out.splitlines()
    page = (DOCS / "instrument-files.md").read_text("utf-8").split("```")[2]
    for line in page.split("\n\n")[1].splitlines():
        assert line.startswith("    …") or line.strip() in said
    measurement, centroid = shown("docs/instrument-files.md", "toml")
    fit = '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\nmeasurement = "laser"\n'
    fit += "start = 0.0\ninterval = 20.0\npoints = 21\nbilateral = true\n"
    zero = measurement.replace("active = []", 'active = []\nremove = "none"')
    Path("job.toml").write_text(f"[axes.X]\nnumber = 1\n{zero}\n{fit}", "utf-8")
    assert main(["fit", "job.toml"]) == 0
    counts = [round(50 * np.sin(k / 3)) for k in range(21)]
    Path("cnc7x.tab").write_text("21 -8000000\n" + "".join(f"{k}\n" for k in counts))
    fit = fit.replace('"laser"', '"centroid"').replace("bilateral = true\n", "")
    fit = fit.replace("0.0\ninterval = 20.0", "-800.0\ninterval = 40.0")
    zero = centroid.replace("active = []", 'active = []\nremove = "none"')
    axis = "[axes.X]\nnumber = 1\nincrement = 1e-4\n"
    Path("job.toml").write_text(f"{axis}{zero}\n{fit}", "utf-8")
    assert main(["fit", "job.toml"]) == 0


RUN = {
    "README.md": "test_pages.py::test_the_worked_examples_of_the_readme_run",
    "batch.md": "test_pages.py::test_the_commands_of_the_page_on_fleets_run",
    "compensations": "test_pages.py::test_the_job_of_a_compensation_makes_a_list",
    "conventions.md": "test_the_page_on_measuring_again_and_the_keys_of_other_pages_run",
    "diagnosis.md": "test_the_page_on_diagnosis_runs",
    "external.md": "test_the_page_on_an_external_compensation_runs; its Python in"
    " external/test_export.py",
    "first-run.md": "test_the_page_on_measuring_again_and_the_keys_of_other_pages_run",
    "groups.md": "test_the_job_of_the_page_on_groups_makes_its_lists",
    "instrument-files.md": "test_the_page_on_files_runs",
    "library.md": "test_library.py, as doctests",
    "measure-again.md": "test_the_page_on_measuring_again_and_the_keys_of_other_pages_run",
    "volumetric.md": "test_volumetric_fit.py, as doctests",
    "whole-axis.md": "test_the_page_on_measuring_again_and_the_keys_of_other_pages_run",
    "your-first-list.md": "new/test_first_list.py",
}
"""Which test runs the blocks of a page."""


def test_every_page_with_blocks_has_a_test_that_runs_them() -> None:
    pages = [page for page in DOCS.rglob("*.md") if any(blocks(page))]
    names = {p.name if p.parent == DOCS else p.parent.name for p in pages}
    assert {"README.md"} | names == set(RUN)

"""What `axcomp new` writes: roles, nodes, fits and questions."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from axcomp.ident.cli import main

from .conftest import answer

Written = Callable[[str], Path]


def new(folder: Path, text: str, *options: str, name: str = "readings.csv") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    job = folder / "job.toml"
    assert main(["new", str(folder / name), "--out", str(job), *options]) == 0
    return job


def asked(folder: Path, capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    """Return the questions of the job that is made of the same file once more."""
    capsys.readouterr()
    files = [str(each) for each in folder.glob("*.csv")]
    assert main(["new", *files, "--out", str(folder / "again.toml"), "--json"]) == 0
    found: list[dict[str, object]] = json.loads(capsys.readouterr().out)["questions"]
    return found


INSTRUMENTS = ("laser", "straightness", "probe", "scope", "thermal", "motion")


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_an_open_job_is_refused_at_its_first_question(
    written: Written, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = written(name)
    capsys.readouterr()
    assert main(["fit", str(job), "--out", str(job.parent / "none")]) == 1
    words = "axes.X.number: found nothing, expected this key"
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("name", ["laser", "straightness", "probe", "motion"])
def test_the_fit_asks_for_the_owner_of_a_constant_as_the_job_does(
    written: Written, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = written(name)
    assert "#? remove =" in job.read_text()
    numbered = job.with_name("numbered.toml")
    numbered.write_bytes(job.read_bytes())
    numbers = job.read_text().count("#? number =")
    answer(numbered, [f"number = {k}" for k in range(1, numbers + 1)])
    capsys.readouterr()
    assert main(["fit", str(numbered), "--out", str(job.parent / "none")]) == 1
    assert "expected the job to say whose they are" in capsys.readouterr().err

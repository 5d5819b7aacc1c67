"""`axcomp discover`: from a job file to what it says, and to the job that fits it."""

import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from axcomp.ident.cli import main
from axcomp.ident.job import load_job, run_job

JOB = """\
title = "Portal mill 7"

[axes.X]
number = 1
limits = [0.0, 800.0]

[measurements.laser]  # as it came
file = "laser.csv"
axis = "X"
datum = { at = 0.0 }
"""


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """Return a job with a laser measurement: pitch error, lost motion, set-ups."""
    rng = np.random.default_rng(0)
    targets = np.arange(0.0, 801.0, 50.0)
    place = np.tile(np.concatenate([targets, targets[::-1]]), 5)
    way = np.tile(np.repeat([1, -1], len(targets)), 5)
    run = np.repeat(np.arange(1, 6), 2 * len(targets))
    error = (
        0.01 * np.sin(place / 150) + 0.003 * way + 5e-4 * rng.normal(size=place.size)
    )
    rows = [
        f"{r},{d:+d},{x:.3f},{e:.5f}"
        for r, d, x, e in zip(run, way, place, error, strict=True)
    ]
    text = "\n".join(["run,direction,target [mm],error [mm]", *rows, ""])
    (tmp_path / "laser.csv").write_text(text)
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path / "job.toml"


def test_json_says_what_was_found_rejected_and_left(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["discover", str(job), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"found", "rejected", "unexplained"} <= set(found)
    first, second = found["found"]
    assert (first["compensation"], second["compensation"]) == ("leadscrew", "backlash")
    assert (first["axis"], first["masters"], first["sensor"]) == ("X", [], None)
    # Squares of 7 and 3 µm; what chance adds at 0.5 µm is far less than a twentieth.
    assert first["share"] == pytest.approx(0.85, abs=0.05)
    assert found["unexplained"] == []
    assert {"compensation", "axis", "masters", "sensor", "reason"} == set(
        found["rejected"][0]
    )


def test_a_person_reads_a_table_and_sentences(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["discover", str(job)]) == 0
    text = capsys.readouterr().out
    assert "error of X:" in text
    assert "in 170 readings" in text
    assert "backlash of X: 3 µm rms" in text
    assert "could not be looked for: no temperature was recorded" in text


@pytest.mark.slow
def test_the_written_job_is_what_fit_then_runs(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = job.with_name("new.toml")
    assert main(["discover", str(job), "--write", str(new)]) == 0
    text = new.read_text()
    said = capsys.readouterr().err
    assert "It leaves out datum of measurement laser: of fits that are" in said
    assert 'It states remove = "offset" of measurement laser: of fits that are' in said
    # All but the fits stays; the datum of one effect is none of a sum of two.
    kept = JOB.replace("datum = { at = 0.0 }", 'remove = "offset"')
    assert text.startswith(kept.rstrip())
    first, second = load_job(new).spec.fits
    assert (first.compensation, second.compensation) == ("leadscrew", "backlash")
    assert first.group == second.group == "X"
    # The targets become the nodes.
    assert "start = 0.0\ninterval = 50.0\npoints = 17\n" in text
    result = run_job(new, job.parent / "out")
    assert [fit.compensation for fit in result.fits] == ["leadscrew", "backlash"]
    assert (job.parent / "out" / "achskw1.lis").exists()


def test_a_datum_gives_way_to_the_remove_that_is_stated(job: Path) -> None:
    stated = "[measurements.laser.datum]\nat = 0.0\n"
    job.write_text(JOB.replace("datum = { at = 0.0 }", 'remove = "line"') + stated)
    new = job.with_name("new.toml")
    assert main(["discover", str(job), "--write", str(new)]) == 0
    spec = load_job(new).spec.measurements["laser"]
    assert (spec.datum, spec.remove) == (None, "line")


def test_fits_of_the_old_job_give_way_to_those_found(job: Path) -> None:
    old = JOB + '\n[[fits]]\ncompensation = "cross"\naxis = "X"\nmaster = "Y"\n'
    job.write_text(
        old.replace("[measurements", "[axes.Y]\nnumber = 2\n\n[measurements", 1)
        + 'measurement = "laser"\nsetpoints = [0.0, 800.0]\n'
    )
    new = job.with_name("new.toml")
    assert main(["discover", str(job), "--write", str(new)]) == 0
    assert [fit.compensation for fit in load_job(new).spec.fits] == [
        "leadscrew",
        "backlash",
    ]


def test_a_new_job_goes_beside_the_old_and_replaces_nothing(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = job.parent / "deeper"
    other.mkdir()
    assert main(["discover", str(job), "--write", str(other / "new.toml")]) == 2
    assert "expected a file beside" in capsys.readouterr().err
    assert main(["discover", str(job), "--write", str(job)]) == 2
    assert "which exists, expected a new file" in capsys.readouterr().err
    assert job.read_text() == JOB


def test_a_job_without_errors_is_refused_in_one_line(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (job.parent / "laser.csv").write_text("X.position [mm]\n1.0\n2.0\n")
    job.write_text(JOB.replace('axis = "X"\n', ""))
    assert main(["discover", str(job)]) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "no measured error and no current" in line


def test_what_the_data_cannot_tell_is_exit_status_1(
    job: Path, virtual: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(2)
    place = 800.0 * rng.random(600)
    error = 0.01 * np.sin(place / 150) + 5e-4 * rng.normal(size=600)
    table = np.column_stack([place, place + 40.0, error])
    header = "X.position [mm],Y.position [mm],Z.error [mm]"
    np.savetxt(job.parent / "both.csv", table, "%.5f", ",", header=header, comments="")
    axes = "".join(f"[axes.{a}]\nnumber = {k}\n" for k, a in enumerate("XYZ", 1))
    job.write_text(axes + '[measurements.both]\nfile = "both.csv"\n')
    assert main(["discover", str(job), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["found"] == []
    (one,) = found["unexplained"]
    assert one["verdict"] == "the data cannot tell"
    assert sorted(one["masters"]) == ["X", "Y"]
    assert "X and Y went together" in one["sentence"]

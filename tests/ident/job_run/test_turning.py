"""Axes that go round, shown within one turn: what they did is what counts, not the display."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.job import JobError, run_job

from .screw import offsets, table

_JOB = """
[axes.C]
number = 4
type = "rotary"
modulo = [0.0, 360.0]
[measurements.m]
file = "m.csv"
active = []
remove = "none"
columns = {{ {columns} }}
[[fits]]
compensation = "leadscrew"
axis = "C"
measurement = "m"
modulo = true
bilateral = true
start = 0.0
interval = 30.0
points = 13
"""


def truth(angle: np.ndarray, direction: np.ndarray) -> np.ndarray:
    return 4e-3 * np.sin(np.deg2rad(angle) + 0.7) - 3e-3 * direction


def left(folder: Path) -> float:
    """Return the largest of what the written list leaves, beside the sagitta of its nodes."""
    place = np.arange(-400.0, 1100.0, 15.0)
    path = np.concatenate([place, place[-2::-1]])
    direction = np.where(np.arange(len(path)) < len(place), 1.0, -1.0)
    error = truth(path, direction) + offsets(folder, 4, A4=path, D=direction)
    return float(np.abs(error).max())


@pytest.mark.parametrize("loss", ["student", "gauss"])
def test_a_display_that_begins_anew_turns_no_direction(
    tmp_path: Path, loss: str
) -> None:
    rng = np.random.default_rng(1)
    there = np.arange(0.0, 361.0, 30.0)
    path = np.tile(np.concatenate([there, there[::-1]]), 5)
    direction = np.tile(np.repeat([1.0, -1.0], len(there)), 5)
    error = truth(path, direction) + 1e-4 * rng.standard_normal(len(path))
    run = np.repeat(np.arange(5), 2 * len(there))
    table(tmp_path / "m.csv", "run,c,e", run, np.mod(path, 360.0), error)
    columns = 'run = "run", "C.position" = "c", "C.error" = "e"'
    job = tmp_path / "job.toml"
    job.write_text(_JOB.format(columns=columns) + f'loss = "{loss}"\n')
    assert run_job(job, tmp_path / "out").passed
    # Sagitta of a sine of 4 m° over 30°: 0.14 m°; three deviations of five readings beside.
    assert left(tmp_path / "out") < 3e-4


def test_a_log_that_passes_the_end_of_its_turn_keeps_its_delay(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 120.0, 0.01)
    speed = 24.0 * (1.0 + 0.6 * np.sin(2.0 * np.pi * time / 7.0))
    speed = np.where(time < 60.0, speed, -speed)
    speed *= np.clip(np.abs(time - 60.0) / 0.5, 0.0, 1.0)
    encoder = np.cumsum(speed) * 0.01
    path = encoder + truth(encoder, np.where(time < 60.0, 1.0, -1.0))
    late = np.interp(time - 0.002, time, path) + 2e-4 * rng.standard_normal(len(time))
    shown = (np.mod(encoder, 360.0), np.mod(late, 360.0))
    table(tmp_path / "m.csv", "t,enc,act", time, *shown)
    columns = (
        'time = "t", "C.encoder" = "enc", "C.actual" = { column = "act", unit = "deg" }'
    )
    job = tmp_path / "job.toml"
    job.write_text(_JOB.format(columns=columns))
    result = run_job(job, tmp_path / "out")
    assert result.passed
    # 2 ms late at 38 °/s is 76 m°, which a seam in the encoder hides from the search.
    assert left(tmp_path / "out") < 4e-4


def test_a_datum_may_be_named_a_turn_further(tmp_path: Path) -> None:
    place = np.arange(-180.0, 181.0, 30.0)
    run = np.repeat(np.arange(3), len(place))
    shown = np.tile(place, 3)
    error = truth(shown, np.ones(len(shown)))
    table(tmp_path / "m.csv", "run,c,e", run, shown, error)
    columns = 'run = "run", "C.position" = "c", "C.error" = "e"'
    text = _JOB.format(columns=columns).replace("bilateral = true\n", "")
    text = text.replace("[0.0, 360.0]", "[-180.0, 180.0]").replace(
        "start = 0.0", "start = -180.0"
    )
    job = tmp_path / "job.toml"
    job.write_text(text.replace('remove = "none"', "datum = { at = 270.0 }"))
    assert run_job(job, tmp_path / "out").passed
    # 270° is −90°; one list unit.
    assert abs(offsets(tmp_path / "out", 4, A4=np.array([-90.0]))[0]) < 1.1e-4


def test_no_line_is_taken_off_a_turn(tmp_path: Path) -> None:
    place = np.arange(0.0, 361.0, 30.0)
    table(tmp_path / "m.csv", "c,e", place, truth(place, np.ones(len(place))))
    text = _JOB.format(columns='"C.position" = "c", "C.error" = "e"')
    text = text.replace("bilateral = true\n", "").replace('"none"', '"line"')
    (tmp_path / "job.toml").write_text(text)
    with pytest.raises(JobError, match=r"C goes round, and .* has no slope"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_a_direction_that_was_read_in_part_of_a_turn_follows_the_other(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(1)
    there = np.arange(0.0, 346.0, 15.0)
    parts = [(there, 1.0), (there[there <= 135.0][::-1], -1.0)] * 5
    path = np.concatenate([at for at, _ in parts])
    direction = np.concatenate([np.full(len(at), way) for at, way in parts])
    error = truth(path, direction) + 3e-3 * np.sin(np.deg2rad(3.0 * path))
    error += 1e-4 * rng.standard_normal(len(path))
    table(tmp_path / "m.csv", "way,c,e", direction, path, error)
    columns = '"C.direction" = "way", "C.position" = "c", "C.error" = "e"'
    job = tmp_path / "job.toml"
    job.write_text(_JOB.format(columns=columns))
    (fit,) = run_job(job, tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert "No reading in − direction lies at C = 180 to 330" in said
    # 6 m° everywhere, to what half a cell at the last reading makes of the third harmonic.
    apart = fit.table["neg"] - fit.table["pos"]
    assert apart == pytest.approx(6e-3, abs=1e-3)

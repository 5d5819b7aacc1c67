"""A log in motion, measured again beside a crosstalk list, which such a log does not judge."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.job import run_job

CYCLE = 0.004  # s
FULL = 2000.0  # mm/s²
NOISE = 5e-4  # mm

JOB = """
[axes.X]
number = 1
limits = [0.0, 400.0]
[axes.Z]
number = 3
{lists}
[measurements.log]
file = "{log}.csv"
remove = "none"
active = {active}
"""
FITS = """
[[fits]]
compensation = "cross"
axis = "Z"
master = "X"
measurement = "log"
start = 0.0
interval = 50.0
points = 9
group = "Z"
[[fits]]
compensation = "crosstalk"
axis = "Z"
master = "X"
measurement = "log"
acceleration = 2000.0
deceleration = -2000.0
group = "Z"
"""


def write_log(path: Path, sag: float, push: float, seed: int) -> None:
    """X moves to and fro; Z errs by times of a sag over X and of a push while X accelerates."""
    rng = np.random.default_rng(seed)
    pieces, place, still = [np.zeros(50)], 0.0, np.zeros(25)
    for _ in range(120):
        rows, cruise = rng.integers(18, 26), rng.integers(20, 60)
        way = rows * (rows + cruise) * FULL * CYCLE**2
        sign = 1.0 if place + way < 400.0 else -1.0
        place += sign * way
        ramp = sign * FULL * np.ones(rows)
        pieces += [ramp, np.zeros(cruise), -ramp, still]
    acceleration = np.concatenate(pieces)
    velocity = CYCLE * np.cumsum(acceleration)
    velocity[np.abs(velocity) < 1e-6] = 0.0
    x = CYCLE * np.cumsum(velocity)
    error = sag * 0.008 * np.sin(np.pi * x / 400.0)
    error += push * 0.010 * acceleration / FULL + NOISE * rng.standard_normal(len(x))
    columns = {
        "time": CYCLE * np.arange(len(x)),
        "X.position": x,
        "X.velocity": velocity,
        "X.acceleration": acceleration,
        "Z.error": error,
    }
    values = np.column_stack(list(columns.values()))
    np.savetxt(path, values, "%.7f", ",", header=",".join(columns), comments="")


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job of cross and crosstalk of one log, whose lists lie in ``out``."""
    folder = tmp_path_factory.mktemp("first")
    write_log(folder / "first.csv", 1.0, 1.0, seed=1)
    text = JOB.format(lists="", log="first", active="[]") + FITS
    (folder / "job.toml").write_text(text)
    run_job(folder / "job.toml", folder / "out")
    lists = 'list = "out/achskw3.lis"'
    active = '["cross", "crosstalk"]'
    (folder / "after.toml").write_text(
        JOB.format(lists=lists, log="again", active=active)
    )
    return folder


@pytest.mark.parametrize(
    ("sag", "push", "verdict", "wrong"),
    [(0.0, 2.0, "right", ("crosstalk",)), (2.0, 0.0, "sign", ())],
)
def test_a_list_is_judged_where_no_crosstalk_acts_and_a_wrong_crosstalk_is_named(
    first: Path, sag: float, push: float, verdict: str, wrong: tuple[str, ...]
) -> None:
    write_log(first / "again.csv", sag, push, seed=2)
    found = run_job(first / "job.toml", first / "out", after=first / "after.toml")
    again = found.fits[0].again
    assert again is not None
    assert again.diagnosis is not None
    assert again.diagnosis.verdict == verdict
    assert again.beside == wrong

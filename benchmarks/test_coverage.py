"""Standard deviations of written lists: how often the truth lies within two of them.

Laser tables of many truths and seeds go through `run_job`; the written entries are judged at
every node, with the deviations that `result.json` states. The same tables go through
`axcomp.fit`. Nodes of one run err together, so that a run by itself shows little: shares are
over all runs of a case.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import axcomp
from axcomp.ident.job import TableResult, run_job

SEEDS = 16
NODES = np.linspace(0.0, 400.0, 21)
NOISE = 0.001  # mm
TRUTHS = ("smooth", "rough", "pitch", "kinked", "zero", "linear")

JOB = """
[axes.X]
number = 1
[measurements.laser]
file = "laser.csv"
active = []
{zero}
[measurements.laser.columns]
run = "run"
"X.position" = {{ column = "target", unit = "mm" }}
"X.direction" = "direction"
"X.error" = {{ column = "error", unit = "mm" }}
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = {bilateral}
start = 0.0
interval = 20.0
points = 21
"""


class Case(NamedTuple):
    """A way to measure: runs, directions, what runs have of their own (mm), whose zero.

    Heat is the rms of a curve of its own that each run errs by in the course of time.
    """

    runs: int
    bilateral: bool = False
    offset: float = 0.0
    drift: float = 0.0
    datum: bool = False
    heat: float = 0.0


CASES = {
    "2 runs": Case(2),
    "3 runs": Case(3),
    "5 runs, both directions": Case(5, bilateral=True),
    "5 runs with offsets": Case(5, offset=0.002),
    "5 runs with drifts, both directions": Case(5, bilateral=True, drift=0.003),
    "5 runs with offsets and a datum": Case(5, offset=0.002, datum=True),
    "3 runs with heat": Case(3, offset=0.002, heat=0.001),
    "5 runs with heat, both directions": Case(5, bilateral=True, heat=0.002),
}


def truth_of(name: str, rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Return an error in µm over positions in mm."""
    a, b, phase = (*rng.normal(size=2), rng.uniform(0.0, 2 * np.pi))
    walk = np.cumsum(rng.normal(size=97))
    places = np.linspace(-40.0, 440.0, 97)
    middle = rng.uniform(120.0, 280.0)
    laws: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "smooth": lambda x: 6 * a * np.sin(x / 127 + phase) + 3 * b * np.cos(x / 64),
        "rough": lambda x: np.interp(x, places, walk - walk.mean()),
        "pitch": lambda x: a * x / 80 + 2 * np.sin(2 * np.pi * x / 63.5 + phase),
        "kinked": lambda x: (
            (a * np.minimum(x - middle, 0) + b * np.maximum(x - middle, 0)) / 40
        ),
        "zero": lambda x: 0.05 * a * np.sin(x / 80 + phase),
        "linear": lambda x: 8 * (a + b * x / 400),
    }
    return laws[name]


class Measured(NamedTuple):
    """Rows of run, place, direction and error, and the error at the nodes by direction."""

    rows: np.ndarray
    truth: dict[int, np.ndarray]


def measured(case: Case, name: str, seed: int) -> Measured:
    """Return what a laser reads of an error."""
    rng = np.random.default_rng([seed, TRUTHS.index(name)])
    law, gap = truth_of(name, rng), 0.003 * rng.normal()
    ways = (1, -1) if case.bilateral else (1,)
    truth = {way: 1e-3 * law(NODES) + gap * (way < 0) for way in ways}
    rows = []
    for run in range(case.runs):
        offset, drift = rng.normal(0.0, [case.offset, case.drift])
        error = np.concatenate([truth[way][::way] for way in ways])
        late = np.linspace(-0.5, 0.5, len(error))
        error = error + offset + drift * late + rng.normal(0.0, NOISE, len(error))
        waves = np.arange(1, 5)  # over the run
        angles = 2 * np.pi * waves * late[:, None] + rng.uniform(0, 2 * np.pi, 4)
        error += case.heat * np.cos(angles) @ (rng.normal(size=4) / np.sqrt(2.0))
        place = np.concatenate([NODES[::way] for way in ways])
        way = np.repeat(ways, len(NODES))
        rows.append(np.column_stack([np.full(len(error), run), place, way, error]))
    return Measured(np.concatenate(rows), truth)


def of_a_job(folder: Path, case: Case, name: str, seed: int) -> np.ndarray:
    """Return (entry − truth) / deviation at the nodes of one list; entries are errors."""
    rows, truth = measured(case, name, seed)
    np.savetxt(
        folder / "laser.csv", rows, "%.7f", ",", comments="",
        header="run,target,direction,error",
    )  # fmt: skip
    zero = "datum = { at = 0.0 }" if case.datum else 'remove = "none"'
    bilateral = str(case.bilateral).lower()
    (folder / "job.toml").write_text(JOB.format(zero=zero, bilateral=bilateral))
    found = run_job(folder / "job.toml", folder / "out", sync=False).fits[0]
    assert isinstance(found, TableResult)
    taken = np.mean([own[0] for own in truth.values()]) if case.datum else 0.0
    ratios = [
        (found.table[branch] - own + taken) / found.standard_deviation[branch]
        for own, branch in zip(truth.values(), ("pos", "neg"), strict=False)
    ]
    return np.concatenate(ratios)


def of_the_library(folder: Path, case: Case, name: str, seed: int) -> np.ndarray:
    """Return (value − truth) / deviation at the nodes of a leadscrew by `axcomp.fit`."""
    del folder
    rows, truth = measured(case, name, seed)
    roles = ("run", "X.position", "X.direction", "X.error")
    screw = axcomp.Leadscrew(
        "X", start=0.0, interval=20.0, points=21, bilateral=case.bilateral
    )
    found = axcomp.fit([screw], dict(zip(roles, rows.T, strict=True)))["leadscrew"]
    model, spread = found.model, found.standard_deviation
    ratios = [
        (np.asarray(getattr(model, way)) - own) / np.asarray(getattr(spread, way))
        for own, way in zip(truth.values(), ("pos", "neg"), strict=False)
    ]
    return np.concatenate(ratios)


WAYS = {"job": of_a_job, "library": of_the_library}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", CASES)
def test_truth_lies_within_two_deviations(
    benchmark: BenchmarkFixture, name: str, way: str, tmp_path: Path
) -> None:
    case = CASES[name]
    if way == "library" and (case.drift or case.datum):
        pytest.skip("a drift and a datum are stated otherwise")

    def every() -> list[np.ndarray]:
        return [
            WAYS[way](tmp_path, case, truth, seed)
            for truth in TRUTHS
            for seed in range(SEEDS)
        ]

    ratios = benchmark.pedantic(every, rounds=1)
    inside = [np.abs(each) <= 2.0 for each in ratios]
    covered = float(np.concatenate(inside).mean())
    by_truth = np.reshape([each.mean() for each in inside], (len(TRUTHS), SEEDS))
    benchmark.extra_info |= {
        "inside_two_deviations": covered,
        "rms_ratio": float(np.sqrt(np.mean(np.square(ratios)))),
        "whole_lists_inside": float(np.mean([each.all() for each in inside])),
        "by_truth": dict(zip(TRUTHS, by_truth.mean(axis=1).tolist(), strict=True)),
    }
    assert 0.92 <= covered <= 0.985

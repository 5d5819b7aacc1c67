"""A reference that wanders between the knots of its drift, and one that does not."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from axcomp.ident.core import FitError
from axcomp.ident.fit.joint import (
    Cross,
    JointData,
    JointFit,
    Leadscrew,
    Temperature,
    fit_joint,
    held_out_errors,
)

from .gauge import in_gauge

WALK = 2e-3
"""How far the reference wanders within the recording, in mm."""
NOISE = 5e-4
ROWS, TIME = 12_000, 1800.0
X, Y = np.linspace(0.0, 1000.0, 21), np.linspace(0.0, 500.0, 11)


def walked(seed: int, walk: float) -> tuple[JointData, np.ndarray]:
    """Return rows along X, then along Y, as a machine works, and what the reference does."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, TIME, ROWS)
    # Slow strokes: a node is seen for seconds at a time, not all over the recording.
    x = 500.0 + 500.0 * np.sin(2.0 * np.pi * time / 97.0)
    y = 250.0 + 250.0 * np.sin(2.0 * np.pi * time / 611.0 + 1.0)
    wander = np.cumsum(rng.normal(0.0, walk / np.sqrt(ROWS), ROWS))
    error = truth(X, x, 160.0) + truth(Y, y, 80.0) + wander
    data = JointData(
        position={"X": x, "Y": y},
        error={"X": error + rng.normal(0.0, NOISE, ROWS)},
        time=time,
    )
    return data, wander


def truth(nodes: np.ndarray, place: np.ndarray, wave: float) -> np.ndarray:
    """Return an error in mm that is linear between nodes."""
    return np.asarray(np.interp(place, nodes, 0.004 * np.sin(nodes / wave)))


def fitted(data: JointData, **options: Any) -> JointFit:
    stack = [Leadscrew("X", X), Cross("X", master="Y", setpoints=Y)]
    return fit_joint(data, stack, **{"loss": "gauss", "drift": 6} | options)


def reference(fit: JointFit, data: JointData) -> np.ndarray:
    """Return what was taken off the run, in mm."""
    return fit.predict(data, runs=True)["X"] - fit.predict(data)["X"]


def ratios(fit: JointFit) -> np.ndarray:
    """Return (value − truth) / deviation of both tables."""
    own = [truth(X, X, 160.0), truth(Y, Y, 80.0)]
    aligned, _ = in_gauge(fit, own)
    return np.concatenate(
        [
            (part.values - values) / part.standard_deviation
            for part, values in zip(fit.parts, aligned, strict=True)
        ]
    )


@pytest.mark.parametrize("walk", [0.0, WALK], ids=["white", "wandering"])
def test_tables_are_as_far_from_the_truth_as_they_say(walk: float) -> None:
    away = np.stack([ratios(fitted(walked(seed, walk)[0])) for seed in range(8)])
    # 8 × 32 values, neighbours of them alike: their rms scatters by a tenth or so.
    assert 0.7 < np.sqrt(np.mean(np.square(away))) < 1.3
    assert np.mean(np.abs(away) < 1.0) > 0.55
    assert np.mean(np.abs(away) < 3.0) > 0.98


def test_a_walk_is_taken_off_where_pieces_alone_leave_it() -> None:
    data, wander = walked(1, WALK)
    fit = fitted(data)
    assert data.time is not None
    left = reference(fit, data) - wander
    # White noise of 0.5 µm against 0.047 µm per root of a second: a filter that knows both
    # leaves some 0.1 µm; six straight pieces leave 0.3 µm.
    assert np.std(left) < 1.5e-4
    knots = np.linspace(0.0, TIME, 7)
    straight = np.interp(data.time, knots, np.interp(knots, data.time, wander))
    assert np.std(straight - wander) > 2.5e-4
    # What is left is the noise, and the fit says so.
    assert fit.noise["X"] == pytest.approx(NOISE, rel=0.02)
    assert fit.predict(data, runs=True)["X"] + fit.residual["X"] == pytest.approx(
        data.error["X"], abs=1e-12
    )


def test_where_nothing_wanders_the_walk_costs_next_to_nothing() -> None:
    data, _ = walked(2, 0.0)
    free, tied = fitted(data), fitted(data, drift=0)
    for one, other in zip(free.parts, tied.parts, strict=True):
        # Seven knots of a drift and a walk that is not there.
        ratio = one.standard_deviation / other.standard_deviation
        assert np.median(ratio) < 1.15
    # The deviation of a knot is some 0.05 µm.
    assert np.std(reference(free, data)) < 7e-5


def test_no_gauge_and_no_confusion_comes_of_a_walk() -> None:
    data, _ = walked(3, WALK)
    fit = fitted(data)
    assert not fit.confusions
    assert not any("wander" in name for gauge in fit.gauges for name in gauge.effects)


def test_two_runs_wander_each_by_itself() -> None:
    data, wander = walked(4, WALK)
    half = np.arange(ROWS) >= ROWS // 2
    # The second run began two hours later, somewhere else, and takes as long.
    error = data.error["X"] + np.where(half, 0.003, 0.0)
    data = dataclasses.replace(data, error={"X": error}, run=half.astype(np.int64))
    fit = fitted(data, drift=3)
    predicted = fit.predict(data, runs=True)["X"]
    clean = truth(X, data.position["X"], 160.0) + truth(Y, data.position["Y"], 80.0)
    left = predicted - clean - wander - np.where(half, 0.003, 0.0)
    assert np.std(left) < 1.5e-4
    one, other = fit.runs["X"]
    assert other.offset - one.offset == pytest.approx(
        0.003 + float(wander[half].mean() - wander[~half].mean()), abs=5e-4
    )


def test_a_fold_keeps_the_walk_of_the_whole() -> None:
    data, _ = walked(5, WALK)
    fit = fitted(data)
    assert data.time is not None
    groups = np.floor(data.time / 10.0).astype(np.int64) % 5
    left = held_out_errors(fit, groups, runs=True)["X"]
    # For ten seconds that nobody saw the reference walks on: 0.047 µm per root of a second.
    assert np.std(left) == pytest.approx(NOISE, rel=0.05)


def test_few_readings_have_no_walk() -> None:
    data, _ = walked(6, WALK)
    few = data.take(np.arange(0, ROWS, 60))
    curve = reference(fitted(few, drift=3), few)
    # 200 readings tell four knots of the drift, and no more: it is straight between them, and
    # each inner knot bends two of the differences.
    bent = np.abs(np.diff(curve, 2)) > 1e-12
    assert 0 < bent.sum() <= 4


@pytest.mark.parametrize("pieces", [0, 4])
def test_a_short_log_that_drifts_says_how_little_it_tells(pieces: int) -> None:
    distances = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        time = np.arange(300) * 60.0
        warm = 20.0 + 18.0 * np.sin(np.pi * time / time[-1])
        # 3 µm that forget in 20 minutes, beside 0.5 µm of a reading.
        drift, kept = np.zeros(300), np.exp(-60.0 / 1200.0)
        for row in range(1, 300):
            drift[row] = kept * drift[row - 1] + np.sqrt(1 - kept**2) * rng.normal()
        error = 2e-3 * (warm - 20.0) + 3e-3 * drift + 5e-4 * rng.normal(size=300)
        data = JointData(error={"X": error}, temperature={"T": warm}, time=time)
        law = {"offset": np.array([20.0, 38.0])}
        heat = Temperature(
            "X", {"offset": "T"}, 0.0, law=law, reference_temperature=20.0
        )
        fit = fit_joint(data, [heat], drift=pieces)
        part = fit.parts[0]
        distances.append((part.values[1] - 0.036) / part.standard_deviation[1])
    # 16 draws of a unit deviation: their rms is 0.6 to 1.5 in 99 %; white noise said 4. For how
    # long the drift remembers is hardly known: deviations may be half as large again.
    assert 0.4 < np.sqrt(np.mean(np.square(distances))) < 1.5


def test_a_short_log_with_a_missed_instant_is_fitted_as_one_without_a_clock() -> None:
    rng = np.random.default_rng(0)
    time, place = np.arange(200.0), np.tile(np.linspace(0.0, 100.0, 20), 10)
    time[7] = np.nan
    error = 0.01 * np.sin(place / 30.0) + 5e-4 * rng.normal(size=200)
    screw = Leadscrew("X", start=0.0, interval=20.0, points=6)
    one, other = (
        fit_joint(JointData({"X": place}, {"X": error}, time=clock), [screw]).parts[0]
        for clock in (time, None)
    )
    np.testing.assert_array_equal(one.standard_deviation, other.standard_deviation)


def test_a_drift_needs_a_clock_that_runs() -> None:
    place = np.tile(np.linspace(0.0, 100.0, 20), 3)
    data = JointData({"X": place}, {"X": 1e-4 * place}, time=np.full(60, 5.0))
    screw = Leadscrew("X", start=0.0, interval=20.0, points=6)
    with pytest.raises(FitError, match="expected a clock that runs"):
        fit_joint(data, [screw], drift=2)

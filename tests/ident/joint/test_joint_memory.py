"""Deviations where the noise has a memory that no stated drift describes."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from axcomp.ident.fit.joint import (
    JointData,
    Leadscrew,
    Part,
    Temperature,
    fit_joint,
)

WALK = 1e-3
"""How far the reference wanders within the recording, in mm."""


def grown(mixed: Any, seed: int, walk: float) -> Part:
    """Return the growth of a screw, fitted to a reference that wanders."""
    case = mixed(seed, outliers=0.0)
    rng = np.random.default_rng(seed + 900)
    count = len(case.data)
    wander = np.cumsum(rng.normal(0.0, walk / np.sqrt(count), count))
    error = case.parts["temperature"] + wander + rng.normal(0.0, 5e-4, count)
    data = dataclasses.replace(case.data, error={"X": error})
    stack = [
        Leadscrew("X", np.linspace(0.0, 1000.0, 11)),
        Temperature("X", {"offset": "T", "coefficient": "T"}, 200.0, lag=120.0),
    ]
    return fit_joint(data, stack, loss="gauss").parts[1]


def away(part: Part) -> float:
    """Return how far the offset at its last node is off, in its deviations."""
    effect = part.effect
    assert isinstance(effect, Temperature)
    # The mix grows by 1 µm per K at the reference.
    true = 1e-3 * (effect.nodes["offset"][-1] - 20.0)
    place = len(effect.nodes["offset"]) - 1
    return float((part.values[place] - true) / part.standard_deviation[place])


def test_a_reference_that_wanders_makes_the_temperature_less_certain(
    mixed: Any,
) -> None:
    found = [away(grown(mixed, seed, WALK)) for seed in range(8)]
    # Eight of them: their rms scatters by a quarter, and 24 stretches know the memory of a
    # walk, which has no end, to within a half.
    assert np.sqrt(np.mean(np.square(found))) < 2.0


def test_white_noise_leaves_the_deviations_alone(mixed: Any) -> None:
    found = [away(grown(mixed, seed, 0.0)) for seed in range(8)]
    # Eight of them: their rms scatters by a quarter.
    assert 0.4 < np.sqrt(np.mean(np.square(found))) < 1.75


def test_the_deviation_grows_with_what_the_reference_does(mixed: Any) -> None:
    place = 0
    still, wandering = (
        grown(mixed, 3, walk).standard_deviation[place] for walk in (0.0, WALK)
    )
    # White noise of 0.5 µm over 4000 readings beside a walk of 1 µm through all of them.
    assert wandering > 3.0 * still


def warmed_up(order: np.ndarray) -> np.ndarray:
    """Return the deviations of a thermal line, its readings given in some order."""
    rng = np.random.default_rng(4)
    count = len(order)
    time = 60.0 * np.arange(count)
    warm = 20.0 + 15.0 * (1.0 - np.exp(-time / 3000.0))
    place = rng.choice([0.0, 200.0, 400.0], count)
    wander = 4e-4 * np.cumsum(rng.normal(size=count))
    error = (warm - 20.0) * (1e-3 + 1e-5 * place) + wander
    error += 1e-3 * rng.normal(size=count)
    data = JointData(
        position={"X": place[order]},
        error={"X": error[order]},
        temperature={"T": warm[order]},
        time=time[order],
    )
    line = Temperature("X", sensor="T", reference=0.0)
    return fit_joint(data, [line]).parts[0].standard_deviation


def test_deviations_do_not_hang_on_the_order_of_the_readings() -> None:
    order = np.arange(240)
    shuffled = np.random.default_rng(99).permutation(order)
    # Sums in another order differ by rounding. What a rule holds at zero has no variance but
    # that, which once made 0.7 % of the others' deviation.
    np.testing.assert_allclose(warmed_up(shuffled), warmed_up(order), 1e-9, 1e-10)


def backlash_in(runs: int) -> tuple[JointData, np.ndarray]:
    """Return readings out and back with a backlash of 4 µm, and the true mean table."""
    rng = np.random.default_rng(3)
    nodes = np.arange(0.0, 801.0, 10.0)
    out = 5e-3 * np.sin(nodes / 120.0)
    place = np.tile(np.concatenate([nodes, nodes[::-1]]), runs)
    error = np.tile(np.concatenate([out, out[::-1] - 4e-3]), runs)
    error += rng.normal(scale=3e-4, size=len(error))
    run = np.repeat(np.arange(runs), 2 * len(nodes))
    return JointData({"X": place}, {"X": error}, run=run), out - 2e-3


@pytest.mark.parametrize("runs", [2, 5])
def test_one_table_for_both_directions_takes_the_backlash_for_no_drift(
    runs: int,
) -> None:
    data, true = backlash_in(runs)
    table = Leadscrew("X", np.arange(0.0, 801.0, 10.0))
    fit = fit_joint(data, [table])
    (part,), (datum, doubt) = fit.parts, fit.datum["X"]
    # 2 µm about the mean, alternately: each of the 81 nodes has 4 or 10 readings, and the
    # smooth table shares them. As a drift that outlasts the log it made 12 to 18 µm.
    assert float(np.hypot(part.standard_deviation, doubt).max()) < 1e-3
    # Three of the deviations that a node of independent readings would have.
    assert np.abs(part.table + datum - true).max() < 3e-4

"""Readings in whole steps of a coarse instrument: repeats are rounded alike."""

import numpy as np
import pytest

import axcomp
from axcomp.ident.fit import Samples, TableEffect, TableFit, fit_table

NODES = np.linspace(0.0, 400.0, 21)
STEP, RUNS, SEEDS = 1e-3, 5, 12


def rough(seed: int) -> np.ndarray:
    """Return a screw's error in mm at the nodes, without any place that is special."""
    rng = np.random.default_rng(seed)
    walk = np.interp(NODES, np.linspace(0.0, 400.0, 81), rng.normal(size=81).cumsum())
    return 1e-3 * walk


def read(seed: int, scatter: float, step: float) -> np.ndarray:
    """Return readings of all runs in mm, one run after the other."""
    noise = np.random.default_rng([seed, 1]).normal(0.0, scatter, (RUNS, len(NODES)))
    return np.asarray(step * np.rint((rough(seed) + noise) / step)).ravel()


def fit(error: np.ndarray, loss: str = "student") -> TableFit:
    samples = Samples(np.tile(NODES, RUNS)[:, None], error)
    return fit_table(TableEffect((NODES,)), samples, loss=loss)


def inside(scatter: float) -> float:
    fits = [fit(read(seed, scatter, STEP)) for seed in range(SEEDS)]
    ratios = [(f.values - rough(k)) / f.standard_deviation for k, f in enumerate(fits)]
    return float(np.mean(np.abs(ratios) <= 2.0))


@pytest.mark.parametrize("scatter", [1e-4, 2e-4, 4e-4])
def test_truth_lies_within_two_deviations_of_rounded_readings(scatter: float) -> None:
    # Evenly distributed errors of rounding lie within two of their deviations always.
    assert inside(scatter) >= 0.92


def test_an_axis_fitted_with_others_knows_of_rounded_readings() -> None:
    screw = axcomp.Leadscrew("X", start=0.0, interval=20.0, points=21, bilateral=False)
    place, ratios = np.tile(NODES, RUNS), []
    for seed in range(4):
        roles = {"X.position": place, "X.error": read(seed, 1e-4, STEP)}
        found = axcomp.fit([screw], roles)["leadscrew"]
        error = np.asarray(found.model.pos) - rough(seed)
        ratios.append(error / np.asarray(found.standard_deviation.pos))
    assert np.mean(np.abs(ratios) <= 2.0) >= 0.92


def test_what_is_taken_off_at_each_place_hides_no_steps() -> None:
    error = read(0, 2e-4, STEP)
    line = 3.3e-6 * np.tile(NODES, RUNS) + 1.7e-4
    np.testing.assert_allclose(
        fit(error - line).standard_deviation.mean(),
        fit(error).standard_deviation.mean(),
        rtol=0.1,  # the smoothness of another table
    )


def test_readings_off_by_a_step_are_believed() -> None:
    # Of five repeats most read the same: the others tell as much of the mean as they.
    readings = [read(seed, 2e-4, STEP) for seed in range(SEEDS)]
    errors = [
        [fit(each, loss).values - rough(k) for k, each in enumerate(readings)]
        for loss in ("student", "gauss")
    ]
    robust, plain = np.sqrt(np.mean(np.square(errors), axis=(1, 2)))
    assert robust < 1.05 * plain  # 1.24 where the most frequent reading counts alone


def test_steps_finer_than_the_scatter_add_nothing() -> None:
    fine, exact = fit(read(1, 1e-3, 1e-3)), fit(read(1, 1e-3, 1e-7))
    # 1/12 of the variance is rounding, by each reading on its own.
    np.testing.assert_allclose(
        fine.standard_deviation.mean(), exact.standard_deviation.mean(), rtol=0.15
    )

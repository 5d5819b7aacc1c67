"""Robust regression: what readings determine, and polylines as columns."""

import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.ident.core import FitError, find_drift, node_shares, regress
from axcomp.models import TemperatureCurve

NOISE = 1e-3


def test_shares_of_nodes_are_those_of_the_curve_of_the_models() -> None:
    rng = np.random.default_rng(0)
    nodes = np.array([18.0, 21.5, 22.0, 40.0])
    values = rng.normal(size=4)
    # Both ends are held; a place that is not known stays so.
    places = np.concatenate([[10.0, 18.0, 22.0, 50.0], rng.uniform(18.0, 40.0, 50)])
    curve = TemperatureCurve.of(nodes, values)
    # The same two products per place.
    np.testing.assert_allclose(
        node_shares(places, nodes) @ values,
        curve(jnp.asarray(places[:, None])),
        atol=1e-14,
    )
    assert np.isnan(node_shares(np.array([np.nan, 20.0]), nodes)[0]).all()


def test_what_only_wild_readings_show_is_undetermined_and_the_rest_is_not() -> None:
    rng = np.random.default_rng(1)
    columns = np.column_stack([np.ones(60), rng.normal(size=60), np.arange(60) >= 56])
    target = columns @ [1.0, 2.0, 0.0] + NOISE * rng.normal(size=60)
    target[56:] += [1.0, -1.0, 0.5, -0.3]
    found = regress(columns, target)
    np.testing.assert_array_equal(found.undetermined, [False, False, True])
    assert np.isinf(found.standard_deviation[2])
    # 56 readings: a deviation of 0.13 of the noise each; four of them.
    np.testing.assert_allclose(found.coefficients[:2], [1.0, 2.0], atol=0.6 * NOISE)
    assert (found.standard_deviation[:2] < 0.3 * NOISE).all()


def test_columns_that_say_the_same_are_refused() -> None:
    columns = np.column_stack([np.ones(9), np.arange(9.0), 2.0 + np.arange(9.0)])
    with pytest.raises(FitError, match="cannot tell the columns apart"):
        regress(columns, np.zeros(9))


def test_residuals_without_any_scatter_have_no_drift() -> None:
    time, columns = np.arange(50.0), np.ones((50, 1))
    for value in 1.0 / np.arange(1.0, 31.0):
        residual = np.full(50, value)
        # What rounding leaves is the root of a difference of squares.
        drift = find_drift(time, columns, residual).drift
        assert drift < 1e-6 * value


def test_few_readings_state_deviations_that_are_honest() -> None:
    # The scatter known beforehand, that within an event, is a tenth of that between events.
    rng, distances = np.random.default_rng(5), []
    for _ in range(150):
        places = node_shares(rng.uniform(0.0, 1.0, 10), np.linspace(0.0, 1.0, 3))
        found = regress(places, rng.normal(size=10), loss="gauss", noise=0.1)
        distances += list(found.coefficients / found.standard_deviation)
    # 95 % of Student's t, to 1 % of 450 values that are three and three alike.
    assert np.mean(np.abs(distances) < 2.0) > 0.93


@pytest.mark.parametrize(
    "kept",
    [pytest.param(np.exp(-1.0 / k), marks=pytest.mark.heavy) for k in (5.0, 50.0)]
    + [1.0],
)
def test_deviations_know_that_the_memory_of_a_drift_is_hardly_known(
    kept: float,
) -> None:
    # A warm-up of 120 readings beside a drift that forgets in 5 or in 50 of them, or never.
    time = np.arange(120.0)
    columns = np.column_stack([np.ones(120), 1.0 - np.exp(-time / 33.0)])
    step = 0.3 if kept == 1.0 else np.sqrt(1.0 - kept**2)
    distances = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        noise, drift = 0.5 * rng.normal(size=120), rng.normal(size=120) * step
        for row in range(1, 120):
            drift[row] += kept * drift[row - 1]
        target = columns @ [1.0, 5.0] + noise + drift
        found = regress(columns, target, time=time, loss="gauss")
        away = found.coefficients[1] - 5.0
        distances.append(away / found.standard_deviation[1])
    # 95 % less what 100 draws leave open, 4 %, and the drift that fits the warm-up as well;
    # with the likeliest drift alone 91, 80 and 71 %.
    assert np.mean(np.abs(distances) <= 2.0) >= 0.84

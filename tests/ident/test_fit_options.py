"""Losses, smoothness given by hand, determinism, and what a fit says of itself."""

import dataclasses
import pickle

import numpy as np
import pytest

from axcomp.ident.exchange import LIST_UNITS
from axcomp.ident.fit import (
    FitError,
    Samples,
    TableEffect,
    fit_table,
    predict,
    spatial_blocks,
)
from axcomp.ident.job.table._draft import written_deviation

NOISE = 0.002  # mm
NODES = np.linspace(0.0, 300.0, 31)
LINE = TableEffect((NODES,))
PLANE = TableEffect((np.arange(9.0) * 10, np.arange(7.0) * 10))


def readings(layout: TableEffect, count: int, seed: int = 0) -> Samples:
    rng = np.random.default_rng(seed)
    positions = rng.uniform(
        0.0, [nodes[-1] for nodes in layout.nodes], (count, len(layout.nodes))
    )
    error = 0.02 * np.sin(positions.sum(axis=1) / 40) + rng.normal(0, NOISE, count)
    return Samples(positions, error)


def test_losses_agree_where_nothing_is_wild() -> None:
    samples = readings(LINE, 3000)
    plain = fit_table(LINE, samples, loss="gauss")
    for loss in ("huber", "student"):
        fit = fit_table(LINE, samples, loss=loss)
        # Where the efficiency is 95 %, estimates differ by √(1/0.95 − 1) = 0.23 standard
        # deviations; four times that for the furthest of 60 nodes.
        distance = np.abs(fit.values - plain.values) / plain.standard_deviation
        assert distance.max() < 0.92
        assert fit.noise == pytest.approx(plain.noise, rel=0.02)
        assert not fit.wild.any()
        assert fit.suspect_nodes == ()
    assert not plain.wild.any()


def test_huber_bounds_what_a_wild_point_can_do() -> None:
    samples = readings(LINE, 1000)
    values = {}
    for size in (0.0, 0.1, 1000.0):
        error = samples.error.copy()
        error[5] += size
        spoilt = dataclasses.replace(samples, error=error)
        values[size] = fit_table(LINE, spoilt, smoothness=1.0, loss="huber").values
    # Pull at most 1.345 scales over about 33 readings per node.
    assert np.abs(values[0.1] - values[0.0]).max() < 3 * NOISE / 33 * 1.345
    # Its median of magnitudes does not feel how far: only the tolerance of the iterations.
    np.testing.assert_allclose(values[1000.0], values[0.1], atol=1e-5)


def test_noise_and_deviation_are_those_of_the_readings() -> None:
    inside, noise = [], []
    truth = 0.02 * np.sin(NODES / 40)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        position = rng.uniform(0.0, 300.0, 600)
        error = np.interp(position, NODES, truth) + rng.normal(0.0, NOISE, 600)
        fit = fit_table(LINE, Samples(position[:, None], error), smoothness=0.0)
        inside.append(np.abs(fit.values - truth) <= 2 * fit.standard_deviation)
        noise.append(fit.noise)
    # 248 nodes, 95 % of them with a margin of three binomial deviations.
    assert 0.91 <= np.mean(inside) <= 0.99
    # 4800 readings tell their scatter to 1 %.
    assert np.mean(noise) == pytest.approx(NOISE, rel=0.03)


def test_smoothness_zero_is_the_plain_mean_at_the_nodes() -> None:
    rng = np.random.default_rng(3)
    error = rng.normal(size=(5, 31))
    samples = Samples(np.tile(NODES, 5)[:, None], error.ravel())
    fit = fit_table(LINE, samples, smoothness=0.0, loss="gauss")
    # What fills gaps weighs 1e-9 of the readings.
    np.testing.assert_allclose(fit.values, error.mean(axis=0), atol=1e-7)
    assert (fit.support == 5).all()


def test_single_reading_per_node_has_its_noise_judged_by_its_neighbours() -> None:
    rng = np.random.default_rng(4)
    nodes = np.arange(200.0)
    truth = 0.02 * np.sin(nodes / 15)
    error = truth + rng.normal(0.0, NOISE, 200)
    samples = Samples(nodes[:, None], error)
    fit = fit_table(TableEffect((nodes,)), samples, smoothness=0.0, loss="gauss")
    np.testing.assert_allclose(fit.values, error, atol=1e-8)
    # 200 readings tell their scatter to 5 %.
    assert fit.noise == pytest.approx(NOISE, rel=0.2)
    assert "follows every reading" in fit.message


@pytest.mark.parametrize(
    ("layout", "loss"), [(LINE, "student"), (PLANE, "gauss")], ids=["line", "plane"]
)
def test_same_readings_give_the_same_fit_in_any_order(
    layout: TableEffect, loss: str
) -> None:
    samples = readings(layout, 1000)
    shuffle = np.random.default_rng(5).permutation(1000)
    mixed = Samples(samples.positions[shuffle], samples.error[shuffle])
    one, again, other = (
        fit_table(layout, each, loss=loss) for each in (samples, samples, mixed)
    )
    for name in ("values", "standard_deviation", "residual"):
        np.testing.assert_array_equal(getattr(again, name), getattr(one, name))
    assert again.smoothness == one.smoothness
    # Sums in another order: rounding, far below the tolerance of the search.
    np.testing.assert_allclose(other.values, one.values, atol=1e-7)
    np.testing.assert_allclose(other.residual, one.residual[shuffle], atol=1e-7)


def test_scale_and_offset_of_the_readings_carry_over() -> None:
    samples = readings(LINE, 1000)
    fit = fit_table(LINE, samples)
    larger = fit_table(LINE, Samples(samples.positions, 1000.0 * (samples.error + 5.0)))
    # Sums about the current table: only what rounding of 5 leaves of 1e-3.
    np.testing.assert_allclose(larger.values / 1000 - 5, fit.values, atol=1e-7)
    np.testing.assert_allclose(
        larger.standard_deviation / 1000, fit.standard_deviation, rtol=1e-3
    )


def test_residuals_and_support_belong_to_the_readings() -> None:
    samples = readings(LINE, 500)
    keep = (samples.positions[:, 0] < 100.0) | (samples.positions[:, 0] > 160.0)
    samples = samples.take(keep)
    fit = fit_table(LINE, samples)
    mean, _ = predict(fit, samples.positions)
    np.testing.assert_allclose(fit.residual, samples.error - mean, atol=1e-15)
    np.testing.assert_array_equal(np.flatnonzero(fit.support == 0), np.arange(11, 16))
    # What is bridged is known less than what is measured.
    measured = fit.support > 0
    assert fit.standard_deviation[~measured].min() > np.median(
        fit.standard_deviation[measured]
    )


def test_direction_means_nothing_to_a_table_that_has_one() -> None:
    samples = readings(LINE, 500)
    branch = np.random.default_rng(6).integers(0, 2, 500)
    both = fit_table(LINE, dataclasses.replace(samples, branch=branch))
    np.testing.assert_array_equal(both.values, fit_table(LINE, samples).values)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_shortest_tables_are_fitted(count: int) -> None:
    layout = TableEffect((np.linspace(0.0, 10.0, count),))
    rng = np.random.default_rng(7)
    position = rng.uniform(0.0, 10.0, 400)
    truth = 0.01 * np.arange(count) if count > 1 else np.array([0.3])
    error = np.interp(position, layout.nodes[0], truth) + rng.normal(0.0, NOISE, 400)
    fit = fit_table(layout, Samples(position[:, None], error))
    # A straight line costs no smoothness.
    assert (np.abs(fit.values - truth) < 4 * fit.standard_deviation).all()
    assert fit.noise == pytest.approx(NOISE, rel=0.15)


def test_result_travels_through_process_pools() -> None:
    fit = fit_table(LINE, readings(LINE, 200))
    again = pickle.loads(pickle.dumps(fit))
    np.testing.assert_array_equal(again.values, fit.values)
    with pytest.raises(FitError, match="no readings") as caught:
        fit_table(LINE, readings(LINE, 0))
    error = pickle.loads(pickle.dumps(caught.value))
    assert str(error) == str(caught.value)
    assert error.args == caught.value.args


def test_huber_leaves_wild_readings_out_of_the_noise() -> None:
    rng = np.random.default_rng(9)
    samples = readings(LINE, 3000)
    error = samples.error.copy()
    error[rng.choice(3000, 30, replace=False)] += rng.choice([-1.0, 1.0], 30)
    fit = fit_table(LINE, dataclasses.replace(samples, error=error), loss="huber")
    # 3000 readings tell their scatter to 1.3 %; the wild ones pull the table a little.
    assert fit.noise == pytest.approx(NOISE, rel=0.1)
    # So do figures: the thirty, and no sound one, which lie within four deviations.
    assert fit.wild.sum() == 30


def test_steps_of_a_coarse_instrument_are_not_wild() -> None:
    # A level of 12.3 µm read in whole µm: mostly 12, sometimes 13.
    level = 0.0123 + np.random.default_rng(0).normal(0.0, 2e-4, 155)
    samples = Samples(np.tile(NODES, 5)[:, None], np.round(level, 3))
    fit = fit_table(LINE, samples)
    assert not fit.wild.any()
    assert fit.noise == pytest.approx(np.std(samples.error), rel=0.1)


def test_a_single_cell_is_judged_on_readings_left_out() -> None:
    layout = TableEffect((NODES[[0, -1]],))
    groups = spatial_blocks(layout, readings(layout, 30), 5)
    assert np.bincount(groups).tolist() == [6] * 5


def test_a_table_with_two_directions_is_not_asked_without_any() -> None:
    rng = np.random.default_rng(10)
    layout = TableEffect((NODES,), branches=2)
    position, branch = rng.uniform(0.0, 300.0, (400, 1)), rng.integers(0, 2, 400)
    error = 0.01 * branch + rng.normal(0.0, NOISE, 400)
    fit = fit_table(layout, Samples(position, error, branch))
    with pytest.raises(FitError, match="says something else in each"):
        predict(fit, position)


def test_rounding_of_a_list_is_part_of_what_is_said_of_it() -> None:
    rng = np.random.default_rng(9)
    x = np.tile(NODES, 200)
    truth = 5e-5 * np.sin(NODES / 40.0)
    error = np.tile(truth, 200) + rng.normal(0.0, 5e-5, len(x))
    fit = fit_table(LINE, Samples(x[:, None], error))
    # A list has tenths of a micrometre; what is off by half of one is inside two of
    # √(unit²/12) = 0.058 µm, but far outside two of the 0.004 µm of the values.
    off = np.abs(np.round(fit.values * LIST_UNITS) / LIST_UNITS - truth)
    assert np.mean(off < 2 * written_deviation(fit)) > 0.95
    assert np.mean(off < 2 * fit.standard_deviation) < 0.5


def test_few_readings_beside_free_nodes_do_not_call_each_other_wild() -> None:
    nodes, inside = np.arange(21) * 10.0, []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = np.append(nodes, rng.uniform(0.0, 200.0, 3))
        error = 0.01 * np.sin(x / 40.0) + 0.001 * rng.normal(size=24)
        samples = Samples(x[:, None], error)
        found = fit_table(TableEffect((nodes,)), samples, smoothness=0.0)
        assert found.converged
        off = np.abs(found.values - 0.01 * np.sin(nodes / 40.0))
        inside.append(np.mean(off < 2.0 * found.standard_deviation))
    # 95 % are due; 20 tables, each of a noise known from 3 readings, tell it to 4 %.
    assert np.mean(inside) > 0.85

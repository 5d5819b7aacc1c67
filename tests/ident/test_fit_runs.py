"""Repeated runs: their offsets and drifts, bad runs, bad nodes, runs left out."""

import dataclasses
import io
from typing import Literal

import numpy as np
import pytest

from axcomp.ident.fit import (
    FitError,
    Samples,
    TableEffect,
    fit_table,
    leave_out,
    predict,
    spatial_blocks,
)

from .batch.conftest import readings

NOISE = 0.002  # mm
RUNS = 5
NODES = np.linspace(0.0, 400.0, 21)
TARGETS = np.linspace(0.0, 400.0, 41)
LAYOUT = TableEffect((NODES,), branches=2)
OFFSET = np.array([0.010, -0.004, 0.007, -0.009, 0.001])
DRIFT = np.array([0.006, 0.002, -0.005, 0.004, -0.002])
LOSSES = pytest.mark.parametrize("loss", ["gauss", "huber", "student"])


def truth(position: np.ndarray, branch: np.ndarray | int) -> np.ndarray:
    table = 0.01 * np.sin(NODES / 60) + 5e-5 * NODES
    gap = -0.012 + 1e-5 * NODES
    return np.asarray(
        np.interp(position, NODES, table) + branch * np.interp(position, NODES, gap)
    )


TRUTH = np.stack([truth(NODES, 0), truth(NODES, 1)])


def runs(
    seed: int = 1, offset: np.ndarray = OFFSET, drift: np.ndarray = DRIFT
) -> Samples:
    """Five runs out and back over all targets."""
    rng = np.random.default_rng(seed)
    count = 2 * len(TARGETS)
    position = np.tile(np.concatenate([TARGETS, TARGETS[::-1]]), RUNS)
    branch = np.tile(np.repeat([0, 1], len(TARGETS)), RUNS)
    run = np.repeat(np.arange(RUNS), count)
    order = np.tile(np.linspace(0.0, 1.0, count), RUNS)
    error = truth(position, branch) + offset[run] + drift[run] * (order - 0.5)
    error = error + rng.normal(0.0, NOISE, len(error))
    return Samples(position[:, None], error, branch, run, order)


def changed(samples: Samples, keep: np.ndarray, by: float | np.ndarray) -> Samples:
    error = samples.error.copy()
    error[keep] += by
    return dataclasses.replace(samples, error=error)


@LOSSES
def test_offsets_and_drifts_are_recovered_and_sum_to_zero(loss: str) -> None:
    fit = fit_table(LAYOUT, runs(), loss=loss, run_effects="drift")
    assert [effect.run for effect in fit.runs] == list(range(RUNS))
    for name, true in (("offset", OFFSET), ("drift", DRIFT)):
        found = np.array([getattr(effect, name) for effect in fit.runs])
        spread = np.array([getattr(effect, name + "_sd") for effect in fit.runs])
        # Effects are contrasts; rounding only.
        assert abs(found.sum()) < 1e-14
        # Ten numbers of one draw: 3.5 standard deviations hold 99.5 % of such draws.
        assert (np.abs(found - (true - true.mean())) < 3.5 * spread).all()
        # 82 readings tell a mean to noise/√82, a slope to √12 times that.
        expected = NOISE / np.sqrt(82) * (1.0 if name == "offset" else np.sqrt(12))
        np.testing.assert_allclose(spread, expected, rtol=0.25)


@LOSSES
def test_table_does_not_feel_the_offsets(loss: str) -> None:
    fit = fit_table(LAYOUT, runs(), loss=loss, run_effects="offset")
    without = runs(offset=0 * OFFSET + OFFSET.mean(), drift=DRIFT)
    plain = fit_table(LAYOUT, without, loss=loss, run_effects="offset")
    # Shifting a run by a constant shifts its effect alone; the start differs a little, and
    # the iterations end at a hundredth of a standard deviation of 0.5 µm.
    np.testing.assert_allclose(fit.values, plain.values, atol=2e-5)


def test_table_keeps_the_mean_of_the_runs() -> None:
    # Targets on all nodes, all runs complete: the table is the plain mean at the targets.
    layout = TableEffect((TARGETS,), branches=2)
    samples = runs()
    order = np.argsort(TARGETS)
    assert samples.branch is not None
    for effects in ("none", "offset"):
        fit = fit_table(
            layout, samples, smoothness=0.0, loss="gauss", run_effects=effects
        )
        for branch in (0, 1):
            own = samples.branch == branch
            mean = [
                samples.error[own & (samples.positions[:, 0] == x)] for x in TARGETS
            ]
            expected = np.mean(mean, axis=1)[order]
            # The prior that fills gaps weighs 1e-9: what it draws stays below 0.1 nm.
            np.testing.assert_allclose(fit.values[branch], expected, atol=1e-7)


def test_drift_that_all_runs_share_stays_in_the_table() -> None:
    samples = runs(offset=0 * OFFSET, drift=0 * DRIFT + 0.01)
    fit = fit_table(LAYOUT, samples, loss="gauss", run_effects="drift")
    assert max(abs(effect.drift) for effect in fit.runs) < 4 * fit.runs[0].drift_sd
    plain = fit_table(LAYOUT, samples, loss="gauss")
    # Ten effects of no size: a fraction of the standard deviation of 0.5 µm.
    np.testing.assert_allclose(fit.values, plain.values, atol=2e-4)


def test_ignored_offsets_are_told_as_noise_and_fitted_ones_are_not() -> None:
    ignored = fit_table(LAYOUT, runs(), loss="gauss")
    fitted = fit_table(LAYOUT, runs(), loss="gauss", run_effects="drift")
    # 410 readings tell their scatter to 3.5 %.
    assert fitted.noise == pytest.approx(NOISE, rel=0.1)
    assert ignored.noise > 3 * NOISE
    assert ignored.runs == ()


def test_one_run_has_no_effect_of_its_own() -> None:
    samples = runs()
    assert samples.run is not None
    fit = fit_table(LAYOUT, samples.take(samples.run == 2), run_effects="drift")
    assert fit.runs == ()


def test_good_runs_and_nodes_are_not_suspected() -> None:
    for seed in range(3):
        fit = fit_table(LAYOUT, runs(seed), run_effects="drift")
        assert fit.suspect_runs == ()
        assert fit.suspect_nodes == ()


def test_loud_run_is_named() -> None:
    samples = runs()
    assert samples.run is not None
    own = samples.run == 3
    extra = np.random.default_rng(4).normal(0.0, 6 * NOISE, own.sum())
    fit = fit_table(LAYOUT, changed(samples, own, extra), run_effects="offset")
    assert fit.suspect_runs == (3,)


def test_far_run_is_named() -> None:
    samples = runs()
    assert samples.run is not None
    fit = fit_table(
        LAYOUT, changed(samples, samples.run == 1, 0.5), run_effects="offset"
    )
    assert fit.suspect_runs == (1,)
    # Its shape is as good as that of the others and is kept.
    assert not fit.wild.any()


def test_bad_node_is_named_and_bridged() -> None:
    samples = runs(offset=0 * OFFSET, drift=0 * DRIFT)
    assert samples.branch is not None
    near = (samples.positions[:, 0] == NODES[8]) & (samples.branch == 1)
    fit = fit_table(LAYOUT, changed(samples, near, 0.3))
    # Flat index into (2, 21).
    assert fit.suspect_nodes == (21 + 8,)
    assert fit.wild[near].all()
    # 42 nodes of one draw stay inside 4 standard deviations.
    assert np.abs(fit.values - TRUTH)[1, 8] < 4.0 * fit.standard_deviation[1, 8]


@pytest.mark.parametrize("effects", ["none", "offset", "drift"])
def test_run_of_garbage_does_not_end_the_fit(
    effects: Literal["none", "offset", "drift"],
) -> None:
    samples = runs(offset=0 * OFFSET, drift=0 * DRIFT)
    assert samples.run is not None
    own = samples.run == 3
    extra = np.random.default_rng(4).normal(0.0, 100.0, own.sum())
    fit = fit_table(LAYOUT, changed(samples, own, extra), run_effects=effects)
    np.testing.assert_array_equal(fit.wild, own)
    # Four runs are left, and 42 nodes of one draw stay inside 4 standard deviations; the
    # constant is as uncertain as the effect of the run of which nothing is believed.
    error = fit.values - TRUTH
    assert np.abs(error - error.mean()).max() < 4 * NOISE / np.sqrt(4)
    assert abs(error.mean()) < 4 * NOISE / np.sqrt(4 * 82)
    if effects != "none":
        assert fit.suspect_runs == (3,)
        assert fit.runs[3].offset == pytest.approx(0.0, abs=1e-6)


def test_wild_reading_is_found_beside_run_effects() -> None:
    samples = changed(runs(), np.arange(410) == 17, 1.0)
    fit = fit_table(LAYOUT, samples, run_effects="drift")
    np.testing.assert_array_equal(np.flatnonzero(fit.wild), [17])
    assert "1 wild reading was left out" in fit.message


def test_left_out_run_is_not_in_its_fit() -> None:
    samples = runs()
    assert samples.run is not None
    fit = fit_table(LAYOUT, samples, run_effects="drift")
    folds = leave_out(fit, samples, samples.run)
    assert list(folds) == list(range(RUNS))
    for run, fold in folds.items():
        assert fold.smoothness == pytest.approx(fit.smoothness)
        assert fold.loss == fit.loss
        # Whatever the left-out run says changes nothing.
        spoilt = changed(samples, samples.run == run, 7.0)
        again = leave_out(fit, spoilt, samples.run)[run]
        np.testing.assert_array_equal(again.values, fold.values)


def test_left_out_runs_scatter_as_predicted() -> None:
    samples = runs(offset=0 * OFFSET, drift=0 * DRIFT)
    assert samples.run is not None
    fit = fit_table(LAYOUT, samples)
    residual, spread = np.zeros(410), np.zeros(410)
    for run, fold in leave_out(fit, samples, samples.run).items():
        own = samples.run == run
        assert samples.branch is not None
        mean, deviation = predict(fold, samples.positions[own], samples.branch[own])
        residual[own] = samples.error[own] - mean
        spread[own] = np.hypot(deviation, fold.noise)
    # 410 residuals: 3.5 % each for what is seen and what the folds estimate.
    ratio = np.sqrt(np.mean((residual / spread) ** 2))
    assert ratio == pytest.approx(1.0, abs=0.1)


def test_leaving_out_needs_two_groups() -> None:
    samples = runs()
    fit = fit_table(LAYOUT, samples)
    with pytest.raises(FitError, match="at least two groups of readings, found one"):
        leave_out(fit, samples, np.zeros(410, np.int64))


@pytest.mark.parametrize(
    "layout",
    [
        TableEffect((np.arange(33.0), np.arange(21.0))),
        TableEffect((np.arange(200.0),)),
        TableEffect((np.arange(37.0),), branches=2, periodic=True),
        TableEffect((np.arange(6.0), np.arange(4.0))),
    ],
    ids=["plane", "line", "ring", "small plane"],
)
def test_spatial_blocks_cover_everything_evenly(layout: TableEffect) -> None:
    rng = np.random.default_rng(0)
    last = [nodes[-1] for nodes in layout.nodes]
    positions = rng.uniform(0.0, last, (20_000, len(last)))
    branch = rng.integers(0, 2, 20_000) if layout.branches == 2 else None
    samples = Samples(positions, np.zeros(20_000), branch)
    group = spatial_blocks(layout, samples, count=5)
    assert group.shape == (20_000,)
    assert set(group) == set(range(5))
    # Blocks differ by one cell along each axis, groups by one block of 15 or more.
    share = np.bincount(group) / 20_000
    assert share.min() > 0.5 / 5
    assert share.max() < 2.0 / 5
    # A cell is never divided.
    cells = np.floor(positions) @ [1000.0, 1.0][: len(last)]
    for cell in np.unique(cells)[::17]:
        assert len(set(group[cells == cell])) == 1
    np.testing.assert_array_equal(group, spatial_blocks(layout, samples, count=5))


def test_left_out_blocks_are_bridged_within_their_stated_deviation() -> None:
    rng = np.random.default_rng(3)
    x, y = np.arange(13.0), np.arange(11.0)
    positions = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    surface = 0.05 * np.sin(positions[:, 0] / 4) * np.cos(positions[:, 1] / 5)
    layout = TableEffect((x, y))
    samples = Samples(positions, surface + rng.normal(0.0, NOISE, len(surface)))
    fit = fit_table(layout, samples)
    group = spatial_blocks(layout, samples, count=4)
    ratio = []
    for block, fold in leave_out(fit, samples, group).items():
        own = group == block
        mean, deviation = predict(fold, positions[own])
        spread = np.hypot(deviation, fold.noise)
        ratio.extend((samples.error[own] - mean) / spread)
    # 143 readings, one per node: 95 % of them with a margin of three binomial deviations.
    assert len(ratio) == 143
    assert np.mean(np.abs(ratio) <= 2.0) >= 0.89


def test_least_squares_without_smoothness_keeps_the_mean_of_all_runs() -> None:
    # One of five runs lies 40 µm off: it is named, and counts in the mean.
    layout = TableEffect((TARGETS,), branches=2)
    offset = np.array([0.0005, -0.0004, 0.0002, 0.040, -0.0003])
    samples = runs(offset=offset, drift=0 * DRIFT)
    fit = fit_table(layout, samples, smoothness=0.0, loss="gauss", run_effects="offset")
    assert fit.suspect_runs == (3,)
    assert samples.branch is not None
    plain = [
        [
            samples.error[(samples.branch == b) & (samples.positions[:, 0] == x)].mean()
            for x in TARGETS
        ]
        for b in (0, 1)
    ]
    # The prior that fills gaps weighs 1e-9.
    np.testing.assert_allclose(fit.values, plain, atol=1e-6)


@pytest.mark.parametrize(
    "seeds", [range(3), pytest.param(range(3, 12), marks=pytest.mark.heavy)]
)
def test_runs_that_differ_by_little_all_count(seeds: range) -> None:
    nodes = np.linspace(0.0, 800.0, 81)
    layout, inside = TableEffect((nodes,), branches=2), []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        # White curvature: what second differences take a table for.
        bend = rng.normal(0.0, 0.0005, (2, 81))
        rough = np.cumsum(np.cumsum(bend, axis=1), axis=1)
        run = np.repeat(np.arange(5), 162)
        branch = np.tile(np.repeat([0, 1], 81), 5)
        place = np.tile(np.concatenate([np.arange(81)] * 2), 5)
        offset = rng.normal(0.0, 0.0008, 5)
        error = rough[branch, place] + offset[run] + rng.normal(0.0, 0.0004, 810)
        samples = Samples(nodes[place][:, None], error, branch, run)
        fit = fit_table(layout, samples, run_effects="offset")
        assert fit.suspect_runs == ()
        # The table keeps the mean of the runs.
        off = fit.values - rough - offset.mean()
        inside.append(np.mean(np.abs(off) <= 2.0 * fit.standard_deviation))
    # 162 nodes a draw: 95 % with three binomial deviations of a few hundred.
    assert 0.92 <= np.mean(inside) <= 0.99


@pytest.mark.parametrize("seed", [4, 37, 47])
def test_robust_passes_that_would_swing_for_ever_come_to_rest(seed: int) -> None:
    rows = np.genfromtxt(io.StringIO(readings(seed)), delimiter=",", names=True)
    samples = Samples(
        rows["x"][:, None],
        1e-3 * rows["e"],
        branch=(rows["dir"] < 0).astype(np.int64),
        run=rows["run"].astype(np.int64),
    )
    layout = TableEffect((np.linspace(-20.0, 20.0, 9),), branches=2)
    fit = fit_table(layout, samples)
    assert fit.converged
    # 1.2 µm as made, a tenth of it by chance for 90 readings, and the drift within a run,
    # which is fitted as an offset; 2.7 to 5.9 µm where the passes ended on the way.
    assert 1.0e-3 < fit.noise < 1.6e-3


def test_a_ripple_that_every_run_shows_is_no_noise() -> None:
    # As short as three nodes: a prior of differences takes it for noise (24 % inside).
    truth = 0.002 * np.sin(2 * np.pi * NODES / 63.5)
    run = np.repeat(np.arange(3), len(NODES))
    inside, noise = [], []
    for seed in range(8):
        scatter = np.random.default_rng(seed).normal(0.0, 0.001, len(run))
        samples = Samples(np.tile(NODES, 3)[:, None], np.tile(truth, 3) + scatter)
        samples = dataclasses.replace(samples, run=run)
        fit = fit_table(TableEffect((NODES,)), samples, run_effects="offset")
        inside.append(np.abs(fit.values - truth) <= 2 * fit.standard_deviation)
        noise.append(fit.noise)
    # 168 nodes: 95 % less three standard deviations of that share.
    assert np.mean(inside) >= 0.90
    # 320 readings to spare tell a scatter to 4 %; the loss of few readings adds some.
    assert np.mean(noise) == pytest.approx(0.001, rel=0.12)


def waves(rng: np.random.Generator, length: float, size: float) -> np.ndarray:
    """A smooth curve over the nodes, of about this wave length and rms."""
    lengths = length * rng.uniform(1.0, 2.0, 6)
    phases, sizes = rng.uniform(0.0, 2 * np.pi, 6), rng.normal(0.0, size, 6)
    curves = np.cos(2 * np.pi * np.linspace(0, 600, 31)[:, None] / lengths + phases)
    return np.asarray(curves @ sizes / np.sqrt(3.0))


@pytest.mark.parametrize("heat", [0.0, 0.001])
@pytest.mark.parametrize("count", [2, 5])
def test_deviations_hold_what_heat_makes_of_each_run(count: int, heat: float) -> None:
    nodes, ratios, told = np.linspace(0, 600, 31), [], []
    run, place = np.repeat(np.arange(count), 31), np.tile(np.linspace(0, 1, 31), count)
    line = np.vander(nodes / 600, 2)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        truth = waves(rng, 200.0, 0.004)
        error = [truth + waves(rng, 150.0, heat) for _ in range(count)]
        scatter = rng.normal(0.0, 0.0002, len(run))
        samples = Samples(
            np.tile(nodes, count)[:, None], np.ravel(error) + scatter, None, run, place
        )
        fit = fit_table(TableEffect((nodes,)), samples, run_effects="drift")
        # The mean of the runs' offsets and drifts is told apart from this.
        off = fit.values - truth
        off = off - line @ np.linalg.lstsq(line, off, rcond=None)[0]
        ratios.append(off / fit.standard_deviation)
        told.append("err alike" in fit.message)
    # 310 nodes, of which about 100 are independent: 95 % less three deviations of that share;
    # 70 % and 75 % where each reading counts as news.
    assert np.mean(np.abs(ratios) <= 2.0) > 0.885
    # Nor are they inflated where nothing shows.
    assert np.sqrt(np.mean(np.square(ratios))) > 0.7
    assert np.mean(told) == (heat > 0.0)


def test_runs_that_contradict_each_other_on_a_stretch_are_told_and_doubted() -> None:
    samples = runs(offset=0 * OFFSET, drift=0 * DRIFT)
    assert samples.run is not None
    place = samples.positions[:, 0]
    low, high = np.quantile(TARGETS, (0.4, 0.65))
    torn = np.isin(samples.run, (1, 3)) & (place >= low) & (place <= high)
    fit = fit_table(LAYOUT, changed(samples, torn, 0.06), run_effects="drift")
    # One place at either end lies between two nodes, there and back.
    assert np.sum((fit.apart != 0.0) != torn) <= 8
    # Two of five are right, or three: the table lies 24 µm off these and 36 µm off those.
    off = np.abs(fit.values - TRUTH)
    assert off.max() > 0.02
    assert (off < 2.0 * fit.standard_deviation).all()


@pytest.mark.parametrize("effects", ["offset", "drift"])
def test_runs_that_are_curves_of_their_own_do_not_contradict_each_other(
    effects: Literal["offset", "drift"],
) -> None:
    samples = runs()
    assert samples.run is not None
    assert samples.order is not None
    bend = np.random.default_rng(5).normal(0.0, 0.02, RUNS)
    heat = bend[samples.run] * np.sin(np.pi * samples.order)
    fit = fit_table(
        LAYOUT, changed(samples, heat != 0.0, heat[heat != 0.0]), run_effects=effects
    )
    assert not fit.apart.any()


def test_share_of_readings_that_are_too_many_to_be_left_out_is_told() -> None:
    samples = runs(offset=0 * OFFSET, drift=0 * DRIFT)
    rng = np.random.default_rng(6)
    wild = rng.random(len(samples.error)) < 0.15
    some = changed(samples, wild, rng.uniform(0.1, 1.0, int(wild.sum())))
    message = fit_table(LAYOUT, some, run_effects="drift").message
    share = int(message.split("% of the readings lie far off")[0].split()[-1])
    # Some of them lie among the others.
    assert 10 <= share <= round(100 * wild.mean())


@pytest.mark.parametrize("seed", range(3))
def test_a_third_of_wild_readings_is_told_and_doubted(seed: int) -> None:
    samples = runs(seed, offset=0 * OFFSET, drift=0 * DRIFT)
    rng = np.random.default_rng(seed)
    wild = rng.random(len(samples.error)) < 1 / 3
    some = changed(samples, wild, rng.uniform(0.08, 0.12, int(wild.sum())))
    fit = fit_table(LAYOUT, some, run_effects="offset")
    share = int(fit.message.split("% of the readings lie far off")[0].split()[-1])
    # Of five readings of a place more than two may be wild: then the others are far off. Where
    # some in a row of one run are, the run contradicts the others, and they are named as such.
    assert 15 <= share <= 45
    # One third of 0.1 mm, to one side, moves a mean by 33 µm.
    off = np.abs(fit.values - TRUTH)
    assert (off < 2.0 * fit.standard_deviation).mean() > 0.8


@pytest.mark.parametrize("passes", [2, 3, 4, 5])
def test_passes_there_and_back_as_runs_of_their_own_leave_the_slope_of_the_table(
    passes: int,
) -> None:
    rng = np.random.default_rng(5)
    ways = [1 - 2 * (k % 2) for k in range(passes)]
    position = np.concatenate([TARGETS[::way] for way in ways])
    run = np.repeat(np.arange(passes), len(TARGETS))
    order = np.tile(np.linspace(0.0, 1.0, len(TARGETS)), passes)
    # The ends of the directions differ by 4 µm: each reading grows with the order of its run.
    error = truth(position, 0) + 0.004 * (order - 0.5)
    error += 5e-4 * rng.standard_normal(len(error))
    layout = TableEffect((NODES,))
    fit = fit_table(
        layout, Samples(position[:, None], error, None, run, order), run_effects="drift"
    )
    # The mean of the passes: what an odd one has more of lies within a part of the number.
    lean = 0.004 * sum(ways) / passes * (NODES / 400.0 - 0.5)
    apart = fit.values.ravel() - truth(NODES, 0) - lean
    deviation = fit.standard_deviation.ravel()
    assert np.abs(apart).max() < 4.0 * deviation.max()
    # Readings of 0.5 µm; one unknown slope made 500 µm of it.
    assert deviation.max() < 1e-3


def test_set_ups_that_adjoin_are_joined_by_the_smoothness_of_the_table() -> None:
    rng = np.random.default_rng(8)
    near, far = TARGETS[TARGETS < 195.0], TARGETS[TARGETS >= 195.0]
    position = np.concatenate([near, near, near, far, far, far])
    run = np.repeat(np.arange(6), [len(near)] * 3 + [len(far)] * 3)
    order = np.concatenate([np.linspace(0.0, 1.0, (run == k).sum()) for k in range(6)])
    zero = np.where(run < 3, 0.0, 0.03)
    error = truth(position, 0) + zero + 4e-4 * rng.standard_normal(len(run))
    fit = fit_table(
        TableEffect((NODES,)),
        Samples(position[:, None], error, None, run, order),
        run_effects="drift",
    )
    apart = fit.values.ravel() - truth(NODES, 0)
    step = apart[NODES >= 195.0].mean() - apart[NODES < 195.0].mean()
    # No target in common: the table goes on over them to some of its noise, and not by 30 µm.
    assert abs(step) < 3e-3

"""Leadscrew, modulo and cross tables of known truth come back."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar

from axcomp.ident.fit import Samples, TableEffect, TableFit, fit_table, fit_values

NOISE = 0.002  # mm or °
WILD, WILD_SHARE = 1.0, 0.01
UNIT = 1e-4
SEEDS = (0, 1)

_GAPS = np.random.default_rng(7).uniform(3.6, 4.4, 139)
LAYOUTS = {
    "leadscrew": TableEffect((np.concatenate([[-20.0], -20 + _GAPS.cumsum()]),), 2),
    "modulo": TableEffect((np.linspace(0.0, 360.0, 73),), 2, periodic=True),
    "cross": TableEffect((2.0 * np.arange(1000),)),
}
COUNTS = {"leadscrew": 10_000, "modulo": 5_000, "cross": 10_000}


class Case(NamedTuple):
    """A true table in mm or °, readings of it, and which of them are wild."""

    layout: TableEffect
    truth: np.ndarray
    samples: Samples
    wild: np.ndarray


def smoothed(white: np.ndarray, length: float, ring: bool) -> np.ndarray:
    # Filtering white noise by σ gives a correlation exp(-d²/4σ²): length = σ·√2.
    mode = "wrap" if ring else "reflect"
    field = gaussian_filter1d(white, length / np.sqrt(2), mode=mode)
    return np.asarray(0.01 * field / field.std())


def line_of(name: str, nodes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    x = np.linspace(0, 1, len(nodes))
    if name == "rough":
        rough = rng.normal(size=len(nodes)).cumsum().cumsum()
        rough -= np.polyval(np.polyfit(x, rough, 1), x)
        return np.asarray(0.02 * x + 0.015 * x**2 + 1e-3 * rough)
    x = (nodes - nodes[0]) / (nodes[-1] - nodes[0])
    if name == "waves":
        return np.asarray(0.01 * np.sin(8 * x + 1) + 0.005 * np.cos(17 * x))
    if name == "sag":
        return np.asarray(-0.05 * (1 - (2 * x - 1) ** 2))
    white = rng.normal(size=len(nodes) + 80)
    return smoothed(white, float(name.split()[2]), False)[40:-40]


def ring_of(name: str, nodes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    count = len(nodes) - 1
    if name == "rough":
        spectrum = np.fft.rfft(rng.normal(size=count))
        bend = 2 - 2 * np.cos(2 * np.pi * np.fft.rfftfreq(count))
        spectrum[0], bend[0] = 0.0, 1.0
        turn = 1e-3 * np.fft.irfft(spectrum / bend, count)
    elif name == "waves":
        angle = 2 * np.pi * np.arange(count) / count
        turn = 0.01 * np.sin(2 * angle + 1) + 0.004 * np.cos(5 * angle)
    else:
        turn = smoothed(rng.normal(size=count), float(name.split()[2]), True)
    return np.append(turn, turn[0])


def make(table: str, name: str, seed: int) -> Case:
    rng = np.random.default_rng(seed)
    layout, count = LAYOUTS[table], COUNTS[table]
    nodes = layout.nodes[0]
    draw = ring_of if layout.periodic else line_of
    truth = np.stack([draw(name, nodes, rng) for _ in range(layout.branches)])
    position = rng.uniform(nodes[0], nodes[-1], count)
    branch = rng.integers(0, layout.branches, count)
    error = np.stack([np.interp(position, nodes, line) for line in truth])
    error = error[branch, np.arange(count)] + rng.normal(0.0, NOISE, count)
    if layout.periodic:
        position += 360.0 * rng.integers(-2, 3, count)
    wild = rng.random(count) < WILD_SHARE
    error[wild] += rng.choice([-WILD, WILD], wild.sum())
    two = layout.branches == 2
    samples = Samples(position[:, None], error, branch if two else None)
    return Case(layout, truth if two else truth[0], samples, wild)


def rounded(values: np.ndarray) -> np.ndarray:
    return np.asarray(UNIT * np.round(values / UNIT))


def size(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def best_fixed(case: Case) -> float:
    """Error of the best weight of second differences, given truth and good readings only."""
    good = case.samples.take(~case.wild)

    def cost(log: float) -> float:
        values = fit_values(case.layout, good, smoothness=10.0**log)
        return size(rounded(np.asarray(values)) - case.truth)

    found: Any = minimize_scalar(
        cost, bounds=(-1.0, 8.0), method="bounded", options={"xatol": 0.1}
    )
    return float(found.fun)


def judge(table: str, name: str) -> tuple[float, float, list[TableFit]]:
    """Mean ratio to the best fixed smoothness, share of nodes inside 2 σ, the fits."""
    ratios, covered, fits = [], [], []
    for seed in SEEDS:
        case = make(table, name, seed)
        fit = fit_table(case.layout, case.samples)
        error = rounded(fit.values) - case.truth
        deviation = np.sqrt(fit.standard_deviation**2 + UNIT**2 / 12)
        ratios.append(size(error) / best_fixed(case))
        covered.append((np.abs(error) <= 2 * deviation).mean())
        np.testing.assert_array_equal(fit.wild, case.wild)
        fits.append(fit)
    return float(np.mean(ratios)), float(np.mean(covered)), fits


@pytest.mark.parametrize("table", LAYOUTS)
def test_rough_table_comes_back_as_well_as_with_the_best_fixed_smoothness(
    table: str,
) -> None:
    ratio, covered, _ = judge(table, "rough")
    assert ratio <= 1.1
    # What the issue asks for; a bilateral table of 140 nodes is 280 correlated draws.
    assert 0.92 <= covered <= 0.98


@pytest.mark.parametrize(
    ("table", "name"),
    [
        *[(table, "waves") for table in LAYOUTS],
        *[
            pytest.param(table, name, marks=pytest.mark.heavy)
            for table in LAYOUTS
            for name in ("field of 5 nodes", "field of 10 nodes", "sag")
            if not (table == "modulo" and name == "sag")  # no turn sags
        ],
    ],
)
def test_smooth_table_comes_back_better_than_with_the_best_fixed_smoothness(
    table: str, name: str
) -> None:
    ratio, covered, _ = judge(table, name)
    # What the issue asks for; fourth differences are seen to gain 5 to 35 %.
    assert ratio <= 1.0
    assert covered >= 0.92


@pytest.mark.parametrize("table", LAYOUTS)
def test_wild_points_move_no_node(table: str) -> None:
    case = make(table, "field of 5 nodes", 5)
    fit = fit_table(case.layout, case.samples)
    clean = fit_table(case.layout, case.samples.take(~case.wild))
    # What the issue asks for is 1 µm; left-out readings leave nothing but the tolerance of
    # the iterations.
    assert np.abs(fit.values - clean.values).max() <= 2e-5


def test_turn_closes() -> None:
    case = make("modulo", "field of 10 nodes", 6)
    fit = fit_table(case.layout, case.samples)
    for part in (fit.values, fit.standard_deviation, fit.support):
        np.testing.assert_array_equal(part[:, 0], part[:, -1])


def test_directions_share_smoothness_and_nothing_else() -> None:
    case = make("leadscrew", "waves", 7)
    samples = case.samples
    assert samples.branch is not None
    fit = fit_table(case.layout, samples, smoothness=50.0, loss="gauss")
    for branch in (0, 1):
        own = samples.take(samples.branch == branch)
        alone = fit_table(
            TableEffect(case.layout.nodes),
            Samples(own.positions, own.error),
            smoothness=50.0,
            loss="gauss",
        )
        # The start is another median; 1e-15 × condition of about 1e4.
        np.testing.assert_allclose(fit.values[branch], alone.values, atol=1e-12)


@pytest.mark.heavy
@pytest.mark.slow
@pytest.mark.parametrize(("runs", "bend"), [(5, 10.0), (3, 300.0)])
def test_sharp_bends_on_which_repeated_readings_agree_are_believed(
    runs: int, bend: float
) -> None:
    # Second differences `bend` times the noise, every target measured a few times: a
    # smooth start would take the readings of a whole target for wild ones.
    nodes = np.linspace(0.0, 1000.0, 41)
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        truth = bend * NOISE * rng.normal(size=41).cumsum().cumsum()
        error = np.tile(truth, runs) + rng.normal(0.0, NOISE, 41 * runs)
        samples = Samples(np.tile(nodes, runs)[:, None], error)
        fit = fit_table(TableEffect((nodes,)), samples)
        assert not fit.wild.any()
        # As good as the mean of the runs; the loss costs up to a tenth of the precision,
        # and 41 nodes of one draw as much again.
        mean = size(error.reshape(runs, 41).mean(axis=0) - truth)
        assert size(fit.values - truth) <= 1.25 * mean


def test_readings_without_noise_come_back() -> None:
    nodes = np.linspace(0.0, 10.0, 11)
    rng = np.random.default_rng(0)
    position = rng.uniform(0.0, 10.0, 200)
    for truth in (np.full(11, 0.3), np.zeros(11), 0.1 * nodes, np.sin(nodes)):
        samples = Samples(position[:, None], np.interp(position, nodes, truth))
        for loss in ("student", "gauss"):
            fit = fit_table(TableEffect((nodes,)), samples, loss=loss)
            # The smallest smoothness, 1e-7 of the information, draws a little.
            np.testing.assert_allclose(fit.values, truth, atol=1e-6)
            assert not fit.wild.any()

"""Planes of known truth come back: rough and smooth ones, with wild points and gaps.

The same as `benchmarks/test_fit_accuracy.py`, which fits 10⁶ readings to 101 × 101 nodes,
with 10⁵ readings and 41 × 31 nodes.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize_scalar

from axcomp.ident.fit import Samples, TableEffect, TableFit, fit_table, fit_values

LONG, SHORT = 41, 31
INTERVAL = 10.0  # mm
COUNT = 100_000
NOISE = 0.002  # mm
WILD, WILD_SHARE = 1.0, 0.01  # mm
UNIT = 1e-4  # mm, what a list can say
LAYOUT = TableEffect((INTERVAL * np.arange(LONG), INTERVAL * np.arange(SHORT)))
SMOOTH = ("waves", "field of 5 nodes", "field of 10 nodes", "sag")


class Case(NamedTuple):
    """A true table in mm, readings of it, and which of them are wild."""

    truth: np.ndarray
    samples: Samples
    wild: np.ndarray


def white_curvature(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Squared second differences of a chain: values and vectors."""
    differences = np.diff(np.eye(count), 2, axis=0)
    values, vectors = np.linalg.eigh(differences.T @ differences)
    return np.maximum(values, 0.0), vectors


def truth_of(name: str, rng: np.random.Generator) -> np.ndarray:
    y, x = np.meshgrid(
        np.linspace(-1, 1, SHORT), np.linspace(-1, 1, LONG), indexing="ij"
    )
    if name == "rough":
        (bend1, modes1), (bend2, modes2) = white_curvature(LONG), white_curvature(SHORT)
        power = bend1[None] + bend2[:, None]
        size = np.where(power > 1e-9, power, np.inf) ** -0.5
        rough = modes2 @ (size * rng.normal(size=power.shape)) @ modes1.T
        return np.asarray(0.02 * x + 0.01 * y + 0.015 * x**2 + 1e-3 * rough)
    if name == "waves":
        waves = 0.01 * np.sin(4 * x + 1) * np.cos(3 * y)
        return np.asarray(waves + 0.005 * np.sin(7 * y + 2 * x))
    if name == "sag":
        return np.asarray(-0.05 * (1 - x**2) * (1 + 0.3 * y) + 0.01 * y**2)
    length = float(name.split()[2])
    white = rng.normal(size=(SHORT + 80, LONG + 80))
    # Filtering white noise by σ gives a correlation exp(-d²/4σ²): length = σ·√2.
    field = gaussian_filter(white, length / np.sqrt(2))[40:-40, 40:-40]
    return np.asarray(0.01 * field / field.std())


def bilinear(table: np.ndarray, positions: np.ndarray) -> np.ndarray:
    place = positions / INTERVAL
    i, j = np.minimum(place.astype(int), (LONG - 2, SHORT - 2)).T
    u, v = (place - np.stack([i, j], axis=1)).T
    low = (1 - u) * table[j, i] + u * table[j, i + 1]
    high = (1 - u) * table[j + 1, i] + u * table[j + 1, i + 1]
    return np.asarray((1 - v) * low + v * high)


def make(name: str, seed: int, hole: bool = False) -> Case:
    rng = np.random.default_rng(seed)
    truth = truth_of(name, rng)
    size = np.array([LONG - 1, SHORT - 1]) * INTERVAL
    positions = rng.uniform((0.0, 0.0), size, (COUNT, 2))
    if hole:
        positions = positions[~(positions > 0.5 * size).all(axis=1)]
    error = bilinear(truth, positions) + rng.normal(0.0, NOISE, len(positions))
    wild = rng.random(len(positions)) < WILD_SHARE
    error[wild] += rng.choice([-WILD, WILD], wild.sum())
    return Case(truth, Samples(positions, error), wild)


def rounded(values: np.ndarray) -> np.ndarray:
    return np.asarray(UNIT * np.round(values / UNIT))


def size(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def best_fixed(case: Case) -> float:
    """Error of the best weight of second differences, given truth and good readings only."""
    good = case.samples.take(~case.wild)

    def cost(log: float) -> float:
        values = fit_values(LAYOUT, good, smoothness=10.0**log)
        return size(rounded(np.asarray(values)) - case.truth)

    found: Any = minimize_scalar(
        cost, bounds=(-1.0, 5.0), method="bounded", options={"xatol": 0.1}
    )
    return float(found.fun)


def inside(case: Case, fit: TableFit) -> np.ndarray:
    """Which nodes lie within two standard deviations, rounding to list units included."""
    deviation = np.sqrt(fit.standard_deviation**2 + UNIT**2 / 12)
    return np.asarray(np.abs(rounded(fit.values) - case.truth) <= 2.0 * deviation)


def test_rough_plane_comes_back_as_well_as_with_the_best_fixed_smoothness() -> None:
    for seed in (0, 1):
        case = make("rough", seed)
        fit = fit_table(LAYOUT, case.samples)
        # What the issue asks for; 1.00 and 1.01 are seen.
        assert size(rounded(fit.values) - case.truth) <= 1.1 * best_fixed(case)
        assert 0.92 <= inside(case, fit).mean() <= 0.98
        # 10⁵ readings tell their scatter to 0.3 %; the tails of the loss cost as much.
        assert fit.noise == pytest.approx(NOISE, rel=0.01)
        assert fit.converged


@pytest.mark.parametrize(
    "name",
    [
        SMOOTH[0],
        *(pytest.param(name, marks=pytest.mark.heavy) for name in SMOOTH[1:]),
    ],
)
def test_smooth_plane_comes_back_better_than_with_the_best_fixed_smoothness(
    name: str,
) -> None:
    ratios, covered = [], []
    for seed in (0, 1):
        case = make(name, seed)
        fit = fit_table(LAYOUT, case.samples)
        ratios.append(size(rounded(fit.values) - case.truth) / best_fixed(case))
        covered.append(inside(case, fit).mean())
        assert fit.converged
    # What the issue asks for; fourth differences are seen to gain 20 % and more.
    assert np.mean(ratios) <= 1.0
    assert np.mean(covered) >= 0.92


@pytest.mark.parametrize("name", ["rough", "waves"])
def test_wild_points_move_no_node(name: str) -> None:
    case = make(name, 2)
    fit = fit_table(LAYOUT, case.samples)
    clean = fit_table(LAYOUT, case.samples.take(~case.wild))
    np.testing.assert_array_equal(fit.wild, case.wild)
    # What the issue asks for is 1 µm; left-out readings leave nothing but the tolerance of
    # the iterations, a hundredth of a standard deviation of 0.25 µm.
    assert np.abs(fit.values - clean.values).max() <= 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "rough",
        *(pytest.param(name, marks=pytest.mark.heavy) for name in ("waves", "sag")),
    ],
)
def test_unmeasured_quarter_is_marked_and_covered(name: str) -> None:
    covered, ratios = [], []
    for seed in (0, 1, 2):
        case, whole = make(name, seed, hole=True), make(name, seed)
        fit, other = fit_table(LAYOUT, case.samples), fit_table(LAYOUT, whole.samples)
        measured = fit.support > 0
        row, column = np.nonzero(~measured)
        # The hole begins in the middle, at nodes 15 and 20, which its edge still touches.
        assert (row.min(), column.min()) == (16, 21)
        assert (~measured).sum() == 15 * 20
        assert (fit.values[~measured] != 0.0).all()
        good = inside(case, fit)
        assert good[measured].mean() >= 0.92
        covered.append(good[~measured].mean())
        error = (rounded(one.values) - case.truth for one in (fit, other))
        after, before = (size(part[measured]) for part in error)
        ratios.append(after / before)
    # What is filled in hangs together: one table is hardly more than one draw.
    assert np.mean(covered) >= 0.92
    # The rest is as before; nodes beside the hole know a little less.
    assert np.mean(ratios) <= 1.1


def test_table_measured_along_one_axis_more_is_turned_with_its_axes() -> None:
    case = make("waves", 4)
    some = case.samples.take(np.arange(COUNT) < 20_000)
    fit = fit_table(LAYOUT, some)
    turned = fit_table(
        TableEffect(LAYOUT.nodes[::-1]), Samples(some.positions[:, ::-1], some.error)
    )
    # The same sums in another order.
    np.testing.assert_allclose(turned.values.T, fit.values, atol=1e-9)
    np.testing.assert_array_equal(turned.support.T, fit.support)
    swap = {"axis 1": "axis 2", "axis 2": "axis 1"}
    for key, weight in fit.smoothness.items():
        order, axis = key.split(", ")
        assert turned.smoothness[f"{order}, {swap[axis]}"] == pytest.approx(
            weight, 1e-3
        )


def test_bend_of_one_axis_only_is_smoothed_along_the_other() -> None:
    rng = np.random.default_rng(6)
    rail = np.cumsum(np.cumsum(rng.normal(size=LONG)))
    truth = np.broadcast_to(1e-4 * (rail - rail.mean()), (SHORT, LONG))
    positions = rng.uniform(
        (0.0, 0.0), ((LONG - 1) * INTERVAL, (SHORT - 1) * INTERVAL), (20_000, 2)
    )
    error = bilinear(truth, positions) + rng.normal(0.0, NOISE, 20_000)
    fit = fit_table(LAYOUT, Samples(positions, error))
    along, across = (fit.smoothness[f"order 2, axis {axis}"] for axis in (1, 2))
    # A rough rail straight across: orders of magnitude between the two weights.
    assert across > 100 * along
    # 15 readings per node, 31 nodes to each value of the rail: 2 µm / √(15 × 31) and
    # what the weak coupling of the rail's ends costs.
    assert size(fit.values - truth) < 2 * NOISE / np.sqrt(15 * 31)


@pytest.mark.parametrize("smoothness", [0.1, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("gap", [False, True])
def test_values_alone_are_those_of_the_whole_fit(smoothness: float, gap: bool) -> None:
    rng = np.random.default_rng(15)
    nodes = np.linspace(0.0, 300.0, 31)
    places = rng.uniform(0.0, 300.0, (8000, 2))
    if gap:
        places = places[(places > 100.0).any(axis=1)]
    error = 0.02 * np.sin(places[:, 0] / 60.0) * np.cos(places[:, 1] / 50.0)
    error += 0.002 * rng.standard_normal(len(places))
    layout = TableEffect((nodes, nodes))
    samples = Samples(places, error)
    fit = fit_table(layout, samples, smoothness=smoothness, loss="gauss")
    values = fit_values(layout, samples, smoothness=smoothness)
    # Conjugate gradients end at 1e-10 of the right-hand side, a thousandth of a list unit
    # after the condition of the matrix; stiff ones go to the factor.
    np.testing.assert_allclose(values, fit.values, atol=1e-7)


@pytest.mark.parametrize("digits", [4, 6])
def test_a_plane_that_bends_towards_its_corner_keeps_all_its_readings(
    digits: int,
) -> None:
    nodes = np.arange(0.0, 401.0, 50.0)
    x, y = (each.ravel() for each in np.meshgrid(nodes, nodes, indexing="ij"))
    error = 2e-4 * np.sin(x / 100.0) * y
    samples = Samples(np.stack([x, y], axis=1), error.round(digits))
    fit = fit_table(TableEffect((nodes, nodes)), samples, loss="student")
    truth = 2e-4 * np.sin(nodes / 100.0) * nodes[:, None]
    # As one reading per node is written; a table too smooth at first lost eight to 185 µm.
    np.testing.assert_allclose(fit.values, truth, atol=10.0**-digits)


@pytest.mark.parametrize(
    "seeds", [range(3), pytest.param(range(3, 15), marks=pytest.mark.heavy)]
)
def test_of_many_lone_readings_only_a_far_one_is_named(seeds: range) -> None:
    x, y = np.arange(0.0, 601.0, 40.0), np.arange(0.0, 401.0, 40.0)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    truth = 0.02 * np.sin(places[:, 0] / 150.0) * np.cos(places[:, 1] / 200.0)
    layout, named = TableEffect((x, y)), []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        error = truth + 4e-4 * rng.standard_normal(len(places))
        named.append(len(fit_table(layout, Samples(places, error)).suspect_nodes) > 0)
        error[70] += 8e-3
        assert 70 in fit_table(layout, Samples(places, error)).suspect_nodes
    # By chance in one of a hundred; three of 176 sound ones lie beyond three deviations.
    assert sum(named) <= 1


def test_readings_that_agree_with_each_other_and_no_others_are_a_doubt_of_the_table() -> (
    None
):
    rng = np.random.default_rng(21)
    nodes = (np.arange(0.0, 401.0, 50.0), np.arange(0.0, 301.0, 50.0))
    x, y = (
        g.ravel() for g in np.meshgrid(np.arange(0, 401, 25.0), np.arange(0, 301, 25.0))
    )
    error = 0.01 * np.sin(x / 120.0) * np.cos(y / 90.0) + 7e-4 * rng.normal(size=x.size)
    corner = (x >= 300.0) & (y >= 250.0)  # 30 µm, of the machine or of the instrument
    fit = fit_table(
        TableEffect(nodes), Samples(np.stack([x, y], axis=1), error + 0.03 * corner)
    )
    assert fit.wild[corner].all()
    there = np.ix_(nodes[1] >= 250.0, nodes[0] >= 300.0)
    assert (fit.standard_deviation[there] > 0.02).all()
    assert fit.standard_deviation[:4].max() < 1e-3
    error[7] += 0.03  # one is the instrument's
    lone = fit_table(TableEffect(nodes), Samples(np.stack([x, y], axis=1), error))
    assert lone.wild.sum() == 1
    assert lone.standard_deviation.max() < 2e-3


def test_places_read_twice_are_named_where_both_readings_are_off_and_not_by_chance() -> (
    None
):
    nodes = (np.arange(0.0, 401.0, 50.0), np.arange(0.0, 301.0, 50.0))
    x, y = (np.tile(g.ravel(), 2) for g in np.meshgrid(*nodes))
    run = np.repeat([0, 1], x.size // 2)
    place = np.stack([x, y], axis=1)
    truth = 0.01 * np.sin(x / 120.0) * np.cos(y / 90.0)
    off = 5e-3 * ((x == 200.0) & (y == 150.0))
    for seed in range(4):  # of 63 nodes in each; one in a hundred planes may have one
        noise = 7e-4 * np.random.default_rng(seed).normal(size=x.size)
        fit = fit_table(TableEffect(nodes), Samples(place, truth + noise, run=run))
        assert fit.suspect_nodes == ()
        fit = fit_table(
            TableEffect(nodes), Samples(place, truth + noise + off, run=run)
        )
        assert fit.suspect_nodes == (3 * 9 + 4,)

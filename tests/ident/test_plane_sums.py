"""The one pass over a plane's readings gives the sums that plain code gives step by step."""

import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.ident.fit import (
    FitError,
    Grid,
    Samples,
    TableLayout,
    _plane_sums,
    fit_streamed,
)
from axcomp.ident.fit._compiled import axis_nodes
from axcomp.ident.fit._information import (
    evaluate,
    moment_sums,
    normal_from_moments,
    touched,
    vector_from_moments,
)
from axcomp.ident.fit._plane_sums import Tally, plane_residual, sums_of, tally_of

EVEN = np.arange(31.0) * 2.0
UNEVEN = np.cumsum([0.0, *[1.0, 2.5] * 12])
BUNCHED = np.concatenate([np.geomspace(1e-6, 1.0, 40), [30.0, 60.0]])
LAYOUTS = {
    "equidistant": (EVEN, np.linspace(-7.0, 60.0, 12)),
    "across": (np.linspace(0.0, 60.0, 7), EVEN),
    "uneven": (UNEVEN, EVEN),
    "both uneven": (BUNCHED, UNEVEN),
    "one cell": (np.array([0.0, 60.0]), np.array([0.0, 60.0])),
}
layouts = pytest.mark.parametrize("name", LAYOUTS)


def readings(count: int, weighted: bool = False, on_nodes: float = 0.1) -> Samples:
    """Return readings within, on and beyond the tables above."""
    rng = np.random.default_rng(7)
    positions = rng.uniform(-5.0, 65.0, (count, 2))
    hit = rng.random((count, 2)) < on_nodes
    positions[hit] = np.round(positions[hit])
    error = 3.0 + rng.normal(size=count)
    weight = rng.uniform(0.5, 2.0, count) if weighted else None
    return Samples(positions, error, weight=weight)


def assert_sums(tally: Tally, grid: Grid, samples: Samples) -> None:
    """Compare with the plain code: sums one by one over readings that were located before."""
    place = grid.locate(samples)
    weight = samples.weight
    weight = np.ones(len(samples.error)) if weight is None else weight
    plain = normal_from_moments(grid, moment_sums(grid, place, weight, 2))
    right = vector_from_moments(
        grid, moment_sums(grid, place, weight * samples.error, 1)
    )
    normal, vector = tally.sums()
    # Up to 2e5 numbers of size 5 in another order, and places that differ by a rounding.
    for key, values in plain.diagonals.items():
        np.testing.assert_allclose(normal.diagonals[key], values, rtol=0, atol=1e-8)
    np.testing.assert_allclose(vector, right, rtol=0, atol=1e-8)
    square = float(weight @ np.square(samples.error))
    assert tally.square == pytest.approx(square, rel=1e-12)
    assert np.array_equal(tally.support, touched(grid, place))


@layouts
@pytest.mark.parametrize("weighted", [False, True], ids=["equal", "weighted"])
def test_sums_in_one_pass_are_those_of_numpy(name: str, weighted: bool) -> None:
    grid, samples = Grid(TableLayout(LAYOUTS[name])), readings(20_011, weighted)
    tally = Tally(grid)
    assert tally.add(samples)
    assert_sums(tally, grid, samples)


@layouts
def test_readings_less_the_table_are_those_of_numpy(name: str) -> None:
    grid, samples = Grid(TableLayout(LAYOUTS[name])), readings(5_000)
    values = np.random.default_rng(3).normal(size=(grid.slow, grid.fast))
    plain = samples.error - evaluate(grid, grid.locate(samples), values)
    found = plane_residual(grid, samples, values)
    # Roundings of places up to 42 cells from the first node, times values of size 3.
    np.testing.assert_allclose(found, plain, rtol=0, atol=1e-13)


def test_a_reading_of_weight_zero_is_not_there() -> None:
    grid, samples = Grid(TableLayout(LAYOUTS["uneven"])), readings(4_000, True)
    keep = np.random.default_rng(1).random(4_000) < 0.7
    assert samples.weight is not None
    left, alone = Tally(grid), Tally(grid)
    weight = np.where(keep, samples.weight, 0.0)
    left.add(Samples(samples.positions, samples.error, weight=weight))
    alone.add(samples.take(keep))
    assert np.array_equal(left.support, alone.support)
    assert np.array_equal(left.sums()[1], alone.sums()[1])


@pytest.mark.parametrize("on_nodes", [0.0, 0.2, 1.0])
def test_readings_on_edges_are_counted_at_the_nodes_that_they_touch(
    on_nodes: float,
) -> None:
    grid = Grid(TableLayout(LAYOUTS["equidistant"]))
    samples = readings(30_000, on_nodes=on_nodes)
    tally = Tally(grid)
    tally.add(samples)
    assert np.array_equal(tally.support, touched(grid, grid.locate(samples)))


@layouts
def test_tallies_of_pieces_add_up(name: str) -> None:
    grid, samples = Grid(TableLayout(LAYOUTS[name])), readings(9_000)
    whole, parts = Tally(grid), [Tally(grid), Tally(grid)]
    whole.add(samples)
    for number, part in enumerate(parts):
        part.add(samples.take(np.arange(9_000) % 2 == number))
    both = parts[0] + parts[1]
    assert_sums(both, grid, samples)
    assert both.count == whole.count == 9_000
    assert np.array_equal(both.support, whole.support)
    for extent in (both.extent, whole.extent):
        assert np.array_equal(extent.low, samples.positions.min(axis=0))
        assert np.array_equal(extent.high, samples.positions.max(axis=0))
        assert extent.counts == [9_000]


def cells_found(
    nodes: np.ndarray, positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return cell and place of each position: of a tally with that reading alone."""
    across = np.array([0.0, 1.0])
    grid = Grid(TableLayout((across, nodes)))
    found = []
    for position in positions:
        tally = Tally(grid)
        tally.add(Samples(np.array([[0.5, position]]), np.ones(1)))
        records = tally._table.reshape(-1, 16)
        cell = int(np.flatnonzero(records[:, 0])[0])
        found.append((cell, records[cell, 8]))
    cells, shares = zip(*found, strict=True)
    return np.array(cells), np.array(shares)


@pytest.mark.parametrize(
    "nodes",
    [
        -1234.5 + 0.1 * np.arange(24),
        np.linspace(0.0, 1.0 / 3.0, 11),
        1e6 + 0.3 * np.arange(7),
        UNEVEN,
        BUNCHED,
        np.array([0.1, 0.2, 0.4]),
    ],
    ids=["far", "thirds", "very far", "uneven", "bunched", "three"],
)
def test_cells_are_those_of_the_controller_model_at_its_nodes(
    nodes: np.ndarray,
) -> None:
    model = axis_nodes(nodes)
    exact = np.asarray(model.positions)
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    beyond = nodes[[0, -1]] + np.array([-1.0, 1.0]) * np.ptp(nodes)
    positions = np.concatenate([nodes, exact, middles, beyond])
    for steps in (1, 2, 20):
        for way in (-np.inf, np.inf):
            moved = nodes
            for _ in range(steps):
                moved = np.nextafter(moved, way)
            positions = np.concatenate([positions, moved])
    cells, shares = cells_found(nodes, positions)
    cell, share = (np.asarray(each) for each in model.locate(jnp.asarray(positions)))
    assert np.array_equal(cells, cell)
    # XLA takes numbers below 1e-307 for zero.
    np.testing.assert_allclose(shares, share, rtol=0, atol=1e-307)


def test_the_sum_of_many_readings_does_not_depend_on_the_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    grid, samples = Grid(TableLayout(LAYOUTS["uneven"])), readings(1_300_000)
    found = []
    for threads in (1, 3):
        monkeypatch.setattr(_plane_sums, "cores", lambda threads=threads: threads)
        found.append(tally_of(grid, samples))
    for one, other in zip(*(tally.sums() for tally in found), strict=True):
        if isinstance(one, np.ndarray):
            assert np.array_equal(one, other)
        else:
            for key, values in one.diagonals.items():
                assert np.array_equal(values, other.diagonals[key])
    # In one go the same, but for the order of the sum.
    assert_sums(found[0], grid, samples)


def test_many_readings_may_lie_in_memory_in_any_way() -> None:
    grid, samples = Grid(TableLayout(LAYOUTS["uneven"])), readings(100_000)
    _, vector = sums_of(grid, samples)
    for positions in (
        np.asfortranarray(samples.positions),
        np.repeat(samples.positions, 2, axis=0)[::2],
    ):
        positions.flags.writeable = False  # as they come from a file
        _, found = sums_of(grid, Samples(positions, samples.error))
        assert np.array_equal(found, vector)
    single = samples.positions.astype(np.float32)
    _, found = sums_of(grid, Samples(single, samples.error))
    _, plain = sums_of(grid, Samples(single.astype(float), samples.error))
    assert np.array_equal(found, plain)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["x", "y", "e"])
def test_what_is_no_number_is_found_in_the_same_pass(where: str, bad: float) -> None:
    layout, samples = TableLayout(LAYOUTS["equidistant"]), readings(3_000)
    if where == "e":
        samples.error[2_345] = bad
    else:
        samples.positions[2_345, "xy".index(where)] = bad
    assert not Tally(Grid(layout)).add(samples)
    name = "error" if where == "e" else "positions"
    with pytest.raises(FitError, match=f"reading 2346: {name} is not finite"):
        fit_streamed(layout, [lambda: [samples]])


def test_readings_too_large_to_be_squared_are_numbers() -> None:
    samples = readings(100)
    samples.error[3] = 1e200
    assert Tally(Grid(TableLayout(LAYOUTS["equidistant"]))).add(samples)


_SMALL = """
import sys
import numpy as np
from axcomp.ident.batch import fit_log
from axcomp.ident.fit import Samples, TableLayout, fit_table, fit_values
nodes = np.linspace(0.0, 10.0, 9)
layout = TableLayout((nodes, nodes[:5]))
place = np.random.default_rng(0).uniform(0.0, 10.0, (500, 2))
fit_table(layout, Samples(place, np.sin(place[:, 0])))
# Nothing else here switches JAX to double precision.
assert fit_values(layout, place, place[:, 0], smoothness=1.0).dtype == np.float64
assert "numba" not in sys.modules
assert "llvmlite" not in sys.modules
"""


def test_a_small_fit_loads_no_compiler() -> None:
    subprocess.run([sys.executable, "-c", _SMALL], check=True)


def test_where_nothing_can_be_kept_the_sums_are_compiled_all_the_same() -> None:
    from numba import types

    from axcomp.ident.fit._machine_code import machine_code

    # What comes from no file has no place for what is compiled.
    scope: dict[str, object] = {}
    exec("def twice(x):\n    return 2.0 * x", scope)
    twice = machine_code(scope["twice"], types.float64(types.float64))
    assert twice(21.0) == 42.0

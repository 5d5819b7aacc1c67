"""Derivatives of the fit with respect to what was measured."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.typing import ArrayLike

from axcomp.ident.fit import (
    FitError,
    Samples,
    TableLayout,
    fit_table,
    fit_values,
)

COUNT = 200
UNEVEN = np.cumsum([0.0, 1.5, 2.0, 2.5, 1.0, 2.2, 1.8, 2.0, 1.6, 2.4, 2.0])
LAYOUTS = {
    "plane": TableLayout((np.arange(9.0) * 2, UNEVEN[:6])),
    "one direction": TableLayout((UNEVEN,)),
    "two directions": TableLayout((np.arange(11.0) * 2,), branches=2),
    "ring": TableLayout((UNEVEN,), periodic=True),
    "ring, two directions": TableLayout(
        (np.arange(12.0) * 2,), branches=2, periodic=True
    ),
}
layouts = pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
SMOOTHNESS = {"order 2, axis 1": 0.5, "order 4, axis 1": 0.2, "order 2, axis 2": 0.8}


class Case:
    """Readings in cells and outside the table, and one number made of the fit."""

    def __init__(self, layout: TableLayout) -> None:
        rng = np.random.default_rng(2)
        low, high = np.array([nodes[[0, -1]] for nodes in layout.nodes]).T
        self.layout = layout
        self.positions = rng.uniform(low - 3, high + 3, (COUNT, len(layout.nodes)))
        self.error = rng.normal(size=COUNT)
        self.weight = rng.uniform(0.5, 2.0, COUNT)
        self.branch = rng.integers(0, 2, COUNT) if layout.branches == 2 else None
        self.pull = jnp.asarray(rng.normal(size=layout.shape))

    @property
    def arguments(self) -> list[np.ndarray]:
        return [self.positions, self.error, self.weight]

    def values(
        self, positions: ArrayLike, error: ArrayLike, weight: ArrayLike
    ) -> jax.Array:
        return fit_values(
            self.layout, positions, error,
            smoothness=SMOOTHNESS, branch=self.branch, weight=weight,
        )  # fmt: skip

    def number(
        self, positions: ArrayLike, error: ArrayLike, weight: ArrayLike
    ) -> jax.Array:
        return jnp.sum(self.pull * self.values(positions, error, weight) ** 2)


def slope(
    function: Callable[..., jax.Array],
    arguments: list[np.ndarray],
    which: int,
    entry: tuple[int, ...],
    step: float,
) -> float:
    """Central difference over one entry of one argument."""
    results = []
    for sign in (1.0, -1.0):
        moved = [argument.copy() for argument in arguments]
        moved[which][entry] += sign * step
        results.append(float(function(*moved)))
    return (results[0] - results[1]) / (2.0 * step)


@layouts
@pytest.mark.parametrize("which", [0, 1, 2], ids=["positions", "error", "weight"])
def test_gradient_is_that_of_finite_differences(
    layout: TableLayout, which: int
) -> None:
    case = Case(layout)
    found = np.asarray(jax.grad(case.number, which)(*case.arguments))
    scale = np.abs(found).max()
    rng = np.random.default_rng(9)
    for _ in range(12):
        entry = tuple(int(rng.integers(size)) for size in found.shape)
        expected = slope(case.number, case.arguments, which, entry, 1e-5)
        # Curvature costs 1e-10 of the scale, rounding (1e-15 / 1e-5) as much.
        assert found[entry] == pytest.approx(expected, rel=1e-6, abs=1e-8 * scale)


def test_gradient_over_the_error_is_the_same_at_once() -> None:
    case = Case(LAYOUTS["plane"])
    # The fit is linear in the readings: rows of the inverse times the transposed design.
    jacobian = jax.jacrev(lambda error: case.values(case.positions, error, case.weight))
    rows = np.asarray(jacobian(case.error))
    seen = np.asarray(case.values(case.positions, case.error, case.weight))
    np.testing.assert_allclose(rows @ case.error, seen, atol=1e-12)


@layouts
def test_readings_outside_the_table_do_not_feel_their_place(
    layout: TableLayout,
) -> None:
    case = Case(layout)
    found = np.asarray(jax.grad(case.number, 0)(*case.arguments))
    for axis, nodes in enumerate(layout.nodes):
        x = case.positions[:, axis]
        beyond = (x < nodes[0]) | (x > nodes[-1])
        assert beyond.any()
        if layout.periodic:
            assert np.abs(found[beyond, axis]).min() > 0
        else:
            assert not found[beyond, axis].any()


@layouts
def test_reading_at_a_node_takes_the_slope_of_the_cell_that_begins_there(
    layout: TableLayout,
) -> None:
    case = Case(layout)
    axis = len(layout.nodes) - 1
    nodes = layout.nodes[axis]
    case.positions[0, axis] = nodes[3]
    case.positions[1, axis] = nodes[0]
    case.positions[2, axis] = nodes[-1]
    found = np.asarray(jax.grad(case.number, 0)(*case.arguments))[:3, axis]

    def ahead(row: int) -> float:
        results = []
        # One-sided, second order: values at x, x + h and x + 2h.
        for steps in (0, 1, 2):
            moved = case.positions.copy()
            moved[row, axis] += 1e-5 * steps
            results.append(float(case.number(moved, *case.arguments[1:])))
        return (-3 * results[0] + 4 * results[1] - results[2]) / 2e-5

    for row in (0, 1, 2):
        # The third derivative costs 1e-10, rounding 1e-15 × 10 / 1e-5.
        assert found[row] == pytest.approx(ahead(row), rel=1e-6, abs=1e-7)
    # At the last node that is the held edge, or the first cell of the next turn.
    assert (found[2] == 0.0) == (not layout.periodic)


@layouts
def test_jit_changes_nothing(layout: TableLayout) -> None:
    case = Case(layout)
    plain = case.values(*case.arguments)
    np.testing.assert_array_equal(jax.jit(case.values)(*case.arguments), plain)
    gradient = jax.grad(case.number, (0, 1, 2))
    for compiled, eager in zip(
        jax.jit(gradient)(*case.arguments), gradient(*case.arguments), strict=True
    ):
        # XLA may fuse the sum over the nodes in another order.
        np.testing.assert_allclose(compiled, eager, rtol=1e-12, atol=1e-14)


def test_vmap_is_a_loop() -> None:
    case = Case(LAYOUTS["two directions"])
    batch = jnp.stack([case.error, 2 * case.error, case.error[::-1]])

    def one(error: jax.Array) -> jax.Array:
        return case.values(case.positions, error, case.weight)

    def rise(error: jax.Array) -> jax.Array:
        return case.number(case.positions, error, case.weight)

    np.testing.assert_array_equal(
        jax.vmap(one)(batch), jnp.stack([one(row) for row in batch])
    )
    np.testing.assert_array_equal(
        jax.vmap(jax.grad(rise))(batch),
        jnp.stack([jax.grad(rise)(row) for row in batch]),
    )


@layouts
def test_values_are_those_of_fit_table(layout: TableLayout) -> None:
    case = Case(layout)
    samples = Samples(case.positions, case.error, case.branch, case.weight)
    for smoothness in (0.0, 0.7, SMOOTHNESS):
        fit = fit_table(layout, samples, smoothness=smoothness, loss="gauss")
        values = fit_values(
            layout, case.positions, case.error,
            smoothness=smoothness, branch=case.branch, weight=case.weight,
        )  # fmt: skip
        # The table fit starts from the median; rounding × condition, below 1e5 here.
        np.testing.assert_allclose(values, fit.values, atol=1e-10)


def test_many_readings_take_the_compiled_way_to_the_same_values() -> None:
    rng = np.random.default_rng(4)
    layout = TableLayout((np.arange(9.0) * 2, UNEVEN[:6]))
    count = 140_000
    positions = rng.uniform((-1.0, -1.0), (17.0, 10.0), (count, 2))
    error = np.sin(positions[:, 0]) + rng.normal(size=count)
    values = fit_values(layout, positions, error, smoothness=0.7)
    fit = fit_table(layout, Samples(positions, error), smoothness=0.7, loss="gauss")
    # 140 000 numbers of size 1 in another order.
    np.testing.assert_allclose(values, fit.values, atol=1e-11)


@pytest.mark.parametrize("kind", [np.int8, np.int32, np.int64, bool])
def test_direction_may_be_any_integer(kind: type) -> None:
    case = Case(LAYOUTS["two directions"])
    assert case.branch is not None
    plain = case.values(*case.arguments)
    case.branch = case.branch.astype(kind)
    np.testing.assert_array_equal(case.values(*case.arguments), plain)


def test_gradient_descends_to_positions_that_explain_the_readings() -> None:
    layout = TableLayout((np.arange(6.0),))
    rng = np.random.default_rng(0)
    true = np.sort(rng.uniform(0.2, 4.8, 40))
    error = np.interp(true, np.arange(6.0), [0.0, 1.0, 0.5, 2.0, 1.0, 1.5])

    def cost(shift: jax.Array) -> jax.Array:
        # An offset of the scale, found through the fit from the residuals it leaves.
        place = jnp.asarray(true)[:, None] - 0.1 + shift
        values = fit_values(layout, place, error, smoothness=1e-3)
        seen = jnp.interp(place[:, 0], jnp.arange(6.0), values)
        return jnp.sum((error - seen) ** 2)

    shift = jnp.asarray(0.0)
    for _ in range(15):
        shift = shift - 0.03 * jax.grad(cost)(shift)
    # The small smoothness draws a little: 1 % of the 0.1 mm to be found.
    assert float(shift) == pytest.approx(0.1, abs=1e-3)


def test_undetermined_table_is_refused() -> None:
    layout = TableLayout((np.arange(5.0),), branches=2)
    x = np.linspace(0, 4, 20)[:, None]
    with pytest.raises(FitError, match="do not determine the table"):
        fit_values(layout, x, x[:, 0], smoothness=1.0, branch=np.zeros(20, np.int64))

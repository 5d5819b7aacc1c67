from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import EquidistantNodes, ModuloNodes, Plane, Setpoints

START, INTERVAL = (-40.0, -70.0), (10.0, 2.5)
ROUNDING = 1e-14  # a few roundings of a sum of four products of numbers around 1


def values(rows: int = 7, columns: int = 5, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, columns))


def plane(table: np.ndarray | None = None) -> Plane:
    return Plane.rectangular(START, INTERVAL, values() if table is None else table)


def positions(count: int, seed: int = 2) -> np.ndarray:
    """Positions inside and, about every third, outside of the table of `plane()`."""
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(-50, 10, count), rng.uniform(-73, -51, count)], axis=1)


def bilinear_by_hand(table: np.ndarray, x: float, y: float) -> float:
    """Bilinear value, one sample at a time, written out from [001] p.38 and p.40."""
    rows, columns = table.shape
    u = min(max((x - START[0]) / INTERVAL[0], 0.0), columns - 1.0)
    v = min(max((y - START[1]) / INTERVAL[1], 0.0), rows - 1.0)
    i, j = min(int(u), columns - 2), min(int(v), rows - 2)
    f, g = u - i, v - j
    lower = (1 - f) * table[j, i] + f * table[j, i + 1]
    upper = (1 - f) * table[j + 1, i] + f * table[j + 1, i + 1]
    return float((1 - g) * lower + g * upper)


def test_evaluation_agrees_with_a_bilinear_look_up_written_out_by_hand() -> None:
    places = positions(500)
    expected = [bilinear_by_hand(values(), x, y) for x, y in places]
    np.testing.assert_allclose(plane().entry(places), expected, rtol=0, atol=ROUNDING)


def test_values_of_a_small_example_computed_by_hand() -> None:
    small = Plane.quadratic((0.0, 0.0), 10.0, np.array([[0.0, 1.0], [2.0, 7.0]]))
    places = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 5.0], [5.0, 5.0], [2.5, 7.5]])
    # The last one: 0.75 * (0.25 * 0 + ... ) row 0: 0.25; row 1: 2 + 0.25 * 5 = 3.25.
    expected = [0.0, 0.5, 1.0, 2.5, 0.25 * 0.25 + 0.75 * 3.25]
    np.testing.assert_allclose(small.entry(places), expected, rtol=0, atol=ROUNDING)


def test_first_index_of_the_table_belongs_to_master_2() -> None:
    small = Plane.quadratic((0.0, 0.0), 10.0, np.array([[0.0, 0.0], [1.0, 1.0]]))
    np.testing.assert_array_equal(
        small.entry(np.array([[10.0, 0.0], [0.0, 10.0]])), [0.0, 1.0]
    )


def test_every_node_position_gives_exactly_the_node_value() -> None:
    # Intervals without an exact binary form: the sums below are rounded.
    table = values(40, 60)
    model = Plane.rectangular((-17.3, 0.1), (0.1, 0.3), table)
    x = -17.3 + np.arange(60) * 0.1
    y = 0.1 + np.arange(40) * 0.3
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    np.testing.assert_array_equal(model.entry(grid), table.reshape(-1))


def test_outside_the_table_the_edge_is_held() -> None:
    table = values()
    far = np.array([[-1e6, -1e6], [1e6, -1e6], [-1e6, 1e6], [1e6, 1e6], [-35.0, 1e6]])
    expected = [table[0, 0], table[0, -1], table[-1, 0], table[-1, -1]]
    found = plane().entry(far)
    np.testing.assert_array_equal(found[:4], expected)
    # The mean of two values: one rounding.
    assert abs(found[4] - (table[-1, 0] + table[-1, 1]) / 2) < ROUNDING


def test_offset_is_the_entry_times_the_sign() -> None:
    places = positions(20)
    turned = eqx.tree_at(lambda p: p.values, plane(), -plane().values)
    opposite = Plane(plane().nodes1, plane().nodes2, plane().values, sign=-1.0)
    np.testing.assert_array_equal(plane().offset(places), plane().entry(places))
    np.testing.assert_array_equal(opposite.offset(places), turned.entry(places))


def test_quadratic_and_rectangular_grids_of_equal_interval_agree() -> None:
    places = positions(50)
    np.testing.assert_array_equal(
        Plane.quadratic(START, 10.0, values()).entry(places),
        Plane.rectangular(START, (10.0, 10.0), values()).entry(places),
    )


def test_a_plane_over_given_setpoints_agrees_with_an_equidistant_one() -> None:
    model = plane()
    same = Plane(
        Setpoints(model.nodes1.positions),
        Setpoints(model.nodes2.positions),
        model.values,
    )
    places = positions(200)
    np.testing.assert_allclose(
        same.entry(places), model.entry(places), rtol=0, atol=ROUNDING
    )


def test_a_modulo_master_is_wrapped_into_its_range() -> None:
    nodes = EquidistantNodes(0.0, 90.0, 5)
    table = np.array([[0.0, 1.0, 2.0, 3.0, 0.0]])
    model = Plane(ModuloNodes(nodes), EquidistantNodes(0.0, 1.0, 1), table)
    places = np.array([[45.0, 0.0], [405.0, 0.0], [-315.0, 0.0], [360.0, 0.0]])
    np.testing.assert_allclose(
        model.entry(places), [0.5, 0.5, 0.5, 0.0], rtol=0, atol=ROUNDING
    )


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (4, 1)])
def test_an_axis_with_one_node_is_constant_along_it(shape: tuple[int, int]) -> None:
    table = values(*shape)
    model = Plane.quadratic((0.0, 0.0), 1.0, table)
    places = np.array([[0.0, 0.0], [1e3, 1e3], [-1e3, -1e3]])
    expected = [table[0, 0], table[-1, -1], table[0, 0]]
    np.testing.assert_array_equal(model.entry(places), expected)
    np.testing.assert_array_equal(
        model.stencil(places)(model.values.reshape(-1)), expected
    )


def test_no_positions_give_no_values_and_a_zero_gradient() -> None:
    none = np.zeros((0, 2))
    assert plane().entry(none).shape == (0,)
    assert plane().stencil(none).nodes.shape == (0, 4)
    slope = jax.jit(jax.grad(lambda m: jnp.sum(m.entry(none))))(plane()).values
    np.testing.assert_array_equal(slope, np.zeros((7, 5)))


def test_a_position_that_is_not_a_number_gives_none_and_harms_no_other() -> None:
    places = positions(6)
    places[2, 0] = np.nan
    found = np.asarray(plane().entry(places))
    assert np.isnan(found[2])
    assert np.isfinite(np.delete(found, 2)).all()


# ------------------------------------------------------------------------- derivatives


# Compiled: one compilation instead of one for each operation and shape.
SLOPES = jax.jit(jax.grad(lambda model, p: jnp.sum(model.entry(p)), argnums=1))


def slopes(model: Plane, places: np.ndarray) -> np.ndarray:
    """Derivative of each value with respect to its own two positions."""
    return np.asarray(SLOPES(model, jnp.asarray(places)))


def differences(model: Plane, places: np.ndarray, step: float) -> np.ndarray:
    """Difference quotients from each position to `step` beyond it, per axis."""
    base = model.entry(places)
    moved = [model.entry(places + step * np.eye(2)[axis]) for axis in (0, 1)]
    return np.stack([(np.asarray(m) - base) / step for m in moved], axis=1)


def test_gradient_in_cells_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(3)
    cells = rng.integers(0, (4, 6), (50, 2)) + rng.uniform(0.05, 0.95, (50, 2))
    places = np.array(START) + cells * np.array(INTERVAL)
    # Linear along each axis inside a cell: only rounding, 1e-16 / 1e-3, is left.
    np.testing.assert_allclose(
        slopes(plane(), places), differences(plane(), places, 1e-3), rtol=0, atol=1e-11
    )


def test_gradient_at_nodes_is_that_of_the_cell_which_begins_there() -> None:
    model = plane()
    i, j = np.meshgrid(np.arange(5), np.arange(7))
    places = np.stack(
        [START[0] + i * INTERVAL[0], START[1] + j * INTERVAL[1]], axis=-1
    ).reshape(-1, 2)
    # A step to the right stays in the cell, or outside at the last node: slope 0.
    expected = differences(model, places, 1e-3)
    np.testing.assert_allclose(slopes(model, places), expected, rtol=0, atol=1e-11)
    last = places[:, 0] == places[:, 0].max()
    np.testing.assert_array_equal(slopes(model, places)[last, 0], 0.0)


def test_gradient_outside_the_table_is_zero_across_the_edge() -> None:
    outside = np.array([[-41.0, -60.0], [0.1, -60.0]])
    np.testing.assert_array_equal(slopes(plane(), outside)[:, 0], 0.0)
    np.testing.assert_allclose(
        slopes(plane(), outside),
        differences(plane(), outside, 1e-3),
        rtol=0,
        atol=1e-11,
    )


def test_rounded_node_positions_take_the_derivative_to_their_right() -> None:
    table = np.cumsum(np.arange(60.0))[None, :]  # every cell has another slope
    model = Plane.rectangular((-17.3, 0.0), (0.1, 1.0), table)
    places = np.stack([-17.3 + np.arange(60) * 0.1, np.zeros(60)], axis=1)
    expected = np.append(np.diff(table[0]), 0.0) / 0.1
    np.testing.assert_allclose(slopes(model, places)[:, 0], expected, rtol=1e-12)


def test_derivative_with_respect_to_the_values_is_the_weight_of_the_node() -> None:
    places = jnp.asarray(positions(40))
    stencil = plane().stencil(places)
    dense = np.zeros((40, 35))
    np.add.at(dense, (np.arange(40)[:, None], stencil.nodes), stencil.weights)

    def flat(table: jax.Array) -> jax.Array:
        return Plane(plane().nodes1, plane().nodes2, table.reshape(7, 5)).entry(places)

    table = plane().values.reshape(-1)
    for way in (jax.jacfwd, jax.jacrev):
        jacobian = jax.jit(way(flat))(table)
        np.testing.assert_allclose(jacobian, dense, rtol=0, atol=ROUNDING)


def test_gradient_with_respect_to_start_and_interval_agrees_with_differences() -> None:
    places = positions(40)

    @jax.jit
    def total(model: Plane) -> jax.Array:
        return jnp.sum(model.entry(places) ** 2)

    found = jax.jit(jax.grad(total))(plane()).nodes1
    for name in ("start", "interval"):

        def moved(by: float, name: str = name) -> float:
            at = getattr(plane().nodes1, name) + by
            return float(
                total(eqx.tree_at(lambda p: getattr(p.nodes1, name), plane(), at))
            )

        step = 1e-6  # central: h² · f''' plus rounding 1e-16 · 40 / h
        quotient = (moved(step) - moved(-step)) / (2 * step)
        assert abs(getattr(found, name) - quotient) < 1e-6


def test_second_derivative_with_respect_to_the_values_is_zero() -> None:
    places = jnp.asarray(positions(5))

    def flat(table: jax.Array) -> jax.Array:
        return jnp.sum(Plane(plane().nodes1, plane().nodes2, table).entry(places))

    for second in (
        jax.jacfwd(jax.grad(flat)),
        jax.jacrev(jax.grad(flat)),
        jax.jacfwd(jax.jacfwd(flat)),
    ):
        found = jax.jit(second)(plane().values)
        np.testing.assert_array_equal(found, np.zeros((7, 5, 7, 5)))


def test_mixed_second_derivatives_agree_whichever_way_they_are_taken() -> None:
    places = jnp.asarray(positions(6))

    def cubes(table: jax.Array, at: jax.Array) -> jax.Array:
        return jnp.sum(Plane(plane().nodes1, plane().nodes2, table).entry(at) ** 3)

    ways = [
        jax.jit(outer(inner(cubes, 0), 1))(plane().values, places)
        for outer in (jax.jacfwd, jax.jacrev)
        for inner in (jax.jacfwd, jax.jacrev)
    ]
    for way in ways[1:]:
        # Sums of a few products of size 1 to 10.
        np.testing.assert_allclose(way, ways[0], rtol=0, atol=1e-12)


# --------------------------------------------------------------- transformations of JAX


def test_jit_gives_what_eager_gives() -> None:
    places = jnp.asarray(positions(300))
    compiled = jax.jit(lambda model, p: model.entry(p))(plane(), places)
    # XLA may contract a product and a sum into one rounding.
    np.testing.assert_allclose(compiled, plane().entry(places), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("mapped", ["tables", "positions", "both", "nodes"])
def test_vmap_gives_what_a_loop_gives(mapped: str) -> None:
    tables = jnp.asarray(np.stack([values(seed=seed) for seed in range(3)]))
    places = jnp.asarray(np.stack([positions(11, seed) for seed in range(3)]))
    starts = jnp.asarray([-40.0, -35.0, -47.5])

    def one(table: jax.Array, at: jax.Array, start: jax.Array) -> tuple[Any, ...]:
        model = Plane(EquidistantNodes(start, 10.0, 5), plane().nodes2, table)
        value, slope = jax.value_and_grad(lambda m: jnp.sum(m.entry(at) ** 2))(model)
        return value, slope.values, model.entry(at)

    axes = {
        "tables": (0, None, None),
        "positions": (None, 0, None),
        "both": (0, 0, None),
        "nodes": (None, None, 0),
    }[mapped]
    arguments = [
        stack if axis == 0 else stack[0]
        for stack, axis in zip((tables, places, starts), axes, strict=True)
    ]
    together = jax.jit(jax.vmap(one, in_axes=axes))(*arguments)
    alone = jax.jit(one)
    for lane in range(3):
        single = alone(
            *(
                a[lane] if axis == 0 else a
                for a, axis in zip(arguments, axes, strict=True)
            )
        )
        for found, expected in zip(together, single, strict=True):
            # Sums over 11 samples in another order.
            np.testing.assert_allclose(found[lane], expected, rtol=0, atol=1e-13)


def test_gradient_of_a_vmap_is_the_sum_of_gradients() -> None:
    places = jnp.asarray(np.stack([positions(11, seed) for seed in range(3)]))

    def total(model: Plane) -> jax.Array:
        return jnp.sum(jax.vmap(model.entry)(places) ** 2)

    def looped(model: Plane) -> jax.Array:
        return sum((jnp.sum(model.entry(p) ** 2) for p in places), jnp.zeros(()))

    np.testing.assert_allclose(
        # 33 samples in another order.
        jax.jit(jax.grad(total))(plane()).values,
        jax.jit(jax.grad(looped))(plane()).values,
        rtol=0,
        atol=1e-13,
    )


# ------------------------------------------------------------------ promises, refusals


@settings(max_examples=60, deadline=None)
@given(x=st.floats(-1e9, 1e9), y=st.floats(-1e9, 1e9), seed=st.integers(0, 5))
def test_the_range_of_the_table_is_never_exceeded(
    x: float, y: float, seed: int
) -> None:
    table = values(seed=seed)
    found = float(plane(table).entry(np.array([[x, y]]))[0])
    # Weights that sum up to 1 within a few roundings.
    assert table.min() - ROUNDING <= found <= table.max() + ROUNDING


@settings(max_examples=60, deadline=None)
@given(x=st.floats(-60, 20), y=st.floats(-80, -40), step=st.floats(-1e-6, 1e-6))
def test_values_are_continuous_everywhere(x: float, y: float, step: float) -> None:
    table = values()
    here, there = plane(table).entry(np.array([[x, y], [x + step, y + step]]))
    steepest = np.ptp(table) * (1 / INTERVAL[0] + 1 / INTERVAL[1])
    # Lipschitz, plus rounding of positions (1e-14 mm) and values.
    assert abs(here - there) <= steepest * (abs(step) + 1e-13) + ROUNDING


def test_values_of_another_shape_are_refused() -> None:
    nodes = EquidistantNodes(0.0, 1.0, 3)
    with pytest.raises(ValueError, match=r"master 2.*\(4, 3\), got shape \(3, 4\)"):
        Plane(nodes, EquidistantNodes(0.0, 1.0, 4), np.zeros((3, 4)))

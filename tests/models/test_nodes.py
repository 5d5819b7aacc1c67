import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import (
    AbstractNodes,
    EquidistantNodes,
    ModuloNodes,
    Setpoints,
)

EVEN = EquidistantNodes(-10.0, 2.5, 5)
UNEVEN = Setpoints(np.array([-10.0, -9.0, -2.0, 0.0]))


@pytest.mark.parametrize(
    ("nodes", "position", "cell", "share"),
    [
        (EVEN, -10.0, 0, 0.0),
        (EVEN, -8.0, 0, 0.8),
        (EVEN, -7.5, 1, 0.0),
        (EVEN, 0.0, 3, 1.0),
        (EVEN, 99.0, 3, 1.0),
        (EVEN, -99.0, 0, 0.0),
        (UNEVEN, -9.0, 1, 0.0),
        (UNEVEN, -5.5, 1, 0.5),
        (UNEVEN, 0.0, 2, 1.0),
        (UNEVEN, 99.0, 2, 1.0),
        (UNEVEN, -99.0, 0, 0.0),
        (Setpoints(np.array([4.0])), 7.0, 0, 0.0),
        (EquidistantNodes(4.0, 1.0, 1), 7.0, 0, 0.0),
    ],
)
def test_a_position_lies_in_the_cell_that_begins_at_or_before_it(
    nodes: AbstractNodes, position: float, cell: int, share: float
) -> None:
    found_cell, found_share = nodes.locate(jnp.array([position]))
    assert int(found_cell[0]) == cell
    # One subtraction and one product.
    assert abs(float(found_share[0]) - share) < 1e-15


def test_positions_of_equidistant_nodes_start_at_start() -> None:
    np.testing.assert_array_equal(EVEN.positions, [-10.0, -7.5, -5.0, -2.5, 0.0])


@pytest.mark.parametrize("start", [-4000.0, -0.7, 0.0, 1e4])
@pytest.mark.parametrize("interval", [0.1, 1 / 3, 7.3])
def test_rounded_node_positions_are_found_as_nodes(
    start: float, interval: float
) -> None:
    nodes = EquidistantNodes(start, interval, 3000)
    number = np.arange(3000)
    for positions in (start + number * interval, np.asarray(nodes.positions)):
        np.testing.assert_array_equal(nodes.coordinate(jnp.asarray(positions)), number)


@pytest.mark.parametrize("nodes", [EVEN, UNEVEN])
def test_derivative_of_the_place_is_the_right_hand_one(nodes: AbstractNodes) -> None:
    positions = np.asarray(nodes.positions)
    at = np.concatenate([positions, [positions[0] - 1, positions[-1] + 1]])
    expected = np.concatenate([1 / np.diff(positions), [0.0, 0.0, 0.0]])
    found = jax.vmap(jax.grad(lambda x: nodes.coordinate(x[None])[0]))(jnp.asarray(at))
    # A quotient of two exact numbers.
    np.testing.assert_allclose(found, expected, rtol=1e-15)


def test_derivative_of_the_place_with_respect_to_setpoints() -> None:
    def place(points: jax.Array) -> jax.Array:
        return Setpoints(points).coordinate(jnp.array([-5.5]))[0]

    # (x - p1) / (p2 - p1) at x = -5.5, p1 = -9, p2 = -2.
    expected = [0.0, -3.5 / 49.0, -3.5 / 49.0, 0.0]
    np.testing.assert_allclose(jax.grad(place)(UNEVEN.points), expected, rtol=1e-14)


def test_both_ends_are_covered_and_nothing_beyond() -> None:
    at = jnp.array([-10.0, 0.0, -10.001, 0.001, np.nan])
    for nodes in (EVEN, UNEVEN):
        np.testing.assert_array_equal(
            nodes.covers(at), [True, True, False, False, False]
        )


def test_modulo_positions_are_wrapped_with_the_upper_end_excluded() -> None:
    nodes = ModuloNodes(EquidistantNodes(0.0, 90.0, 5))
    at = jnp.array([0.0, 360.0, -90.0, 810.0, -1e-20])
    np.testing.assert_array_equal(nodes.wrap(at), [0.0, 0.0, 270.0, 90.0, 0.0])
    np.testing.assert_array_equal(nodes.covers(at), np.full(5, True))
    assert nodes.count == 5


def test_a_given_modulo_range_counts_before_that_of_the_nodes() -> None:
    nodes = ModuloNodes(EquidistantNodes(0.0, 90.0, 4), (-180.0, 180.0))
    # 350° is -10°, before the first node at 0°: held there.
    np.testing.assert_array_equal(
        nodes.coordinate(jnp.array([350.0, 90.0])), [0.0, 1.0]
    )
    np.testing.assert_array_equal(nodes.covers(jnp.array([350.0, 90.0])), [False, True])


@pytest.mark.parametrize("interval", [0.0, -1.0, np.nan])
def test_an_interval_that_is_not_positive_is_refused(interval: float) -> None:
    with pytest.raises(ValueError, match="interval must be positive"):
        EquidistantNodes(0.0, interval, 3)


def test_a_table_without_nodes_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one node, got count = 0"):
        EquidistantNodes(0.0, 1.0, 0)
    with pytest.raises(ValueError, match=r"list of positions, got shape \(0,\)"):
        Setpoints(np.zeros(0))


@pytest.mark.parametrize(
    "points", [[0.0, 2.0, 2.0], [0.0, 2.0, 1.0], [0.0, 2.0, np.nan]]
)
def test_setpoints_that_do_not_ascend_are_refused(points: list[float]) -> None:
    with pytest.raises(ValueError, match=r"points must ascend, got 2.0 at index 1"):
        Setpoints(np.array(points))


def test_a_modulo_range_that_cannot_be_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"must ascend, got \(360.0, 0.0\)"):
        ModuloNodes(EVEN, (360.0, 0.0))
    with pytest.raises(ValueError, match="single node leaves the modulo range open"):
        ModuloNodes(EquidistantNodes(0.0, 1.0, 1))

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from axcomp.models import EquidistantNodes, ExternalCompensation, VolumetricGrid

START, INTERVAL = (-40.0, 0.0, 100.0), (10.0, 2.5, 50.0)
ROUNDING = 1e-14  # a few roundings of a sum of eight products of numbers around 1


def values(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(3, 4, 5, 6))


def grid() -> VolumetricGrid:
    return VolumetricGrid.regular(START, INTERVAL, values())


def positions(count: int, seed: int = 2) -> np.ndarray:
    """Positions inside and, about every second, outside of `grid`."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-45, -1, 80.0]), np.array([15, 11, 270.0])
    return rng.uniform(low, high, (count, 3))


def test_evaluation_agrees_with_the_trilinear_look_up_of_another_library() -> None:
    nodes = [np.asarray(each.positions) for each in reversed(grid().nodes)]
    places = positions(500)
    inside = np.clip(places[:, ::-1], *np.array([[n[0], n[-1]] for n in nodes]).T)
    expected = [RegularGridInterpolator(nodes, own)(inside) for own in values()]
    np.testing.assert_allclose(
        grid().entry(places), np.transpose(expected), rtol=0, atol=ROUNDING
    )


def test_each_node_position_gives_exactly_the_node_values() -> None:
    x, y, z = (np.asarray(each.positions) for each in grid().nodes)
    k, j, i = (each.ravel() for each in np.indices((4, 5, 6)))
    places = np.stack([x[i], y[j], z[k]], axis=1)
    np.testing.assert_array_equal(grid().entry(places), values().reshape(3, -1).T)


def test_the_stencil_gives_the_same_values_from_eight_nodes() -> None:
    places = positions(100)
    stencil = grid().stencil(places)
    assert stencil.nodes.shape == (100, 8)
    for column, own in zip(grid().entry(places).T, values(), strict=True):
        np.testing.assert_allclose(
            stencil(jnp.asarray(own.reshape(-1))), column, rtol=0, atol=ROUNDING
        )


def test_tables_of_some_axes_leave_the_others_at_zero() -> None:
    only = VolumetricGrid.regular(START, INTERVAL, values()[:1], axes=(2,), sign=-1.0)
    places = positions(20)
    expected = np.zeros((20, 3))
    expected[:, 2] = -np.asarray(grid().entry(places))[:, 0]
    np.testing.assert_array_equal(only.offset(places), expected)


def test_derivatives_of_positions_and_values_are_those_of_the_cell() -> None:
    place, step = np.array([[-33.0, 3.1, 170.0]]), 1e-3
    model = grid()
    slopes = jax.jit(jax.jacfwd(lambda p: model.offset(p)[0]))(place)[:, 0]
    for axis in range(3):
        ends = [
            grid().offset(place + side * step * np.eye(3)[axis]) for side in (1, -1)
        ]
        # Linear along each axis inside a cell: only rounding is left.
        np.testing.assert_allclose(
            slopes[:, axis], (ends[0] - ends[1])[0] / (2 * step), rtol=0, atol=1e-11
        )

    def total(model: VolumetricGrid) -> jax.Array:
        return jnp.sum(model.entry(place))

    share = jax.jit(jax.grad(total))(grid()).values
    spread = grid().stencil(place).spread(jnp.ones(1)).reshape(4, 5, 6)
    np.testing.assert_allclose(share, np.stack([spread] * 3), rtol=0, atol=ROUNDING)


def test_a_batch_of_grids_gives_what_each_gives_alone() -> None:
    tables = jnp.stack([jnp.asarray(values(seed)) for seed in (1, 2)])
    both = eqx.filter_vmap(lambda v: VolumetricGrid(grid().nodes, v).offset(PLACES))
    alone = [VolumetricGrid(grid().nodes, v).offset(PLACES) for v in tables]
    np.testing.assert_array_equal(both(tables), np.stack(alone))


PLACES = positions(9)


def test_a_grid_acts_as_an_external_compensation() -> None:
    small = VolumetricGrid.regular(START, INTERVAL, 1e-2 * values())
    compensation = ExternalCompensation(small.offset)
    start = compensation.start(PLACES)
    # `start` promises the position to 1e-9 mm.
    back = start.positions + compensation.offsets(start.positions)
    np.testing.assert_allclose(back, PLACES, rtol=0, atol=1e-9)


@pytest.mark.parametrize("axes", [(0, 1, 1), (1, 0, 2), (0, 1, 3)])
def test_axes_that_are_not_three_of_x_y_z_are_refused(axes: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="axes must ascend"):
        VolumetricGrid.regular(START, INTERVAL, values(), axes)


def test_tables_that_do_not_fit_the_nodes_are_refused() -> None:
    nodes = EquidistantNodes(0.0, 1.0, 2)
    with pytest.raises(ValueError, match=r"\(3, 2, 2, 2\), got shape \(3, 2, 2, 3\)"):
        VolumetricGrid((nodes, nodes, nodes), np.zeros((3, 2, 2, 3)))

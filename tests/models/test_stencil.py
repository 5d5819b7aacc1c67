"""Stencil and kernel: the same table look-up, once stored and once fused."""

import pickle
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import (
    Cross,
    EquidistantNodes,
    Leadscrew,
    ModuloNodes,
    Plane,
    Setpoints,
    interpolate,
)
from axcomp.models._kernels import CHUNK

RNG_SEED = 11
TABLE = np.random.default_rng(RNG_SEED).normal(size=(13, 9))
PLANE = Plane.rectangular((-40.0, -70.0), (10.0, 2.5), TABLE)
SIZES = [
    *(0, CHUNK, 3 * CHUNK + 17),
    *(
        pytest.param(count, marks=pytest.mark.heavy)
        for count in (1, 2, 1000, CHUNK - 1, CHUNK + 1)
    ),
]


def samples(count: int) -> tuple[jax.Array, jax.Array]:
    rng = np.random.default_rng(RNG_SEED)
    places = np.stack(
        [rng.uniform(-50, 50, count), rng.uniform(-75, -35, count)], axis=1
    )
    return jnp.asarray(places), jnp.asarray(rng.normal(size=count))


@pytest.mark.parametrize("count", SIZES)
def test_kernel_and_stencil_give_one_value_and_one_sum_for_any_size(count: int) -> None:
    places, amounts = samples(count)
    stencil = PLANE.stencil(places)

    @jax.jit
    def value_and_sum(
        values: jax.Array, at: jax.Array, by: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        def entry(v: jax.Array) -> jax.Array:
            return Plane(PLANE.nodes1, PLANE.nodes2, v).entry(at)

        value, back = jax.vjp(entry, values)
        return value, back(by)[0].reshape(-1)

    by_kernel, summed = value_and_sum(PLANE.values, places, amounts)
    by_stencil = stencil(PLANE.values.reshape(-1))
    np.testing.assert_allclose(by_kernel, by_stencil, rtol=0, atol=1e-14)
    spread = np.zeros(TABLE.size)
    np.add.at(spread, np.asarray(stencil.nodes), stencil.weights * amounts[:, None])
    # Each node sums count/30 numbers of size 1 in another order.
    tolerance = 1e-14 * max(1.0, count / 300)
    np.testing.assert_allclose(summed, spread, rtol=0, atol=tolerance)
    np.testing.assert_allclose(stencil.spread(amounts), spread, rtol=0, atol=tolerance)


def test_weights_sum_up_to_one() -> None:
    places, _ = samples(1000)
    # Four products whose exact sum is 1.
    np.testing.assert_allclose(
        jnp.sum(PLANE.stencil(places).weights, axis=1), 1.0, rtol=0, atol=1e-15
    )


def test_nodes_of_a_plane_are_the_corners_of_the_cell_with_master_1_running_fast() -> (
    None
):
    stencil = PLANE.stencil(np.array([[-15.0, -60.0]]))
    corner = 4 * 9 + 2
    np.testing.assert_array_equal(
        stencil.nodes, [[corner, corner + 1, corner + 9, corner + 10]]
    )
    np.testing.assert_array_equal(stencil.weights, [[0.5, 0.5, 0.0, 0.0]])
    assert stencil.size == 13 * 9


def test_weights_are_differentiable_in_the_positions() -> None:
    places, _ = samples(50)
    values = PLANE.values.reshape(-1)
    by_stencil = jax.jit(jax.grad(lambda p: jnp.sum(PLANE.stencil(p)(values) ** 2)))
    by_kernel = jax.jit(jax.grad(lambda p: jnp.sum(PLANE.entry(p) ** 2)))
    # Products of a few numbers of size 1.
    np.testing.assert_allclose(
        by_kernel(places), by_stencil(places), rtol=0, atol=1e-13
    )


def test_a_stack_of_tables_is_looked_up_table_by_table() -> None:
    first, second = np.arange(4.0), 10.0 + np.arange(4.0)
    found = interpolate(
        jnp.asarray(np.concatenate([first, second])),
        (jnp.array([0.5, 0.5, 3.0]),),
        (4,),
        jnp.array([0, 1, 1]),
    )
    np.testing.assert_array_equal(found, [0.5, 10.5, 13.0])


def test_forward_and_reverse_mode_agree_beyond_one_chunk() -> None:
    places, amounts = samples(CHUNK + 5)

    def entry(table: jax.Array) -> jax.Array:
        return Plane(PLANE.nodes1, PLANE.nodes2, table).entry(places)

    direction = jnp.asarray(np.random.default_rng(3).normal(size=TABLE.shape))
    forward = jnp.vdot(amounts, jax.jvp(entry, (PLANE.values,), (direction,))[1])
    reverse = jnp.vdot(jax.vjp(entry, PLANE.values)[1](amounts)[0], direction)
    # A sum of 65 000 numbers of size 1 in another order.
    assert abs(forward - reverse) < 1e-9


def test_reverse_over_reverse_goes_through_the_chunks() -> None:
    places, _ = samples(CHUNK + 5)

    def steepness(at: jax.Array) -> jax.Array:
        gradient = jax.grad(
            lambda v: jnp.sum(Plane(PLANE.nodes1, PLANE.nodes2, v).entry(at) ** 2)
        )(PLANE.values)
        return jnp.sum(gradient**2) / CHUNK

    def plainly(at: jax.Array) -> jax.Array:
        stencil = PLANE.stencil(at)
        gradient = 2 * stencil.spread(stencil(PLANE.values.reshape(-1)))
        return jnp.sum(gradient**2) / CHUNK

    # Node sums of about 600 samples, multiplied once more.
    np.testing.assert_allclose(
        jax.jit(jax.grad(steepness))(places),
        jax.jit(jax.grad(plainly))(places),
        rtol=0,
        atol=1e-12,
    )


@pytest.mark.parametrize(
    "model",
    [
        PLANE,
        Cross(Setpoints(np.array([0.0, 1.0, 3.0])), np.array([0.0, 1.0, 0.5])),
        Leadscrew(EquidistantNodes(0.0, 1.0, 3), np.ones(3), np.zeros(3)),
        Leadscrew(EquidistantNodes(0.0, 180.0, 3), np.ones(3), modulo=True),
        Plane(
            ModuloNodes(EquidistantNodes(0.0, 180.0, 3), (0.0, 360.0)),
            EquidistantNodes(0.0, 1.0, 1),
            np.ones((1, 3)),
        ),
        PLANE.stencil(np.zeros((2, 2))),
    ],
)
def test_models_survive_pickling(model: Any) -> None:
    copy = pickle.loads(pickle.dumps(model))
    leaves, structure = jax.tree.flatten(copy)
    own_leaves, own_structure = jax.tree.flatten(model)
    assert structure == own_structure
    for leaf, own in zip(leaves, own_leaves, strict=True):
        np.testing.assert_array_equal(leaf, own)


def test_values_of_another_size_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"Expected 117 values in a row, got shape \(9,\)"
    ):
        PLANE.stencil(np.zeros((1, 2)))(jnp.zeros(9))

"""The external compensation: offsets, and the start without a motion."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import (
    Cross,
    EquidistantNodes,
    ExternalCompensation,
    Leadscrew,
    OffsetPart,
    OffsetStack,
    Plane,
    Setpoints,
)

FORWARD = 1e-9  # mm; what start_offsets promises


def stack(scale: float, seed: int = 1) -> OffsetStack:
    """Tables on three axes over each other; `scale` is the height in mm of 10 mm."""
    rng = np.random.default_rng(seed)
    plane = Plane.quadratic((0.0, 0.0), 10.0, scale * rng.uniform(-1, 1, (5, 5)))
    nodes = Setpoints(np.array([0.0, 10.0, 22.0, 40.0]))
    cross = Cross(nodes, scale * rng.uniform(-1, 1, 4))
    screw = Leadscrew(EquidistantNodes(0.0, 10.0, 5), scale * rng.uniform(-1, 1, 5))
    return OffsetStack(
        (
            OffsetPart(plane, axis=2, masters=(0, 1)),
            OffsetPart(cross, axis=0, masters=(2,)),
            OffsetPart(screw, axis=1, masters=(1,)),
        ),
        axes=3,
    )


PLACES = np.random.default_rng(3).uniform(-5, 45, (300, 3))


@jax.jit
def _inverse(law: Any, given: Any) -> tuple[Any, Any]:
    found = ExternalCompensation(law).start(given)
    return found.result, jnp.max(
        jnp.abs(found.positions + law(found.positions) - given)
    )


def inverse_error(law: Any, given: np.ndarray) -> float:
    """How far the start is from leading to the given positions, in mm."""
    result, error = _inverse(law, given)
    np.testing.assert_array_equal(result, 0)
    return float(error)


def test_offsets_are_the_sum_of_the_tables_of_each_axis() -> None:
    tables = (
        OffsetPart(Cross(Setpoints(np.array([0.0, 10.0])), np.array([0.0, 1.0])), 0, (1,)),
        OffsetPart(Leadscrew(EquidistantNodes(0.0, 10.0, 2), np.array([0.0, 1.0])), 0, (0,)),
    )  # fmt: skip
    at = np.array([[2.0, 5.0]])
    found = ExternalCompensation(OffsetStack(tables, axes=2)).offsets(at)
    # By hand: half of 1 mm from the cross table; −2/10 mm from the leadscrew at X = 2.
    np.testing.assert_allclose(found, [[0.5 - 0.2, 0.0]], rtol=0, atol=1e-15)
    last = OffsetPart(tables[1].model, 0, (0,), compensated=True)
    found = OffsetStack((tables[0], last), axes=2)(jnp.asarray(at))
    # The leadscrew now looks at 2.5.
    np.testing.assert_allclose(found, [[0.5 - 0.25, 0.0]], rtol=0, atol=1e-15)


@pytest.mark.parametrize("scale", [0.01, 1.0, 3.0])
def test_start_composed_with_the_offsets_is_the_identity(scale: float) -> None:
    # Slopes of 1 µm to 0.6 mm per mm; nodes as well, and beyond the tables.
    nodes = np.stack(np.meshgrid([0.0, 10.0, 20.0], [0.0, 40.0], [10.0]), -1)
    given = np.concatenate([PLACES, nodes.reshape(-1, 3)])
    assert inverse_error(stack(scale), given) < FORWARD


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 1.5))
def test_start_is_found_for_any_tables_of_moderate_slope(
    seed: int, scale: float
) -> None:
    # 1.5 mm per 10 mm both ways: slopes up to 0.3 in each of three tables.
    given = np.random.default_rng(seed).uniform(-5, 45, (16, 3))
    assert inverse_error(stack(scale, seed), given) < FORWARD


def test_start_comes_back_to_the_positions_it_was_made_from() -> None:
    law = stack(0.5)
    offsets = jax.jit(lambda at: law(at))(PLACES)
    found = ExternalCompensation(law).start(PLACES + offsets)
    # The residual of 1e-10 divided by 1 − slope, the slope being 0.3 at most.
    np.testing.assert_allclose(found.positions, PLACES, rtol=0, atol=FORWARD)
    np.testing.assert_allclose(
        ExternalCompensation(law).start_offsets(PLACES + offsets), offsets,
        rtol=0, atol=FORWARD,
    )  # fmt: skip


def test_newton_that_jumps_to_and_fro_between_cells_is_caught() -> None:
    # x + offset(x) rises by 0.1, then by 1.9, around 0: a plain Newton step from the
    # flat side lands far on the steep one and comes back.
    nodes = Setpoints(np.array([-10.0, 0.0, 10.0]))
    kink = Cross(nodes, np.array([9.0, 0.0, 9.0]))
    law = OffsetStack((OffsetPart(kink, 0, (0,)),), axes=1)
    given = np.linspace(-0.9, 18.0, 50)[:, None]
    assert inverse_error(law, given) < FORWARD


def test_offsets_without_a_start_are_told_row_by_row() -> None:
    def law(place: Any) -> jax.Array:
        # −x from −1 to 1: nothing leads to 0.5, everything there to 0.
        return jnp.where(jnp.abs(place) < 1.0, -place, 0.0)

    found = ExternalCompensation(law).start(np.array([[0.5], [3.0]]))
    np.testing.assert_array_equal(found.result, [70582, 0])
    offsets = ExternalCompensation(law).start_offsets(np.array([[0.5], [3.0]]))
    assert np.isnan(offsets[0, 0])
    assert offsets[1, 0] == 0.0


def test_a_position_that_is_none_fails_alone() -> None:
    found = ExternalCompensation(stack(0.5)).start(
        np.array([[np.nan, 0.0, 0.0], [1.0, 2.0, 3.0]])
    )
    np.testing.assert_array_equal(found.result, [70582, 0])


def test_derivative_of_the_start_with_respect_to_positions() -> None:
    compensation = ExternalCompensation(stack(0.5))
    start = jax.jit(lambda at: compensation.start_offsets(at))
    at = PLACES[:1]
    found = jax.jit(jax.jacrev(start))(at)[0, :, 0, :]
    width = 1e-4
    for k, unit in enumerate(np.eye(3)):
        ahead, back = start(at + width * unit), start(at - width * unit)
        # Twice 1e-10 of the solver over 2e-4; the law is bilinear: no third derivative.
        np.testing.assert_allclose(
            found[:, k], (ahead - back)[0] / (2 * width), rtol=1e-6, atol=2e-6
        )
    forward = jax.jit(jax.jacfwd(start))(at)[0, :, 0, :]
    # The same linear system, solved with the matrix and with its transpose.
    np.testing.assert_allclose(forward, found, rtol=0, atol=1e-14)


def test_derivative_of_the_start_with_respect_to_the_table() -> None:
    def moved(height: Any) -> jax.Array:
        values = height * jnp.array([0.0, 1.0, -1.0])
        cross = Cross(Setpoints(np.array([0.0, 10.0, 20.0])), values)
        law = OffsetStack((OffsetPart(cross, 0, (0,)),), axes=1)
        return ExternalCompensation(law).start_offsets(jnp.array([[4.0]]))[0, 0]

    # By hand: x + h·x/10 = 4, so the offset is 4 − 40/(10 + h), its slope 40/(10 + h)².
    value, slope = jax.jit(jax.value_and_grad(moved))(2.0)
    assert float(value) == pytest.approx(4 - 40 / 12, abs=FORWARD)
    # The residual of the solver moves the point of the derivative by 1e-10 mm.
    assert float(slope) == pytest.approx(40 / 144, rel=1e-9)


def test_derivative_at_a_node_is_that_of_the_cell_to_its_right() -> None:
    cross = Cross(Setpoints(np.array([0.0, 10.0, 20.0])), np.array([0.0, 0.0, 5.0]))
    law = OffsetStack((OffsetPart(cross, 0, (0,)),), axes=1)
    slope = jax.jit(
        jax.grad(lambda x: ExternalCompensation(law).start_offsets(x)[0, 0])
    )
    # Offset slope s = 0.5 to the right: d/dx of x − start(x) is s / (1 + s).
    assert float(slope(jnp.array([[10.0]]))[0, 0]) == pytest.approx(1 / 3, abs=1e-15)


def test_batch_of_machines_is_the_loop_over_them() -> None:
    def start(height: Any, places: Any) -> jax.Array:
        cross = Cross(
            EquidistantNodes(0.0, 10.0, 3), height * jnp.array([0.0, 1.0, 3.0])
        )
        law = OffsetStack(
            (OffsetPart(cross, 0, (1,)), OffsetPart(cross, 1, (0,))), axes=2
        )
        return ExternalCompensation(law).start_offsets(places)

    heights = jnp.array([0.1, 1.0, 2.0])
    places = jnp.asarray(np.random.default_rng(5).uniform(0, 20, (3, 40, 2)))
    batch = jax.jit(jax.vmap(start))(heights, places)
    alone = jax.jit(start)
    loop = np.stack([alone(h, p) for h, p in zip(heights, places, strict=True)])
    # Both stop at a residual of 1e-10; finished rows wait, they do not move on.
    np.testing.assert_allclose(batch, loop, rtol=0, atol=2e-10)


def test_table_for_each_direction_is_refused() -> None:
    screw = Leadscrew(EquidistantNodes(0.0, 1.0, 2), np.zeros(2), np.ones(2))
    with pytest.raises(ValueError, match="knows positions only, got a leadscrew table"):
        OffsetPart(screw, 0, (0,))


def test_wrong_columns_are_refused() -> None:
    cross = Cross(Setpoints(np.array([0.0, 1.0])), np.zeros(2))
    with pytest.raises(
        ValueError, match=r"Cross needs 1 master column\(s\), got \(0, 1"
    ):
        OffsetPart(cross, 0, (0, 1))
    with pytest.raises(ValueError, match="Columns must be 0 to 1, got axis 2"):
        OffsetStack((OffsetPart(cross, 2, (0,)),), axes=2)

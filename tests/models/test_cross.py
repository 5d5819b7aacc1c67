from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import Cross, EquidistantNodes, Setpoints

POINTS = np.array([0.0, 1.0, 3.5, 4.0, 10.0])
VALUES = np.array([0.1, -0.2, 0.05, 0.4, -0.3])
CROSS = Cross(Setpoints(POINTS), VALUES)
INSIDE_AND_OUTSIDE = np.random.default_rng(4).uniform(-3, 13, 400)
ROUNDING = 1e-15  # two products of numbers below 1 and their sum


def test_evaluation_agrees_with_numpy() -> None:
    expected = np.interp(INSIDE_AND_OUTSIDE, POINTS, VALUES)
    np.testing.assert_allclose(
        CROSS.entry(INSIDE_AND_OUTSIDE), expected, rtol=0, atol=ROUNDING
    )


def test_equidistant_evaluation_agrees_with_numpy() -> None:
    model = Cross(EquidistantNodes(-1.0, 2.5, 5), VALUES)
    expected = np.interp(INSIDE_AND_OUTSIDE, -1.0 + 2.5 * np.arange(5), VALUES)
    np.testing.assert_allclose(
        model.entry(INSIDE_AND_OUTSIDE), expected, rtol=0, atol=ROUNDING
    )


def test_the_printed_list_gives_its_corrections_in_mm() -> None:
    # [001] p.35: setpoint 10735 has correction 3; setpoints in 0.1 µm.
    model = Cross(Setpoints(np.array([1.0735, 1.1523])), np.array([3e-4, 5e-4]))
    np.testing.assert_array_equal(model.offset(np.array([1.0735, 0.0])), [3e-4, 3e-4])


def test_the_edge_is_held_by_default_and_adds_nothing_where_it_is_not() -> None:
    at = np.array([-0.1, 0.0, 10.0, 10.1])
    zero = Cross(Setpoints(POINTS), VALUES, held=False)
    np.testing.assert_array_equal(CROSS.entry(at), [0.1, 0.1, -0.3, -0.3])
    np.testing.assert_array_equal(zero.entry(at), [0.0, 0.1, -0.3, 0.0])
    np.testing.assert_array_equal(zero.stencil(at)(zero.values), [0.0, 0.1, -0.3, 0.0])


@pytest.mark.parametrize("held", [True, False])
def test_an_unknown_position_has_an_unknown_offset(held: bool) -> None:
    model = Cross(Setpoints(POINTS), VALUES, held=held)
    assert np.isnan(model.offset(np.array([np.nan]))).all()
    stencil = model.stencil(np.array([np.nan]))
    assert np.isnan(stencil.weights).all()


def test_offset_carries_the_sign() -> None:
    opposite = Cross(Setpoints(POINTS), VALUES, sign=-1.0)
    np.testing.assert_array_equal(opposite.offset(POINTS), -VALUES)


def test_one_point_is_a_constant() -> None:
    model = Cross(Setpoints(np.array([5.0])), np.array([0.7]))
    np.testing.assert_array_equal(model.entry(np.array([-9.0, 5.0, 9.0])), 0.7)
    assert float(jax.grad(lambda x: model.entry(x)[0])(jnp.array([5.0]))[0]) == 0.0


def test_gradient_with_respect_to_setpoints_agrees_with_finite_differences() -> None:
    def total(points: Any) -> jax.Array:
        return jnp.sum(Cross(Setpoints(points), VALUES).entry(INSIDE_AND_OUTSIDE) ** 2)

    found = jax.grad(total)(jnp.asarray(POINTS))
    step = 1e-7
    for number in range(POINTS.size):
        by = step * np.eye(POINTS.size)[number]
        quotient = (total(POINTS + by) - total(POINTS - by)) / (2 * step)
        # Rounding of a sum of 400 squares below 0.2: 1e-14 / 1e-7.
        assert abs(found[number] - quotient) < 1e-6


def test_gradient_at_nodes_is_that_of_the_cell_which_begins_there() -> None:
    found = jax.grad(lambda x: jnp.sum(CROSS.entry(x)))(jnp.asarray(POINTS))
    expected = np.append(np.diff(VALUES) / np.diff(POINTS), 0.0)
    # One quotient and one product.
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_gradient_outside_is_zero() -> None:
    at = jnp.array([-0.1, 10.1])
    for held in (True, False):
        model = Cross(Setpoints(POINTS), VALUES, held=held)
        found = jax.grad(lambda x, m=model: jnp.sum(m.entry(x)))(at)
        np.testing.assert_array_equal(found, [0.0, 0.0])


def test_vmap_over_tables_gives_what_a_loop_gives() -> None:
    tables = jnp.asarray(np.random.default_rng(5).normal(size=(3, 5)))

    def one(values: jax.Array) -> jax.Array:
        return Cross(Setpoints(POINTS), values).entry(INSIDE_AND_OUTSIDE)

    looped = jnp.stack([one(values) for values in tables])
    np.testing.assert_array_equal(jax.vmap(one)(tables), looped)


@settings(max_examples=60, deadline=None)
@given(position=st.floats(-1e9, 1e9), step=st.floats(-1e-6, 1e-6))
def test_values_stay_in_range_and_are_continuous(position: float, step: float) -> None:
    here, there = CROSS.entry(np.array([position, position + step]))
    assert -0.3 - ROUNDING <= here <= 0.4 + ROUNDING
    # Steepest cell: 0.35 over 0.5 mm; the rest is rounding.
    assert abs(here - there) <= 0.7 * (abs(step) + 1e-14) + ROUNDING


def test_values_that_do_not_match_the_nodes_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"one entry per node, \(5,\), got shape \(4,\)"
    ):
        Cross(Setpoints(POINTS), VALUES[:4])

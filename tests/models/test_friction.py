"""Friction laws: the table of the list, and the Stribeck curve."""

import dataclasses
import pickle
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import (
    AbstractFriction,
    FrictionTable,
    Setpoints,
    StribeckFriction,
    sample_friction,
    stribeck_columns,
)

# [001] p.70: in 0, 316, 333 µm/s; out 0, 3722, 3884; scaling_factor 10, that is 0.01.
PRINTED = FrictionTable(
    Setpoints(np.array([0.0, 0.316, 0.333])), np.array([0.0, 3722.0, 3884.0]), 0.01
)
OWN = FrictionTable(
    Setpoints(np.array([0.5, 2.0, 10.0])), np.array([4.0, 3.0, 5.0]), 0.5
)
CURVE = StribeckFriction(2.0, 3.0, 1.5, 1.3, 0.1)
DIRECTED = StribeckFriction([2.0, 2.5], [3.0, 3.2], [1.5, 0.7], [1.3, 2.0], [0.1, 0.2])
MOVING = np.array([-40.0, -3.0, -0.4, -0.01, 0.02, 0.7, 2.5, 30.0])
ROUNDING = 1e-14  # a few roundings of currents below 40


def test_the_printed_list_gives_its_currents() -> None:
    velocity = np.array([0.079, 0.158, 0.316, 0.3245, 0.333, 5.0])
    # 930.5, 1861, 3722, (3722 + 3884) / 2 = 3803, 3884, held: all times 0.01.
    expected = np.array([9.305, 18.61, 37.22, 38.03, 38.84, 38.84])
    np.testing.assert_allclose(PRINTED(velocity), expected, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(PRINTED(-velocity), -np.asarray(PRINTED(velocity)))


def test_at_rest_a_table_gives_nothing_and_next_to_it_the_first_entry() -> None:
    found = OWN(np.array([-1e-9, -0.0, 0.0, 1e-9, 0.5]))
    np.testing.assert_array_equal(found, [-2.0, 0.0, 0.0, 2.0, 2.0])


def test_the_other_readings_outside_the_table_are_lines() -> None:
    lines = FrictionTable(
        OWN.nodes, OWN.values, 0.5, held_below=False, held_above=False
    )
    # Below: a quarter of the way to 4; above: 8 mm/s on at 2 per 8 mm/s; times 0.5.
    np.testing.assert_allclose(
        lines(np.array([0.125, 0.5, 10.0, 18.0, -18.0])),
        [0.5, 2.0, 2.5, 3.5, -3.5],
        rtol=0,
        atol=ROUNDING,
    )


def test_a_line_below_an_entry_at_rest_is_that_entry() -> None:
    table = FrictionTable(PRINTED.nodes, PRINTED.values, held_below=False)
    np.testing.assert_allclose(table(np.array([0.158])), [1861.0], rtol=1e-15)


@pytest.mark.parametrize("held", [True, False])
def test_the_stencil_of_a_table_gives_what_the_table_gives(held: bool) -> None:
    table = FrictionTable(OWN.nodes, OWN.values, 0.7, held_below=held, held_above=held)
    velocity = np.concatenate([MOVING, [0.0, 0.5, -2.0, 10.0]])
    stencil = table.stencil(velocity)
    assert stencil.size == 3
    np.testing.assert_allclose(
        stencil(table.values), table(velocity), rtol=0, atol=ROUNDING
    )


def test_one_entry_is_coulomb_friction() -> None:
    table = FrictionTable(Setpoints(np.array([1.0])), np.array([7.0]), held_above=False)
    np.testing.assert_array_equal(table(np.array([-9.0, 0.0, 3.0])), [-7.0, 0.0, 7.0])


def test_derivative_at_entries_is_the_right_hand_one_and_0_at_rest() -> None:
    at = jnp.array([0.0, 0.25, 0.5, 2.0, 10.0, -2.0])
    found = jax.grad(lambda v: jnp.sum(OWN(v)))(at)
    # (3 − 4)/1.5 and (5 − 3)/8, times 0.5; the slope of an odd function is even.
    expected = [0.0, 0.0, -1 / 3, 0.125, 0.0, 0.125]
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_the_stribeck_curve_at_points_computed_by_hand() -> None:
    curve = StribeckFriction(2.0, 3.0, 1.5, 2.0, 0.1)
    # At v_s: 2 + 1/e + 0.15; at 3 v_s: 2 + e^-9 + 0.45; far off 2 + b v.
    found = curve(np.array([0.0, 1.5, -4.5, 1e4]))
    expected = [0.0, 2.15 + np.exp(-1.0), -2.45 - np.exp(-9.0), 1002.0]
    np.testing.assert_allclose(found, expected, rtol=1e-15)
    assert float(curve.level(np.zeros(1), np.ones(1))[0]) == 3.0


def test_each_direction_takes_its_own_parameters() -> None:
    negative = StribeckFriction(2.5, 3.2, 0.7, 2.0, 0.2)
    speed = np.abs(MOVING)
    np.testing.assert_array_equal(DIRECTED(speed), CURVE(speed))
    np.testing.assert_array_equal(DIRECTED(-speed), negative(-speed))
    assert DIRECTED.directional
    assert not CURVE.directional


def gradients_agree(law: Any, velocity: np.ndarray) -> None:
    weights = jnp.asarray(np.random.default_rng(2).normal(size=velocity.size))

    @jax.jit
    def total(own: Any, v: Any) -> jax.Array:
        return jnp.vdot(weights, own(v))

    leaves, structure = jax.tree.flatten(law)
    found = jax.tree.leaves(jax.grad(total)(law, jnp.asarray(velocity)))
    for number, leaf in enumerate(leaves):
        for place in np.ndindex(leaf.shape):
            step = 1e-6 * max(1.0, abs(float(leaf[place])))

            def moved(by: float, n: int = number, p: Any = place) -> jax.Array:
                own = [*leaves]
                own[n] = own[n].at[p].add(by)
                return total(jax.tree.unflatten(structure, own), velocity)

            quotient = (moved(step) - moved(-step)) / (2 * step)
            # Rounding of a sum of size 30 over the step, 1e-14 / 1e-6, and its square.
            np.testing.assert_allclose(found[number][place], quotient, 1e-6, 1e-7)
    slope = jax.grad(lambda v: total(law, v))(jnp.asarray(velocity))
    for number, speed in enumerate(velocity):
        step = 1e-6 * max(1e-2, abs(speed))
        by = step * np.eye(velocity.size)[number]
        quotient = (total(law, velocity + by) - total(law, velocity - by)) / (2 * step)
        # At 0.01 mm/s the step is 1e-8: 1e-14 / 1e-8.
        np.testing.assert_allclose(slope[number], quotient, 1e-6, 3e-6)


@pytest.mark.parametrize(
    "law",
    [
        OWN,
        FrictionTable(OWN.nodes, OWN.values, 0.5, held_below=False, held_above=False),
        CURVE,
        DIRECTED,
    ],
)
def test_derivatives_agree_with_finite_differences(law: AbstractFriction) -> None:
    gradients_agree(law, MOVING)


@pytest.mark.parametrize("law", [CURVE, DIRECTED])
def test_derivatives_at_rest_and_far_off_are_numbers(law: StribeckFriction) -> None:
    steep = dataclasses.replace(law, stribeck_shape=40.0 * law.stribeck_shape)
    slopes = jax.jit(jax.grad(lambda x, v: jnp.sum(x(v)), (0, 1)))
    for own in (law, steep):
        by_law, by_speed = slopes(own, np.array([0.0, -0.0, 1e-300, 1e9, -1e9]))
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(by_law))
        assert np.isfinite(by_speed[np.array([0, 1, 3, 4])]).all()
    by_law, by_speed = slopes(law, np.zeros(5))
    assert all((leaf == 0.0).all() for leaf in jax.tree.leaves((by_law, by_speed)))


def test_the_level_at_rest_depends_on_the_break_away_alone() -> None:
    found = jax.grad(lambda law: law.level(jnp.zeros(1), jnp.ones(1))[0])(CURVE)
    assert (float(found.breakaway), float(found.coulomb)) == (1.0, 0.0)
    assert (float(found.stribeck_velocity), float(found.stribeck_shape)) == (0.0, 0.0)


def test_a_sampled_law_agrees_with_it_at_the_knots_and_is_the_mean_of_both() -> None:
    knots = np.array([0.0, 0.001, 0.5, 3.0, 50.0])
    table = sample_friction(CURVE, knots)
    np.testing.assert_allclose(table(knots[1:]), CURVE(knots[1:]), rtol=1e-15)
    assert float(table.values[0]) == 3.0
    mean = 0.5 * (DIRECTED(knots[1:]) - DIRECTED(-knots[1:]))
    np.testing.assert_allclose(
        sample_friction(DIRECTED, knots).values[1:], mean, rtol=1e-15
    )


def test_a_sampled_table_is_differentiable_in_law_and_knots() -> None:
    knots = jnp.array([0.0, 0.4, 2.0, 9.0])

    @jax.jit
    def total(law: StribeckFriction, at: jax.Array) -> jax.Array:
        return jnp.sum(sample_friction(law, at)(MOVING) ** 2)

    by_law, by_knots = jax.jit(jax.grad(total, (0, 1)))(CURVE, knots)
    step = 1e-6
    shape = [
        total(dataclasses.replace(CURVE, stribeck_shape=1.3 + by), knots)
        for by in (step, -step)
    ]
    knot = [total(CURVE, knots.at[2].add(by)) for by in (step, -step)]
    # Sums of size 100: rounding 1e-14 / 1e-6.
    np.testing.assert_allclose(
        [by_law.stribeck_shape, by_knots[2]],
        [(shape[0] - shape[1]) / (2 * step), (knot[0] - knot[1]) / (2 * step)],
        rtol=1e-6,
        atol=1e-7,
    )


def test_vmap_over_tables_and_laws_gives_what_a_loop_gives() -> None:
    values = jnp.asarray(np.random.default_rng(5).normal(size=(4, 3)))
    table = lambda v: FrictionTable(OWN.nodes, v)(MOVING)  # noqa: E731
    curve = lambda v: StribeckFriction(v[0], v[1], 1.5, 1.3, v[2])(MOVING)  # noqa: E731
    for one in (table, curve):
        looped = jnp.stack([one(row) for row in values])
        # XLA may contract a product and a sum in one of the two and not in the other.
        np.testing.assert_allclose(jax.vmap(one)(values), looped, rtol=0, atol=1e-14)


@settings(max_examples=60, deadline=None)
@given(speed=st.floats(1e-6, 1e6), step=st.floats(0, 1e-3))
def test_tables_are_odd_continuous_and_within_their_entries(
    speed: float, step: float
) -> None:
    here, there, back = OWN(np.array([speed, speed + step, -speed]))
    assert back == -here
    assert 1.5 - ROUNDING <= here <= 2.5 + ROUNDING
    # Steepest cell: 1 over 1.5 mm/s, times 0.5.
    assert abs(there - here) <= step / 3 + ROUNDING


@pytest.mark.parametrize(
    "law",
    [
        OWN,
        FrictionTable(OWN.nodes, OWN.values, 0.5, held_below=False, held_above=False),
        FrictionTable(Setpoints(np.array([2.0])), np.array([3.0])),
        CURVE,
        DIRECTED,
    ],
)
def test_numpy_gives_what_jax_gives(law: AbstractFriction) -> None:
    velocity = np.array([-9.0, -1.5, -1e-3, 0.0, 0.2, 1.0, 4.0, 60.0, np.nan])
    # Both round a few products and sums of numbers below 100.
    np.testing.assert_allclose(law.evaluate(velocity), law(velocity), atol=1e-13)


def test_slopes_of_the_stribeck_column_are_its_derivatives() -> None:
    speed = np.array([0.0, 1e-3, 0.5, 2.0, 30.0])

    def decay(shape: jax.Array) -> jax.Array:
        curve = StribeckFriction(0.0, 1.0, jnp.exp(shape[0]), jnp.exp(shape[1]), 0.0)
        return curve.level(speed, np.ones_like(speed))

    at = np.log([3.0, 1.3])
    slopes = jax.jacfwd(decay)(jnp.asarray(at)).T
    column, *own = stribeck_columns(speed, 3.0, 1.3)
    np.testing.assert_allclose(column, decay(jnp.asarray(at)), atol=1e-15)
    # The same formula by hand and by JAX: rounding only.
    np.testing.assert_allclose(own, slopes, atol=1e-14)


@pytest.mark.parametrize("law", [PRINTED, CURVE, DIRECTED])
def test_laws_survive_pickling(law: AbstractFriction) -> None:
    copy = pickle.loads(pickle.dumps(law))
    np.testing.assert_array_equal(copy(MOVING), law(MOVING))


def test_tables_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"one entry per node, \(3,\), got shape \(2"):
        FrictionTable(OWN.nodes, np.zeros(2))
    with pytest.raises(ValueError, match=r"speeds cannot be negative, got -1"):
        FrictionTable(Setpoints(np.array([-1.0, 2.0])), np.zeros(2))


@pytest.mark.parametrize("name", ["stribeck_velocity", "stribeck_shape"])
def test_parameters_that_make_no_curve_are_refused(name: str) -> None:
    own = {"stribeck_velocity": 1.0, "stribeck_shape": 1.0, name: [1.0, 0.0]}
    with pytest.raises(ValueError, match=rf"{name} must be positive"):
        StribeckFriction(coulomb=1.0, breakaway=1.0, viscous=0.0, **own)

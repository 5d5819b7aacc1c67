"""Friction compensation over cycles: reversals, dwells, delays, pieces."""

import dataclasses
import pickle
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import (
    FrictionCompensation,
    FrictionState,
    FrictionTable,
    Setpoints,
    StribeckFriction,
)

# [001] p.70: lookahead 4 cycles, position_delay 30 = 0.003 mm, delay 9 cycles; above
# 0.333 mm/s the table is held at 38.84.
TABLE = FrictionTable(
    Setpoints(np.array([0.0, 0.316, 0.333])), np.array([0.0, 3722.0, 3884.0]), 0.01
)
FULL = 38.84
PRINTED = FrictionCompensation(TABLE, 4, 0.003, 9)
AT_ONCE = FrictionCompensation(TABLE, 4, 0.003)
ROUNDING = 1e-12  # shares of 38.84 of positions that are sums of steps


def motion(*parts: tuple[int, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity: steps of ±1 µm in ±0.4 mm/s, from standstill."""
    velocity = np.concatenate([[0.0], *(np.full(n, 0.4 * sign) for n, sign in parts)])
    return np.cumsum(np.sign(velocity)) * 1e-3, velocity


def shares(model: FrictionCompensation, *parts: tuple[int, float]) -> np.ndarray:
    position, velocity = motion(*parts)
    # Standing on to one length for all: XLA compiles for each length anew.
    rest = (0, 32 - velocity.size)
    found, _ = model.run(
        model.start(), np.pad(position, rest, mode="edge"), np.pad(velocity, rest)
    )
    return np.asarray(found)[: velocity.size] / FULL


def test_a_reversal_decays_over_cycles_and_builds_up_over_the_distance() -> None:
    found = shares(AT_ONCE, (8, 1.0), (4, -1.0))
    # First motion of all: 1/3, 2/3, 1 of 3 µm; four cycles 3/4 … 0; then up again.
    expected = [0, 1 / 3, 2 / 3, 1, 1, 0.75, 0.5, 0.25, 0, -1 / 3, -2 / 3, -1, -1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_the_printed_delay_shifts_all_of_it_by_nine_cycles() -> None:
    parts = ((8, 1.0), (15, -1.0))
    late, prompt = shares(PRINTED, *parts), shares(AT_ONCE, *parts)
    np.testing.assert_array_equal(late[:9], 0.0)
    np.testing.assert_array_equal(late[9:], prompt[:-9])


def test_a_short_dwell_counts_among_the_cycles_before_the_reversal() -> None:
    found = shares(AT_ONCE, (8, 1.0), (2, 0.0), (3, -1.0))
    expected = [0, 1 / 3, 2 / 3, 1, 1, 1, 1, 0.75, 0.5, 0, 0, -1 / 3, -2 / 3, -1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_before_a_long_dwell_nothing_decays() -> None:
    found = shares(AT_ONCE, (4, 1.0), (5, 0.0), (2, -1.0))
    expected = [0, 1 / 3, 2 / 3, 1, 1, 0, 0, 0, 0, 0, -1 / 3, -2 / 3]
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_a_stop_without_reversal_is_not_weighted() -> None:
    found = shares(AT_ONCE, (5, 1.0), (2, 0.0), (3, 1.0))
    expected = [0, 1 / 3, 2 / 3, 1, 1, 1, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_without_lookahead_and_distance_it_is_the_law() -> None:
    plain = FrictionCompensation(TABLE, sign=-1.0)
    position, velocity = motion((3, 1.0), (2, 0.0), (3, -1.0))
    found, _ = plain.run(plain.start(), position, velocity)
    np.testing.assert_array_equal(found, -np.asarray(TABLE(velocity)))
    np.testing.assert_array_equal(found, plain.current(velocity))


def test_a_short_stroke_takes_both_weights_or_the_lesser() -> None:
    least = dataclasses.replace(AT_ONCE, weights_multiply=False)
    parts = ((8, 1.0), (2, -1.0), (4, 1.0))
    # In the stroke back: up 1/3, 2/3; down 1/4, 0.
    np.testing.assert_allclose(
        shares(AT_ONCE, *parts)[9:13], [-1 / 12, 0, 1 / 3, 2 / 3], rtol=0, atol=ROUNDING
    )
    np.testing.assert_allclose(
        shares(least, *parts)[9:13], [-1 / 4, 0, 1 / 3, 2 / 3], rtol=0, atol=ROUNDING
    )


@pytest.mark.parametrize(
    ("reading", "expected"),
    [
        ({}, [0, 1 / 3, 2 / 3, 1, 0, 1]),
        ({"first_builds_up": False}, [0, 1, 1, 1, 0, 1]),
        ({"restart_builds_up": True}, [0, 1 / 3, 2 / 3, 1, 0, 1 / 3]),
        ({"held_at_rest": True}, [0, 1 / 3, 2 / 3, 1, 1, 1]),
    ],
)
def test_readings_of_start_and_rest(
    reading: dict[str, bool], expected: list[float]
) -> None:
    flat = FrictionTable(Setpoints(np.array([1.0])), np.array([FULL]))
    model = dataclasses.replace(FrictionCompensation(flat, 4, 0.003), **reading)
    found = shares(model, (3, 1.0), (1, 0.0), (1, 1.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_the_decay_may_end_above_zero() -> None:
    model = dataclasses.replace(AT_ONCE, decays_to_zero=False)
    found = shares(model, (8, 1.0), (1, -1.0))[4:9]
    np.testing.assert_allclose(found, [1, 0.8, 0.6, 0.4, 0.2], rtol=0, atol=ROUNDING)


def test_the_other_delay_holds_values_from_the_reversal_on() -> None:
    model = FrictionCompensation(TABLE, delay_cycles=2, delays_all=False)
    found = shares(model, (3, 1.0), (4, -1.0))
    np.testing.assert_array_equal(found, [0, 1, 1, 1, 1, 1, -1, -1])


def test_a_motion_that_runs_in_the_first_cycle_builds_up_from_there() -> None:
    found, _ = AT_ONCE.run(AT_ONCE.start(), 1e-3 * np.arange(5.0), np.full(5, 0.4))
    np.testing.assert_allclose(
        found / FULL, [0, 1 / 3, 2 / 3, 1, 1], rtol=0, atol=ROUNDING
    )


# ------------------------------------------------------------------- against a slow loop


def slowly(
    model: FrictionCompensation, position: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """Return the currents by one step of the rules after the other."""
    sign = np.sign(velocity)
    cycles = model.reversal_lookahead
    last, origin, out = 0.0, None, []
    for t, way in enumerate(sign):
        if way != 0.0:
            if last != way:
                origin = position[max(t - 1, 0)]
            last = way
        weight = 1.0
        if origin is not None and float(model.position_delay) > 0:
            away = abs(position[t] - origin) / float(model.position_delay)
            weight = min(1.0, away)
        for k in range(1, cycles + 1):
            ahead = sign[t + 1 : t + k]
            turns = t + k < sign.size and sign[t + k] * last < 0
            if turns and not (ahead * last < 0).any():
                weight *= (k - 1) / cycles
        out.append(weight * float(model.law(velocity[t : t + 1])[0]))
    delay = model.delay_cycles
    return np.array([0.0] * delay + out)[: len(out)]


def random_motion(seed: int, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    runs = rng.choice([-1.0, 0.0, 1.0], size=count)[rng.integers(0, count, count)]
    velocity = np.repeat(runs, rng.integers(1, 6, count))[:count] * rng.uniform(
        0.1, 0.5, count
    )
    return np.cumsum(velocity) * 2.5e-3, velocity


@pytest.mark.parametrize("seed", range(8))
def test_whole_logs_agree_with_a_loop_over_cycles(seed: int) -> None:
    model = FrictionCompensation(TABLE, 4, 0.003, 3)
    position, velocity = random_motion(seed)
    found, _ = model.run(model.start(), position, velocity)
    expected = slowly(model, position, velocity)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def in_pieces(
    model: FrictionCompensation, position: np.ndarray, velocity: np.ndarray, size: int
) -> np.ndarray:
    state, found = model.start(), []
    for at in range(0, velocity.size, size):
        end = at + size
        ahead = velocity[end : end + model.reversal_lookahead]
        ahead = np.pad(ahead, (0, model.reversal_lookahead - ahead.size))
        part, state = model.run(state, position[at:end], velocity[at:end], ahead=ahead)
        found.append(np.asarray(part))
    return np.concatenate(found)


@pytest.mark.parametrize(
    "reading",
    [
        {},
        {"restart_builds_up": True, "held_at_rest": True},
        {"delays_all": False},
    ],
)
@pytest.mark.parametrize("size", [1, pytest.param(15, marks=pytest.mark.heavy)])
def test_a_log_in_pieces_gives_the_log_at_once_to_the_last_bit(
    size: int, reading: dict[str, bool]
) -> None:
    model = dataclasses.replace(PRINTED, **reading)
    position, velocity = random_motion(11)
    whole, _ = model.run(model.start(), position, velocity)
    np.testing.assert_array_equal(in_pieces(model, position, velocity, size), whole)


def test_a_law_with_exponentials_in_pieces_misses_no_more_than_the_last_bit() -> None:
    law = StribeckFriction(2.0, 3.0, 0.2, 1.3, [0.1, 0.2])
    model = FrictionCompensation(law, 4, 0.003, 3)
    position, velocity = random_motion(11)
    whole, _ = model.run(model.start(), position, velocity)
    # XLA's exponential of one number differs from that of many by a rounding.
    found = in_pieces(model, position, velocity, 7)
    np.testing.assert_allclose(found, whole, rtol=1e-15)


def test_more_rows_ahead_than_needed_change_nothing() -> None:
    position, velocity = motion((8, 1.0), (9, -1.0))
    some, more = (
        AT_ONCE.run(AT_ONCE.start(), position[:7], velocity[:7], ahead=velocity[7:end])
        for end in (11, 18)
    )
    np.testing.assert_array_equal(some[0], more[0])


# --------------------------------------------------------------------------- derivatives


def test_derivatives_agree_with_finite_differences_and_go_through_the_state() -> None:
    law = StribeckFriction(2.0, 3.0, 0.2, 1.3, 0.1)
    # Over 3.5 µm no distance is exactly that of the delay.
    model = FrictionCompensation(law, 3, 0.0035, 2)
    position, velocity = motion((8, 1.0), (2, 0.0), (9, -1.0))
    weights = jnp.asarray(np.random.default_rng(3).normal(size=velocity.size))

    @jax.jit
    def total(own: FrictionCompensation, place: Any) -> jax.Array:
        first, state = own.run(own.start(), place[:12], velocity[:12], velocity[12:15])
        second, _ = own.run(state, place[12:], velocity[12:])
        return jnp.vdot(weights, jnp.concatenate([first, second]))

    by_model, by_place = jax.grad(total, (0, 1))(model, jnp.asarray(position))
    step = 1e-8

    def quotient(name: str) -> float:
        there, here = (
            total(
                dataclasses.replace(
                    model, position_delay=model.position_delay + by, law=law
                )
                if name == "position_delay"
                else dataclasses.replace(
                    model, law=dataclasses.replace(law, coulomb=law.coulomb + by)
                ),
                position,
            )
            for by in (step, -step)
        )
        return float(there - here) / (2 * step)

    # Sums of size 10: rounding 1e-15 over the step of 1e-8.
    np.testing.assert_allclose(
        by_model.position_delay, quotient("position_delay"), rtol=1e-6, atol=1e-6
    )
    np.testing.assert_allclose(
        by_model.law.coulomb, quotient("coulomb"), rtol=1e-6, atol=1e-6
    )
    for number in range(position.size):
        by = step * np.eye(position.size)[number]
        difference = total(model, position + by) - total(model, position - by)
        np.testing.assert_allclose(
            by_place[number], difference / (2 * step), rtol=1e-6, atol=2e-6
        )


def test_at_the_end_of_the_build_up_the_derivative_is_0() -> None:
    position, velocity = np.array([0.0, 1.0, 2.0]), np.ones(3)
    model = FrictionCompensation(TABLE, 0, 2.0)

    def last(delay: jax.Array) -> jax.Array:
        own = dataclasses.replace(model, position_delay=delay)
        return own.run(own.start(), position, velocity)[0][2]

    assert float(jax.grad(last)(jnp.array(2.0))) == 0.0
    # Just before the end it is −current · distance / delay², by the quotient rule.
    found = jax.grad(last)(jnp.array(2.5))
    np.testing.assert_allclose(found, -FULL * 2.0 / 2.5**2, rtol=1e-14)


def test_derivatives_at_rest_and_without_distance_are_numbers() -> None:
    law = StribeckFriction(2.0, 3.0, 0.2, 1.3, 0.1)
    model = FrictionCompensation(law, 4)
    position, velocity = motion((3, 1.0), (3, 0.0), (3, -1.0))

    @jax.jit
    def total(own: FrictionCompensation, place: Any, speed: Any) -> jax.Array:
        return jnp.sum(own.run(own.start(), place, speed)[0] ** 2)

    found = jax.grad(total, (0, 1, 2))(
        model, jnp.asarray(position), jnp.asarray(velocity)
    )
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))


def test_vmap_over_tables_gives_what_a_loop_gives() -> None:
    position, velocity = random_motion(4)
    values = jnp.asarray(np.random.default_rng(5).normal(size=(3, 3)))

    def one(entries: jax.Array) -> jax.Array:
        model = FrictionCompensation(FrictionTable(TABLE.nodes, entries), 4, 0.003, 2)
        return model.run(model.start(), position, velocity)[0]

    looped = jnp.stack([one(row) for row in values])
    # XLA may contract a product and a sum in one of the two and not in the other.
    np.testing.assert_allclose(jax.vmap(one)(values), looped, rtol=0, atol=1e-15)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_no_weight_exceeds_the_law_or_turns_it_round(seed: int) -> None:
    position, velocity = random_motion(seed)
    found = np.asarray(AT_ONCE.run(AT_ONCE.start(), position, velocity)[0])
    law = np.asarray(TABLE(velocity))
    assert (found * law >= 0).all()
    assert (np.abs(found) <= np.abs(law) + ROUNDING).all()


def test_state_and_model_survive_pickling() -> None:
    model, state = pickle.loads(pickle.dumps((PRINTED, PRINTED.start())))
    assert isinstance(state, FrictionState)
    position, velocity = motion((8, 1.0), (4, -1.0))
    np.testing.assert_array_equal(
        model.run(state, position, velocity)[0],
        PRINTED.run(PRINTED.start(), position, velocity)[0],
    )


def test_counts_and_distances_below_zero_are_refused() -> None:
    with pytest.raises(
        ValueError, match="reversal_lookahead cannot be negative, got -1"
    ):
        FrictionCompensation(TABLE, -1)
    with pytest.raises(ValueError, match="delay_cycles cannot be negative, got -2"):
        FrictionCompensation(TABLE, delay_cycles=-2)
    with pytest.raises(
        ValueError, match=r"position_delay cannot be negative, got -0.1"
    ):
        FrictionCompensation(TABLE, 4, -0.1)

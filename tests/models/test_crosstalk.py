"""Crosstalk compensation: the printed lists, branches, filter, derivatives."""

import dataclasses
import pickle
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import (
    AbstractCrosstalk,
    Crosstalk,
    DelaunaySurface,
    LegacyCrosstalk,
    Setpoints,
    ThinPlateSurface,
    surface_through,
)

UNIT = 1e-4  # mm: entries are in 0.1 µm
ROUNDING = 1e-17  # a few roundings of numbers below 0.01
RNG = np.random.default_rng(9)

# [001] p.91: 10000 and −10000 mm/s²; 25 and 25 in positive, 50 and 50 in negative
# direction.
MODE1 = Crosstalk(
    surface_through(np.zeros((1, 0))),
    UNIT * np.array([[25.0], [50.0], [25.0], [50.0]]),
    10000.0,
    -10000.0,
)
# [001] p.91-92: tests at 0, 1000, 2000 × 0.1 µm of one adaptation axis.
MODE2 = Crosstalk(
    surface_through(np.array([[0.0], [0.1], [0.2]])),
    UNIT * np.array([[50.0, 70, 50], [60, 80, 60], [50, 70, 50], [60, 80, 60]]),
    1000.0,
    -1000.0,
)
# [001] p.92 prints tests 0 and 8 of nine, at (0, 0) and (0.3, 0.3) mm; those between are
# ours. acc_pos: 60 and 50; acc_neg: 70 and 60.
PLACES9 = np.array([[x, y] for x in (0.0, 0.15, 0.3) for y in (0.0, 0.15, 0.3)])
ACCELERATE = np.array([60.0, 62, 64, 58, 66, 61, 55, 57, 50])
MODE3 = Crosstalk(
    surface_through(PLACES9),
    UNIT * np.stack([ACCELERATE, ACCELERATE, ACCELERATE + 10, ACCELERATE + 10]),
    1000.0,
    -1000.0,
)
LEGACY = LegacyCrosstalk(
    Setpoints(np.array([-2000.0, 0.0, 500.0])), UNIT * np.array([-30.0, 0.0, 20.0])
)


def test_the_printed_list_of_mode_1() -> None:
    acceleration = np.array([1e4, 5e3, -5e3, -1e4, -1e4, 2.5e3, 0.0, 3e4, -9e4, 1e4])
    velocity = np.array([1.0, 20.0, 3.0, 9.0, -1.0, -4.0, 5.0, 2.0, -2.0, 0.0])
    # Shares 1, ½, ½, 1, 1, ¼, 0, held, held, at rest as positive; as entered: even in a.
    expected = UNIT * np.array([25, 12.5, 12.5, 25, 50, 12.5, 0, 25, 50, 25])
    found = MODE1.offset(acceleration, velocity)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_the_printed_list_of_mode_2() -> None:
    acceleration = np.array([1e3, 500.0, -1e3, 1e3, 1e3, 1e3, -250.0, 2e3])
    velocity = np.array([1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
    at = np.array([0.05, 0.05, 0.1, 0.1, -1.0, 0.3, 0.175, 0.1])
    # Midway 60; half of it; the node 70; 80; both edges held at 50; a quarter of 65.
    expected = UNIT * np.array([60, 30, 70, 80, 50, 50, 16.25, 80])
    found = MODE2.offset(acceleration, velocity, at[:, None])
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)
    covered = [True, True, True, True, False, False, True, True]
    np.testing.assert_array_equal(MODE2.covers(at[:, None]), covered)


def test_the_printed_list_of_mode_3() -> None:
    acceleration = np.array([1e3, -1e3, 1e3, -500.0, 1e3, 1e3])
    velocity = np.array([1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
    at = [[0.0, 0], [0, 0], [0.3, 0.3], [0.3, 0.3], [0.225, 0.225], [9, 9]]
    # Nodes 60, 70, 50, half of 60; the mean of 66, 61, 57, 50; held.
    expected = UNIT * np.array([60, 70, 50, 30, 58.5, 50])
    found = MODE3.offset(acceleration, velocity, np.array(at))
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_the_older_list_is_linear_in_the_acceleration_and_held() -> None:
    found = LEGACY.offset(np.array([-9e3, -1e3, 0.0, 125.0, 500.0, 1e4]), np.zeros(6))
    expected = UNIT * np.array([-30, -15, 0, 5, 20, 20])
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


FOUR = dataclasses.replace(
    MODE1, values=np.array([[1.0], [2.0], [3.0], [4.0]]), deceleration=-20000.0
)


@pytest.mark.parametrize(
    ("reading", "expected"),
    [
        # Of a = 1e4, 1e4, −1e4, −1e4 with v = 1, −1, 1, −1; the last two with v = 0.
        ({}, [1.0, 2.0, 1.5, 2.0, 1.0, 1.5]),
        # Slowing down is a against v: 4 of 20000 for the second, 2 of 10000 for the
        # fourth; at rest |v| grows either way.
        ({"by_speed": True}, [1.0, 2.0, 1.5, 2.0, 1.0, 1.0]),
        ({"velocity_dependent": False}, [1.0, 1.0, 1.5, 1.5, 1.0, 1.5]),
        (
            {"velocity_dependent": False, "own_deceleration": False},
            [1.0, 1.0, 0.5, 0.5, 1.0, 0.5],
        ),
        ({"rest_direction": -1}, [1.0, 2.0, 1.5, 2.0, 2.0, 2.0]),
        ({"sign": -1.0}, [-1.0, -2.0, -1.5, -2.0, -1.0, -1.5]),
    ],
)
def test_readings_of_the_branches(
    reading: dict[str, Any], expected: list[float]
) -> None:
    acceleration = np.array([1e4, 1e4, -1e4, -1e4, 1e4, -1e4])
    velocity = np.array([1.0, -1.0, 1.0, -1.0, 0.0, 0.0])
    model = dataclasses.replace(FOUR, **reading)
    np.testing.assert_array_equal(model.offset(acceleration, velocity), expected)


def test_readings_beyond_the_specified_values() -> None:
    grows = dataclasses.replace(MODE2, held_above=False)
    nothing = dataclasses.replace(MODE2, held_outside=False)
    a, v = np.array([3000.0, 1000.0]), np.ones(2)
    at = np.array([[0.1], [0.3]])
    np.testing.assert_allclose(
        grows.offset(a, v, at), UNIT * np.array([210.0, 50.0]), rtol=1e-15
    )
    np.testing.assert_allclose(
        nothing.offset(a, v, at), UNIT * np.array([70.0, 0.0]), rtol=1e-15
    )


# ------------------------------------------------------------ stencils and derivatives

LOOSE = np.stack([RNG.uniform(0, 300, 7), RNG.uniform(0, 200, 7)], axis=1)
TABLE = RNG.normal(size=(4, 7))
TRIANGLES = Crosstalk(DelaunaySurface.through(LOOSE), TABLE, 700.0, -900.0)
PLATE = Crosstalk(ThinPlateSurface.through(LOOSE), TABLE, 700.0, -900.0)
A = RNG.uniform(-1500, 1500, 80)
V = RNG.normal(size=80)
BOTH = np.stack([RNG.uniform(-50, 350, 80), RNG.uniform(-50, 250, 80)], axis=1)
CASES: list[tuple[AbstractCrosstalk, Any]] = [
    (MODE1, None),
    (MODE2, 1e-3 * BOTH[:, :1]),
    (MODE3, 1e-3 * BOTH),
    (dataclasses.replace(MODE3, velocity_dependent=False), 1e-3 * BOTH),
    (dataclasses.replace(TRIANGLES, held_outside=False), BOTH),
    (TRIANGLES, BOTH),
    (PLATE, BOTH),
    (LEGACY, None),
]


@pytest.mark.parametrize(("model", "places"), CASES)
def test_the_stencil_gives_what_the_model_gives(model: Any, places: Any) -> None:
    stencil = model.stencil(A, V, places)
    assert stencil.size == model.values.size
    # Sums of up to 10 products of size 1.
    np.testing.assert_allclose(
        stencil(model.values.reshape(-1)),
        model.offset(A, V, places),
        rtol=0,
        atol=1e-12,
    )


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(1, marks=pytest.mark.heavy),  # a grid of one axis; 2: of two
        2,
        pytest.param(5, marks=pytest.mark.slow),
        7,
    ],
)
def test_derivatives_agree_with_finite_differences(number: int) -> None:
    model, places = CASES[number]
    weights = jnp.asarray(RNG.normal(size=A.size))
    at = jnp.zeros((A.size, 0)) if places is None else jnp.asarray(places)
    scale = float(jnp.max(jnp.abs(model.values)))  # type: ignore[attr-defined]

    @jax.jit
    def total(own: Any, a: Any, p: Any) -> jax.Array:
        return jnp.vdot(weights, own.offset(a, V, p)) / scale

    by_model, by_a, by_p = jax.grad(total, (0, 1, 2))(model, jnp.asarray(A), at)
    for row in (0, 17, 43):
        step = 1e-3
        by = step * np.eye(A.size)[row]
        quotient = (total(model, A + by, at) - total(model, A - by, at)) / (2 * step)
        # A sum of size 10: rounding 1e-14 / 1e-3; no sample is that near to a kink.
        np.testing.assert_allclose(by_a[row], quotient, rtol=1e-6, atol=1e-10)
        for axis in range(at.shape[1]):
            step = 1e-6 * float(jnp.max(at))
            by = step * np.eye(A.size)[row][:, None] * np.eye(at.shape[1])[axis]
            there, here = total(model, A, at + by), total(model, A, at - by)
            # The same over a step of 4e-7 mm, or of 4e-4 mm.
            np.testing.assert_allclose(
                by_p[row, axis],
                (there - here) / (2 * step),
                rtol=1e-6,
                atol=1e-14 / step,
            )
    leaves, structure = jax.tree.flatten(model)
    for leaf, slope in zip(leaves, jax.tree.leaves(by_model), strict=True):
        place = np.unravel_index(leaf.size // 2, leaf.shape)
        step = 1e-6 * float(jnp.max(jnp.abs(leaf)))

        def moved(by: float, own: Any = leaf, p: Any = place) -> jax.Array:
            new = [own.at[p].add(by) if x is own else x for x in leaves]
            return total(jax.tree.unflatten(structure, new), A, at)

        quotient = (moved(step) - moved(-step)) / (2 * step)
        np.testing.assert_allclose(slope[place], quotient, rtol=1e-6, atol=3e-14 / step)


def test_derivatives_by_acceleration_at_kinks() -> None:
    model = FOUR
    at = jnp.array([0.0, 1e4, -2e4, 5e3, -5e3])
    found = jax.grad(lambda a: jnp.sum(model.offset(a, jnp.ones(5))))(at)
    # At 0 that of positive ones; 0 from the specified ones on; −3/20000 when braking.
    np.testing.assert_allclose(found, [1e-4, 0.0, 0.0, 1e-4, -1.5e-4], rtol=1e-15)


@pytest.mark.parametrize("number", [2, 5, 7])
def test_vmap_over_values_gives_what_a_loop_gives(number: int) -> None:
    model, places = CASES[number]
    batch = jnp.asarray(RNG.normal(size=(3, *model.values.shape)))  # type: ignore[attr-defined]

    def one(values: jax.Array) -> jax.Array:
        own: Any = dataclasses.replace(model, values=values)
        return own.run(own.start(), A, V, places)[0]

    # XLA may contract a product and a sum in one of the two and not in the other.
    np.testing.assert_allclose(
        jax.vmap(one)(batch), jnp.stack([one(row) for row in batch]), rtol=0, atol=1e-14
    )


# ------------------------------------------------------------------------------- in time


def test_values_come_through_the_filter_as_sin_squared() -> None:
    model = dataclasses.replace(MODE1, cycles=4)
    found, _ = model.run(model.start(), np.full(6, 1e4), np.ones(6))
    k = np.arange(1, 5)
    expected = [*(25 * UNIT * np.sin(np.pi / 2 * k / 4) ** 2), 25 * UNIT, 25 * UNIT]
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_without_cycles_values_come_at_once() -> None:
    found, _ = MODE1.run(MODE1.start(), A, V)
    np.testing.assert_array_equal(found, MODE1.offset(A, V))


@pytest.mark.parametrize(
    ("number", "size", "rounding"),
    # In a program for one cycle the weights of a triangle are contracted differently.
    [(0, 1, 0.0), (2, 1, 0.0), (2, 30, 0.0), (5, 7, 0.0), (5, 1, 1e-15), (7, 30, 0.0)],
)
def test_a_log_in_pieces_gives_the_log_at_once_to_the_last_bit(
    number: int, size: int, rounding: float
) -> None:
    case, places = CASES[number]
    model: Any = dataclasses.replace(case, cycles=5)  # type: ignore[type-var]
    whole, _ = model.run(model.start(), A, V, places)
    state, found = model.start(), []
    for at in range(0, A.size, size):
        piece = slice(at, at + size)
        own = None if places is None else places[piece]
        part, state = model.run(state, A[piece], V[piece], own)
        found.append(np.asarray(part))
    np.testing.assert_allclose(np.concatenate(found), whole, rtol=0, atol=rounding)


# ---------------------------------------------------------------------------- properties

ENTRIES = st.floats(-1.0, 1.0)


@settings(max_examples=60, deadline=None)
@given(up=ENTRIES, down=ENTRIES, a=st.floats(0.0, 3e4), v=st.sampled_from([-2.0, 2.0]))
def test_mode_1_is_as_odd_or_even_as_its_entries(
    up: float, down: float, a: float, v: float
) -> None:
    both = np.array([a, -a]), np.array([v, v])
    for sign in (1.0, -1.0):
        values = np.array([[up], [down], [sign * up], [sign * down]])
        there, back = dataclasses.replace(MODE1, values=values).offset(*both)
        assert float(back) == sign * float(there)
        assert abs(float(there)) <= abs(up if v > 0 else down)


@settings(max_examples=60, deadline=None)
@given(
    a=st.floats(-2e3, 2e3),
    step=st.floats(-1.0, 1.0),
    place=st.tuples(st.floats(-50, 350), st.floats(-50, 250)),
)
def test_offsets_are_continuous_in_the_acceleration_and_within_the_entries(
    a: float, step: float, place: tuple[float, float]
) -> None:
    here, there = TRIANGLES.offset(
        np.array([a, a + step]), np.ones(2), np.array([place, place])
    )
    largest = np.abs(TABLE).max()
    assert abs(here) <= largest + 1e-12
    # Linear to the specified 700 and −900 mm/s².
    assert abs(here - there) <= largest / 700 * abs(step) + 1e-12


@pytest.mark.parametrize(("model", "places"), CASES)
def test_models_survive_pickling(model: Any, places: Any) -> None:
    copy = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(copy.offset(A, V, places), model.offset(A, V, places))


def test_lists_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(4, 3\), got shape \(4, 2\)"):
        dataclasses.replace(MODE2, values=np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r"acceleration must be positive, got 0\.0"):
        dataclasses.replace(MODE2, acceleration=0.0)
    with pytest.raises(ValueError, match=r"deceleration must be negative, got 5\.0"):
        dataclasses.replace(MODE2, deceleration=5.0)
    with pytest.raises(ValueError, match=r"per acceleration, \(3,\), got shape \(2,\)"):
        dataclasses.replace(LEGACY, values=np.zeros(2))
    with pytest.raises(ValueError, match="have 1 adaptation axes, got positions of 2"):
        MODE2.offset(A, V, BOTH)
    with pytest.raises(ValueError, match="have 1 adaptation axes, got positions of 0"):
        MODE2.offset(A, V)

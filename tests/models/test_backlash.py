import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import Backlash

# Forward, a dwell, back, a dwell, forward again.
PLACES = jnp.array([0.0, 1.0, 2.0, 2.0, 1.0, 0.0, 0.0, 1.0])


def offsets(model: Backlash, places: jax.Array) -> jax.Array:
    return model.run(model.start(), places)[0]


@pytest.mark.parametrize(
    ("width", "reference", "expected"),
    [
        # getriebe[0].lose 1000 = 0.1 mm (manual [001] p. 13), anwahl_losekomp 1 and 2.
        (0.1, 1, [0, 0, 0, 0, -0.1, -0.1, -0.1, 0]),
        (0.1, -1, [0.1, 0.1, 0.1, 0.1, 0, 0, 0, 0.1]),
        (-0.1, 1, [0, 0, 0, 0, 0.1, 0.1, 0.1, 0]),
        (-0.1, -1, [-0.1, -0.1, -0.1, -0.1, 0, 0, 0, -0.1]),
    ],
)
def test_the_width_is_added_when_moving_against_the_reference(
    width: float, reference: int, expected: list[float]
) -> None:
    model = Backlash(width, reference)
    np.testing.assert_array_equal(offsets(model, PLACES), expected)


def test_a_reversal_is_spread_by_sine_squared() -> None:
    model = Backlash(0.1, cycles=4)
    places = jnp.array([0.0, 1.0, 0.0, -1.0, -2.0, -3.0, -4.0])
    half = np.sqrt(0.5)
    shares = [0, 0, (1 - half) / 2, 0.5, (1 + half) / 2, 1, 1]
    np.testing.assert_allclose(
        offsets(model, places), -0.1 * np.array(shares), rtol=0, atol=1e-16
    )


def test_a_reversal_during_a_reversal_is_superposed() -> None:
    model = Backlash(0.1, cycles=2)
    places = jnp.array([0.0, 1.0, 0.0, 1.0, 2.0])
    # Half of the way back in the cycle of the reversal, half of it taken back then.
    np.testing.assert_allclose(
        offsets(model, places), [0, 0, -0.05, -0.05, 0], rtol=0, atol=1e-16
    )


def test_a_spread_goes_on_while_the_axis_stands() -> None:
    model = Backlash(0.1, cycles=2)
    places = jnp.array([0.0, 1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(
        offsets(model, places), [0, 0, -0.05, -0.1, -0.1], rtol=0, atol=1e-16
    )


@pytest.mark.parametrize("cuts", [[1], [3, 4, 5], [7]])
def test_a_log_in_pieces_is_the_log_at_once_to_the_last_bit(cuts: list[int]) -> None:
    model = Backlash(0.1, cycles=3)
    whole, _ = model.run(model.start(), PLACES)
    state, parts = model.start(), []
    for piece in np.split(np.asarray(PLACES), cuts):
        found, state = model.run(state, jnp.asarray(piece))
        parts.append(found)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(
    st.lists(st.integers(-3, 3), min_size=20, max_size=20),
    st.floats(-0.2, 0.2),
    st.sampled_from([1, -1]),
)
def test_the_offset_stays_between_nothing_and_the_width(
    steps: list[int], width: float, reference: int
) -> None:
    model = Backlash(width, reference, cycles=5)
    found = reference * offsets(model, jnp.cumsum(jnp.array(steps, dtype=float)))
    low, high = sorted([0.0, -width])
    # Five sums of numbers of size 0.2.
    assert np.min(found) >= low - 1e-15
    assert np.max(found) <= high + 1e-15


def test_derivatives_are_the_share_for_the_width_and_none_for_the_position() -> None:
    model = Backlash(0.1, cycles=2)
    places = jnp.array([0.0, 1.0, 0.0, -1.0])

    def total(model: Backlash, places: jax.Array) -> jax.Array:
        return jnp.sum(offsets(model, places))

    slope, moved = jax.grad(total, argnums=(0, 1))(model, places)
    assert float(slope.width) == pytest.approx(-1.5, abs=1e-15)  # half, then all
    np.testing.assert_array_equal(moved, np.zeros(4))


def test_vmap_over_widths_gives_what_a_loop_gives() -> None:
    widths = jnp.array([0.1, -0.05, 0.0])
    found = jax.vmap(lambda w: offsets(Backlash(w, cycles=3), PLACES))(widths)
    for width, expected in zip(widths, found, strict=True):
        one = offsets(Backlash(width, cycles=3), PLACES)
        # The product may be contracted with the sum in one of the two.
        np.testing.assert_allclose(one, expected, rtol=0, atol=1e-17)


def test_a_reference_that_is_no_direction_is_refused() -> None:
    with pytest.raises(ValueError, match="reference must be 1 or -1, got 0"):
        Backlash(0.1, 0)
    with pytest.raises(ValueError, match="cannot be negative, got -3"):
        Backlash(0.1, cycles=-3)

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.models import Delay, SineSquaredFilter

HALF = np.sqrt(0.5)


def test_a_step_over_four_cycles_takes_the_values_of_sine_squared() -> None:
    smoother = SineSquaredFilter(4)
    found, _ = smoother.run(smoother.start(), jnp.ones(6))
    # sin² of 22.5°, 45°, 67.5°, 90°, by the half-angle formula.
    expected = [(1 - HALF) / 2, 0.5, (1 + HALF) / 2, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)  # one rounding


def test_changes_that_overlap_are_superposed() -> None:
    smoother = SineSquaredFilter(2)
    values = jnp.array([1.0, 3.0, 3.0, 0.0, 0.0])
    found, _ = smoother.run(smoother.start(), values)
    # Shares of two cycles are a half each: means of neighbours.
    np.testing.assert_allclose(found, [0.5, 2.0, 3.0, 1.5, 0.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("cycles", [0, 1])
def test_none_and_one_cycle_are_abrupt(cycles: int) -> None:
    smoother = SineSquaredFilter(cycles)
    values = jnp.array([0.0, 2.0, -1.0])
    np.testing.assert_array_equal(smoother.run(smoother.start(), values)[0], values)


def test_a_late_filter_lets_nothing_through_in_the_cycle_of_the_change() -> None:
    smoother = SineSquaredFilter(2, late=1)
    found, _ = smoother.run(smoother.start(), jnp.ones(4))
    np.testing.assert_allclose(found, [0.0, 0.5, 1.0, 1.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("cycles", [2, 3, 7, 20])
def test_shares_of_all_cycles_sum_up_to_one_exactly(cycles: int) -> None:
    smoother = SineSquaredFilter(cycles)
    assert smoother.response[-1] == 1.0
    assert np.all(np.diff(smoother.response) > 0)
    constant = jnp.full(30, 0.1)
    found, _ = smoother.run(smoother.start(0.1), constant)
    np.testing.assert_array_equal(found, constant)


@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=30, max_size=30),
    st.sampled_from([0, 2, 20]),
)
def test_filtered_values_stay_within_the_range_of_the_values(
    values: list[float], cycles: int
) -> None:
    smoother = SineSquaredFilter(cycles)
    found, _ = smoother.run(smoother.start(), jnp.array(values))
    # Twenty sums of numbers of size 1.
    assert np.max(found) <= max(*values, 0.0) + 1e-14
    assert np.min(found) >= min(*values, 0.0) - 1e-14


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("cuts", [[1, 2, 3], [50], [7, 8, 60, 99]])
def test_a_log_in_pieces_is_the_log_at_once_to_the_last_bit(
    cuts: list[int], late: int
) -> None:
    smoother = SineSquaredFilter(9, late)
    values = jnp.asarray(np.random.default_rng(1).normal(size=100))
    whole, end = smoother.run(smoother.start(0.5), values)
    state, parts = smoother.start(0.5), []
    for piece in np.split(np.asarray(values), cuts):
        part, state = smoother.run(state, jnp.asarray(piece))
        parts.append(part)
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(state.values, end.values)


def test_derivative_of_the_sum_is_the_share_that_comes_through() -> None:
    smoother = SineSquaredFilter(4)

    def total(values: jax.Array) -> jax.Array:
        return jnp.sum(smoother.run(smoother.start(), values)[0])

    found = jax.grad(total)(jnp.zeros(6))
    shares = np.diff(smoother.response, prepend=0.0)
    through = [1.0, 1.0, 1.0, *np.cumsum(shares)[2::-1]]
    np.testing.assert_allclose(found, through, rtol=0, atol=1e-15)  # sums of 4 shares


def test_vmap_gives_what_a_loop_gives() -> None:
    smoother = SineSquaredFilter(5)
    rows = jnp.asarray(np.random.default_rng(2).normal(size=(3, 12)))
    found = jax.vmap(lambda row: smoother.run(smoother.start(), row)[0])(rows)
    for row, expected in zip(rows, found, strict=True):
        np.testing.assert_array_equal(smoother.run(smoother.start(), row)[0], expected)


@pytest.mark.parametrize("cycles", [0, 1, 3, 9])
def test_a_delay_passes_each_value_on_later_in_pieces_too(cycles: int) -> None:
    delay = Delay(cycles)
    values = jnp.arange(1.0, 7.0)
    expected = np.concatenate([np.full(cycles, 0.5), values])[:6]
    np.testing.assert_array_equal(delay.run(delay.start(0.5), values)[0], expected)
    first, state = delay.run(delay.start(0.5), values[:2])
    second, _ = delay.run(state, values[2:])
    np.testing.assert_array_equal(jnp.concatenate([first, second]), expected)


def test_negative_numbers_of_cycles_are_refused() -> None:
    with pytest.raises(ValueError, match="cannot be negative, got -1"):
        SineSquaredFilter(-1)
    with pytest.raises(ValueError, match="cannot be negative, got -2"):
        SineSquaredFilter(3, late=-2)
    with pytest.raises(ValueError, match="cannot be negative, got -1"):
        Delay(-1)


def test_what_goes_back_through_the_filter_is_the_transpose_of_what_it_does() -> None:
    filtering = SineSquaredFilter(5)
    rng = np.random.default_rng(4)
    values, amounts = rng.normal(size=(3, 30)), rng.normal(size=(3, 30))

    def run(row: jax.Array) -> jax.Array:
        return filtering.run(filtering.start(), row)[0]

    forward = jax.vmap(run)(jnp.asarray(values))
    looped = jnp.stack([run(jnp.asarray(row)) for row in values])
    np.testing.assert_array_equal(forward, looped)
    back = jax.vmap(lambda row, amount: jax.vjp(run, row)[1](amount)[0])(
        jnp.asarray(values), jnp.asarray(amounts)
    )
    # Thirty products of numbers near 1, summed up in two orders.
    assert float(jnp.vdot(forward, amounts) - jnp.vdot(values, back)) == pytest.approx(
        0.0, abs=1e-13
    )
    matrix = jax.jacfwd(run)(jnp.asarray(values[0]))
    np.testing.assert_allclose(
        jax.jacrev(run)(jnp.asarray(values[0])), matrix, rtol=0, atol=1e-15
    )

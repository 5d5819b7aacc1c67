import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import DirectionState, directions, first_motion

PLACES = jnp.array([5.0, 5.0, 6.0, 6.0, 6.0, 5.5, 5.0, 5.0, 7.0])


def test_the_last_step_that_was_one_gives_the_direction() -> None:
    found, turned, state = directions(DirectionState.start(), PLACES)
    np.testing.assert_array_equal(found, [1, 1, 1, 1, 1, -1, -1, -1, 1])
    np.testing.assert_array_equal(np.flatnonzero(turned), [5, 8])
    assert float(state.direction) == 1.0
    assert float(state.position) == 7.0
    assert bool(state.moved)


def test_before_the_first_motion_the_start_direction_holds() -> None:
    found, turned, state = directions(DirectionState.start(-1), PLACES)
    np.testing.assert_array_equal(found, [-1, -1, 1, 1, 1, -1, -1, -1, 1])
    np.testing.assert_array_equal(np.flatnonzero(turned), [2, 5, 8])
    still, turned, state = directions(DirectionState.start(-1), jnp.full(4, 3.0))
    np.testing.assert_array_equal(still, [-1, -1, -1, -1])
    assert not np.any(turned)
    assert not bool(state.moved)


def test_the_first_motion_of_all_is_told_from_later_ones() -> None:
    np.testing.assert_array_equal(
        np.flatnonzero(first_motion(DirectionState.start(), PLACES)), [2]
    )
    _, _, state = directions(DirectionState.start(), PLACES[:4])
    assert not np.any(first_motion(state, PLACES[4:]))
    _, _, state = directions(DirectionState.start(), PLACES[:2])
    np.testing.assert_array_equal(np.flatnonzero(first_motion(state, PLACES[2:])), [0])


@pytest.mark.parametrize("cuts", [[1], [2, 3, 4], [120, 121, 300]])
def test_a_log_in_pieces_is_the_log_at_once(cuts: list[int]) -> None:
    steps = np.random.default_rng(3).choice([-1.0, 0.0, 0.0, 0.0, 1.0], 500)
    steps[100:200] = 0.0  # a dwell that is longer than a row of the evaluation
    places = np.cumsum(steps)
    whole, turned, end = directions(DirectionState.start(), jnp.asarray(places))
    last, expected = 1.0, []
    for step in np.diff(places, prepend=places[0]):
        last = np.sign(step) if step != 0.0 else last
        expected.append(last)
    np.testing.assert_array_equal(whole, expected)
    state, parts, turns = DirectionState.start(), [], []
    for piece in np.split(places, cuts):
        found, turn, state = directions(state, jnp.asarray(piece))
        parts.append(found)
        turns.append(turn)
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(np.concatenate(turns), turned)
    assert jax.tree.all(jax.tree.map(lambda a, b: bool(a == b), state, end))


def test_an_empty_piece_changes_nothing() -> None:
    start = DirectionState.start(-1)
    found, turned, state = directions(start, jnp.zeros(0))
    assert found.size == turned.size == 0
    assert float(state.direction) == -1.0


def test_a_direction_has_no_derivative() -> None:
    slope = jax.grad(lambda x: jnp.sum(directions(DirectionState.start(), x)[0]))
    np.testing.assert_array_equal(slope(PLACES), np.zeros(9))


def test_vmap_gives_what_a_loop_gives() -> None:
    rng = np.random.default_rng(4)
    rows = jnp.asarray(np.cumsum(rng.choice([-1.0, 0.0, 1.0], (3, 40)), axis=1))
    found = jax.vmap(lambda row: directions(DirectionState.start(), row)[0])(rows)
    for row, expected in zip(rows, found, strict=True):
        one, _, _ = directions(DirectionState.start(), row)
        np.testing.assert_array_equal(one, expected)

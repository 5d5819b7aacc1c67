"""What the controller answers to external offsets that are too large or too fast."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import Answer, Conventions, ExternalLimits

DT = 1e-3
LIMITS = ExternalLimits(np.array([0.1]), np.array([0.5]), np.array([1e6]))


def answer(limits: ExternalLimits, offsets: np.ndarray) -> Answer:
    table = offsets.reshape(len(offsets), -1)
    return limits.run(limits.start(table[0]), table, DT)[0]


def test_warning_comes_when_the_limit_is_passed_and_when_it_is_passed_again() -> None:
    found = answer(LIMITS, np.array([0.0, 0.1, 0.11, 0.2, 0.1, -0.15, -0.2, 0.0]))
    # 0.1 is at the limit, not above it.
    codes = [0, 0, 70583, 0, 0, 70583, 0, 0]
    np.testing.assert_array_equal(found.codes[:, 0], codes)
    assert bool(jnp.all(found.active))


def test_error_stops_the_compensation_for_good() -> None:
    found = answer(LIMITS, np.array([0.0, 0.4, 0.6, 0.0, 0.2]))
    np.testing.assert_array_equal(found.codes[:, 0], [0, 70583, 70584, 0, 0])
    np.testing.assert_array_equal(found.active, [True, True, False, False, False])


def test_error_of_one_axis_stops_all() -> None:
    limits = ExternalLimits(np.zeros(2), np.array([0.5, 0.5]), np.full(2, 1e6))
    offsets = np.array([[0.0, 0.0], [0.6, 0.0], [0.6, 0.7]])
    found = limits.run(limits.start(offsets[0]), offsets, DT)[0]
    np.testing.assert_array_equal(found.codes, [[0, 0], [70584, 0], [0, 0]])


def test_acceleration_is_the_second_difference_of_the_offsets() -> None:
    # 1 µm, 4 µm, 9 µm …: 2 µm per ms² are 2000 mm/s² in every cycle but the first,
    # which starts at rest with 1 µm per ms².
    offsets = 1e-3 * np.arange(6) ** 2
    wide = np.array([0.0]), np.array([1.0])
    for largest, code in ((2000.1, 0), (1999.9, 70586)):
        limits = ExternalLimits(*wide, np.array([largest]))
        found = answer(limits, offsets)
        np.testing.assert_array_equal(found.codes[:, 0], [0, 0, code, 0, 0, 0])


def test_switching_on_is_no_motion() -> None:
    # From the start offset on, wherever it is.
    found = answer(LIMITS, np.full(3, 0.09))
    np.testing.assert_array_equal(found.codes[:, 0], 0)


def test_limits_of_the_change_are_the_other_reading() -> None:
    change = ExternalLimits(
        np.array([0.1]), np.array([0.5]), np.array([1e9]), of_change=True
    )
    found = answer(change, np.array([0.4, 0.4, 0.52, 0.6, 1.2]))
    np.testing.assert_array_equal(found.codes[:, 0], [0, 0, 70583, 0, 70584])
    assert Conventions().external_limit == "offset"


@pytest.mark.parametrize("name", ["error", "acceleration"])
def test_missing_limits_are_reported_at_once(name: str) -> None:
    given = {"warning": 0.0, "error": 0.5, "acceleration": 1e6} | {name: 0.0}
    limits = ExternalLimits(
        np.array([given["warning"]]),
        np.array([given["error"]]),
        np.array([given["acceleration"]]),
    )
    found = answer(limits, np.zeros(3))
    np.testing.assert_array_equal(found.codes[:, 0], [70585, 0, 0])
    assert not bool(jnp.any(found.active))


def test_pieces_of_any_length_are_the_whole_to_the_last_bit() -> None:
    rng = np.random.default_rng(7)
    offsets = np.cumsum(rng.normal(0.0, 0.02, (200, 2)), axis=0)
    limits = ExternalLimits(np.array([0.1, 0.05]), np.full(2, 0.4), np.full(2, 5e4))
    whole = limits.run(limits.start(offsets[0]), offsets, DT)[0]
    assert bool(jnp.any(whole.codes == 70583))
    state, codes, active = limits.start(offsets[0]), [], []
    for piece in np.split(offsets, [1, 2, 5, 60, 61, 150]):
        found, state = limits.run(state, piece, DT)
        codes.append(found.codes)
        active.append(found.active)
    np.testing.assert_array_equal(jnp.concatenate(codes), whole.codes)
    np.testing.assert_array_equal(jnp.concatenate(active), whole.active)


def test_batch_of_machines_is_the_loop_over_them() -> None:
    offsets = jnp.asarray(np.random.default_rng(8).normal(0, 0.2, (4, 30, 1)))

    def codes(table: jax.Array) -> jax.Array:
        return LIMITS.run(LIMITS.start(table[0]), table, DT)[0].codes

    batch = jax.vmap(codes)(offsets)
    np.testing.assert_array_equal(batch, jnp.stack([codes(one) for one in offsets]))


def test_limits_that_are_none_are_refused() -> None:
    one = np.array([0.1])
    with pytest.raises(ValueError, match=r"error must not be negative, got \[-1"):
        ExternalLimits(one, np.array([-1.0]), one)
    with pytest.raises(ValueError, match="one number per axis, got shapes"):
        ExternalLimits(one, np.array([1.0, 2.0]), one)

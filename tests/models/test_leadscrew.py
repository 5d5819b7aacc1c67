import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import EquidistantNodes, Leadscrew, Setpoints

POINTS = np.array([-20.0, -19.9306, -19.8667, -19.8001])
POS = np.array([0.0, 0.0024, -0.0102, 0.001])
NEG = np.array([0.0, 0.0067, 0.0080, -0.002])
SCREW = Leadscrew(Setpoints(POINTS), POS, NEG)
ROTARY = EquidistantNodes(0.0, 90.0, 5)
AROUND = np.array([0.0, 0.1, 0.3, -0.2, 0.0])
ROUNDING = 1e-16  # two products of numbers around 0.01 and their sum


def test_the_printed_example_gives_minus_the_error_of_its_direction() -> None:
    # [001] p.62, figures as printed (S-18, S-24): Δ = -102 and 80 at table[2], 0.1 µm.
    at = np.full(2, -19.8667)
    found = SCREW.offset(at, np.array([1, -1]))
    np.testing.assert_allclose(found, [0.0102, -0.0080], rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(("direction", "values"), [(1, POS), (-1, NEG)])
def test_each_direction_agrees_with_numpy(direction: int, values: np.ndarray) -> None:
    at = np.random.default_rng(6).uniform(-20.1, -19.7, 300)
    expected = np.interp(at, POINTS, values)
    # Slopes up to 0.2 mm/mm times the rounding of a position of 20 mm.
    np.testing.assert_allclose(SCREW.entry(at, direction), expected, atol=1e-15)


def test_direction_may_change_from_sample_to_sample_and_be_of_any_number_type() -> None:
    at = np.full(4, -19.9306)
    expected = [0.0024, 0.0067, 0.0067, 0.0024]
    for direction in (np.array([1, -1, -1, 1]), np.array([0.5, -1.0, -0.2, 1.0])):
        np.testing.assert_array_equal(SCREW.entry(at, direction), expected)


FORMS = """
import jax, jax.numpy as jnp, numpy as np
from axcomp.models import Leadscrew, Setpoints
screw = Leadscrew(Setpoints(np.array([0.0, 1.0, 3.0])), np.array([0.1, 0.4, -0.2]))
for form in ((), (2, 3)):
    places = np.random.default_rng(2).uniform(-1.0, 4.0, (4, *form))
    along = screw.offset(places.ravel()).reshape(places.shape)
    for found in (np.stack([*map(screw.offset, places)]), jax.vmap(screw.offset)(places)):
        np.testing.assert_array_equal(found, along)
    total = jax.grad(lambda own, place: jnp.sum(own.offset(place)))
    shares = total(screw, jnp.asarray(places[0])).pos
    # By the entries: each reading adds its two shares, whose sum is -1.
    np.testing.assert_allclose(shares.sum(), -places[0].size, rtol=1e-12)
"""


def test_one_position_and_rows_of_them_keep_their_form() -> None:
    # Other types than annotated: here they would be refused.
    subprocess.run([sys.executable, "-c", FORMS], check=True)


def test_standstill_without_a_past_counts_as_positive() -> None:
    at = np.full(1, -19.9306)
    np.testing.assert_array_equal(SCREW.entry(at, np.array([0])), [0.0024])


def test_a_unilateral_table_serves_both_directions() -> None:
    one = Leadscrew(Setpoints(POINTS), POS)
    assert not one.bilateral
    assert SCREW.bilateral
    np.testing.assert_array_equal(one.entry(POINTS, -1), one.entry(POINTS, 1))
    assert one.stencil(POINTS, -1).size == 4


def test_nodes_of_the_negative_direction_come_after_those_of_the_positive() -> None:
    stencil = SCREW.stencil(np.array([-19.95, -19.95]), np.array([1, -1]))
    np.testing.assert_array_equal(stencil.nodes, [[0, 1], [4, 5]])
    assert stencil.size == 8
    np.testing.assert_array_equal(SCREW.values, np.concatenate([POS, NEG]))


def test_stencil_and_evaluation_agree() -> None:
    rng = np.random.default_rng(7)
    at, direction = rng.uniform(-20.1, -19.7, 200), rng.choice([-1, 1], 200)
    np.testing.assert_allclose(
        SCREW.stencil(at, direction)(SCREW.values),
        SCREW.entry(at, direction),
        rtol=0,
        atol=ROUNDING,
    )


def test_the_edge_is_held() -> None:
    at = np.array([-1e3, 1e3])
    np.testing.assert_array_equal(SCREW.entry(at), POS[[0, -1]])
    np.testing.assert_array_equal(SCREW.entry(at, -1), NEG[[0, -1]])


def test_a_reversal_blends_from_one_table_to_the_other() -> None:
    at = np.full(3, -19.9306)
    found = SCREW.blended_offset(at, np.array([0.0, 0.25, 1.0]))
    expected = [-0.0024, -(0.75 * 0.0024 + 0.25 * 0.0067), -0.0067]
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_a_modulo_axis_is_wrapped_into_the_range_of_its_points() -> None:
    model = Leadscrew(ROTARY, AROUND, modulo=True)
    at = np.array([45.0, 405.0, -315.0, 3645.0])
    np.testing.assert_allclose(model.entry(at), np.full(4, 0.05), rtol=0, atol=1e-16)


def test_the_modulo_transition_takes_the_slope_of_the_first_cell() -> None:
    model = Leadscrew(ROTARY, AROUND, modulo=True)
    around = np.array([360.0 - 1e-9, 360.0, 360.0 + 1e-9])
    # Slopes of 0.002 per degree times 1e-9, plus rounding of 360 times the slope.
    np.testing.assert_allclose(model.entry(around), np.zeros(3), rtol=0, atol=3e-12)
    slope = jax.grad(lambda x: jnp.sum(model.entry(x)))(jnp.asarray(around))
    np.testing.assert_allclose(slope, [0.2 / 90, 0.1 / 90, 0.1 / 90], rtol=1e-12)


def test_a_given_modulo_range_counts() -> None:
    model = Leadscrew(EquidistantNodes(0.0, 90.0, 4), AROUND[:4], modulo=(0.0, 360.0))
    # Between the last point and the end of the range the edge is held.
    np.testing.assert_array_equal(model.entry(np.array([300.0, -60.0])), [-0.2, -0.2])
    np.testing.assert_array_equal(model.entry(np.array([360.0])), [0.0])


def test_gradient_with_respect_to_each_branch_comes_from_its_own_samples() -> None:
    at, direction = np.array([-19.95, -19.95, -19.85]), np.array([1, 1, -1])
    found = jax.grad(lambda model: jnp.sum(model.entry(at, direction)))(SCREW)
    weights = SCREW.stencil(at, direction).weights
    pos, neg = np.zeros(4), np.zeros(4)
    np.add.at(pos, [0, 1, 0, 1], np.asarray(weights[:2]).reshape(-1))
    np.add.at(neg, [2, 3], np.asarray(weights[2]))
    np.testing.assert_allclose(found.pos, pos, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.neg, neg, rtol=0, atol=1e-15)


def test_gradient_with_respect_to_position_is_the_slope_of_the_branch() -> None:
    at, direction = jnp.full(2, -19.95), np.array([1, -1])
    found = jax.grad(lambda x: jnp.sum(SCREW.offset(x, direction)))(at)
    expected = [-0.0024 / 0.0694, -0.0067 / 0.0694]
    # The width of the cell, 0.0694, is a difference of numbers around 20.
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_vmap_over_positions_and_directions_gives_what_a_loop_gives() -> None:
    rng = np.random.default_rng(8)
    at = jnp.asarray(rng.uniform(-20.1, -19.7, (3, 9)))
    direction = jnp.asarray(rng.choice([-1, 1], (3, 9)))

    @jax.jit
    def gradient(x: jax.Array, d: jax.Array) -> tuple[jax.Array, Leadscrew]:
        return SCREW.entry(x, d), jax.grad(lambda m: jnp.sum(m.entry(x, d) ** 2))(SCREW)

    values, slopes = jax.vmap(gradient)(at, direction)
    for lane in range(3):
        value, slope = gradient(at[lane], direction[lane])
        np.testing.assert_allclose(values[lane], value, rtol=0, atol=ROUNDING)
        # 9 samples in the same order, contracted differently.
        np.testing.assert_allclose(slopes.pos[lane], slope.pos, rtol=0, atol=1e-15)


def test_jit_and_eager_agree_with_the_direction_traced() -> None:
    at, direction = jnp.full(2, -19.95), jnp.array([1, -1])
    compiled = jax.jit(lambda m, x, d: m.offset(x, d))(SCREW, at, direction)
    np.testing.assert_allclose(
        compiled, SCREW.offset(at, direction), rtol=0, atol=ROUNDING
    )


def test_tables_of_unequal_length_are_refused() -> None:
    with pytest.raises(ValueError, match=r"pos must have one entry per node, \(4,\)"):
        Leadscrew(Setpoints(POINTS), POS[:3])
    with pytest.raises(ValueError, match=r"neg must have one entry per node, \(4,\)"):
        Leadscrew(Setpoints(POINTS), POS, np.zeros(5))


def test_a_modulo_range_that_does_not_ascend_is_refused() -> None:
    with pytest.raises(ValueError, match=r"must ascend, got \(0.0, 0.0\)"):
        Leadscrew(ROTARY, AROUND, modulo=(0.0, 0.0))

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import TemperatureCurve, TemperatureLine

NONE = jnp.zeros((5, 0))
# Manual [001] p. 24: position_0 100 and offset_0 40 in 0.1 µm, coefficient 4000 µm/m.
EXAMPLE = TemperatureLine(0.01, 0.004, 4000e-6)
STOPS = jnp.array([0.0, 100.0, 80.0, 50.0, -200.0])

COOL, WARM = 20.0, 30.0
CURVES = TemperatureLine(
    TemperatureCurve.of([COOL, WARM], [0.0, 50.0]),
    TemperatureCurve.of([COOL, 25.0, WARM], [0.0, 0.01, 0.03]),
    TemperatureCurve.of([COOL, WARM], [0.0, 1e-4], sensor=1),
)


def test_the_example_of_the_manual_gives_its_line() -> None:
    # 0.004 + 0.004 · (s − 0.01), in mm.
    expected = [0.00396, 0.40396, 0.32396, 0.20396, -0.79604]
    # Positions of up to 200 mm are rounded to 3e-14 mm, times 0.004.
    np.testing.assert_allclose(EXAMPLE.offset(STOPS, NONE), expected, atol=2e-16)


def test_a_flipped_sign_turns_the_offset_round() -> None:
    flipped = TemperatureLine(0.01, 0.004, 4000e-6, sign=-1.0)
    np.testing.assert_array_equal(
        flipped.offset(STOPS, NONE), -EXAMPLE.offset(STOPS, NONE)
    )


def test_parameters_follow_their_sensors_and_hold_outside() -> None:
    warm = jnp.array([[22.5, 20.0], [27.5, 25.0], [40.0, 40.0], [0.0, 0.0]])
    places = jnp.full(4, 100.0)
    # Sensor 0: s₀ and offset, sensor 1: coefficient.
    expected = [
        0.005,
        0.02 + 5e-5 * (100.0 - 37.5),
        0.03 + 1e-4 * (100.0 - 50.0),
        0.0,
    ]
    np.testing.assert_allclose(CURVES.offset(places, warm), expected, atol=1e-16)


def test_gradients_agree_with_finite_differences_where_it_is_smooth() -> None:
    rng = np.random.default_rng(5)
    warm = jnp.asarray(rng.uniform(20.5, 24.5, (7, 2)))
    places = jnp.asarray(rng.uniform(-100, 100, 7))

    @jax.jit
    def total(model: TemperatureLine, x: jax.Array, t: jax.Array) -> jax.Array:
        return jnp.sum(model.offset(x, t) ** 2)

    arguments = (CURVES, places, warm)
    leaves, tree = jax.tree.flatten(arguments)
    slopes = jax.tree.leaves(jax.jit(jax.grad(total, (0, 1, 2)))(*arguments))
    for number, (leaf, slope) in enumerate(zip(leaves, slopes, strict=True)):
        size = 1e-6 * max(float(jnp.max(jnp.abs(leaf))), 1e-3)
        way = jnp.asarray(rng.normal(size=leaf.shape))

        def moved(step: float, number: int = number, way: jax.Array = way) -> float:
            changed = list(leaves)
            changed[number] = changed[number] + step * way
            return float(total(*jax.tree.unflatten(tree, changed)))

        found = (moved(size) - moved(-size)) / (2 * size)
        assert float(jnp.sum(slope * way)) == pytest.approx(found, rel=1e-6, abs=1e-9)


def test_at_a_node_the_derivative_by_temperature_is_the_right_hand_one() -> None:
    offset = TemperatureCurve.of([20.0, 25.0, 30.0], [0.0, 0.01, 0.03])
    slope = jax.jit(jax.grad(lambda t: jnp.sum(offset(t))))(
        jnp.array([[19.0], [20.0], [25.0], [30.0], [31.0]])
    )
    np.testing.assert_allclose(slope[:, 0], [0, 0.002, 0.004, 0, 0], atol=1e-16)


def test_vmap_over_machines_gives_what_a_loop_gives() -> None:
    scale = jnp.array([1.0, 2.0, -1.0])
    many = jax.vmap(lambda k: jax.tree.map(lambda leaf: k * leaf, EXAMPLE))(scale)
    found = jax.vmap(lambda model: model.offset(STOPS, NONE))(many)
    for number, row in enumerate(found):
        one = jax.tree.map(lambda leaf, n=number: leaf[n], many)
        # The product may be contracted with the sum in one of the two.
        np.testing.assert_allclose(row, one.offset(STOPS, NONE), atol=1e-16)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="one entry per temperature, \\(2,\\)"):
        TemperatureCurve.of([20.0, 30.0], [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="sensor must be a number from 0 on, got -1"):
        TemperatureCurve.of([20.0, 30.0], [1.0, 2.0], sensor=-1)
    with pytest.raises(ValueError, match="Sensor 1 does not exist, there are 1"):
        CURVES.offset(jnp.zeros(3), jnp.zeros((3, 1)))
    with pytest.raises(ValueError, match="cannot be negative, got -1"):
        TemperatureLine(0.0, 0.0, 0.0, cycles=-1)

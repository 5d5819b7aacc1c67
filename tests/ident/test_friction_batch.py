"""Many Stribeck laws at once: the same optimum as one at a time."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from axcomp.ident.fit.friction import StribeckBatch, _batch, fit_stribeck_batch

AXES, SAMPLES = 60, 2000


def axes(noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities, currents and true (coulomb, drop, viscous, v_s) of many axes."""
    rng = np.random.default_rng(0)
    coulomb = rng.uniform(0.5, 2.0, AXES)
    drop = coulomb * rng.uniform(0.3, 1.0, AXES)
    viscous = coulomb * rng.uniform(0.1, 1.0, AXES) / 300.0
    place = np.exp(rng.uniform(np.log(3.0), np.log(30.0), AXES))
    speed = np.exp(rng.uniform(np.log(0.3), np.log(300.0), (AXES, SAMPLES)))
    velocity = rng.choice([-1.0, 1.0], speed.shape) * speed
    truth = np.stack([coulomb, drop, viscous, place], axis=1)
    current = law(truth.T[..., None], velocity)
    current += noise * coulomb[:, None] * rng.normal(size=current.shape)
    return velocity, current, truth


def law(parameters: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    coulomb, drop, viscous, place = parameters
    level = coulomb + drop * np.exp(-((velocity / place) ** 2))
    return np.asarray(np.sign(velocity) * level + viscous * velocity)


def fitted(velocity: np.ndarray, current: np.ndarray) -> StribeckBatch:
    return fit_stribeck_batch(jnp.asarray(velocity), jnp.asarray(current))


def test_batch_finds_the_optimum_of_a_loop_over_scipy() -> None:
    velocity, current, truth = axes(0.1)
    found = fitted(velocity, current)
    assert np.all(found.settled)
    for row in range(0, AXES, 6):
        best = least_squares(
            lambda p, row=row: law(p, velocity[row]) - current[row],
            truth[row],
            x_scale=truth[row],
            ftol=1e-13,
            xtol=1e-13,
        )
        # Promised is a relative gain below 1e-8 by another step; asked for are 1e-6.
        assert float(found.cost[row]) <= best.cost * (1 + 1e-7)


def test_batch_recovers_exact_laws() -> None:
    velocity, current, truth = axes(0.0)
    found = fitted(velocity, current)
    # Exact data: the search ends when steps are below 1e-7 in ln v_s.
    np.testing.assert_allclose(found.stribeck_velocity, truth[:, 3], rtol=1e-5)
    np.testing.assert_allclose(found.coulomb, truth[:, 0], rtol=1e-5)
    np.testing.assert_allclose(found.viscous, truth[:, 2], rtol=1e-4)
    np.testing.assert_allclose(found.breakaway, truth[:, 0] + truth[:, 1], rtol=1e-5)
    assert np.all(found.determined)


def test_one_axis_does_not_disturb_another() -> None:
    velocity, current, _ = axes(0.1)
    whole = fitted(velocity, current)
    broken = current.copy()
    broken[3] = np.nan
    beside = fitted(velocity, broken)
    keep = np.arange(AXES) != 3
    # Lanes share loops, not numbers: equal bits.
    np.testing.assert_array_equal(whole.coulomb[keep], beside.coulomb[keep])
    assert not beside.settled[3]
    assert not beside.determined[3]


def test_axes_on_several_cores_give_what_one_gives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    velocity, current, _ = axes(0.1)
    whole = fitted(velocity, current)
    monkeypatch.setattr(_batch, "WORTH_A_CORE", 10)
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    for one, parted in zip(whole, fitted(velocity, current), strict=True):
        # Start values from other lanes differ by roundings, which a search keeps small.
        np.testing.assert_allclose(one, parted, rtol=1e-11)


def test_axis_without_a_drop_says_so() -> None:
    velocity, _, _ = axes(0.1)
    rng = np.random.default_rng(1)
    bare = np.sign(velocity) + 0.003 * velocity + 0.1 * rng.normal(size=velocity.shape)
    # The threshold of 5 σ lets about one of a million pass, with v_s searched.
    assert not np.any(fitted(velocity, bare).determined)


def test_samples_at_rest_do_not_count() -> None:
    velocity, current, _ = axes(0.1)
    whole = fitted(velocity, current)
    rest_v = np.concatenate([velocity, np.zeros((AXES, 50))], axis=1)
    rest_i = np.concatenate([current, np.full((AXES, 50), 9.0)], axis=1)
    beside = fitted(rest_v, rest_i)
    # The same sums in another order, and a search that ends at a gain of 1e-8.
    np.testing.assert_allclose(beside.coulomb, whole.coulomb, rtol=1e-3)
    np.testing.assert_allclose(beside.cost, whole.cost, rtol=1e-7)


def test_empty_batch_is_refused() -> None:
    with pytest.raises(ValueError, match="needs axes and samples"):
        fit_stribeck_batch(jnp.zeros((0, 5)), jnp.zeros((0, 5)))

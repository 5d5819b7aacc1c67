import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from axcomp.ident._ipopt import least_squares_ipopt

VELOCITY = np.linspace(0.1, 50.0, 200)
TRUTH = np.array([1.0, 0.5, 3.0, 1.3, 0.01])
START = np.array([0.5, 0.2, 8.0, 1.0, 0.0])


def stribeck(
    values: Float[Array, " x"], velocity: Float[Array, " t"]
) -> Float[Array, " t"]:
    decay = jnp.exp(-((velocity / values[2]) ** values[3]))
    return values[0] + values[1] * decay + values[4] * velocity


def residual(
    values: Float[Array, " x"], data: tuple[Float[Array, " t"], Float[Array, " t"]]
) -> Float[Array, " t"]:
    return stribeck(values, data[0]) - data[1]


@pytest.fixture(scope="module")
def data() -> tuple[Float[Array, " t"], Float[Array, " t"]]:
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(VELOCITY))
    velocity = jnp.asarray(VELOCITY)
    return velocity, stribeck(jnp.asarray(TRUTH), velocity) + noise


def test_without_active_limits_the_optimum_is_that_of_scipy(
    data: tuple[Float[Array, " t"], Float[Array, " t"]],
) -> None:
    lower, upper = np.array([0, 0, 0.1, 0.5, 0]), np.array([5, 5, 50, 2.5, 1.0])
    found = least_squares_ipopt(residual, START, data, lower=lower, upper=upper)
    other = least_squares(
        lambda values: np.asarray(residual(jnp.asarray(values), data)),
        TRUTH,
        **dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15),
    )
    assert found.status == "converged"
    # SciPy differentiates by differences: 1e-8 of the step.
    np.testing.assert_allclose(found.values, other.x, rtol=1e-6)
    cost = 0.5 * jnp.sum(residual(jnp.asarray(found.values), data) ** 2)
    assert cost == pytest.approx(other.cost, rel=1e-12)


def test_limits_and_inequalities_hold_at_the_solution(
    data: tuple[Float[Array, " t"], Float[Array, " t"]],
) -> None:
    def margins(values: Float[Array, " x"], _: object) -> Float[Array, " g"]:
        return jnp.stack([values[0] + values[1] - 1.55, 4.0 - values[2] * values[3]])

    upper = np.array([np.inf, np.inf, np.inf, 1.1, np.inf])
    lower = np.array([0.0, 0.0, 0.5, 0.5, 0.0])
    found = least_squares_ipopt(
        residual,
        START,
        data,
        lower=lower,
        upper=upper,
        inequality=margins,
    )
    assert found.converged
    assert np.all(found.values <= upper)
    # An interior point stays inside a limit by its tolerance over the multiplier.
    assert found.values[3] == pytest.approx(1.1, abs=1e-6)
    first, second = margins(jnp.asarray(found.values), None)
    assert first == pytest.approx(0.0, abs=1e-6)
    assert second >= 0


def test_failures_are_values() -> None:
    def logarithm(values: Float[Array, " x"], _: object) -> Float[Array, " t"]:
        return jnp.log(values) - jnp.ones(3)

    def both(values: Float[Array, " x"], _: object) -> Float[Array, " g"]:
        return jnp.stack([values[0] - 2.0, 1.0 - values[0]])

    assert least_squares_ipopt(logarithm, np.array([-1.0])).status == "not_finite"
    start = np.array([1.5])
    assert least_squares_ipopt(logarithm, start, inequality=both).status == "infeasible"
    assert least_squares_ipopt(logarithm, start, max_steps=1).status == "max_steps"


def test_an_error_of_the_residual_reaches_the_caller() -> None:
    def broken(values: Float[Array, " x"], _: object) -> Float[Array, " t"]:
        msg = "no such column"
        raise KeyError(msg)

    with pytest.raises(KeyError, match="no such column"):
        least_squares_ipopt(broken, np.array([1.0]))


def test_a_lower_limit_above_the_upper_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"lower limit 2\.0 of value 0"):
        least_squares_ipopt(residual, np.array([1.0]), lower=2.0, upper=1.0)

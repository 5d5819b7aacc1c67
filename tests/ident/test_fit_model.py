"""Any model, fitted by optimistix or by IPOPT."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pyarrow as pa
import pytest
from jaxtyping import Array, Float

import axcomp
from axcomp.ident.core import FitError
from axcomp.models import FrictionTable, Setpoints, StribeckFriction

TIME = np.linspace(0.0, 5.0, 60)
NOISE = 0.01


class Decay(eqx.Module):
    """A signal that falls from one level to another."""

    rate: Array
    levels: Array

    def __call__(self, time: Float[Array, " t"]) -> Float[Array, " t"]:
        return self.levels[0] + self.levels[1] * jnp.exp(-self.rate * time)


class Line(eqx.Module):
    """A straight line."""

    offset: Array
    slope: Array


def along(model: Line, place: Float[Array, " t"]) -> Float[Array, " t"]:
    return model.offset + model.slope * place


TRUTH = Decay(jnp.array(0.8), jnp.array([0.3, 1.2]))
GUESS = Decay(jnp.array(2.0), jnp.array([0.0, 0.4]))
READINGS = TRUTH(jnp.asarray(TIME)) + NOISE * np.random.default_rng(0).normal(size=60)
FLAT = Line(jnp.array(0.0), jnp.array(0.0))


def decay(readings: Any = READINGS, **options: Any) -> Any:
    return axcomp.fit_model(GUESS, Decay.__call__, TIME, readings, **options)


BOUNDS = {
    "inactive": {"rate": (0.01, 10.0), "levels": (0.0, None)},
    "one active": {"rate": (None, 0.7), "levels": (np.array([0.0, 0.1]), None)},
    "two active": {"rate": (0.9, 10.0), "levels": (None, np.array([np.inf, 1.1]))},
}


@pytest.mark.parametrize("bounds", BOUNDS.values(), ids=BOUNDS)
def test_both_solvers_end_at_the_same_optimum(bounds: Any) -> None:
    ours, theirs = decay(bounds=bounds), decay(bounds=bounds, solver="ipopt")
    # The floor of the issue; an interior point stays 1e-8 inside an active limit.
    np.testing.assert_allclose(ours.values, theirs.values, rtol=1e-6)
    assert ours.at_limit == theirs.at_limit
    assert (
        len(ours.at_limit)
        == {"inactive": 0, "one active": 1, "two active": 2}[
            next(name for name, each in BOUNDS.items() if each is bounds)
        ]
    )


def test_columns_of_a_table_are_arrays() -> None:
    time, readings = pa.array(TIME), pa.array(np.asarray(READINGS))
    found = axcomp.fit_model(GUESS, Decay.__call__, time, readings)
    assert found.model.rate == decay().model.rate
    named = axcomp.fit_model(
        GUESS, lambda model, given: model(given["t"]), {"t": time}, readings
    )
    assert named.model.rate == found.model.rate


def test_limits_may_be_shaped_like_the_model() -> None:
    free = jax.tree.map(lambda _: None, GUESS)
    shaped = eqx.tree_at(
        lambda m: m.rate, free, (None, 0.7), is_leaf=lambda leaf: leaf is None
    )
    fit = decay(bounds=shaped)
    assert fit.at_limit == ("rate",)
    assert eqx.tree_equal(fit.model, decay(bounds={"rate": (None, 0.7)}).model)


def test_standard_deviations_are_those_of_repeated_data() -> None:
    exact = TRUTH(jnp.asarray(TIME))
    noise = NOISE * np.random.default_rng(1).normal(size=(400, 60))

    @jax.jit
    def repeated(noise: Float[Array, "k t"]) -> tuple[Array, Array, Array, Array]:
        def one(row: Float[Array, " t"]) -> Any:
            fit = decay(exact + row)
            sigma = fit.standard_deviation
            return (
                fit.values,
                jnp.append(sigma.rate, sigma.levels),
                fit.noise,
                fit.held_out,
            )

        return jax.vmap(one)(noise)

    values, sigma, found, held_out = repeated(jnp.asarray(noise))
    # A standard deviation of 400 values is known to 3.5 %.
    np.testing.assert_allclose(
        np.std(values, axis=0), np.mean(sigma, axis=0), rtol=0.12
    )
    # Means of 400: to 0.5 %.
    assert np.mean(found) == pytest.approx(NOISE, rel=0.02)
    # With three parameters for 60 readings unseen ones are off by some percent more.
    assert NOISE < np.sqrt(np.mean(np.square(held_out))) < 1.15 * NOISE


def test_the_joint_covariance_is_that_of_least_squares() -> None:
    place = np.linspace(-1.0, 4.0, 40)
    readings = 2.0 + 0.5 * place + 0.1 * np.random.default_rng(2).normal(size=40)
    fit = axcomp.fit_model(FLAT, along, place, readings)
    _, expected = np.polyfit(place, readings, 1, cov=True)
    # Exact in both up to rounding.
    np.testing.assert_allclose(fit.covariance(["slope", "offset"]), expected, rtol=1e-9)
    with pytest.raises(KeyError, match="no fitted parameter 'slop'"):
        fit.covariance(["slop"])
    (own,) = fit.covariance(["slope"])
    np.testing.assert_array_equal(fit.covariance("slope"), [own])


def test_error_held_out_is_that_of_refits_without_each_group() -> None:
    rng = np.random.default_rng(3)
    place, group = rng.uniform(size=40), np.arange(40) % 5
    readings = place**2 + 0.1 * rng.normal(size=40)
    fit = axcomp.fit_model(FLAT, along, place, readings, groups=group)
    off = np.empty(40)
    for k in range(5):
        slope, offset = np.polyfit(place[group != k], readings[group != k], 1)
        off[group == k] = (readings - offset - slope * place)[group == k]
    assert float(fit.held_out) == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-9)


@pytest.mark.parametrize("solver", [None, "ipopt"])
def test_a_prior_counts_as_a_reading_of_its_own(solver: Any) -> None:
    place = np.zeros(40)
    readings = 1.0 + 0.3 * np.random.default_rng(4).normal(size=40)
    priors = {"offset": (0.0, 0.2), "slope": (0.1, 0.05)}
    fit = axcomp.fit_model(
        FLAT, along, place, readings, priors=priors, noise=0.3, solver=solver
    )
    precision = 40 / 0.3**2 + 1 / 0.2**2
    assert float(fit.model.offset) == pytest.approx(
        readings.sum() / 0.3**2 / precision, rel=1e-8
    )
    assert float(fit.standard_deviation.offset) == pytest.approx(precision**-0.5)
    # No reading tells the slope: it is what the prior says.
    assert float(fit.standard_deviation.slope) == pytest.approx(0.05)
    assert fit.undetermined == ()


def test_the_noise_that_weighs_priors_is_estimated() -> None:
    priors = {"rate": (1.0, 0.1)}
    fit = decay(priors=priors)
    again = decay(priors=priors, noise=fit.noise)
    # Fixed point: the noise found is the noise that weighed the prior.
    np.testing.assert_allclose(fit.values, again.values, rtol=1e-7)
    assert decay().model.rate < fit.model.rate < 1.0


def test_what_readings_do_not_determine_is_named_and_has_no_deviation() -> None:
    speeds = np.linspace(1.0, 30.0, 50)
    table = FrictionTable(Setpoints(np.array([0.0, 10.0, 30.0, 60.0])), np.ones(4))
    fit = axcomp.fit_model(table, FrictionTable.__call__, speeds, 1.0 + 0.01 * speeds)
    assert fit.converged
    # The last node is never read, and the scaling does what all entries do together.
    lost = [set(each.direction) for each in fit.undetermined]
    assert {"values[3]"} in lost
    assert {"scaling", "values[0]", "values[1]", "values[2]"} in lost
    assert np.isinf(fit.standard_deviation.values).all()
    assert fit.standard_deviation.nodes.points is None
    assert "scaling changes no prediction" not in map(str, fit.undetermined)


def test_only_named_arrays_are_fitted_if_asked() -> None:
    place = np.linspace(0.0, 1.0, 40)
    start = Line(jnp.array(0.0), jnp.array(2.0))
    fit = axcomp.fit_model(start, along, place, 1.0 + 2.0 * place, fitted=["offset"])
    assert fit.names == ("offset",)
    assert fit.standard_deviation.slope is None
    # Exact data: only the tolerance of the solver is left.
    assert float(fit.model.offset) == pytest.approx(1.0, abs=1e-9)


def test_a_fit_is_differentiable() -> None:
    def rate(readings: Float[Array, " t"], weight: Float[Array, ""]) -> Array:
        weights = jnp.where(jnp.arange(60) < 30, weight, 1.0)
        return decay(readings, weights=weights).model.rate

    push = np.random.default_rng(5).normal(size=60)
    slope, by_weight = jax.jit(jax.grad(rate, (0, 1)))(READINGS, jnp.array(1.0))
    step, number = 1e-4, jax.jit(rate)
    ends = [number(READINGS + s * push, jnp.array(1.0)) for s in (step, -step)]
    # Central differences: step² of the third derivative.
    change = float(ends[0] - ends[1]) / (2 * step)
    assert float(slope @ push) == pytest.approx(change, rel=1e-5)
    ends = [number(READINGS, jnp.array(1.0 + s)) for s in (step, -step)]
    change = float(ends[0] - ends[1]) / (2 * step)
    assert float(by_weight) == pytest.approx(change, rel=1e-5)


def test_second_derivatives_within_limits_are_those_without() -> None:
    def rate(push: Any, bounds: Any = None) -> Array:
        return decay(READINGS.at[7].add(push), bounds=bounds).model.rate

    limits = {"rate": (0.01, 10.0), "levels": (-5.0, 5.0)}
    bent = jax.hessian(rate)(0.0)
    # No limit is active; what passes before the last one leave is the tolerance of a solve.
    assert float(jax.hessian(rate)(0.0, limits)) == pytest.approx(float(bent), rel=1e-4)


def test_what_rests_on_a_limit_stays_there_under_a_derivative() -> None:
    def level(readings: Float[Array, " t"]) -> Array:
        return decay(readings, bounds={"rate": (None, 0.7)}).model.levels[1]

    push, step = np.random.default_rng(6).normal(size=60), 1e-4
    number = jax.jit(level)
    change = float(number(READINGS + step * push) - number(READINGS - step * push))
    # Linear in the readings once the rate is held.
    slope = jax.jit(jax.grad(level))(READINGS)
    assert float(slope @ push) == pytest.approx(change / (2 * step), rel=1e-6)


def test_inequalities_hold_and_need_ipopt() -> None:
    def rises_little(model: Decay) -> Array:
        return 1.4 - jnp.sum(model.levels)

    fit = decay(constraints=rises_little)
    # An interior point stays within its tolerance of the constraint.
    assert float(jnp.sum(fit.model.levels)) == pytest.approx(1.4, abs=1e-6)
    with pytest.raises(ValueError, match="solver='ipopt'"):
        decay(constraints=rises_little, solver=optx.LevenbergMarquardt(1e-8, 1e-8))
    with pytest.raises(ValueError, match="works on the host"):
        jax.jit(lambda y: decay(y, solver="ipopt").noise)(READINGS)


def test_weight_zero_leaves_out_what_is_no_number() -> None:
    holes = READINGS.at[::7].set(np.nan)
    with pytest.raises(FitError, match="reading 0 is not finite"):
        decay(holes)
    fit = decay(holes, weights=jnp.isfinite(holes).astype(float))
    assert abs(fit.model.rate - 0.8) < 4 * fit.standard_deviation.rate
    assert float(fit.noise) == pytest.approx(NOISE, rel=0.3)


class Wave(eqx.Module):
    """A wave upon a line."""

    shape: Array
    rate: Array

    def __call__(self, x: Float[Array, " t"]) -> Float[Array, " t"]:
        wave = self.shape[1] * jnp.sin(self.rate * x)
        return self.shape[0] + wave + self.shape[2] * x


def test_a_solver_that_stops_short_of_the_optimum_has_not_converged() -> None:
    place = np.linspace(0.0, 10.0, 200)
    truth = Wave(jnp.array([0.1, 0.5, -0.02]), jnp.array(1.3))
    noise = NOISE * np.random.default_rng(7).normal(size=len(place))
    measured = truth(jnp.asarray(place)) + noise
    start = Wave(jnp.array([0.0, 0.3, 0.0]), jnp.array(1.2))

    def fit(solver: Any) -> axcomp.ModelFit[Wave]:
        return axcomp.fit_model(
            start,
            Wave.__call__,
            place,
            measured,
            solver=solver,
            max_steps=2000,
            throw=False,
        )

    assert fit(None).converged
    assert fit(optx.BFGS(1e-10, 1e-10)).converged
    simplex = fit(optx.NelderMead(1e-12, 1e-12))
    # It says that it is done where ten times the noise is left.
    assert float(simplex.noise) > 5.0 * NOISE
    assert simplex.result == "failed"


def test_a_failed_solve_is_a_value_or_an_error() -> None:
    for solver in (None, "ipopt"):
        fit = decay(solver=solver, max_steps=2, throw=False)
        assert fit.result == "max_steps"
        with pytest.raises(FitError, match="'max_steps' after"):
            decay(solver=solver, max_steps=2)


@pytest.mark.other_types
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"bounds": {"rat": (0, 1)}},
            "bounds: found rat, expected some of rate, levels",
        ),
        ({"bounds": {"rate": 1.0}}, "bounds of rate: found 1.0, expected a pair"),
        ({"fitted": ["level"]}, "fitted: found level"),
        ({"groups": np.array([1, 2])}, "found 2 of them, expected one per reading, 60"),
        ({"weights": -1.0}, "weights: found one below 0"),
        ({"weights": np.ones(3)}, r"weights: found shape \(3,\), expected \(60,\)"),
        ({"weights": 0.0}, "found no reading of a weight above 0"),
        (
            {"bounds": {"levels": (np.zeros(3), None)}},
            r"levels: found shape \(3,\), expected \(2,\)",
        ),
        ({"bounds": {"rate": (2.0, 1.0)}}, "rate: found 2 and 1, expected bounds"),
        ({"bounds": {"rate": (np.nan, 1.0)}}, "rate: found nan and 1"),
        ({"priors": {"rate": (0.9, 0.0)}}, "rate: found 0.9 and 0, expected a prior"),
        ({"bounds": (0.0, 2.0)}, r"bounds: found \(0.0, 2.0\), expected pairs by name"),
        ({"noise": -1.0}, "noise: found -1.0"),
        ({"solver": "casadi"}, "solver: found 'casadi', expected one of optimistix"),
        ({"solver": optx.LevenbergMarquardt}, "expected one of optimistix, made"),
        ({"constraints": lambda m: m.rate < 0.7}, "found truth values"),
    ],
)
def test_what_does_not_fit_together_is_refused(options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decay(**options)


@pytest.mark.parametrize("solver", [None, "ipopt"])
def test_what_is_no_number_is_named_as_the_cause(solver: Any) -> None:
    holes = np.where(TIME > 4.0, np.nan, TIME)
    with pytest.raises(FitError, match=r"'not_finite' .* look at inputs and start"):
        axcomp.fit_model(GUESS, Decay.__call__, holes, READINGS, solver=solver)


def test_both_solvers_take_a_number_that_may_not_move() -> None:
    pinned = {"rate": (0.7, 0.7)}
    found = [decay(bounds=pinned, solver=solver) for solver in (None, "ipopt")]
    assert all(float(each.model.rate) == 0.7 for each in found)
    # The stopping tolerance of the solvers.
    np.testing.assert_allclose(found[0].values, found[1].values, rtol=1e-6)


def test_as_many_readings_as_parameters_tell_no_noise() -> None:
    place = np.array([0.0, 1.0])
    exact = axcomp.fit_model(FLAT, along, place, 2.0 * place)
    assert np.isinf([exact.noise, exact.held_out, exact.standard_deviation.slope]).all()
    assert np.isinf(np.diag(exact.covariance(["offset", "slope"]))).all()
    np.testing.assert_allclose(exact.values, [0.0, 2.0], atol=1e-5)
    # Where it is known, it says all.
    known = axcomp.fit_model(FLAT, along, place, 2.0 * place, noise=0.1)
    assert float(known.standard_deviation.offset) == pytest.approx(0.1)


class Stage(eqx.Module):
    """Two lines, one of them in a list, behind a function: leaves that are no arrays."""

    first: Line
    others: list[Line]
    shape: Any
    name: str

    def __call__(self, inputs: dict[str, Any]) -> Array:
        rest = along(self.others[0], inputs["b"])
        return jnp.asarray(self.shape(along(self.first, inputs["a"]))) + rest


@pytest.mark.other_types
@pytest.mark.parametrize("solver", [None, "ipopt"])
def test_a_model_of_parts_and_functions_takes_lists_and_single_precision(
    solver: Any,
) -> None:
    def stage(*numbers: float) -> Stage:
        a, b, c = map(jnp.float32, numbers)
        other = Line(jnp.zeros(0), c)
        return Stage(Line(a, b), [other], jnp.tanh, "table")

    def predict(model: Stage, inputs: dict[str, Any]) -> Array:
        line = Line(jnp.array(0.0), model.others[0].slope)
        return Stage(model.first, [line], model.shape, model.name)(inputs)

    rng = np.random.default_rng(5)
    inputs = {"a": rng.uniform(-1, 1, 80).tolist(), "b": np.arange(80)}
    arrays = {name: np.asarray(each, np.float32) for name, each in inputs.items()}
    readings: Any = predict(stage(0.5, 1.5, 0.25), arrays)
    bounds = {"first.slope": (0.0, None), "others.0.slope": (None, 10.0)}
    fit = axcomp.fit_model(
        stage(0.0, 1.0, 0.0), predict, inputs, readings.tolist(), bounds=bounds,
        solver=solver, fitted=["first", "others.0.slope"],
    )  # fmt: skip
    # Readings in single precision.
    np.testing.assert_allclose(fit.values, [0.5, 1.5, 0.25], atol=1e-5)
    assert fit.model.shape is jnp.tanh
    half = eqx.tree_at(lambda m: m.others[0].slope, fit.model, jnp.array(0.0))
    only = axcomp.fit_model(half, predict, inputs, readings, fitted="others.0.slope")
    assert only.names == ("others.0.slope",)


def test_several_inequalities_are_kept_at_once() -> None:
    fit = decay(constraints=lambda m: (0.7 - m.rate, m.levels - 0.32))
    assert float(fit.model.rate) <= 0.7 + 1e-8
    assert np.min(fit.model.levels) >= 0.32 - 1e-8
    with pytest.raises(FitError, match="no values keep all bounds and constraints"):
        decay(constraints=lambda m: [0.7 - m.rate, m.rate - 0.8])


def test_a_model_of_numbers_says_what_an_array_is() -> None:
    plain: Any = Line(0.0, 1.0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"jnp\.asarray\(1\.0\)"):
        axcomp.fit_model(plain, along, TIME, READINGS)


def test_predictions_have_the_shape_of_the_readings() -> None:
    with pytest.raises(ValueError, match=r"predict: found shape \(60,\)"):
        decay(READINGS[:, None])


def test_models_of_the_controller_are_fitted_from_a_wrong_start() -> None:
    velocity = np.linspace(-50.0, 50.0, 400)
    truth = StribeckFriction(1.0, 1.5, 3.0, 1.3, 0.01)
    start = StribeckFriction(0.5, 0.7, 8.0, 1.0, 0.0)
    fit = axcomp.fit_model(
        start, StribeckFriction.__call__, velocity, truth(velocity),
        bounds={"stribeck_velocity": (0.1, 50.0), "stribeck_shape": (0.5, 2.5)},
    )  # fmt: skip
    # Exact data: only the solver's tolerance stands between fit and truth.
    assert eqx.tree_equal(fit.model, truth, rtol=1e-6, atol=1e-9)

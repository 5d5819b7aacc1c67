"""Fit any equinox module to readings: least squares by optimistix, or by CasADi and IPOPT."""

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from ._ipopt import least_squares_ipopt, one_vector
from ._model_fit import STATUSES, ModelFit, covariance_of, factor, held_out_rms
from ._parameters import (
    Form,
    Pairs,
    Scaled,
    as_measured,
    fitted_arrays,
    inputs_of,
    number_of,
    readings_of,
    weights_of,
)
from .core import FitError, one_blas_thread

M = TypeVar("M", bound=eqx.Module)

_BLOCKS = 10
"""Blocks of consecutive readings that are held out in turn."""
_RESTARTS = 4
"""Solves with limits: what rests on one may leave it at the next."""
_SPARE = 1e-6
"""Readings beyond the parameters from which on they tell the noise."""
_HELP = {
    "not_finite": "predictions are no numbers; look at inputs and start values",
    "infeasible": "no values keep all bounds and constraints",
}
"""What to do about a solve that failed."""
_PASSES = 30
_SAME = 1e-10
"""Passes at most, and the relative change of the noise that ends them: it weighs priors."""


def fit_model(
    model: M,
    predict: Callable[[M, Any], Array],
    inputs: Any,
    measured: ArrayLike,
    *,
    bounds: Pairs = None,
    priors: Pairs = None,
    weights: ArrayLike | None = None,
    groups: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    constraints: Callable[[M], Any] | None = None,
    fitted: Sequence[str] | None = None,
    solver: optx.AbstractLeastSquaresSolver[Any, Any, Any, Any]
    | optx.AbstractMinimiser[Any, Any, Any]
    | Literal["ipopt"]
    | None = None,
    max_steps: int = 256,
    throw: bool = True,
) -> ModelFit[M]:
    r"""Fit the arrays of a model to readings.

    Minimises $\sum_t w_t\,(y_t - f_\theta(x_t))^2 + \sigma^2 \sum_k (\theta_k -
    \mu_k)^2/s_k^2$ with $f$ = `predict`, weights $w$, priors $(\mu, s)$ and the noise
    $\sigma$, which is estimated with the fit.

    With optimistix it may be called inside `jax.jit` and differentiated by `jax.grad`
    with respect to inputs, readings, weights and priors (implicit function theorem at the
    solution; give `noise` where priors are traced); of standard deviations and covariance
    only the noise has a derivative, and the error held out counts as a constant. IPOPT works
    on the host.

    Args:
        model: Start values; its type is that of the result.
        predict: ``predict(model, inputs)``, a JAX function, in the unit and shape of
            `measured`. Compiles once per function and shape.
        inputs: Whatever `predict` takes: arrays, or a tree of them; a list of numbers is
            an array.
        measured: Readings, of any shape.
        bounds: Pair (least, largest) per array, a number or an array each; None = free.
            Either a tree shaped like the model, or a mapping of names to pairs. optimistix
            starts again from where numbers rest on a limit, so that both solvers end at
            the same optimum where there is one. Of its solvers Levenberg-Marquardt serves
            with limits; others may stop where a number rests on one.
        priors: Pair (mean, standard deviation) per array, in its unit; None = none.
        weights: Of the readings, relative; 0 leaves a reading out, NaN or not.
        groups: Number of the group of each reading, for `ModelFit.held_out`; left out: ten
            blocks of consecutive readings.
        noise: Standard deviation of a reading of weight 1, where known: it weighs the
            priors, and scales all standard deviations.
        constraints: Values that a solution keeps at or above zero, an array or several;
            only with IPOPT.
        fitted: Names of the arrays to fit, or of parts of the model. Left out: all
            inexact arrays except the positions of nodes and surfaces, which stay; numbers
            that are no arrays stay as well.
        solver: An optimistix solver, or ``"ipopt"``. Left out: Levenberg-Marquardt, with
            constraints IPOPT.
        max_steps: Of the solver, at most.
        throw: Raise where the solve fails; else read `ModelFit.result`.

    Raises:
        FitError: If names, shapes or options do not fit together, a reading is no number,
            there is none, or the solve fails and `throw` is true.
    """
    if solver is None:
        solver = "ipopt" if constraints is not None else LEVENBERG_MARQUARDT
    if constraints is not None and solver != "ipopt":
        msg = "constraints need solver='ipopt': optimistix knows no inequalities."
        raise FitError(msg)
    made = isinstance(solver, (optx.AbstractLeastSquaresSolver, optx.AbstractMinimiser))
    if solver != "ipopt" and not made:
        msg = f"solver: found {solver!r}, expected one of optimistix, made, or 'ipopt'"
        raise FitError(msg)
    if not isinstance(max_steps, int | np.integer) or max_steps < 1:
        msg = f"max_steps: found {max_steps!r}, expected a whole number of 1 or more"
        raise FitError(msg)
    params, rest = eqx.partition(model, fitted_arrays(model, fitted))
    form = Form.of(params)
    readings = readings_of(measured)
    problem = _Problem(
        predict,
        constraints,
        form,
        rest,
        inputs_of(inputs),
        readings,
        weights_of(readings, weights),
        form.pairs(bounds, (-np.inf, np.inf), "bounds"),
        form.pairs(priors, (0.0, np.inf), "priors", whole=True),
    )
    form.check(problem.limits, np.less_equal, "bounds, the least one first")
    form.check(problem.prior, lambda _, s: s > 0, "a prior's deviation above 0")
    start = form.flat(params)
    known = None if noise is None else number_of(noise, "noise")
    if known is not None and not isinstance(known, Tracer) and not 0 < known < np.inf:
        msg = f"noise: found {known}, expected one number above 0"
        raise FitError(msg)
    leaves = jax.tree.leaves((problem, start, known))
    traced = any(isinstance(leaf, Tracer) for leaf in leaves)
    if traced and solver == "ipopt":
        msg = "solver='ipopt' works on the host: outside of jax.jit, grad and vmap."
        raise FitError(msg)
    if traced and known is None and priors is not None:
        msg = "give noise where a fit with priors is traced: else fits are repeated."
        raise FitError(msg)

    sigma, steps = jnp.ones(()) if known is None else known, jnp.zeros((), jnp.int64)
    blocks, count = _blocks(groups, readings.size)
    if known is None and priors is not None:
        sigma = _spread_of(problem, start)
    found: dict[str, Any] = {}
    code = jnp.asarray(STATUSES.index("failed"))
    for _ in range(_PASSES):
        with contextlib.nullcontext() if traced else one_blas_thread():
            if isinstance(solver, str):
                start, code, more = _by_ipopt(problem, start, sigma, max_steps)
            else:
                start, code, more = _by_optimistix(
                    problem, start, sigma, solver, max_steps, bounds is not None
                )
            before = sigma
            found = _report(problem, start, sigma, known, blocks, count)
            steps, sigma = steps + more, found["noise"]
            if not traced:
                sigma.block_until_ready()
        # Only priors need the noise, and only where it is not known.
        if known is not None or priors is None or bool(abs(sigma / before - 1) < _SAME):
            break
    fit: ModelFit[M] = ModelFit(**found, steps=steps, code=code, names=form.names)
    if not throw:
        return fit
    if traced:
        failed = code != STATUSES.index("converged")
        fit = eqx.error_if(fit, failed, "fit_model: the solve did not converge")
        return fit
    if not fit.converged:
        remedy = _HELP.get(fit.result, "other start values, bounds, or more max_steps")
        if bounds is not None and solver not in ("ipopt", LEVENBERG_MARQUARDT):
            remedy += ", or the default solver, since numbers may rest on a bound"
        msg = (
            f"the solve of fit_model ended as '{fit.result}' after {int(steps)} steps; "
            f"expected it to converge: {remedy}."
        )
        raise FitError(msg)
    return fit


_STEEP = 1e-2
"""Cosine between what is left and its derivative by a number from which on the solver stopped
early, as one without derivatives may."""
_EXACT = 1e-8
"""Share of the readings below which what is left is rounding."""

LEVENBERG_MARQUARDT: optx.LevenbergMarquardt[Any, Any, Any] = optx.LevenbergMarquardt(
    rtol=1e-10, atol=1e-10
)
"""The default; steps are counted in units that change the residual by its first size."""


class _Problem(eqx.Module):
    """A fit as arrays and functions: its residual over a vector of numbers."""

    predict: Callable[[Any, Any], Array] = eqx.field(static=True)
    constraints: Callable[[Any], Array] | None = eqx.field(static=True)
    form: Form = eqx.field(static=True)
    rest: Any
    """What is not fitted of the model."""
    inputs: Any
    measured: Float[Array, "..."]
    weights: Float[Array, "..."]
    limits: tuple[Float[Array, " p"], Float[Array, " p"]]
    prior: tuple[Float[Array, " p"], Float[Array, " p"]]

    @property
    def length(self) -> Float[Array, ""]:
        """Root of the weighted sum of squares of the readings."""
        seen = jnp.where(self.weights > 0, self.measured, 0.0)
        return jnp.asarray(jnp.linalg.norm(jnp.ravel(jnp.sqrt(self.weights) * seen)))

    def model(self, values: Float[Array, " p"]) -> Any:
        return eqx.combine(self.form.tree(values), self.rest)

    def error(self, values: Float[Array, " p"]) -> Float[Array, "..."]:
        """Return measured − predicted."""
        predicted = self.predict(self.model(values), self.inputs)
        return self.measured - as_measured(predicted, self.measured.shape)

    def residual(self, values: Float[Array, " p"]) -> Float[Array, " t"]:
        """Return predicted − measured, weighted; 0 where the weight is."""
        off = jnp.where(self.weights > 0, self.error(values), 0.0)
        return -jnp.ravel(jnp.sqrt(self.weights) * off)


def _full(
    values: Float[Array, " p"], args: tuple[_Problem, Array]
) -> Float[Array, " r"]:
    """Return the weighted residual with a row per prior below it."""
    problem, noise = args
    mean, spread = problem.prior
    prior = noise * (values - mean) / spread
    return jnp.concatenate([problem.residual(values), prior])


def _at_or_above_zero(
    values: Float[Array, " p"], args: tuple[_Problem, Array]
) -> Float[Array, " g"]:
    problem, _ = args
    assert problem.constraints is not None
    return one_vector(problem.constraints(problem.model(values)))


def _by_ipopt(
    problem: _Problem,
    start: Float[Array, " p"],
    noise: Float[Array, ""],
    max_steps: int,
) -> tuple[Float[Array, " p"], Int[Array, ""], Int[Array, ""]]:
    lower, upper = (np.asarray(side) for side in problem.limits)
    found = least_squares_ipopt(
        _full,
        np.asarray(start),
        (problem, noise),
        lower=lower,
        upper=upper,
        inequality=None if problem.constraints is None else _at_or_above_zero,
        max_steps=max_steps,
    )
    status = "converged" if found.converged else found.status
    code = jnp.asarray(STATUSES.index(status))
    return jnp.asarray(found.values), code, jnp.asarray(found.steps)


def _scaled(
    x: Float[Array, " p"], args: tuple[_Problem, Array, Scaled]
) -> Float[Array, " r"]:
    problem, noise, numbers = args
    return _full(numbers.values(x), (problem, noise)) / numbers.length


def _by_optimistix(
    problem: _Problem,
    start: Float[Array, " p"],
    noise: Float[Array, ""],
    solver: Any,
    max_steps: int,
    limited: bool,
) -> tuple[Float[Array, " p"], Int[Array, ""], Int[Array, ""]]:
    passes, steps = _RESTARTS if limited else 1, jnp.zeros((), jnp.int64)
    most, code = max(max_steps // passes, 1), jnp.asarray(STATUSES.index("failed"))
    for _ in range(passes):
        # The solution is that of the last pass, wherever it began.
        begun = jax.lax.stop_gradient(start)
        start, code, more = _solved(problem, begun, noise, solver, most)
        steps += more
    return start, code, steps


@eqx.filter_jit
def _solved(
    problem: _Problem,
    start: Float[Array, " p"],
    noise: Float[Array, ""],
    solver: Any,
    max_steps: int,
) -> tuple[Float[Array, " p"], Int[Array, ""], Int[Array, ""]]:
    outcomes = {
        "converged": optx.RESULTS.successful,
        "max_steps": optx.RESULTS.nonlinear_max_steps_reached,
        "not_finite": optx.RESULTS.nonfinite,
    }

    def residual(values: Float[Array, " p"]) -> Float[Array, " r"]:
        return _full(values, (problem, noise))

    numbers = Scaled.of(residual, start, problem.limits)
    found: optx.Solution[Any, Any] = optx.least_squares(
        _scaled,
        solver,
        jnp.zeros_like(start),
        args=(problem, noise, numbers),
        # What stands on a limit has no slope: the derivative is that of the others.
        adjoint=optx.ImplicitAdjoint(lx.AutoLinearSolver(well_posed=False)),
        max_steps=max_steps,
        throw=False,
    )
    values = numbers.values(found.value)
    code = jnp.asarray(STATUSES.index("failed"))
    for status, outcome in outcomes.items():
        code = jnp.where(found.result == outcome, STATUSES.index(status), code)
    still = jax.lax.stop_gradient(values)
    off, design = residual(still), jax.jacfwd(residual)(still)
    slope, left = off @ design, jnp.linalg.norm(off)
    inside = (values > numbers.limits[0]) & (values < numbers.limits[1])
    steep = jnp.abs(slope) > _STEEP * left * jnp.linalg.norm(design, axis=0)
    # Of an exact fit rounding alone is left, which has any slope.
    early = jnp.any(steep & inside) & (left > _EXACT * problem.length)
    early &= code == STATUSES.index("converged")
    code = jnp.where(early, STATUSES.index("failed"), code)
    rests = numbers.at_rest(still, slope)
    code = jnp.where(rests, code, STATUSES.index("max_steps"))
    finite = jnp.all(jnp.isfinite(slope))
    code = jnp.where(finite, code, STATUSES.index("not_finite"))
    return values, code, jnp.asarray(found.stats["num_steps"])


@eqx.filter_jit
def _spread_of(problem: _Problem, values: Float[Array, " p"]) -> Float[Array, ""]:
    """Return the rms residual at some values."""
    used = jnp.where(problem.weights > 0, 1.0, 0.0)
    return jnp.sqrt(jnp.sum(problem.residual(values) ** 2) / jnp.sum(used))


@eqx.filter_jit
def _report(
    problem: _Problem,
    values: Float[Array, " p"],
    assumed: Float[Array, ""],
    known: Float[Array, ""] | None,
    blocks: Int[Array, " t"],
    count: int,
) -> dict[str, Any]:
    """Return noise, standard deviations and the rest of a `ModelFit` at a solution.

    Args:
        problem: The fit.
        values: The solution.
        assumed: Noise that the priors were weighed with.
        known: Noise where it is known.
        blocks: Number of the block of each reading, for the error held out.
        count: Of blocks.
    """
    residual = problem.residual(values)
    # Derivatives of a fit are those of its values and its noise: how sure it is counts as
    # constant, since factors of a design are costly to differentiate.
    arrays, others = eqx.partition((problem, values, assumed), eqx.is_array)
    fixed, at, weight = eqx.combine(jax.lax.stop_gradient(arrays), others)
    design = jax.jacfwd(fixed.residual)(at)
    prior = weight / fixed.prior[1]
    scale, singular, directions = factor(design, prior)
    per_noise, lost = covariance_of(singular, directions, scale)
    used = jnp.ravel(jnp.where(fixed.weights > 0, 1.0, 0.0))
    parameters = jnp.sum((design @ per_noise) * design)
    free = jnp.sum(used) - parameters
    noise = jnp.sqrt(jnp.sum(residual**2) / jnp.maximum(free, 1.0))
    # No reading is left to judge the noise by.
    noise = jnp.where((free > _SPARE) | jnp.any(prior > 0), noise, jnp.inf)
    noise = noise if known is None else known
    left_out = held_out_rms(design, -fixed.residual(at), prior, blocks, count, used)
    deviation = noise * jnp.sqrt(jnp.where(lost, jnp.inf, jnp.diag(per_noise)))
    return {
        "model": problem.model(values),
        "standard_deviation": eqx.combine(
            problem.form.tree(deviation),
            eqx.filter(problem.rest, eqx.is_inexact_array, inverse=True),
        ),
        "noise": noise,
        "held_out": jnp.where(jnp.isinf(noise), jnp.inf, left_out),
        "residual": problem.error(values),
        "values": values,
        "limits": jnp.stack(problem.limits),
        "scale": scale,
        "singular": singular,
        "directions": directions,
    }


def _blocks(groups: ArrayLike | None, size: int) -> tuple[Int[Array, " t"], int]:
    if groups is None:
        count = min(_BLOCKS, max(size, 1))
        return jnp.asarray(np.arange(size) * count // max(size, 1)), count
    names, blocks = np.unique(np.ravel(np.asarray(groups)), return_inverse=True)
    if blocks.shape != (size,):
        msg = f"groups: found {blocks.size} of them, expected one per reading, {size}"
        raise FitError(msg)
    return jnp.asarray(blocks), len(names)

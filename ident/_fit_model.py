"""Fit any equinox module to readings: least squares by optimistix, or by CasADi and IPOPT."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..models import AbstractNodes, AbstractSurface
from ._model_fit import STATUSES, ModelFit, covariance_of, factor, held_out_rms
from .core import FitError, least_squares_ipopt

M = TypeVar("M", bound=eqx.Module)

Pairs = Any
"""A tree shaped like the model, or a mapping of names: a pair of numbers or None each."""

_BLOCKS = 10
"""Blocks of consecutive readings that are held out in turn."""
_PASSES = 30
_SAME = 1e-10
"""Passes at most, and the relative change of the noise that ends them: it weighs priors."""
_LIMIT_PASSES = 4
"""Solves with limits: after each, what rests on one is held there, or let go."""
_NEAR = 1e-2
"""How near to a limit that is, in steps that change the residual by its size."""
_INSIDE = 1e-3
"""How far inside its limits a start begins, in parts of their distance or of itself."""


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
    constraints: Callable[[M], Array] | None = None,
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
    solution; give `noise` where priors are traced). IPOPT works on the host.

    Args:
        model: Start values; its type is that of the result.
        predict: ``predict(model, inputs)``, a JAX function, in the unit and shape of
            `measured`. Compiles once per function and shape.
        inputs: Whatever `predict` takes: arrays, or a tree of them.
        measured: Readings, of any shape.
        bounds: Pair (least, largest) per array, a number or an array each; None = free.
            Either a tree shaped like the model, or a mapping of names to pairs. optimistix
            sees them as a change of variables, $\tanh$ with unit slope at the start; a
            solution on a limit is reached to about 1e-6.
        priors: Pair (mean, standard deviation) per array, in its unit; None = none.
        weights: Of the readings, relative; 0 leaves a reading out, NaN or not.
        groups: Number of the group of each reading, for `ModelFit.held_out`; left out: ten
            blocks of consecutive readings.
        noise: Standard deviation of a reading of weight 1, where known: it weighs the
            priors, and scales all standard deviations.
        constraints: Values that a solution keeps at or above zero; only with IPOPT.
        fitted: Names of the arrays to fit, or of parts of the model. Left out: all
            inexact arrays except the positions of nodes and surfaces, which stay.
        solver: An optimistix solver, or ``"ipopt"``. Left out: Levenberg-Marquardt, with
            constraints IPOPT.
        max_steps: Of the solver, at most.
        throw: Raise where the solve fails; else read `ModelFit.result`.

    Raises:
        ValueError: If names, shapes or options do not fit together.
        FitError: If a reading is no number, or the solve fails and `throw` is true.
    """
    if solver is None:
        solver = "ipopt" if constraints is not None else LEVENBERG_MARQUARDT
    if constraints is not None and solver != "ipopt":
        msg = "constraints need solver='ipopt': optimistix knows no inequalities."
        raise ValueError(msg)
    params, rest = eqx.partition(model, fitted_arrays(model, fitted))
    form = Form.of(params)
    if not form.names:
        msg = "found no array to fit in the model, expected one of floats"
        raise ValueError(msg)
    readings = as_float(measured)
    problem = _Problem(
        predict,
        constraints,
        form,
        rest,
        jax.tree.map(as_float, inputs),
        readings,
        weights_of(readings, weights),
        form.pairs(bounds, (-np.inf, np.inf), "bounds"),
        form.pairs(priors, (0.0, np.inf), "priors"),
    )
    start, known = form.flat(params), None if noise is None else as_float(noise)
    leaves = jax.tree.leaves((problem, start, known))
    traced = any(isinstance(leaf, Tracer) for leaf in leaves)
    if traced and solver == "ipopt":
        msg = "solver='ipopt' works on the host: outside of jax.jit, grad and vmap."
        raise ValueError(msg)
    if traced and known is None and priors is not None:
        msg = "give noise where a fit with priors is traced: else fits are repeated."
        raise ValueError(msg)

    sigma, steps = jnp.ones(()) if known is None else known, jnp.zeros((), jnp.int64)
    blocks, count = _blocks(groups, readings.size)
    if known is None and priors is not None:
        sigma = _spread_of(problem, start)
    for _ in range(_PASSES):
        if isinstance(solver, str):
            start, code, more = _by_ipopt(problem, start, sigma, max_steps)
        else:
            start, code, more = _by_optimistix(
                problem, start, sigma, solver, max_steps, bounds is not None
            )
        steps = steps + more
        before, found = sigma, _report(problem, start, sigma, known, blocks, count)
        sigma = found["noise"]
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
        msg = (
            f"the solve of fit_model ended as '{fit.result}' after {int(steps)} steps; "
            "expected it to converge: other start values, bounds, or more max_steps."
        )
        raise FitError(msg)
    return fit


LEVENBERG_MARQUARDT: optx.LevenbergMarquardt[Any, Any, Any] = optx.LevenbergMarquardt(
    rtol=1e-10, atol=1e-10
)
"""The default; steps are counted in units that change the residual by its first size."""


@dataclasses.dataclass(frozen=True)
class Form:
    """How the fitted arrays of a model lie in one vector."""

    structure: Any
    shapes: tuple[tuple[int, ...], ...]
    paths: tuple[str, ...]
    """Name of each array."""

    @classmethod
    def of(cls, params: Any) -> "Form":
        leaves = jtu.tree_leaves_with_path(params)
        shapes = tuple(jnp.shape(leaf) for _, leaf in leaves)
        paths = tuple(path_name(path) for path, _ in leaves)
        return cls(jax.tree.structure(params), shapes, paths)

    @property
    def sizes(self) -> tuple[int, ...]:
        """How many numbers each array has."""
        return tuple(math.prod(shape) for shape in self.shapes)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each number."""
        return tuple(
            path + (f"[{', '.join(map(str, place))}]" if place else "")
            for path, shape in zip(self.paths, self.shapes, strict=True)
            for place in np.ndindex(shape)
        )

    def flat(self, params: Any) -> Float[Array, " p"]:
        return jnp.concatenate(
            [jnp.ravel(as_float(x)) for x in jax.tree.leaves(params)]
        )

    def tree(self, values: Float[Array, " p"]) -> Any:
        ends = np.cumsum(self.sizes)[:-1]
        parts = jnp.split(values, ends)
        leaves = [jnp.reshape(p, s) for p, s in zip(parts, self.shapes, strict=True)]
        return jax.tree.unflatten(self.structure, leaves)

    def pairs(
        self, given: Pairs, default: tuple[float, float], what: str
    ) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        """Return the first and the second number of all pairs, as two vectors.

        Raises:
            ValueError: If a name is unknown or a pair is none.
        """
        if given is None or isinstance(given, Mapping):
            named = dict(given or {})
        else:
            leaves = jtu.tree_leaves_with_path(given, is_leaf=_is_pair)
            named = {path_name(path): pair for path, pair in leaves}
            # What is not fitted may have a place in the tree.
            named = {path: named[path] for path in self.paths if path in named}
        unknown = [name for name in named if name not in self.paths]
        if unknown:
            known = ", ".join(self.paths)
            msg = f"{what}: found {', '.join(unknown)}, expected some of {known}"
            raise ValueError(msg)
        sides: tuple[list[Array], list[Array]] = ([], [])
        for path, shape in zip(self.paths, self.shapes, strict=True):
            pair = named.get(path)
            if not _is_pair(pair):
                msg = f"{what} of {path}: found {pair!r}, expected a pair or None"
                raise ValueError(msg)
            for side, one, other in zip(sides, pair or default, default, strict=True):
                value = as_float(other if one is None else one)
                side.append(jnp.ravel(jnp.broadcast_to(value, shape)))
        return jnp.concatenate(sides[0]), jnp.concatenate(sides[1])


def _is_pair(node: Any) -> bool:
    return node is None or (type(node) in (tuple, list) and len(node) == 2)


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

    def model(self, values: Float[Array, " p"]) -> Any:
        return eqx.combine(self.form.tree(values), self.rest)

    def error(self, values: Float[Array, " p"]) -> Float[Array, "..."]:
        """Return measured − predicted."""
        predicted = self.predict(self.model(values), self.inputs)
        if jnp.shape(predicted) != self.measured.shape:
            msg = (
                f"predict: found shape {jnp.shape(predicted)}, expected that of the "
                f"readings, {self.measured.shape}"
            )
            raise ValueError(msg)
        return self.measured - predicted

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
    return jnp.ravel(problem.constraints(problem.model(values)))


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


class _Change(eqx.Module):
    r"""Change of variables: a step of one from the start changes the residual by its size.

    Inside limits with $\tanh$. What rests on a limit is held there: the change of
    variables would reach it after infinitely many steps.
    """

    start: Float[Array, " p"]
    unit: Float[Array, " p"]
    limits: tuple[Float[Array, " p"], Float[Array, " p"]]
    held: tuple[Bool[Array, " p"], Bool[Array, " p"]]
    """Whether a number rests on its lower, on its upper limit."""
    length: Float[Array, ""]
    """Of the residual at the start."""

    @classmethod
    def of(
        cls,
        problem: _Problem,
        start: Float[Array, " p"],
        noise: Array,
        first: Bool[Array, ""],
    ) -> "_Change":
        (low, high), args = problem.limits, (problem, noise)
        natural = jnp.where(start != 0, jnp.abs(start), 1.0)
        width = jnp.minimum(high - low, float(np.finfo(np.float64).max))
        gap = _INSIDE * jnp.minimum(width, natural)
        inside = jnp.clip(start, low + gap, high - gap)
        at = jnp.where(first, inside, start)
        residual, design = _full(at, args), jax.jacfwd(_full)(at, args)
        length = jnp.linalg.norm(residual)
        length = jnp.where(length > 0, length, 1.0)
        norms = jnp.linalg.norm(design, axis=0)
        felt = jnp.isfinite(norms) & (norms > 0)
        unit = jnp.where(felt, length / jnp.where(felt, norms, 1.0), natural)
        unit, slope = jnp.minimum(unit, width), residual @ design
        near = jnp.where(first, -1.0, _NEAR) * unit
        held = (at - low <= near) & (slope > 0), (high - at <= near) & (slope < 0)
        fixed = (inside, unit, (low, high), held, length)
        return cls(*jax.lax.stop_gradient(fixed))

    def values(self, x: Float[Array, " p"]) -> Float[Array, " p"]:
        """Return the numbers of the model: inside their limits, with slope `unit` at 0."""
        low, high = self.limits
        step = self.unit * x
        has_low, has_high = jnp.isfinite(low), jnp.isfinite(high)
        # One limit: a hyperbola between it and a straight line. What is not meant must
        # stay finite, for its derivative.
        above = jnp.where(has_low, self.start - low, 1.0)
        below = jnp.where(has_high, high - self.start, 1.0)
        only_low = self.start + above * (_hyperbola(step / above) - 1.0)
        only_high = self.start - below * (_hyperbola(-step / below) - 1.0)
        half = 0.5 * (above + below)
        place = (above - below) / (2.0 * half)
        bent = jnp.tanh(jnp.arctanh(place) + step / (half * (1.0 - place**2)))
        both = self.start + half * (bent - place)
        one = jnp.where(has_high, only_high, self.start + step)
        one = jnp.where(has_low, jnp.where(has_high, both, only_low), one)
        return jnp.where(self.held[0], low, jnp.where(self.held[1], high, one))

    def at_rest(self, slope: Float[Array, " p"]) -> Bool[Array, ""]:
        """Return whether the cost pushes all that is held against its limit."""
        low, high = self.held
        return ~jnp.any((low & (slope < 0)) | (high & (slope > 0)))


def _hyperbola(x: Float[Array, " p"]) -> Float[Array, " p"]:
    """Return a positive function with value and slope 1 at 0."""
    root = jnp.sqrt(x * x + 1.0)
    return jnp.where(x < 0, 1.0 / (root - x), x + root)


def _changed(
    x: Float[Array, " p"], args: tuple[_Problem, Array, _Change]
) -> Float[Array, " r"]:
    problem, noise, change = args
    return _full(change.values(x), (problem, noise)) / change.length


@eqx.filter_jit
def _by_optimistix(
    problem: _Problem,
    start: Float[Array, " p"],
    noise: Float[Array, ""],
    solver: Any,
    max_steps: int,
    limited: bool,
) -> tuple[Float[Array, " p"], Int[Array, ""], Int[Array, ""]]:
    passes = _LIMIT_PASSES if limited else 1
    outcomes = {
        "converged": optx.RESULTS.successful,
        "max_steps": optx.RESULTS.nonlinear_max_steps_reached,
        "not_finite": optx.RESULTS.nonfinite,
    }

    def once(
        start: Float[Array, " p"], first: Bool[Array, ""]
    ) -> tuple[Array, tuple[Array, Array]]:
        change = _Change.of(problem, start, noise, first)
        found: optx.Solution[Any, Any] = optx.least_squares(
            _changed,
            solver,
            jnp.zeros_like(start),
            args=(problem, noise, change),
            max_steps=max(max_steps // passes, 1),
            throw=False,
        )
        values = change.values(found.value)
        code = jnp.asarray(STATUSES.index("failed"))
        for status, outcome in outcomes.items():
            code = jnp.where(found.result == outcome, STATUSES.index(status), code)
        slope = jax.grad(lambda x: 0.5 * jnp.sum(_full(x, (problem, noise)) ** 2))
        resting = change.at_rest(jax.lax.stop_gradient(slope(values)))
        code = jnp.where(resting, code, STATUSES.index("max_steps"))
        return values, (code, jnp.asarray(found.stats["num_steps"]))

    values, (codes, steps) = jax.lax.scan(once, start, jnp.arange(passes) == 0)
    return values, codes[-1], jnp.sum(steps)


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
    design = jax.jacfwd(problem.residual)(values)
    prior = assumed / problem.prior[1]
    scale, singular, directions = factor(design, prior)
    per_noise, lost = covariance_of(singular, directions, scale)
    used = jnp.ravel(jnp.where(problem.weights > 0, 1.0, 0.0))
    parameters = jnp.sum((design @ per_noise) * design)
    free = jnp.maximum(jnp.sum(used) - parameters, 1.0)
    noise = jnp.sqrt(jnp.sum(residual**2) / free) if known is None else known
    deviation = noise * jnp.sqrt(jnp.where(lost, jnp.inf, jnp.diag(per_noise)))
    return {
        "model": problem.model(values),
        "standard_deviation": eqx.combine(
            problem.form.tree(deviation),
            eqx.filter(problem.rest, eqx.is_inexact_array, inverse=True),
        ),
        "noise": noise,
        "held_out": held_out_rms(design, -residual, prior, blocks, count, used),
        "residual": problem.error(values),
        "values": values,
        "limits": jnp.stack(problem.limits),
        "scale": scale,
        "singular": singular,
        "directions": directions,
    }


def as_float(value: Any) -> Any:
    """Return numbers as an array of 64-bit floats, integers of arrays as they are."""
    if isinstance(value, Array):
        wide = jnp.issubdtype(value.dtype, jnp.floating)
        return value.astype(jnp.float64) if wide else value
    if isinstance(value, np.ndarray | np.generic | int | float | Sequence):
        return jnp.asarray(value, jnp.float64)
    return value


def weights_of(measured: Float[Array, "..."], given: ArrayLike | None) -> Array:
    weights = jnp.broadcast_to(
        as_float(1.0 if given is None else given), measured.shape
    )
    if not isinstance(weights, Tracer):
        if not np.all(np.asarray(weights) >= 0):
            msg = "weights: found one below 0 or NaN, expected 0 or more"
            raise ValueError(msg)
        if not isinstance(measured, Tracer):
            lost = np.flatnonzero((weights > 0) & ~np.isfinite(measured))
            if lost.size:
                msg = (
                    f"measured: reading {lost[0]} is not finite; weight 0 leaves it out"
                )
                raise FitError(msg)
    return weights


def _blocks(groups: ArrayLike | None, size: int) -> tuple[Int[Array, " t"], int]:
    if groups is None:
        count = min(_BLOCKS, max(size, 1))
        return jnp.asarray(np.arange(size) * count // max(size, 1)), count
    names, blocks = np.unique(np.ravel(np.asarray(groups)), return_inverse=True)
    if blocks.shape != (size,):
        msg = f"groups: found {blocks.size} of them, expected one per reading, {size}"
        raise ValueError(msg)
    return jnp.asarray(blocks), len(names)


def fitted_arrays(model: Any, fitted: Sequence[str] | None) -> Any:
    """Return the filter of the arrays to fit."""
    if fitted is None:
        positions = (AbstractNodes, AbstractSurface)
        return jax.tree.map(
            lambda leaf: not isinstance(leaf, positions) and eqx.is_inexact_array(leaf),
            model,
            is_leaf=lambda leaf: isinstance(leaf, positions),
        )
    arrays = eqx.filter(model, eqx.is_inexact_array)
    known = [path_name(path) for path, _ in jtu.tree_leaves_with_path(arrays)]
    for name in fitted:
        if not any((own + ".").startswith(name + ".") for own in known):
            msg = f"fitted: found {name}, expected some of {', '.join(known)}"
            raise ValueError(msg)
    return jtu.tree_map_with_path(
        lambda path, leaf: (
            eqx.is_inexact_array(leaf)
            and any((path_name(path) + ".").startswith(name + ".") for name in fitted)
        ),
        model,
    )


def path_name(path: Any) -> str:
    return jtu.keystr(path, simple=True, separator=".")

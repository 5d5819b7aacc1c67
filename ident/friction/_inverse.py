"""Friction from any motion: current = (inertia · a + friction(v) + offset) / gain."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ...models import AbstractFriction
from ..core import one_blas_thread
from ._equation import Equation, Known, Weights, equation_of, ridged, weigh
from ._samples import DriveSamples
from ._separable import Solution, fit_equation
from ._structures import GAUSS, WAYS, AbstractStructure, CoulombViscous, Stribeck

METHOD = "inverse dynamic fit"
_ONE_WAY = "no motion in this direction was recorded"
_LEVEL = "only its sum with a constant load is seen"
_CONFUSED = "the motion does not tell it from the others"
_VAGUE_WORDS = "its share of the current is not told apart from the others'"
_VAGUE = 0.3
"""Standard deviation of a column's contribution, as a share of the load, that says nothing."""
_DROP = 3.0
"""Standard deviations that a drop must show to be one."""
_OTHER = 3.0
"""Standard deviations by which an exponent must differ from `GAUSS` to be another one."""
_TOO_FAST = 0.5
"""Stribeck velocity, as a share of the highest speed, that only a bend at speed can give."""
_VAGUE_LOG = 0.7
"""Standard deviation of the logarithm of a shape (a factor of two) that says nothing."""
_IN_NULL = 1e-3
"""Share of a parameter in a direction that no row tells, to be unknown with it."""


@dataclasses.dataclass(frozen=True)
class FrictionFit:
    """A fitted friction law with what is known about it.

    Loads are in the unit that ``gain`` times the current has (drive units for gain 1).

    Attributes:
        method: How it was found, in words.
        structure: Which kind of law.
        has_law: Whether the level of friction is told from a constant load.
        parameters: By the names of the result file, in load units over mm/s and mm/s²; only
            those that the data determine.
        standard_deviations: Of the same.
        names: Of all parameters, determined or not: the order of ``covariance``.
        covariance: Between them; NaN where undetermined.
        undetermined: What the data cannot say: name → reason.
        gauges: Sentences on what can only be told together.
        noise: Robust standard deviation of the residual.
        relative_error: RMS of the residual over RMS of the load, over all rows in motion.
        residual: Load − fit per row used, after filtering, in load units.
        count: Rows that counted.
        converged: Whether the search for the law's shape ended.
        message: One sentence on how the fit went.
        known: What was not fitted.
        decimate: Samples of the recording per row.
        state: Linear factors as fitted: inertia, offset, loads where fitted, then those of the
            law, before a gauge parts level and offset.
        state_covariance: Of ``state`` and ``shape``.
        factors: Linear factors of the law, in the order of `AbstractStructure.names`.
        shape: Logarithms of the law's non-linear parameters.
        law_covariance: Of ``factors`` and ``shape``, for `band`.
    """

    method: str
    structure: AbstractStructure
    has_law: bool
    parameters: Mapping[str, float]
    standard_deviations: Mapping[str, float]
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "r r"]
    undetermined: Mapping[str, str]
    gauges: tuple[str, ...]
    noise: float
    relative_error: float
    residual: Float[np.ndarray, " t"]
    count: int
    converged: bool
    message: str
    known: Known
    decimate: int
    state: Float[np.ndarray, " n"]
    state_covariance: Float[np.ndarray, "m m"]
    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " h"]
    law_covariance: Float[np.ndarray, "p p"]

    @cached_property
    def law(self) -> AbstractFriction | None:
        """Current over velocity without the offset, in load units.

        None where the level of friction cannot be told from a constant load.
        """
        if not self.has_law:
            return None
        factors = self.factors.reshape(self.structure.ways, -1)
        return self.structure.law(factors, self.shape)

    def slopes(self, velocity: Float[np.ndarray, " v"]) -> Float[np.ndarray, "v p"]:
        """Return the derivatives of the friction by ``factors`` and ``shape``."""
        columns = self.structure.columns(velocity, self.shape)
        tangents = self.structure.tangents(velocity, self.shape, self.factors)
        return np.hstack([columns, tangents])

    def band(
        self, velocity: Float[np.ndarray, " v"]
    ) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]]:
        """Return friction and its standard deviation at velocities in mm/s, in load units.

        That of the noise: the law itself is taken as true (see `Choice.deviation`).
        """
        slopes = self.slopes(velocity)
        variance = ((slopes @ self.law_covariance) * slopes).sum(axis=1)
        friction = slopes[:, : len(self.factors)] @ self.factors
        return friction, np.sqrt(np.maximum(variance, 0.0))


def fit_inverse(
    samples: DriveSamples,
    structure: AbstractStructure | None = None,
    *,
    known: Known | None = None,
    loss: str = "trim",
    decimate: int | None = None,
) -> FrictionFit:
    """Fit inertia, friction law and offset to a recording of any motion.

    Current, acceleration and the friction computed from the velocity go through one
    low-pass and are thinned (`Lowpass`); where the samples carry instruments the rows are
    seen through them, which keeps the fit consistent under noise in velocity and
    acceleration. Standard deviations are HAC (`score_covariance`). A Stribeck drop or
    exponent that the data do not show is left out and named, and the rest fitted without it.

    Args:
        samples: The recording.
        structure: Kind of law; Stribeck with a free exponent where left out.
        known: Gain, and what of inertia and offset need not be fitted.
        loss: ``"trim"`` (least squares, wild samples out), ``"student"``, ``"huber"`` or
            ``"gauss"``.
        decimate: Samples per row; about 100 rows per second where not stated.

    Raises:
        FitError: If the samples cannot be used at all; what merely cannot be told apart is
            named in the result.
    """
    equation = equation_of(samples, structure or Stribeck(), known, decimate)
    with one_blas_thread():
        weights = weigh(equation, loss)
        return assemble(*fit_carried(equation, weights), METHOD)


def fit_carried(
    equation: Equation, weights: Weights, near: Float[np.ndarray, " h"] | None = None
) -> tuple[Equation, Solution, dict[str, str]]:
    """Return equation and solution of what the data carry of a law, and what they do not.

    Args:
        equation: Of the law that is asked for.
        weights: Of its rows.
        near: Logarithms of a shape to begin with.
    """
    structure, missing = equation.structure, dict[str, str]()
    solution = fit_equation(equation, weights, near)
    reason = _shape_reason(equation, solution)
    if reason is not None and _drop_reason(equation, solution) is None:
        missing["stribeck_shape"] = reason
        equation = equation.with_structure(Stribeck(structure.directional, GAUSS))
        solution = fit_equation(equation, weights, solution.shape[:1])
    reason = _drop_reason(equation, solution)
    if reason is not None:
        names = [name for name in structure.names if name.startswith("drop")]
        names = [name.replace("drop", "breakaway") for name in names]
        missing |= dict.fromkeys([*names, *structure.shapes], reason)
        equation = equation.with_structure(CoulombViscous(structure.directional))
        solution = fit_equation(equation, weights)
    return equation, solution, missing


def fit_competing(
    equation: Equation, weights: Weights, near: Float[np.ndarray, " h"] | None
) -> tuple[Equation, Solution, dict[str, str]]:
    """Return what `fit_carried` does, of a law that competes with others.

    An exponent is `GAUSS` unless the data ask for another one: where they do not, a free one
    follows the noise.
    """
    structure = equation.structure
    if not structure.parametric:
        return equation, fit_equation(equation, weights), {}
    # Where one direction asks for an exponent, both do.
    if len(structure.shapes) > (1 if near is None else len(near)):
        usual = equation.with_structure(Stribeck(structure.directional, GAUSS))
        solution = fit_equation(usual, weights, near)
        near = np.append(solution.shape, np.log(GAUSS))
        held = fit_equation(equation, weights, near, held=True)
        step = ridged(held.rows.sums[:, :-1], held.rows.sums[:, -1])[-1]
        asked = abs(step) > _OTHER * np.sqrt(held.covariance[-1, -1])
        if not asked and _drop_reason(usual, solution) is None:
            return usual, solution, {}
    return fit_carried(equation, weights, near)


def _drop_reason(equation: Equation, solution: Solution) -> str | None:
    """Return why the data show no Stribeck drop, or None where they do."""
    structure, fixed = equation.structure, len(equation.fixed_names)
    if not isinstance(structure, Stribeck):
        return None
    count = len(solution.factors)
    sd = np.sqrt(np.diag(solution.covariance))
    own, own_sd = (
        each[fixed:count].reshape(structure.ways, -1) for each in (solution.factors, sd)
    )
    velocity, speeds = float(np.exp(solution.shape[0])), equation.speed
    slowest, fastest = float(speeds.min()), float(speeds.max())
    per = f"{equation.samples.unit}/s"
    if (own[:, -1] <= 0).all():
        return (
            "friction does not fall from rest on: no Stribeck effect above "
            f"{slowest:.3g} {per}, the slowest motion recorded"
        )
    if velocity > _TOO_FAST * fastest or (own[:, 0] < 0).any():
        return (
            f"friction bends up to the highest speeds recorded ({fastest:.3g} {per}): "
            "that is no drop from break-away, and says nothing of one"
        )
    if solution.at_bound[0] or sd[count] > _VAGUE_LOG:
        return (
            f"the recording has too little motion in the Stribeck range (slowest "
            f"{slowest:.3g} {per}, found {velocity:.3g} {per})"
        )
    if not (own[:, -1] > _DROP * own_sd[:, -1]).any():
        return "the drop from break-away to Coulomb friction is lost in the noise"
    return None


def _shape_reason(equation: Equation, solution: Solution) -> str | None:
    """Return why the data do not tell the Stribeck exponent, or None where they do."""
    if "stribeck_shape" not in equation.structure.shapes:
        return None
    place = len(solution.factors) + 1
    vague = np.sqrt(solution.covariance[place, place]) > _VAGUE_LOG
    if solution.at_bound[1] or vague:
        return "the data do not tell how sharply friction falls; 2 is assumed"
    return None


def assemble(
    equation: Equation, solution: Solution, missing: Mapping[str, str], method: str
) -> FrictionFit:
    """Return the result of a fit.

    Args:
        equation: What was solved.
        solution: Where the fit ended.
        missing: What the data do not carry: name → reason.
        method: How it was found, in words.
    """
    structure, fixed = equation.structure, len(equation.fixed_names)
    count, shapes = len(solution.factors), len(solution.shape)
    linear_names, linear, to_law = equation.reading
    names = (*linear_names, *structure.shapes)
    parted = "offset" in names and "offset" not in equation.fixed_names
    # The law as fitted, and all parameters as users read them, by factors and shape.
    inner = np.eye(count + shapes)[fixed:]
    inner[: count - fixed, :count] = to_law
    law = inner @ np.concatenate([solution.factors, solution.shape])
    natural = np.exp(solution.shape)
    values = np.concatenate([linear @ solution.factors, natural])
    jacobian = np.zeros((len(names), count + shapes))
    jacobian[: len(linear), :count] = linear
    jacobian[len(linear) :, count:] = np.diag(natural)
    undetermined = _undetermined(equation, solution, names, jacobian, parted)
    undetermined = dict(missing) | undetermined | dict(missing)
    open_ = np.array([name in undetermined for name in names], bool)
    covariance = jacobian @ solution.covariance @ jacobian.T
    covariance = np.where(open_[:, None] | open_[None], np.nan, covariance)
    known = equation.known
    given = {"inertia": known.inertia, "offset": known.offset}
    told = [(place, name) for place, name in enumerate(names) if not open_[place]]
    load, residual, share = (
        each[equation.usable]
        for each in (equation.load, solution.residual, solution.share)
    )
    counted = int(np.count_nonzero(share))
    levels = [
        name
        for name, is_one in zip(structure.factors, structure.levels, strict=True)
        if is_one
    ]
    return FrictionFit(
        method=method,
        structure=structure,
        has_law=not any(name.startswith(tuple(levels)) for name in undetermined),
        parameters={name: float(values[place]) for place, name in told}
        | {name: value for name, value in given.items() if value is not None},
        standard_deviations={
            name: float(np.sqrt(covariance[place, place])) for place, name in told
        },
        names=names,
        covariance=covariance,
        undetermined=undetermined,
        gauges=_gauges(equation, solution, parted),
        noise=solution.scale,
        relative_error=float(np.linalg.norm(residual) / np.linalg.norm(load)),
        residual=residual,
        count=counted,
        converged=solution.converged,
        message=(
            f"{structure.words}: "
            f"{'converged' if solution.converged else 'did not converge'}, "
            f"{len(share) - counted} of {len(share)} samples rejected as wild."
        ),
        known=known,
        decimate=equation.factor,
        state=solution.factors,
        state_covariance=solution.covariance,
        factors=law[: count - fixed],
        shape=solution.shape,
        law_covariance=inner @ solution.covariance @ inner.T,
    )


def _undetermined(
    equation: Equation,
    solution: Solution,
    names: tuple[str, ...],
    jacobian: Float[np.ndarray, "r p"],
    parted: bool,
) -> dict[str, str]:
    """Return what the rows do not tell: name → reason."""
    seen, used = equation.samples.directions, equation.usable
    count, null = len(solution.factors), solution.null
    load = float(np.sqrt(np.mean(equation.load[used] ** 2)))
    size = np.sqrt(np.mean(solution.columns[used] ** 2, axis=0))
    sd = np.sqrt(np.diag(solution.covariance)) * size
    columns = equation.fixed_names + equation.structure.names
    vague = {
        name.replace("drop", "breakaway")
        for name, own in zip(columns, sd, strict=False)
        if own > _VAGUE * load
    }
    size = np.where(size > 0, size, 1.0)
    null = null / np.abs(null * size[:count, None]).max(axis=0)
    reach = np.abs(jacobian[:, :count] @ null).max(axis=1, initial=0.0)
    unseen = reach > _IN_NULL * np.abs(jacobian / size).max(axis=1)
    found: dict[str, str] = {}
    for name, gone in zip(names, unseen, strict=True):
        if name.endswith(WAYS) and not seen[name.endswith(WAYS[1])]:
            found[name] = _ONE_WAY
        elif not all(seen) and (gone or (parted and name == "offset")):
            found[name] = _LEVEL
        elif gone:
            found[name] = _CONFUSED
        elif name in vague:
            found[name] = _VAGUE_WORDS
    return found


def _gauges(equation: Equation, solution: Solution, parted: bool) -> tuple[str, ...]:
    """Return what is only seen together, in sentences."""
    seen, fixed = equation.samples.directions, len(equation.fixed_names)
    if not parted and (all(seen) or "offset" not in equation.fixed_names):
        return ()
    mean = equation.structure.levels / equation.structure.levels.sum()
    levels = solution.factors[fixed:].reshape(equation.structure.ways, -1) @ mean
    if not parted:
        offset = solution.factors[equation.fixed_names.index("offset")]
        way, level = ("+", levels[0] + offset) if seen[0] else ("−", levels[0] - offset)
        return (f"Seen is only Coulomb level {way} offset = {level:.4g}.",)
    parts = [f"level⁺ + offset = {levels[0]:.4g}"] * seen[0]
    parts += [f"level⁻ − offset = {levels[1]:.4g}"] * seen[1]
    end = "; the offset is chosen so that both levels are equal." if all(seen) else "."
    return (
        "A constant load and a difference of the Coulomb levels of both directions cannot be "
        f"told apart in motion: only {' and '.join(parts)} are seen{end}",
    )


def force_error(fit: FrictionFit, samples: DriveSamples) -> Float[np.ndarray, " s"]:
    """Return load − prediction for another recording, filtered alike, in load units.

    Args:
        fit: The law, with inertia and offset.
        samples: A recording, the one fitted or another; its rows in motion count.
    """
    equation = equation_of(samples, fit.structure, fit.known, fit.decimate)
    error = equation.target - equation.columns(fit.shape)[0] @ fit.state
    return np.asarray(error[equation.usable])

"""What a friction fit gives: the law, its parameters with σ, and what the data cannot tell."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ...models import AbstractFriction
from ._determined import VAGUE, unseen, vague_columns
from ._equation import Equation, Known
from ._separable import Solution
from ._structures import WAYS, AbstractStructure

_ONE_WAY = "no motion in this direction was recorded"
_LEVEL = "only its sum with a constant load is seen"


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
        names: Order of ``values`` and ``covariance``: all parameters, determined or not.
        values: All of them; NaN where undetermined.
        covariance: Between them; NaN where undetermined.
        undetermined: What the data cannot say: name → reason.
        gauges: Sentences on what can only be told together.
        remarks: Further sentences for the report.
        noise: Robust standard deviation of the residual.
        relative_error: RMS of the residual over RMS of the load, over all rows in motion.
        residual: Load − fit per row used, after filtering, in load units.
        share: Weight that each of them had, 0 to 1.
        index: Sample of the recording that each of them is centred on.
        count: Rows that counted.
        lag: Rows over which residuals were taken to resemble each other (HAC), 0 for none.
        passes: Iterations.
        converged: Whether the last one changed nothing.
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
    values: Float[np.ndarray, " r"]
    covariance: Float[np.ndarray, "r r"]
    undetermined: Mapping[str, str]
    gauges: tuple[str, ...]
    remarks: tuple[str, ...]
    noise: float
    relative_error: float
    residual: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    index: Int[np.ndarray, " t"]
    count: int
    lag: int
    passes: int
    converged: bool
    message: str
    known: Known
    decimate: int
    state: Float[np.ndarray, " n"]
    state_covariance: Float[np.ndarray, "m m"]
    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " s"]
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

    def band(
        self, velocity: Float[np.ndarray, " v"]
    ) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]]:
        """Return friction and its standard deviation at velocities in mm/s, in load units."""
        columns = self.structure.columns(velocity, self.shape)
        tangents = self.structure.tangents(velocity, self.shape, self.factors)
        full = np.concatenate([columns, tangents], axis=1)
        variance = np.einsum("tk,tk->t", full @ self.law_covariance, full)
        return columns @ self.factors, np.sqrt(np.maximum(variance, 0.0))


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
    count, used = len(solution.factors), equation.usable
    state = np.concatenate([solution.factors, solution.shape])
    seen = equation.samples.directions
    to_offset, to_law = part_offset(equation)
    parted = to_offset is not None
    unit, shapes = np.eye(len(state)), len(solution.shape)
    names, rows = list(equation.fixed_names), [*unit[:fixed]]
    inner = np.concatenate([np.pad(to_law, ((0, 0), (0, shapes))), unit[count:]])
    if to_offset is not None:
        names.append("offset")
        rows.append(np.pad(to_offset, (0, shapes)))
    own = inner[: count - fixed] @ state
    reported, values, slopes = _reported(structure, own, solution.shape)
    jacobian = np.concatenate([np.array(rows).reshape(-1, len(state)), slopes @ inner])
    values = np.concatenate([jacobian[: len(rows)] @ state, values])
    names += reported
    load, residual, share = (
        each[used] for each in (equation.load, solution.residual, solution.share)
    )
    undetermined = dict(missing) | _undetermined(
        equation, solution, names, jacobian, seen, parted
    )
    undetermined |= missing
    has_law = not any(
        name.removesuffix(WAYS[0]).removesuffix(WAYS[1]) in structure.level_names
        for name in reported
        if name in undetermined
    )
    open_ = np.array([name in undetermined for name in names], bool)
    covariance = jacobian @ solution.covariance @ jacobian.T
    covariance = np.where(open_[:, None] | open_[None], np.nan, covariance)
    values = np.where(open_, np.nan, values)
    sd = np.sqrt(np.diag(covariance))
    good = [place for place in range(len(names)) if not open_[place]]
    given = {"inertia": equation.known.inertia, "offset": equation.known.offset}
    counted = int(np.count_nonzero(share))
    return FrictionFit(
        method=method,
        structure=structure,
        has_law=has_law,
        parameters={names[place]: float(values[place]) for place in good}
        | {name: value for name, value in given.items() if value is not None},
        standard_deviations={names[place]: float(sd[place]) for place in good},
        names=tuple(names),
        values=values,
        covariance=covariance,
        undetermined=undetermined,
        gauges=_gauges(equation, solution, seen, parted),
        remarks=equation.samples.oddities,
        noise=solution.scale,
        relative_error=float(np.linalg.norm(residual) / np.linalg.norm(load)),
        residual=residual,
        share=share,
        index=equation.lowpass.centres[used],
        count=counted,
        lag=solution.lag,
        passes=solution.passes,
        converged=solution.converged,
        message=(
            f"{structure.words}: "
            f"{'converged' if solution.converged else 'did not converge'} after "
            f"{solution.passes} passes, {len(share) - counted} of {len(share)} samples "
            "rejected as wild."
        ),
        known=equation.known,
        decimate=equation.factor,
        state=solution.factors,
        state_covariance=solution.covariance,
        factors=own,
        shape=solution.shape,
        law_covariance=inner @ solution.covariance @ inner.T,
    )


def part_offset(
    equation: Equation,
) -> tuple[Float[np.ndarray, " k"] | None, Float[np.ndarray, "f k"]]:
    """Return maps from the linear factors as fitted to the offset, and to those of the law.

    Per direction, seen in motion are level⁺ + offset and level⁻ − offset only. The offset is
    chosen so that the mean levels of both directions are equal. Where it has a column of its
    own or is known there is no map to it.
    """
    structure, fixed = equation.structure, len(equation.fixed_names)
    unit = np.eye(fixed + len(structure.names))
    if not structure.directional or equation.known.offset is not None:
        return None, unit[fixed:]
    one = structure.levels()
    offset = np.zeros(len(unit))
    offset[fixed:] = 0.5 * np.concatenate([one, -one]) / one.sum()
    shift = unit[fixed:] - np.outer(np.concatenate([one, -one]), offset)
    return offset, shift


def _reported(
    structure: AbstractStructure,
    factors: Float[np.ndarray, " k"],
    shape: Float[np.ndarray, " h"],
) -> tuple[list[str], Float[np.ndarray, " r"], Float[np.ndarray, "r p"]]:
    """Return all parameters as users read them, and their derivatives by factors and shape."""
    names: list[str] = []
    values: list[float] = []
    slopes: list[np.ndarray] = []
    width, total = len(structure.factors), len(factors) + len(shape)
    for way in range(structure.ways):
        at = slice(way * width, (way + 1) * width)
        found, numbers, jacobian = structure.reported(factors[at], shape)
        for name, number, row in zip(found, numbers, jacobian, strict=True):
            shared = name in structure.shapes
            if shared and way > 0:
                continue
            full = np.zeros(total)
            full[at], full[len(factors) :] = row[:width], row[width:]
            names.append(name if shared or structure.ways == 1 else name + WAYS[way])
            values.append(float(number))
            slopes.append(full)
    return names, np.array(values), np.array(slopes)


def _undetermined(
    equation: Equation,
    solution: Solution,
    names: list[str],
    jacobian: Float[np.ndarray, "r p"],
    seen: tuple[bool, bool],
    parted: bool,
) -> dict[str, str]:
    """Return what the rows do not tell: name → reason."""
    found: dict[str, str] = {}
    columns = equation.fixed_names + equation.structure.names
    gone = unseen(jacobian, solution)
    vague = {
        name
        for name, one in zip(columns, vague_columns(equation, solution), strict=True)
        if one
    }
    for name, is_gone in zip(names, gone, strict=True):
        if name.endswith(WAYS) and not seen[name.endswith(WAYS[1])]:
            found[name] = _ONE_WAY
        elif is_gone and not all(seen):
            found[name] = _LEVEL
        elif is_gone:
            found[name] = "the motion does not tell it from the others"
        elif name.replace("breakaway", "drop") in vague or name in vague:
            found[name] = VAGUE
        elif parted and name == "offset" and not all(seen):
            found[name] = _LEVEL
    return found


def _gauges(
    equation: Equation, solution: Solution, seen: tuple[bool, bool], parted: bool
) -> tuple[str, ...]:
    if not parted and (all(seen) or not equation.fits_offset):
        return ()
    fixed, one = len(equation.fixed_names), equation.structure.levels()
    mean = one / one.sum()
    ahead = mean @ solution.factors[fixed : fixed + len(one)]
    if not parted:
        offset = solution.factors[equation.fixed_names.index("offset")]
        level = ahead + (1.0 if seen[0] else -1.0) * offset
        way = "+" if seen[0] else "−"
        return (f"Seen is only Coulomb level {way} offset = {level:.4g}.",)
    back = mean @ solution.factors[fixed + len(one) : fixed + 2 * len(one)]
    parts = [f"level⁺ + offset = {ahead:.4g}"] * seen[0]
    parts += [f"level⁻ − offset = {back:.4g}"] * seen[1]
    end = "; the offset is chosen so that both levels are equal." if all(seen) else "."
    return (
        "A constant load and a difference of the Coulomb levels of both directions cannot be "
        f"told apart in motion: only {' and '.join(parts)} are seen{end}",
    )

"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..core import FitError, one_blas_thread
from ._equation import Equation, Known, equation_of
from ._inverse import METHOD, FrictionFit, assemble, fit_carried, part_offset
from ._samples import DriveSamples
from ._separable import (
    Rows,
    Solution,
    Weights,
    ridged,
    weigh,
)
from ._structures import (
    KNOTS,
    AbstractStructure,
    CoulombViscous,
    KnotTable,
    Stribeck,
)

WINDOWS = 10
_FEWEST = 30
"""Rows in motion that a window needs."""
_NEAR, _LONGEST = 0.1, 0.5
"""Steps of a shape's logarithm: up to which a law is linear in it, and the longest taken."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One kind of law and how it predicts what it has not seen.

    Attributes:
        structure: Kind of law.
        parameters: How many numbers it has, inertia and offset left out.
        window_error: RMS of the force error per window held out, relative to the load's RMS
            over the whole recording.
        error: Root of their mean square.
        standard_error: Of the mean square over the windows, in terms of ``error``.
        fitted_error: As ``error``, on the rows fitted.
    """

    structure: AbstractStructure
    parameters: int
    window_error: Float[np.ndarray, " w"]
    error: float
    standard_error: float
    fitted_error: float

    @property
    def spread(self) -> tuple[float, float]:
        """Least and largest error over the windows."""
        return float(np.min(self.window_error)), float(np.max(self.window_error))


@dataclasses.dataclass(frozen=True)
class WindowLaw:
    """A law fitted to a recording without one of its windows.

    Attributes:
        structure: Kind of law.
        factors: Linear factors of the law, in the order of `AbstractStructure.names`.
        shape: Logarithms of its non-linear parameters.
        inertia: In load units per mm/s².
        offset: Constant load in load units.
    """

    structure: AbstractStructure
    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " h"]
    inertia: float
    offset: float

    def friction(self, velocity: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return the friction at velocities in mm/s, in load units."""
        return np.asarray(self.structure.columns(velocity, self.shape) @ self.factors)


@dataclasses.dataclass(frozen=True)
class Choice:
    """The law chosen, and all that competed.

    Attributes:
        fit: The chosen law, fitted to the whole recording.
        laws: The parametric laws among the candidates, likewise.
        chosen: Place of the chosen law among the candidates.
        best: Place of the smallest error held out.
        candidates: From simple to rich.
        windows: How many windows were held out.
        window: Of each sample of the recording.
        without: The chosen law fitted without each window.
    """

    fit: FrictionFit
    laws: tuple[FrictionFit, ...]
    chosen: int
    best: int
    candidates: tuple[Candidate, ...]
    windows: int
    window: Int[np.ndarray, " t"]
    without: tuple[WindowLaw, ...]


def choose_law(
    samples: DriveSamples,
    structures: Sequence[AbstractStructure] | None = None,
    *,
    known: Known | None = None,
    loss: str = "trim",
    decimate: int | None = None,
    windows: int = WINDOWS,
) -> Choice:
    """Choose among kinds of law by windows held out (one standard error rule).

    The recording is cut into stretches of time with equal shares of the motion; each is
    predicted by the law solved on the others. Which rows are wild, and how smooth a table
    is, is what all rows say. Errors are those of the filtered force; wild rows are counted
    only as far as they would count in the fit. Paired: a law is as good as the best where
    its windows are not worse by more than one standard error of the difference.

    Args:
        samples: The recording.
        structures: Kinds of law; `default_structures` where left out.
        known: Gain, and what of inertia and offset need not be fitted.
        loss: As for `fit_inverse`.
        decimate: As for `fit_inverse`.
        windows: Stretches to hold out in turn.

    Raises:
        FitError: If the recording is too short to hold out windows.
    """
    equation = equation_of(samples, CoulombViscous(), known, decimate)
    window = _windows(equation, windows)
    kinds = tuple(structures or default_structures(equation))
    with one_blas_thread():
        weights = weigh(equation, loss)
        size = float(np.mean(equation.load[equation.usable] ** 2))
        fits: dict[
            AbstractStructure, tuple[Equation, Solution, dict[str, str], str]
        ] = {}
        held_out: dict[AbstractStructure, _HeldOut] = {}
        near: dict[tuple[str, ...], Float[np.ndarray, " h"]] = {}
        for kind in kinds:
            # Both directions apart have nearly the shape that they have together.
            asked, solution, missing = fit_carried(
                equation.with_structure(kind), weights, near=near.get(kind.shapes)
            )
            if len(solution.shape) == len(kind.shapes):
                near[kind.shapes] = solution.shape
            fits[kind] = asked, solution, missing, METHOD
            # Where the data do not carry a law, the simpler one speaks for it.
            if asked.structure not in held_out:
                held_out[asked.structure] = _hold_out(asked, solution, weights, window)
        candidates = tuple(
            held_out[fits[kind][0].structure].candidate(kind, size) for kind in kinds
        )
        chosen, best = _order(candidates)
    # Each sample belongs to the window of the nearest row.
    centres = equation.lowpass.centres
    row = np.searchsorted(
        0.5 * (centres[1:] + centres[:-1]), np.arange(len(samples.time))
    )
    return Choice(
        fit=assemble(*fits[kinds[chosen]]),
        laws=tuple(assemble(*fits[kind]) for kind in kinds if kind.parametric),
        chosen=chosen,
        best=best,
        candidates=candidates,
        windows=windows,
        window=window[row],
        without=held_out[fits[kinds[chosen]][0].structure].laws(),
    )


def default_structures(equation: Equation) -> tuple[AbstractStructure, ...]:
    """Return the kinds of law to compare: simple, Stribeck, table, alike and per direction."""
    knots, ways = equation.knots(KNOTS), (False, True)
    laws: list[AbstractStructure] = [CoulombViscous(way) for way in ways]
    laws += [Stribeck(way) for way in ways]
    if len(knots) > 2:
        laws += [KnotTable(way, knots) for way in ways]
    return tuple(laws)


def _order(candidates: Sequence[Candidate]) -> tuple[int, int]:
    """Return the simplest that is as good as the best, and the best."""
    best = int(np.argmin([each.error for each in candidates]))
    good = []
    for place, one in enumerate(candidates):
        worse = one.window_error**2 - candidates[best].window_error ** 2
        if worse.mean() <= np.std(worse, ddof=1) / np.sqrt(len(worse)):
            good.append(place)
    return min(good, key=lambda place: candidates[place].parameters), best


def _windows(equation: Equation, windows: int) -> Int[np.ndarray, " s"]:
    """Return the window of each row: an axis may rest for half of the time.

    Raises:
        FitError: If the recording is too short for so many windows.
    """
    moving = int(equation.usable.sum())
    if windows < 3 or moving < windows * _FEWEST:
        msg = (
            f"model choice: found {moving} samples in motion after filtering for {windows} "
            f"windows, expected at least 3 windows of {_FEWEST}."
        )
        raise FitError(msg)
    share = np.cumsum(equation.usable) / moving
    return np.minimum((share * windows).astype(np.int64), windows - 1)


@dataclasses.dataclass(frozen=True)
class _HeldOut:
    """A law solved without each window in turn.

    Attributes:
        equation: Of the law.
        factors: Linear factors without each window.
        shapes: Logarithms of the shape without each window.
        square: Mean squared error of each window.
        fitted: Of all rows, fitted to them.
    """

    equation: Equation
    factors: Float[np.ndarray, "w k"]
    shapes: Float[np.ndarray, "w h"]
    square: Float[np.ndarray, " w"]
    fitted: float

    def candidate(self, kind: AbstractStructure, size: float) -> Candidate:
        """Return how the law predicts, speaking for a kind, relative to the load's square."""
        square = self.square / size
        error = float(np.sqrt(square.mean()))
        spread = float(np.std(square, ddof=1)) / np.sqrt(len(square))
        return Candidate(
            structure=kind,
            parameters=len(kind.names) + len(kind.shapes),
            window_error=np.sqrt(square),
            error=error,
            standard_error=spread / (2.0 * max(error, 1e-300)),
            fitted_error=float(np.sqrt(self.fitted / size)),
        )

    def laws(self) -> tuple[WindowLaw, ...]:
        """Return the law without each window."""
        structure, known = self.equation.structure, self.equation.known
        to_offset, to_law = part_offset(self.equation)
        found = []
        for factors, shape in zip(self.factors, self.shapes, strict=True):
            beside = {"inertia": known.inertia or 0.0, "offset": known.offset or 0.0}
            beside |= dict(zip(self.equation.fixed_names, factors, strict=False))
            if to_offset is not None:
                beside["offset"] = to_offset @ factors
            values = (float(beside[name]) for name in ("inertia", "offset"))
            found.append(WindowLaw(structure, to_law @ factors, shape, *values))
        return tuple(found)


def _hold_out(
    equation: Equation,
    solution: Solution,
    weights: Weights,
    window: Int[np.ndarray, " s"],
) -> _HeldOut:
    """Solve a law without each window, by the sums of all rows less those of the window.

    The law is taken as linear in its shape about that of all rows.
    """
    own, target, shape = solution.columns, equation.target, solution.shape
    share, size = solution.share, len(solution.factors)
    rows = Rows(equation, share, shape)
    right = rows.root * np.column_stack([own, target])
    left = rows.seen(right[:, :-1])
    edges = np.searchsorted(window, np.arange(window[-1] + 2)).tolist()
    reach, spans = equation.lowpass.reach, list(itertools.pairwise(edges))
    # Rows beside a window share samples with it by the filter.
    near = [slice(max(a - reach, 0), b + reach) for a, b in spans]
    total = left.T @ right
    sums = np.stack([total - left[each].T @ right[each] for each in near] + [total])
    prior = np.pad(solution.prior, (0, len(shape)))
    every = ridged(sums[:, :, :-1] + prior, sums[:, :, -1])
    factors, shapes = every[:-1, :size], np.tile(shape, (len(spans), 1))
    error = np.empty(len(target))
    bounds = equation.structure.bounds(equation.speed_range)
    for number, (first, last) in enumerate(spans):
        span, step = slice(first, last), every[number, size:]
        error[span] = target[span] - own[span] @ every[number]
        if len(step):
            step = np.clip(step, -_LONGEST, _LONGEST)
            shapes[number] = np.clip(shape + step, *bounds)
        if np.abs(step).max(initial=0.0) > _NEAR:
            # Too far for tangents: factors anew at the shape they lead to.
            kept = share.copy()
            kept[near[number]] = 0.0
            design = equation.design(shapes[number])
            normal = Rows(equation, kept, shape).normal(design, target)
            factors[number] = ridged(normal[:, :-1], normal[:, -1])
            error[span] = target[span] - design[span] @ factors[number]
    # A wild row says nothing of the law: it counts no more than where the fit lets go.
    used, starts, most = equation.usable, edges[:-1], weights.limit**2
    square = used * np.minimum(error**2, most)
    residual = (target - own @ every[-1])[used]
    return _HeldOut(
        equation=equation,
        factors=factors,
        shapes=shapes,
        square=np.add.reduceat(square, starts) / np.add.reduceat(used * 1.0, starts),
        fitted=float(np.minimum(residual**2, most).mean()),
    )

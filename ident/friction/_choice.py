"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..core import FitError, one_blas_thread
from ._equation import Equation, Known
from ._inverse import METHOD, equation_of, fit_carried
from ._result import FrictionFit, assemble, part_offset
from ._samples import DriveSamples
from ._separable import (
    Solution,
    free_weights,
    prior_of,
    reweigh,
    solve,
    solve_normal,
)
from ._smoothing import choose_smoothness
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
_WILD = 4.0
"""Error in scales beyond which a row says nothing of the law."""
_SURE = 1e9
"""Condition of scaled normal equations up to which they are solved as they stand."""


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
    parts = _windows(equation, windows)
    kinds = tuple(structures or default_structures(equation))
    with one_blas_thread():
        share = free_weights(equation, loss)
        found: dict[AbstractStructure, _HeldOut] = {}
        fits: dict[AbstractStructure, FrictionFit] = {}
        spoken = []
        near: dict[tuple[str, ...], Float[np.ndarray, " h"]] = {}
        for kind in kinds:
            asked, solution = equation.with_structure(kind), None
            if kind.parametric:
                # Both directions apart have nearly the shape that they have together.
                asked, solution, missing = fit_carried(
                    asked, loss, begin=share, near=near.get(kind.shapes)
                )
                if len(solution.shape) == len(kind.shapes):
                    near[kind.shapes] = solution.shape
                fits[kind] = assemble(asked, solution, missing, METHOD)
            # Where the data do not carry a law, the simpler one speaks for it.
            spoken.append(asked.structure)
            if asked.structure not in found:
                found[asked.structure] = _held_out(asked, loss, share, parts, solution)
        size = float(np.mean(equation.load[equation.usable] ** 2))
        candidates = tuple(
            found[law].candidate(kind, size)
            for kind, law in zip(kinds, spoken, strict=True)
        )
        chosen, best = _order(candidates)
        if kinds[chosen] not in fits:
            asked = equation.with_structure(kinds[chosen])
            fits[kinds[chosen]] = assemble(
                *fit_carried(asked, loss, begin=share), METHOD
            )
    return Choice(
        fit=fits[kinds[chosen]],
        laws=tuple(fits[kind] for kind in kinds if kind.parametric),
        chosen=chosen,
        best=best,
        candidates=candidates,
        windows=windows,
        window=_window_of_samples(equation, parts.window),
        without=found[spoken[chosen]].laws(),
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


@dataclasses.dataclass(frozen=True)
class _Windows:
    """A recording cut into stretches.

    Attributes:
        window: Of each row.
        spans: First row of each window, and the one after its last.
        near: The same with the rows beside it that share samples with it by the filter.
    """

    window: Int[np.ndarray, " s"]
    spans: list[slice]
    near: list[slice]


def _windows(equation: Equation, windows: int) -> _Windows:
    """Return stretches with equal shares of the motion: an axis may rest for half of the time.

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
    window = np.minimum((share * windows).astype(np.int64), windows - 1)
    edges = np.searchsorted(window, np.arange(windows + 1)).tolist()
    reach = equation.lowpass.reach
    spans = list(itertools.pairwise(edges))
    return _Windows(
        window=window,
        spans=[slice(*span) for span in spans],
        near=[slice(max(a - reach, 0), b + reach) for a, b in spans],
    )


def _window_of_samples(
    equation: Equation, window: Int[np.ndarray, " s"]
) -> Int[np.ndarray, " t"]:
    """Return the window of each sample: that of the nearest row."""
    centres = equation.lowpass.centres
    samples = np.arange(len(equation.samples.time))
    return np.asarray(
        window[np.searchsorted(0.5 * (centres[1:] + centres[:-1]), samples)]
    )


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


def _held_out(
    equation: Equation,
    loss: str,
    share: Float[np.ndarray, " s"],
    parts: _Windows,
    solution: Solution | None,
) -> _HeldOut:
    """Solve a law without each window, by the sums of all rows less those of the window.

    Args:
        equation: Of the law.
        loss: Name of the loss.
        share: Weight of each row.
        parts: The windows.
        solution: Fitted to all rows, which a law with a shape needs.
    """
    shape = np.zeros(0) if solution is None else solution.shape
    around = np.zeros(0) if solution is None else solution.factors
    own = _columns(equation, shape, around, False)
    twin = own
    if equation.has_instrument:
        twin = _columns(equation, shape, around, True)
    right = np.column_stack([own, equation.target])

    def sums(left: np.ndarray) -> np.ndarray:
        weighted = share[:, None] * left
        found = [weighted[near].T @ right[near] for near in parts.near]
        total = weighted.T @ right
        return np.stack([total - each for each in found] + [total])

    normal = sums(own)
    mixed = sums(twin) if equation.has_instrument else normal
    size = own.shape[1] - len(shape)
    prior = np.zeros((own.shape[1], own.shape[1]))
    if equation.penalty is not None:
        prior = prior_of(equation, choose_smoothness(equation, share, normal[-1]))
    every = _solve_each(normal[:, :, :-1] + prior, mixed, prior)
    factors = every[:, :size]
    shapes = np.broadcast_to(shape, (len(factors), len(shape))).copy()
    steps = np.clip(every[:, size:], -_LONGEST, _LONGEST)
    residual = equation.target - own @ every[-1]
    _, found = reweigh(equation, residual, loss)
    error = np.empty(len(residual))
    low, high = equation.structure.bounds(equation.speed_range)
    for number, span in enumerate(parts.spans):
        error[span] = equation.target[span] - own[span] @ every[number]
        shapes[number] = np.clip(shape + steps[number], low, high)
        if np.abs(every[number, size:]).max(initial=0.0) > _NEAR:
            # Too far for tangents: factors anew at the shape they lead to.
            kept = share.copy()
            kept[parts.near[number]] = 0.0
            factors[number] = solve(equation, kept, shapes[number]).factors
            design = equation.design(shapes[number])[span]
            error[span] = equation.target[span] - design @ factors[number]
    # A wild row says nothing of the law: it counts no more than where the fit lets go.
    limit = np.inf if loss == "gauss" else (_WILD * found.scale) ** 2
    used = equation.usable
    square = used * np.minimum(error**2, limit)
    starts = [span.start for span in parts.spans]
    return _HeldOut(
        equation=equation,
        factors=factors[:-1],
        shapes=shapes[:-1],
        square=np.add.reduceat(square, starts)
        / np.add.reduceat(used.astype(float), starts),
        fitted=float(np.minimum(residual[used] ** 2, limit).mean()),
    )


def _columns(
    equation: Equation,
    shape: Float[np.ndarray, " h"],
    factors: Float[np.ndarray, " k"],
    instrument: bool,
) -> Float[np.ndarray, "s p"]:
    """Return design and tangents, zero in rows that are not used."""
    design = equation.design(shape, instrument=instrument)
    if not len(shape):
        return design
    tangents = equation.tangents(shape, factors, instrument=instrument)
    return np.concatenate([design, tangents], axis=1)


def _solve_each(
    gram: Float[np.ndarray, "w p p"],
    mixed: Float[np.ndarray, "w p p1"],
    prior: Float[np.ndarray, "p p"],
) -> Float[np.ndarray, "w p"]:
    """Return what `solve_normal` does for several windows; mostly at once."""
    size = np.sqrt(np.einsum("wpp->wp", gram))
    size = np.where(size > 0, size, 1.0)
    matrix = (mixed[:, :, :-1] + prior) / (size[:, :, None] * size[:, None, :])
    moment = mixed[:, :, -1] / size
    found = np.empty(size.shape)
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        sure = np.zeros(len(matrix), bool)
    else:
        norms = (np.abs(each).sum(axis=1).max(axis=1) for each in (matrix, inverse))
        sure = np.prod(list(norms), axis=0) < _SURE
        found = (inverse @ moment[..., None])[..., 0] / size
    for number in np.flatnonzero(~sure):
        own = mixed[number, :, :-1] + prior
        found[number] = solve_normal(gram[number], mixed[number, :, -1], own).factors
    return found

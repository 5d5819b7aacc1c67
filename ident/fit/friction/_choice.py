"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._threads import one_blas_thread
from ._assemble import assemble
from ._inverse import METHOD
from ._lanes import lanes_of
from ._leftout import LeftOut, left_out
from ._lowpass import default_factor
from ._problem import Known, Problem, make_problem
from ._result import FrictionFit
from ._samples import DriveSamples, check_samples
from ._solve import solve_problem
from ._structure import AbstractStructure
from ._structures import CoulombViscous, Stribeck
from ._tables import KnotTable, default_knots

WINDOWS = 10
KNOTS = (3, 5, 8, 12, 20)
_WILD = 4.0
"""Error in scales beyond which a sample says nothing of the law."""


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
        fitted_error: The same on the samples fitted, for the distance between both.
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
class Choice:
    """The law chosen, and all that competed.

    Attributes:
        fit: The chosen law, fitted to the whole recording.
        laws: Those with parameters in words among the candidates, likewise.
        left_out: The windows that were held out.
        chosen: Its place among the candidates.
        best: Place of the smallest error held out.
        candidates: From simple to rich.
        knot_curve: Number of knots → error held out, for the free tables alike in both
            directions.
        sentence: What was chosen and why, in words.
    """

    fit: FrictionFit
    laws: tuple[FrictionFit, ...]
    left_out: LeftOut
    chosen: int
    best: int
    candidates: tuple[Candidate, ...]
    knot_curve: tuple[tuple[int, float, float], ...]
    sentence: str


def default_structures(
    samples: DriveSamples, knots: Sequence[int] = KNOTS
) -> tuple[AbstractStructure, ...]:
    """Return the kinds of law to compare: simple, per direction, Stribeck, tables."""
    speed = np.abs(samples.velocity[samples.in_motion])
    tables = [
        KnotTable(way, found)
        for way in (False, True)
        for count in knots
        if len(found := tuple(sorted(set(default_knots(speed, count))))) == count
    ]
    ways = (False, True)
    laws = [CoulombViscous(way) for way in ways] + [Stribeck(way) for way in ways]
    return (*laws, *tables)


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

    The recording is cut into stretches of time; each is predicted by the law fitted to the
    others. Errors are those of the filtered force; wild samples are counted only as far as
    they would count in the fit. Paired: a law is as good as the best where its windows are
    not worse by more than one standard error of the difference.

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
    check_samples(samples)
    known = Known() if known is None else known
    factor = default_factor(samples.cycle) if decimate is None else decimate
    kinds = default_structures(samples) if structures is None else tuple(structures)
    whole = make_problem(samples, kinds[0], known, factor)
    parts = left_out(whole, loss, windows)
    with one_blas_thread():
        return _chosen(parts, kinds, windows)


def _chosen(parts: LeftOut, kinds: Sequence[AbstractStructure], windows: int) -> Choice:
    load = parts.problem.load[parts.problem.usable]
    size = float(np.sqrt(np.mean(load**2)))
    candidates = tuple(_candidate(kind, parts, size) for kind in kinds)
    order = sorted(range(len(kinds)), key=lambda place: candidates[place].parameters)
    best = int(np.argmin([each.error for each in candidates]))
    chosen = next(
        place for place in order if _as_good(candidates[place], candidates[best])
    )
    return Choice(
        fit=_whole(parts, kinds[chosen]),
        laws=tuple(_whole(parts, kind) for kind in kinds if kind.in_words),
        left_out=parts,
        chosen=chosen,
        best=best,
        candidates=candidates,
        knot_curve=tuple(
            (len(kind.knots), each.error, each.standard_error)
            for kind, each in zip(kinds, candidates, strict=True)
            if isinstance(kind, KnotTable) and not kind.directional
        ),
        sentence=_sentence(candidates, chosen, best, windows),
    )


def _as_good(one: Candidate, best: Candidate) -> bool:
    worse = one.window_error**2 - best.window_error**2
    spread = float(np.std(worse, ddof=1)) / np.sqrt(len(worse))
    return bool(worse.mean() <= spread)


def _whole(parts: LeftOut, structure: AbstractStructure) -> FrictionFit:
    if structure.in_words:
        return assemble(parts.fits(structure)[-1], METHOD)
    problem = parts.problem.with_structure(structure)
    (solved,) = solve_problem(problem, parts.loss, lanes_of(problem.usable))
    return assemble(solved, METHOD)


def _candidate(structure: AbstractStructure, parts: LeftOut, size: float) -> Candidate:
    fits = [each.solution for each in parts.fits(structure)[:-1]]
    square = np.square(np.stack([each.residual for each in fits]))
    if parts.loss != "gauss":
        # A wild sample says nothing of the law: no more than where the fit lets go.
        limit = _WILD * np.array([each.loss.scale for each in fits])
        square = np.minimum(square, np.square(limit)[:, None])
    window_error = np.sqrt(np.einsum("ws,ws->w", square, parts.out)) / size
    own = parts.lanes.use[:-1]
    fitted = np.einsum("ws,ws->w", square, own) / parts.lanes.count[:-1] / size**2
    error = float(np.sqrt(np.mean(window_error**2)))
    spread = float(np.std(window_error**2, ddof=1)) / np.sqrt(len(window_error))
    names = structure.names + structure.shapes
    return Candidate(
        structure,
        len(names),
        window_error,
        error,
        spread / (2.0 * max(error, 1e-300)),
        float(np.sqrt(np.mean(fitted))),
    )


def _row_error(
    factors: Float[np.ndarray, " k"], shape: Float[np.ndarray, " h"], problem: Problem
) -> Float[np.ndarray, " s"]:
    error = problem.target - problem.design(shape) @ factors
    return np.asarray(error[problem.usable])


def force_error(fit: FrictionFit, samples: DriveSamples) -> Float[np.ndarray, " s"]:
    """Return load − prediction for another recording, filtered alike, in load units.

    Args:
        fit: The law, with inertia and offset.
        samples: A recording, the one fitted or another; its samples in motion count.
    """
    check_samples(samples)
    problem = make_problem(samples, fit.structure, fit.known, fit.decimate)
    return _row_error(fit.state, fit.shape, problem)


def _sentence(
    candidates: tuple[Candidate, ...], chosen: int, best: int, windows: int
) -> str:
    one, other = candidates[chosen], candidates[best]
    low, high = one.spread
    text = (
        f"{one.structure.words}: force error {100 * one.error:.2f} % on {windows} windows "
        f"held out in turn ({100 * low:.2f} to {100 * high:.2f} %)"
    )
    if chosen == best:
        return f"{text}, the smallest of all."
    return (
        f"{text}; {other.structure.words} has {100 * other.error:.2f} %, which is not "
        "better by more than one standard error."
    )

"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from .._errors import FitError
from ._inverse import fit_problem, solve_problem
from ._lowpass import default_factor
from ._problem import Known, Problem, make_problem
from ._result import FrictionFit
from ._samples import DriveSamples, check_samples
from ._structure import AbstractStructure
from ._structures import CoulombViscous, Stribeck
from ._tables import KnotTable, default_knots

WINDOWS = 10
KNOTS = (3, 5, 8, 12, 20)
_FEWEST = 30
"""Samples in motion, after filtering, that a window needs."""


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
        chosen: Its place among the candidates.
        best: Place of the smallest error held out.
        candidates: From simple to rich.
        knot_curve: Number of knots → error held out, for the free tables alike in both
            directions.
        sentence: What was chosen and why, in words.
    """

    fit: FrictionFit
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
    moving = int(whole.usable.sum())
    if windows < 3 or moving < windows * _FEWEST:
        msg = (
            f"model choice: found {moving} samples in motion after filtering for {windows} "
            f"windows, expected at least 3 windows of {_FEWEST}."
        )
        raise FitError(msg)
    # Equal shares of the motion, not of the time: an axis may rest for half of it.
    share = np.cumsum(whole.usable) / moving
    window = np.minimum((share * windows).astype(int), windows - 1)
    size = float(np.sqrt(np.mean(whole.load[whole.usable] ** 2)))
    candidates = tuple(
        _candidate(whole.with_structure(kind), loss, window, size) for kind in kinds
    )
    order = sorted(range(len(kinds)), key=lambda place: candidates[place].parameters)
    best = int(np.argmin([each.error for each in candidates]))
    chosen = next(
        place for place in order if _as_good(candidates[place], candidates[best])
    )
    problem = whole.with_structure(kinds[chosen])
    return Choice(
        fit=fit_problem(problem, loss, None, "inverse dynamic fit"),
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


def _candidate(
    problem: Problem, loss: str, window: Int[np.ndarray, " s"], size: float
) -> Candidate:
    structure = problem.structure
    problem.design(structure.starts(problem.speed)[0])
    errors, fitted = [], []
    reach = len(problem.lowpass.kernel) // (2 * problem.lowpass.factor)
    for number in range(int(window.max()) + 1):
        out = window == number
        # Rows near the window share samples with it through the filter.
        near = np.convolve(out, np.ones(2 * reach + 1), mode="same") > 0.5
        used, fit = solve_problem(problem.restricted(~near), loss)
        other = problem.restricted(out)
        if used.structure != structure:
            other = other.with_structure(used.structure)
        residual = _row_error(fit.factors, fit.shape, other)
        # A wild sample says nothing of the law: no more than where the fit lets go.
        limit = 4.0 * fit.loss.scale if loss != "gauss" else np.inf
        errors.append(np.sqrt(np.mean(np.clip(residual, -limit, limit) ** 2)) / size)
        own = np.clip(fit.residual[used.usable], -limit, limit)
        fitted.append(np.mean(own**2) / size**2)
    window_error = np.asarray(errors)
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

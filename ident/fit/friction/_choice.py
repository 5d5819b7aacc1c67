"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ...core._threads import one_blas_thread
from .._gather import in_group
from ._assemble import assemble
from ._compete import Candidate, Competition, compete, fit_all
from ._inverse import METHOD
from ._leftout import LeftOut, left_out
from ._lowpass import default_factor
from ._problem import Known, Problem, make_problem
from ._result import FrictionFit
from ._samples import DriveSamples, check_samples
from ._solve import Solved
from ._stack import alike
from ._structure import AbstractStructure
from ._structures import CoulombViscous, Stribeck
from ._tables import KnotTable, Spread, spread_of

WINDOWS = 10
KNOTS = (3, 5, 8, 12, 20)


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
    return _structures(spread_of(np.abs(samples.velocity[samples.in_motion])), knots)


def _structures(
    spread: Spread, knots: Sequence[int] = KNOTS
) -> tuple[AbstractStructure, ...]:
    """Return what `default_structures` does, given how speeds in motion are spread."""
    places = [tuple(sorted(set(spread.knots(count)))) for count in knots]
    tables = [
        KnotTable(way, found)
        for way in (False, True)
        for count, found in zip(knots, places, strict=True)
        if len(found) == count
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

    The recording is cut into stretches of time; each is predicted by the law solved on the
    others, wild samples and smoothness as all samples tell them. Errors are those of the
    filtered force; wild samples are counted only as far as they would count in the fit.
    Paired: a law is as good as the best where its windows are not worse by more than one
    standard error of the difference.

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
    first = structures[0] if structures else CoulombViscous()
    whole = make_problem(samples, first, known, factor)
    kinds = _structures(whole.spread) if structures is None else tuple(structures)
    parts = left_out(whole, loss, windows)
    (choice,) = in_group(_choose_all, [Competition(parts, kinds)])
    return choice


def _choose_all(asked: Sequence[Competition]) -> list[Choice]:
    """Choose for each recording, those of equal shape side by side."""
    found: dict[int, Choice] = {}
    for places in alike(
        [(each.parts.problem, each.kinds, each.parts.loss) for each in asked]
    ):
        group = [asked[k] for k in places]
        with one_blas_thread():
            choices = _choose(group)
        found |= dict(zip(places, choices, strict=True))
    return [found[k] for k in range(len(asked))]


def _choose(asked: Sequence[Competition]) -> list[Choice]:
    fits, races = compete(asked)
    orders = [_order(each.kinds, race) for each, race in zip(asked, races, strict=True)]
    wanted = [
        each.kinds[chosen] for each, (chosen, _) in zip(asked, orders, strict=True)
    ]
    fit_all(asked, wanted, fits)
    return [_choice(*each) for each in zip(asked, races, orders, fits, strict=True)]


def _order(
    kinds: Sequence[AbstractStructure], race: Sequence[Candidate]
) -> tuple[int, int]:
    """Return which is the simplest that is as good as the best, and which is that."""
    order = sorted(range(len(race)), key=lambda place: race[place].parameters)
    best = int(np.argmin([each.error for each in race]))
    return next(place for place in order if _as_good(race[place], race[best])), best


def _choice(
    asked: Competition,
    candidates: tuple[Candidate, ...],
    order: tuple[int, int],
    fits: Mapping[AbstractStructure, Solved],
) -> Choice:
    chosen, best = order
    kinds = asked.kinds
    named = {kind: assemble(each, METHOD) for kind, each in fits.items()}
    return Choice(
        fit=named[kinds[chosen]],
        laws=tuple(named[kind] for kind in kinds if kind.in_words),
        left_out=asked.parts,
        chosen=chosen,
        best=best,
        candidates=candidates,
        knot_curve=tuple(
            (len(kind.knots), each.error, each.standard_error)
            for kind, each in zip(kinds, candidates, strict=True)
            if isinstance(kind, KnotTable) and not kind.directional
        ),
        sentence=_sentence(candidates, chosen, best, asked.parts.count),
    )


def _as_good(one: Candidate, best: Candidate) -> bool:
    worse = one.window_error**2 - best.window_error**2
    spread = float(np.std(worse, ddof=1)) / np.sqrt(len(worse))
    return bool(worse.mean() <= spread)


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

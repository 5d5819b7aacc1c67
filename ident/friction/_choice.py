"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

from ..core import FitError, one_blas_thread
from ._equation import Equation, Known, equation_of, ridged, weigh
from ._inverse import (
    METHOD,
    FrictionFit,
    assemble,
    fit_competing,
)
from ._samples import DriveSamples
from ._separable import Solution, View
from ._structures import (
    KNOTS,
    AbstractStructure,
    CoulombViscous,
    KnotTable,
    Laws,
    Stribeck,
    default_knots,
)

WINDOWS = 10
_FEWEST = 30
"""Rows in motion that a window needs."""
_UNLIKELY = 0.02
"""Share of the best law's likelihood below which another law casts no doubt on it."""
_NEAR, _LONGEST = 0.1, 0.5
"""Steps of a shape's logarithm: up to which a law is linear in it, and the longest taken."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One kind of law and how it predicts what it has not seen.

    Attributes:
        structure: Kind of law.
        window_error: RMS of the force error per window held out, relative to the load's RMS
            over the whole recording.
        error: Root of their mean square.
        standard_error: Of the mean square over the windows, in terms of ``error``.
        fitted_error: As ``error``, on the rows fitted.
        law: What it is by all rows; a simpler law stands there where they do not carry it.
        without: What it is without each window.
    """

    structure: AbstractStructure
    window_error: Float[np.ndarray, " w"]
    error: float
    standard_error: float
    fitted_error: float
    law: Laws
    without: Laws

    @property
    def parameters(self) -> int:
        """How many numbers it has, inertia and offset left out."""
        return len(self.structure.names) + len(self.structure.shapes)

    @property
    def spread(self) -> tuple[float, float]:
        """Least and largest error over the windows."""
        return float(np.min(self.window_error)), float(np.max(self.window_error))

    def worse(self, other: "Candidate") -> float:
        """Return how much it predicts worse, in standard errors of the paired difference."""
        off = self.window_error**2 - other.window_error**2
        return float(off.mean() / max(_mean_error(off), 1e-300))


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
    """

    fit: FrictionFit
    laws: tuple[FrictionFit, ...]
    chosen: int
    best: int
    candidates: tuple[Candidate, ...]
    windows: int
    window: Int[np.ndarray, " t"]

    @property
    def law(self) -> FrictionFit:
        """The simplest of the parametric laws that predicts as well as the best of them."""
        own = [each for each in self.candidates if each.structure.parametric]
        best = min(own, key=lambda each: each.error)
        limit = best.error + best.standard_error
        good = [place for place, each in enumerate(own) if each.error <= limit]
        return self.laws[min(good, key=lambda place: own[place].parameters)]

    @property
    def without(self) -> Laws:
        """The chosen law fitted without each window."""
        return self.candidates[self.chosen].without

    def deviation(
        self,
        fit: FrictionFit,
        without: Laws,
        velocity: Float[np.ndarray, " v"],
        read: Callable[[Float[np.ndarray, "v *n"]], Float[np.ndarray, "*c"]],
    ) -> Float[np.ndarray, "*c"]:
        """Return the standard deviation of what is read from a law, with the doubt of the law.

        A law is doubtful by the noise of its rows (`score_covariance`) or by how it changes
        without each window (jackknife, B. Efron, C. Stein, Ann. Statist. 9(3), 1981),
        whichever is more, by the straight lines of a table, and by the other laws: the
        mean over them counts each as likely as its windows held out are no worse than those
        of the best, by Student's distribution for so few windows.

        Args:
            fit: The law, fitted to the whole recording.
            without: The same without each window.
            velocity: In mm/s.
            read: Linear map of friction at these velocities, along the first axis, to the
                values in question; further axes are kept.
        """
        own, covariance = read(fit.band(velocity)[0]), fit.law_covariance
        slopes = read(fit.slopes(velocity))
        noise = ((slopes @ covariance) * slopes).sum(axis=-1)

        def jackknife(laws: Laws) -> Float[np.ndarray, "*c"]:
            values = read(laws.friction(velocity))
            count = values.shape[-1]
            # Mean square of Student's t: few windows tell their own spread badly.
            heavier = (count - 1) / max(count - 3, 1)
            return np.asarray(heavier * (count - 1) * np.var(values, axis=-1))

        def lines(structure: AbstractStructure, factors: np.ndarray) -> np.ndarray:
            return np.asarray(np.square(read(structure.bent(velocity, factors))))

        total, best = 1.0, self.candidates[self.best]
        variance = np.maximum(noise, jackknife(without))
        variance += lines(fit.structure, fit.factors)
        seen = {fit.structure}
        for one in self.candidates:
            law, count = one.law, len(one.window_error)
            if law.structure in seen:
                continue
            seen.add(law.structure)
            share = (1 + max(one.worse(best), 0) ** 2 / (count - 1)) ** (-count / 2)
            if share < _UNLIKELY:
                continue
            apart = read(law.friction(velocity)[:, 0]) - own
            more = jackknife(one.without) + lines(law.structure, law.factors[0])
            variance, total = variance + share * (more + apart**2), total + share
        return np.asarray(np.sqrt(variance / total))


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
        found: dict[AbstractStructure, Candidate] = {}
        solved = list[tuple[Equation, Solution, dict[str, str]]]()
        near, candidates = None, list[Candidate]()
        for kind in kinds:
            asked, solution, missing = fit_competing(
                equation.with_structure(kind), weights, near
            )
            solved.append((asked, solution, missing))
            # Both directions apart have nearly the shape that they have together.
            near = solution.shape if len(solution.shape) else None
            # Where the data do not carry a law, the simpler one speaks for it.
            law = asked.structure
            if law not in found:
                found[law] = _hold_out(asked, solution, weights.limit, window)
            own = kind if missing else law
            candidates.append(dataclasses.replace(found[law], structure=own))
        chosen, best = _order(candidates)
        fits = {
            place: assemble(*solved[place], METHOD)
            for place, kind in enumerate(kinds)
            if kind.parametric or place == chosen
        }
    # Each sample belongs to the window of the nearest row.
    centres = equation.lowpass.centres
    between = 0.5 * (centres[1:] + centres[:-1])
    return Choice(
        fit=fits[chosen],
        laws=tuple(fits[place] for place, each in enumerate(kinds) if each.parametric),
        chosen=chosen,
        best=best,
        candidates=tuple(candidates),
        windows=windows,
        window=window[np.searchsorted(between, np.arange(len(samples.time)))],
    )


def default_structures(equation: Equation) -> tuple[AbstractStructure, ...]:
    """Return the kinds of law to compare: simple, Stribeck, table, alike and per direction."""
    knots, ways = default_knots(equation.speed, KNOTS), (False, True)
    laws: list[AbstractStructure] = [CoulombViscous(way) for way in ways]
    laws += [Stribeck(way) for way in ways]
    if len(knots) > 2:
        laws += [KnotTable(way, knots) for way in ways]
    return tuple(laws)


def _mean_error(values: Float[np.ndarray, " w"]) -> float:
    """Return the standard error of a mean."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))


def _order(candidates: Sequence[Candidate]) -> tuple[int, int]:
    """Return the simplest that is as good as the best, and the best."""
    best = int(np.argmin([each.error for each in candidates]))
    worse = [each.worse(candidates[best]) for each in candidates]
    good = [place for place, each in enumerate(worse) if each <= 1.0]
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


def _laws(
    equation: Equation,
    factors: Float[np.ndarray, "n k"],
    shapes: Float[np.ndarray, "n h"],
) -> Laws:
    """Return the laws that linear factors of an equation and shapes stand for."""
    names, linear, to_law = equation.reading
    read = dict(zip(names, linear @ factors.T, strict=True))
    beside = [
        np.broadcast_to(read.get(name, known or 0.0), len(factors))
        for name, known in (
            ("inertia", equation.known.inertia),
            ("offset", equation.known.offset),
        )
    ]
    return Laws(equation.structure, factors @ to_law.T, shapes, *beside)


def _hold_out(
    equation: Equation,
    solution: Solution,
    limit: float,
    window: Int[np.ndarray, " s"],
) -> Candidate:
    """Return how a law predicts, and what it is without each window.

    Solved by the sums of all rows less those of the window.

    Args:
        equation: Of the law.
        solution: By all rows; the law is taken as linear in its shape about it.
        limit: Largest error that counts: a wild row says nothing of the law.
        window: Of each row.
    """
    own, target, shape = solution.columns, equation.target, solution.shape
    size, rows, used = len(solution.factors), solution.rows, equation.usable
    edges = np.searchsorted(window, np.arange(window[-1] + 2)).tolist()
    reach, spans = equation.lowpass.reach, list(itertools.pairwise(edges))
    # Rows beside a window share samples with it by the filter.
    near = [slice(max(a - reach, 0), b + reach) for a, b in spans]
    sums = rows.sums - np.stack([rows.left[k].T @ rows.right[k] for k in near])
    prior = np.pad(solution.prior, (0, len(shape)))
    every = ridged(sums[:, :, :-1] + prior, sums[:, :, -1])
    factors, steps = every[:, :size], every[:, size:]
    bounds = equation.structure.bounds(equation.speed_range)
    shapes = np.clip(shape + np.clip(steps, -_LONGEST, _LONGEST), *bounds)
    parts = [own[slice(*k)] @ each for k, each in zip(spans, every, strict=True)]
    error = target - np.concatenate(parts)
    for number in np.flatnonzero(np.abs(steps).max(axis=1, initial=0.0) > _NEAR):
        # Too far for tangents: factors anew at the shape they lead to.
        kept, held = solution.share.copy(), window == number
        kept[near[number]] = 0.0
        design = equation.columns(shapes[number])[0]
        normal = View(equation, kept, shape).rows(design, target).sums
        factors[number] = ridged(normal[:, :-1], normal[:, -1])
        error[held] = target[held] - design[held] @ factors[number]
    load = float(np.mean(equation.load[used] ** 2))
    square = used * np.minimum(error**2, limit**2)
    square = np.add.reduceat(square, edges[:-1])
    square = square / np.add.reduceat(used * load, edges[:-1])
    mean = float(square.mean())
    laws = _laws(
        equation,
        np.vstack([solution.factors, factors]),
        np.vstack([shape, shapes]),
    )
    fitted = float(np.minimum(solution.residual[used] ** 2, limit**2).mean() / load)
    return Candidate(
        structure=equation.structure,
        window_error=np.sqrt(square),
        error=float(np.sqrt(mean)),
        standard_error=_mean_error(square) / float(np.sqrt(4.0 * max(mean, 1e-300))),
        fitted_error=float(np.sqrt(fitted)),
        law=laws[:1],
        without=laws[1:],
    )

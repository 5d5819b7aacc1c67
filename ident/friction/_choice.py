"""Which law to believe: the simplest that predicts windows held out as well as the best does."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ..core import FitError, one_blas_thread
from ._equation import Known, Recording, record, ridged, weigh
from ._inverse import fit_competing
from ._result import FrictionFit
from ._samples import DriveSamples
from ._separable import View
from ._structures import (
    AbstractStructure,
    CoulombViscous,
    KnotTable,
    Laws,
    Stribeck,
)

WINDOWS = 10
_FEWEST = 30
"""Rows in motion that a window needs."""
_UNLIKELY = 0.02
"""Share of the best law's likelihood below which another law casts no doubt on it."""
_NEAR, _LONGEST = 0.1, 0.5
"""Steps of a shape's logarithm: up to which a law is linear in it, and the longest taken."""


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """One kind of law and how it predicts what it has not seen.

    Attributes:
        structure: Kind of law.
        fit: What it is by all rows; a simpler law stands there where they do not carry it.
        without: What it is without each window.
        window_error: RMS of the force error per window held out, relative to the load's RMS
            over the whole recording.
        fitted_error: As ``error``, on the rows fitted.
    """

    structure: AbstractStructure
    fit: FrictionFit
    without: Laws
    window_error: Float[np.ndarray, " w"]
    fitted_error: float

    @cached_property
    def error(self) -> float:
        """Root of the mean square of the error over the windows."""
        return float(np.sqrt(np.mean(self.window_error**2)))

    @property
    def standard_error(self) -> float:
        """Of that mean square, in terms of ``error``."""
        return _mean_error(self.window_error**2) / (2.0 * max(self.error, 1e-300))

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


@dataclasses.dataclass(frozen=True, eq=False)
class Choice:
    """The law chosen, and all that competed.

    Attributes:
        chosen: Place of the chosen law among the candidates.
        best: Place of the smallest error held out.
        candidates: From simple to rich.
        windows: How many windows were held out.
        window: Of each sample of the recording.
    """

    chosen: int
    best: int
    candidates: tuple[Candidate, ...]
    windows: int
    window: Int[np.ndarray, " t"]

    @property
    def fit(self) -> FrictionFit:
        """The chosen law, fitted to the whole recording."""
        return self.candidates[self.chosen].fit

    @property
    def _parametric(self) -> list[Candidate]:
        return [each for each in self.candidates if each.structure.parametric]

    @property
    def laws(self) -> tuple[FrictionFit, ...]:
        """The parametric laws among the candidates, fitted likewise."""
        return tuple(each.fit for each in self._parametric)

    @property
    def law(self) -> FrictionFit:
        """The simplest of the parametric laws that predicts as well as the best of them."""
        best = min(self._parametric, key=lambda each: each.error)
        limit = best.error + best.standard_error
        good = [each for each in self._parametric if each.error <= limit]
        return min(good, key=lambda each: each.parameters).fit

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

        def jackknife(laws: Laws) -> np.ndarray:
            values = read(laws.friction(velocity))
            count = values.shape[-1]
            # Mean square of Student's t: few windows tell their own spread badly.
            heavier = (count - 1) / max(count - 3, 1)
            return np.asarray(heavier * (count - 1) * np.var(values, axis=-1))

        def lines(fit: FrictionFit) -> np.ndarray:
            return np.asarray(
                np.square(read(fit.structure.bent(velocity, fit.factors)))
            )

        slopes = read(fit.slopes(velocity))
        own = slopes[..., : len(fit.factors)] @ fit.factors
        noise = ((slopes @ fit.law_covariance) * slopes).sum(axis=-1)
        variance = np.maximum(noise, jackknife(without)) + lines(fit)
        total, best, seen = 1.0, self.candidates[self.best], {fit.structure}
        for one in self.candidates:
            law, count = one.fit, len(one.window_error)
            share = (1 + max(one.worse(best), 0) ** 2 / (count - 1)) ** (-count / 2)
            if law.structure in seen or share < _UNLIKELY:
                continue
            seen.add(law.structure)
            apart = read(law.friction(velocity)) - own
            more = jackknife(one.without) + lines(law)
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
    recording = record(samples, known, decimate)
    window = _windows(recording, windows)
    kinds = tuple(structures or default_structures(recording))
    with one_blas_thread():
        weights = weigh(recording, loss)
        found: dict[AbstractStructure, Candidate] = {}
        near, candidates = None, list[Candidate]()
        for kind in kinds:
            fit = fit_competing(weights.free.under(kind), weights, near)
            # Both directions apart have nearly the shape that they have together.
            near = fit.shape if len(fit.shape) else None
            # Where the data do not carry a law, the simpler one speaks for it.
            law = fit.structure
            if law not in found:
                found[law] = _hold_out(fit, weights.limit, window)
            own = kind if fit.missing else law
            candidates.append(dataclasses.replace(found[law], structure=own, fit=fit))
    # Each sample belongs to the window of the nearest row.
    centres = recording.lowpass.centres
    between = 0.5 * (centres[1:] + centres[:-1])
    chosen, best = _order(candidates)
    return Choice(
        chosen=chosen,
        best=best,
        candidates=tuple(candidates),
        windows=windows,
        window=window[np.searchsorted(between, np.arange(len(samples.time)))],
    )


def default_structures(recording: Recording) -> tuple[AbstractStructure, ...]:
    """Return the kinds of law to compare: simple, Stribeck, table, alike and per direction."""
    knots, ways = recording.knots, (False, True)
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


def _windows(recording: Recording, windows: int) -> Int[np.ndarray, " s"]:
    """Return the window of each row: an axis may rest for half of the time.

    Raises:
        FitError: If the recording is too short for so many windows.
    """
    moving = int(recording.usable.sum())
    if windows < 3 or moving < windows * _FEWEST:
        msg = (
            f"model choice: found {moving} samples in motion after filtering for {windows} "
            f"windows, expected at least 3 windows of {_FEWEST}."
        )
        raise FitError(msg)
    share = np.cumsum(recording.usable) / moving
    return np.minimum((share * windows).astype(np.int64), windows - 1)


def _hold_out(
    fit: FrictionFit, limit: float, window: Int[np.ndarray, " s"]
) -> Candidate:
    """Return how a law predicts, and what it is without each window.

    Solved by the sums of all rows less those of the window.

    Args:
        fit: By all rows; the law is taken as linear in its shape about it.
        limit: Largest error that counts: a wild row says nothing of the law.
        window: Of each row.
    """
    equation, shape, size = fit.equation, fit.shape, len(fit.state)
    recording, rows = equation.recording, fit.rows
    edges = np.searchsorted(window, np.arange(window[-1] + 2)).tolist()
    reach, spans = recording.lowpass.reach, list(itertools.pairwise(edges))
    # Rows beside a window share samples with it by the filter.
    near = [slice(max(a - reach, 0), b + reach) for a, b in spans]
    sums = rows.sums - np.stack([rows.left[k].T @ rows.right[k] for k in near])
    prior = np.pad(fit.prior, (0, len(shape)))
    every = ridged(sums[:, :, :-1] + prior, sums[:, :, -1])
    factors, steps = every[:, :size], every[:, size:]
    shapes = np.clip(shape + np.clip(steps, -_LONGEST, _LONGEST), *equation.bounds)
    lines = np.column_stack([-every, np.ones(len(every))])
    parts = [rows.right[slice(*k)] @ each for k, each in zip(spans, lines, strict=True)]
    error = np.concatenate(parts)
    for number in np.flatnonzero(np.abs(steps).max(axis=1, initial=0.0) > _NEAR):
        # Too far for tangents: factors anew at the shape they lead to.
        kept, held = fit.share.copy(), window == number
        kept[near[number]] = 0.0
        moved = equation.rows(shapes[number])
        normal = View(equation, kept, shape).rows(moved).sums
        factors[number] = ridged(normal[:size, :size], normal[:size, -1])
        error[held] = moved[held, -1] - moved[held, :size] @ factors[number]

    def squared(error: np.ndarray) -> np.ndarray:
        return np.asarray(recording.usable * np.minimum(error**2, limit**2))

    square = np.add.reduceat(squared(error), edges[:-1])
    count = np.add.reduceat(recording.usable * 1.0, edges[:-1])
    load = recording.load_size
    fitted = squared(fit.error).sum() / count.sum()
    names, linear, to_law = equation.reading
    read = dict(zip(names, linear @ factors.T, strict=True))
    given = {"inertia": fit.known.inertia, "offset": fit.known.offset}
    none = np.zeros(len(factors))
    beside = [read.get(name, none + (known or 0.0)) for name, known in given.items()]
    return Candidate(
        structure=equation.structure,
        fit=fit,
        without=Laws(equation.structure, factors @ to_law.T, shapes, *beside),
        window_error=np.sqrt(square / count) / load,
        fitted_error=float(np.sqrt(fitted)) / load,
    )

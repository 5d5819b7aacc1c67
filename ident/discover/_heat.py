"""Which sensor, with which lag, an error follows, and whether a drift could be it instead."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from ._evidence import (
    Sums,
    design_of,
    estimate_variances,
    evidence_gain,
    log_evidence,
    present,
    sums_of,
)
from ._features import slow_functions
from ._select import BEYOND_CHANCE, Columns, look_at, weights_of
from ._terms import HEAT, Term

_PASSES = 4
_FINER = 4
"""Rounds of lags about the best of the coarse ones, each time finer."""
_SOON = 15.0
"""Lag in s that is tried beside none."""
_INSTEAD = 0.95
"""Share of what a temperature explains, at which a drift in its place is as good."""
_ALIKE = 0.9
"""Share of a drift from which on a temperature that changes like it may be its cause."""
_SMOOTH = 3
"""Degree of the smoothest drifts, which a warm-up looks like."""
_SLIGHT, _SLIGHT_SHARE = 2.0, 0.1
"""A slow change of that many standard deviations, or of that share of the rms of the error,
is a drift like any other."""


def choose_heat(
    columns: Columns, terms: Sequence[Term], heat: Sequence[Term]
) -> tuple[Term, ...]:
    """Return for offset and coefficient the sensor and lag that are likeliest.

    Everything else is estimated first and taken out; what is left are a few slow terms and
    the drift, which have their variances by evidence.

    Args:
        columns: Features of the axis.
        terms: All other candidates.
        heat: Offset and coefficient for every sensor and some lags.
    """
    evidence = evidence_of(columns, terms)
    places = dict.fromkeys((term.sensor, term.lag) for term in heat)
    pairs = [tuple(t for t in heat if (t.sensor, t.lag) == place) for place in places]
    best = max(pairs, key=evidence)
    for kind in (*HEAT, *HEAT):
        mine = [term for term in heat if term.kind is kind]
        others = tuple(term for term in best if term.kind is not kind)
        if mine:
            best = max(((*others, term) for term in mine), key=evidence)
    longest = max(term.lag for term in heat)
    for step in range(_FINER):
        factor = 2.0 ** (0.5**step)
        for sensor in dict.fromkeys(term.sensor for term in best):
            lag = max(term.lag for term in best if term.sensor == sensor)
            for other in (lag * factor, lag / factor, _SOON * (lag == 0)):
                if not 0 < other <= longest:
                    continue
                moved = tuple(
                    dataclasses.replace(term, lag=other)
                    if term.sensor == sensor
                    else term
                    for term in best
                )
                best = max(best, moved, key=evidence)
    return best


def evidence_of(
    columns: Columns, terms: Sequence[Term]
) -> Callable[[tuple[Term, ...]], float]:
    """Return a function for the log evidence of few terms beside everything else."""
    look = look_at(columns, terms)
    rows, design, drift = look.rows, look.design, columns.drift
    slow = [len(design.slices) - 1] if drift.shape[1] else []
    fast, owner = present(design.slices, look.variances.without(slow).group)
    root = np.sqrt(look.weight[rows])[:, None]
    base = design.columns[np.ix_(rows, fast)] * root
    matrix = base.T @ base
    prior = look.variances.noise**2 / look.variances.group[owner]
    matrix[np.diag_indices(len(matrix))] += prior
    factor = np.linalg.cholesky(matrix)

    def reduced(values: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "m k"]:
        """Return columns whose products are those beside the base; the last are negative."""
        own = values[rows] * root
        return np.concatenate([own, solve_triangular(factor, base.T @ own, lower=True)])

    error, idle = reduced(columns.view.error[:, None]), reduced(drift)
    sign = np.repeat([1.0, -1.0], [len(rows), len(fast)])[:, None]
    blocks = dict[Term, Float[np.ndarray, "m k"]]()
    known: dict[frozenset[Term], float] = {}

    def evidence(some: tuple[Term, ...]) -> float:
        key = frozenset(some)
        if key not in known:
            for term in some:
                if term not in blocks:
                    blocks[term] = reduced(columns.of(term))
            mine = design_of(some, [blocks[term] for term in some], (idle,))
            other = mine.columns * sign
            sums = Sums(
                other.T @ mine.columns,
                (other.T @ error)[:, 0],
                np.asarray(np.sum(error**2 * sign)),
                np.asarray(look.weight[rows].sum()),
            )
            found = estimate_variances(sums, mine.slices, 1e-3 * look.variances.noise)
            known[key] = log_evidence(sums, mine.slices, found)
        return known[key]

    return evidence


@dataclasses.dataclass(frozen=True)
class AgainstDrift:
    """A temperature effect compared with a drift of the instrument in its place.

    Attributes:
        gain: Twice the log evidence that the temperature adds beside the drift.
        instead: Share of the temperature effect that a smooth drift follows.
        alike: Share of the drift, estimated without it, that the temperature follows.
        rms: Of the temperature effect without any drift, in the unit of the error.
        slight: It is small enough to be a drift like any other.
    """

    gain: float
    instead: float
    alike: float
    rms: float
    slight: bool

    @property
    def known(self) -> bool:
        """Whether the readings show that it is the temperature."""
        return self.gain >= BEYOND_CHANCE and self.instead < _INSTEAD

    @property
    def doubtful(self) -> bool:
        """Whether it may be the temperature as well as the drift, and is no small thing."""
        likely = max(self.instead - _INSTEAD, self.alike - _ALIKE) >= 0.0
        return likely and not self.known and not self.slight


def against_drift(
    clock: Float[np.ndarray, " t"],
    heat: Float[np.ndarray, "t h"],
    error: Float[np.ndarray, " t"],
    beside: Float[np.ndarray, "t b"],
    slow: Float[np.ndarray, "t s"] | None = None,
) -> AgainstDrift | None:
    """Return whether an error follows a temperature or a drift; `discover` and `fit` ask it.

    Args:
        clock: Instant of each reading.
        heat: What the temperature may do to the error: functions of it, or of it and a
            position.
        error: Readings in any unit, all else that is known of it taken off.
        beside: Of what else the error may have a part: zeros, a line over the position.
        slow: What the drift may do, of each measurement for itself; None = one measurement.

    Returns:
        What the temperature is against the drift; None for readings too few to have one.
    """
    slow = slow_functions(clock) if slow is None else slow
    if not slow.shape[1]:
        return None
    parts = [_scaled(part - part.mean(axis=0)) for part in (heat, slow)]
    columns = np.concatenate([*parts, _scaled(beside)], axis=1)
    ends = np.cumsum([0, *(part.shape[1] for part in (heat, slow, beside))]).tolist()
    slices = [slice(a, b) for a, b in itertools.pairwise(ends)]
    error = error - np.median(error)
    outer = float(np.quantile(np.abs(error), 0.95)) or 1.0
    weight = 1.0 / (1.0 + (error / outer) ** 2)
    sums = sums_of(columns, error, weight)
    found = estimate_variances(sums, slices, 1e-3 * outer)
    for _ in range(_PASSES - 1):
        weight = weights_of(error - columns @ found.values)
        sums = sums_of(columns, error, weight)
        found = estimate_variances(sums, slices, 1e-3 * outer)
    weight = weights_of(error - columns @ found.values)
    gain = evidence_gain(sums, slices, found, [0], 1, 1e-3 * outer)
    drift = np.array([0.0, *np.full(2, float(sums.square / sums.weight))])
    values = estimate_variances(
        sums, slices, 1e-3 * outer, dataclasses.replace(found, group=drift)
    ).values
    course = parts[1] @ values[slices[1]]
    share = 2.0 * (clock - clock.min()) / (float(np.ptp(clock)) or 1.0) - 1.0
    smooth = np.stack([share**k for k in range(1, _SMOOTH + 1)], axis=1)
    # Set free, without any drift: the temperature takes all that it can.
    free = np.delete(columns, slices[1], axis=1)
    root = np.sqrt(weight)
    full = np.linalg.lstsq(free * root[:, None], error * root)[0]
    warm = parts[0] @ full[slices[0]]
    rms = float(np.std(warm))
    size = float(np.std(error[weight > 0]))
    return AgainstDrift(
        gain=gain,
        instead=followed(warm, smooth),
        alike=followed(course, parts[0]),
        rms=rms,
        slight=rms < max(_SLIGHT * found.noise, _SLIGHT_SHARE * size),
    )


def heat_or_drift(heat: str, axis: str) -> tuple[str, str]:
    """Return what the data cannot tell apart, and what to do: for `discover` and `fit`."""
    wiggle = "Let the temperature rise and fall while measuring, more than once."
    return f"{heat} or drift of the instrument at {axis}", wiggle


def _scaled(columns: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t k"]:
    return np.asarray(columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-12))


def followed(
    course: Float[np.ndarray, " t"], columns: Float[np.ndarray, "t k"]
) -> float:
    """Return the share of the square of a course that columns follow, means aside."""
    course, columns = course - course.mean(), columns - columns.mean(axis=0)
    left = course - columns @ np.linalg.lstsq(columns, course)[0]
    whole = float(course @ course)
    return 1.0 - float(left @ left) / whole if whole > 0 else 0.0

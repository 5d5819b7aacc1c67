"""What the data cannot tell apart: sensor and lag, a temperature or a drift, substitutes."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ._columns import Columns, Design, followed, slow_functions, weights_of_unknown
from ._evidence import Groups, gram_of, robust_groups
from ._select import BEYOND_CHANCE, Selection, Worth, look_at
from ._terms import HEAT, PUSHES, Kind, Need, Term

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
SLIGHT, SLIGHT_SHARE = 2.0, 0.1
"""A slow change of that many standard deviations, or of that share of the rms of the error,
is a drift like that of any instrument."""
_AS_WELL = 0.95
"""Share of what a compensation explains, at which a substitute is as good."""
_PARTLY = 0.3
"""The same, where the substitute cannot be seen beside all that was found."""
_HIDDEN = 0.05
"""Share of a feature that is left beside all that was found; below it is not seen."""
_ROWS = 6_000
_LOOSE = 10.0
"""Size of a substitute's coefficients, relative to the error: free."""
_SAME_COURSE = 0.999
"""Correlation of two sensors from which on either does for the other."""
_CONTAINED = {
    Kind.REVERSAL: (Kind.OWN_REVERSAL, Kind.MEMORY),
    Kind.LINE: (Kind.SURFACE,),
    Kind.PUSH: PUSHES,
    Kind.PUSH_PLACE: PUSHES,
}
"""Terms that a richer one may imitate; the simpler one is taken."""


def choose_heat(
    columns: Columns, terms: Sequence[Term], heat: Sequence[Term], worth: Worth
) -> tuple[Term, ...]:
    """Return for offset and coefficient the sensor and lag that are likeliest.

    Everything else is estimated first and taken out; what is left are a few slow terms and
    the drift, which have their variances by evidence.

    Args:
        columns: Features of the axis.
        terms: All other candidates.
        heat: Offset and coefficient for every sensor and some lags.
        worth: From which contribution on a term counts.
    """
    evidence = evidence_of(columns, terms, worth)
    places = dict.fromkeys((term.sensor, term.lag) for term in heat)
    pairs = [tuple(t for t in heat if (t.sensor, t.lag) == place) for place in places]
    best = max(pairs, key=evidence)
    for kind in (*HEAT, *HEAT):
        mine = [term for term in heat if term.kind is kind]
        others = tuple(term for term in best if term.kind is not kind)
        best = max([best, *((*others, term) for term in mine)], key=evidence)
    longest = max(term.lag for term in heat)
    for step in range(_FINER):
        factor = 2.0 ** (0.5**step)
        for sensor in dict.fromkeys(term.sensor for term in best):
            lag = max(term.lag for term in best if term.sensor == sensor)
            for other in (lag * factor, lag / factor, _SOON * (lag == 0)):
                moved = tuple(
                    dataclasses.replace(term, lag=other)
                    if term.sensor == sensor
                    else term
                    for term in best
                )
                if 0 < other <= longest:
                    best = max(best, moved, key=evidence)
    return best


def evidence_of(
    columns: Columns, terms: Sequence[Term], worth: Worth
) -> Callable[[tuple[Term, ...]], float]:
    """Return a function for the log evidence of few terms beside everything else."""
    design, rows, groups = look_at(columns, terms, worth)
    count = columns.drift.shape[1]
    slow = [len(design.slices) - 1] if count else []
    fast, owner = groups.without(slow).present
    root, weight = np.sqrt(columns.weight[rows])[:, None], columns.weight[rows]
    # Beside the terms that are known, with their priors as readings of zero.
    prior = np.diag(groups.noise / np.sqrt(groups.variance[owner]))
    base = np.concatenate([design.columns[np.ix_(rows, fast)] * root, prior])
    base = np.linalg.qr(base)[0]

    def beside(values: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "m k"]:
        own = np.zeros((len(base), values.shape[1]))
        own[: len(rows)] = values[rows] * root
        return np.asarray(own - base @ (base.T @ own))

    error, idle = beside(columns.view.error[:, None])[:, 0], beside(columns.drift)
    blocks = dict[Term, Float[np.ndarray, "m k"]]()
    known: dict[frozenset[Term], float] = {}

    def evidence(some: tuple[Term, ...]) -> float:
        key = frozenset(some)
        if key not in known:
            for term in key - blocks.keys():
                blocks[term] = beside(columns.of(term))
            mine = Design.of(some, [blocks[term] for term in some], (idle,))
            gram = gram_of(mine.columns, error, np.ones(len(error)))
            found = Groups.of(gram, float(weight.sum()), mine.slices)
            known[key] = found.estimated(1e-3 * groups.noise).evidence
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
    parts = [heat - heat.mean(axis=0), slow - slow.mean(axis=0), beside]
    parts = [
        part / np.maximum(np.sqrt(np.mean(part**2, axis=0)), 1e-12) for part in parts
    ]
    design = Design.of((), parts)
    columns, slices = design.columns, design.slices
    error = error - np.median(error)
    least = 1e-3 * (float(np.quantile(np.abs(error), 0.95)) or 1.0)
    weight = weights_of_unknown(error)
    found, weight = robust_groups(columns, slices, error, weight, least)
    found = dataclasses.replace(
        found, gram=gram_of(columns, error, weight), weight=float(weight.sum())
    )
    drift = np.array([0.0, *np.full(2, found.size**2)])
    alone = dataclasses.replace(found, variance=drift).estimated(least)
    share = 2.0 * (clock - clock.min()) / (float(np.ptp(clock)) or 1.0) - 1.0
    course = np.stack([share**k for k in range(1, _SMOOTH + 1)], axis=1)
    # Set free, without any drift: the temperature takes all that it can.
    free, root = np.delete(columns, slices[1], axis=1), np.sqrt(weight)
    full = np.linalg.lstsq(free * root[:, None], error * root)[0]
    warm = parts[0] @ full[slices[0]]
    rms, size = float(np.std(warm)), float(np.std(error[weight > 0]))
    return AgainstDrift(
        gain=found.evidence_gain(0, 1, least),
        instead=float(followed(warm, course)),
        alike=float(followed(parts[1] @ alone.values[slices[1]], parts[0])),
        rms=rms,
        slight=bool(rms < max(SLIGHT * found.noise, SLIGHT_SHARE * size)),
    )


def heat_or_drift(heat: str, axis: str) -> tuple[str, str]:
    """Return what the data cannot tell apart, and what to do: for `discover` and `fit`."""
    wiggle = "Let the temperature rise and fall while measuring, more than once."
    return f"{heat} or drift of the instrument at {axis}", wiggle


@dataclasses.dataclass(frozen=True)
class Confusion:
    """What the data cannot tell.

    Attributes:
        others: What explains the same as a compensation, by compensation.
        hidden: Terms that could not be seen beside what was found.
        drift: What temperatures are against a drift in their place, by their terms.
    """

    others: dict[Need, list[Term]]
    hidden: tuple[Term, ...]
    drift: dict[tuple[Term, ...], AgainstDrift]


def look_for_confusion(
    found: Selection, needs: Sequence[Need], heat: Sequence[Term]
) -> Confusion:
    """Return which compensations something else would replace.

    Args:
        found: The selection of the axis.
        needs: Compensations made of it.
        heat: Temperature terms of all sensors and some lags.
    """
    drift, columns = {}, found.columns
    if heat and columns.drift.shape[1]:
        warm = [each.terms for each in needs if each.compensation == "temperature"]
        shifts = [term for term in heat if term.kind is Kind.HEAT_OFFSET]
        # Where no temperature was found, the offset that changes most like the drift.
        like = max(shifts, key=lambda each: followed(found.drift, columns.of(each)))
        terms = warm[0] if warm else (like,)
        rest = [found.part(term) for term in found.terms if term not in terms]
        against = against_drift(
            columns.view.data.clock,
            np.concatenate([columns.of(term) for term in terms], axis=1),
            np.asarray(columns.view.error - np.sum(rest, axis=0)),
            np.concatenate([columns.zeros, columns.runs], axis=1),
            columns.drift,
        )
        if against is not None:
            drift[terms] = against
    others, hidden = _substitutes(found, needs) if needs else ({}, [])
    return Confusion(others, tuple(hidden), drift)


def _substitutes(
    found: Selection, needs: Sequence[Need]
) -> tuple[dict[Need, list[Term]], list[Term]]:
    """Return what explains the same as a compensation, and what cannot be seen."""
    columns, design = found.columns, found.design
    others = [term for term in found.looked if term not in found.terms]
    rows = np.random.default_rng(5).permutation(len(columns.view.error))[:_ROWS]
    kept = np.flatnonzero(found.groups.variance > 0).tolist()
    blocks = [design.columns[rows, design.slices[g]] for g in kept]
    blocks += [columns.of(_changing(term))[rows] for term in others]
    whole = Design.of((), blocks)
    weight = columns.weight[rows]
    gram = gram_of(whole.columns, columns.view.error[rows], weight)
    loose = Groups.of(gram, float(weight.sum()), whole.slices)
    variance = _LOOSE * loose.variance
    variance[: len(kept)] = found.groups.variance[kept]
    loose = dataclasses.replace(loose, variance=variance, noise=found.groups.noise)
    every = range(len(kept))
    beside = loose.only(every)
    hidden: list[Term] = []
    for k, term in enumerate(others, len(kept)):
        own = loose.slices[k]
        left = np.trace(beside.reduced(own)[:-1, :-1])
        if left < _HIDDEN * np.trace(loose.gram[own, own]):
            hidden.append(term)
    result: dict[Need, list[Term]] = {}
    for need in needs:
        mine = [k for k in every if kept[k] in found.index(need.terms)]
        rest = [k for k in every if k not in mine]
        gain = max(beside.gain(mine), 1e-300)
        for k, term in enumerate(others, len(kept)):
            share = _PARTLY if term in hidden else _AS_WELL
            if not _contained(need, term):
                if loose.only([*rest, k]).gain([k]) >= share * gain:
                    result.setdefault(need, []).append(term)
    return result, hidden


def _changing(term: Term) -> Term:
    """Return a term without what is the same at any temperature: that is no sign of heat."""
    if term.kind is Kind.HEAT_SLOPE:
        return dataclasses.replace(term, kind=Kind.HEAT_CHANGE)
    return term


def _contained(need: Need, other: Term) -> bool:
    """Return whether the other is only a richer form, or another sensor, of the same."""
    if need.compensation == "temperature" and other.kind in HEAT:
        return True
    for term in need.terms:
        if other.kind in _CONTAINED.get(term.kind, ()):
            masters = term.masters[:1] if other.kind in PUSHES else term.masters
            inside = other.masters[:1] if other.kind in PUSHES else other.masters
            if {*masters} <= {*inside}:
                return True
    return False


def sensors_alike(found: Selection, need: Need) -> tuple[str, ...]:
    """Return the sensors of a temperature, where others changed in the same way."""
    warm = found.view.data.temperature
    for sensor in dict.fromkeys(term.sensor for term in need.terms):
        if sensor is None:
            continue
        alike = [sensor]
        for name, other in warm.items():
            known = np.isfinite(warm[sensor]) & np.isfinite(other)
            if name != sensor and known.sum() > 2:
                same = followed(warm[sensor][known], other[known][:, None])
                if same > _SAME_COURSE**2:
                    alike.append(name)
        if len(alike) > 1:
            return tuple(alike)
    return ()

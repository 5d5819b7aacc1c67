"""What the data cannot tell apart: sensor and lag, a temperature or a drift, substitutes."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ...data.units import small_unit
from ..core import node_shares
from ._columns import Design, followed, slow_functions, smooth
from ._data import Drift, Unexplained, Verdict
from ._evidence import Groups, robust_groups, weights_about
from ._select import BEYOND_CHANCE, Selection
from ._terms import HEAT, PUSHES, Kind, Need, Term
from ._view import some_of

_INSTEAD = 0.95
"""Share of what a temperature explains, at which a drift in its place is as good."""
_PART_INSTEAD = 0.99
"""The same for one part of a temperature effect beside the others."""
_ALIKE = 0.9
"""Share of a drift from which on a temperature that changes like it may be its cause."""
_LEAST = 1e-3
"""Share of the readings from which on a drift or a temperature is there."""
_SMOOTH = 3
"""Degree of the smoothest drifts, which a warm-up looks like."""
_SLIGHT, _SLIGHT_SHARE = 2.0, 0.1
"""Standard deviations, or share of the rms, up to which a drift is that of any instrument."""
_MUCH = 0.3
"""Share of the rms of the error from which on what runs differ by is said."""
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
_PIECES = (1, 2, 3, 4, 6, 8, 12, 16, 20)
"""Straight pieces that a drift may have."""
_FOLLOWED = 0.25
"""Of the scatter of a reading: what is smaller is left where it is."""
_BINS = 4096
"""Places along a position between which readings are not told apart."""
_PADDED = 16
"""Parts of a cycle per travel to which a period is told."""
_CHANCE = 1e-4
"""Probability that noise alone shows a line as strong, over all periods."""
_COARSE = 24
"""Periods per travel up to which the features hold them."""
_FINEST = 0.25
"""Cycles per bin up to which a period is looked for."""
_PER_PERIOD = 6.0
"""Entries of a table that follow a period."""


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
    def imitated(self) -> bool:
        """Whether the drift may well be the temperature's."""
        return not self.known and self.alike >= _ALIKE

    @property
    def doubtful(self) -> bool:
        """Whether it may be the temperature as well as the drift, and is no small thing."""
        likely = self.imitated or self.instead >= _INSTEAD
        return likely and not self.known and not self.slight

    @property
    def doubtful_part(self) -> bool:
        """The same for one part of a temperature effect, the others among the nuisance."""
        return self.doubtful and self.instead > _PART_INSTEAD


def against_drift(
    clock: Float[np.ndarray, " t"],
    heat: Float[np.ndarray, "t h"],
    error: Float[np.ndarray, " t"],
    nuisance: Float[np.ndarray, "t b"],
    slow: Float[np.ndarray, "t s"] | None = None,
) -> AgainstDrift | None:
    """Return whether an error follows a temperature or a drift; `discover` and `fit` ask it.

    Args:
        clock: Instant of each reading.
        heat: Functions of the temperature, or of it and a position.
        error: Readings in any unit, all else that is known of it taken off.
        nuisance: Of what else the error may have a part: zeros, a line over the position.
        slow: What the drift may do, of each measurement for itself; None = one measurement.

    Returns:
        What the temperature is against the drift; None for readings too few to have one.
    """
    slow = slow_functions(clock) if slow is None else slow
    if not slow.shape[1]:
        return None
    error = error - np.median(error)
    parts = [heat - heat.mean(axis=0), slow - slow.mean(axis=0), nuisance]
    design = Design.of((), parts)
    size_of = np.sqrt(np.mean(design.columns**2, axis=0))
    columns = design.columns / np.maximum(size_of, 1e-12)
    groups = robust_groups(columns, design.slices, error, lambda size: _LEAST * size)
    heated_groups, drift_only = groups.with_and_without(0, 1, _LEAST * groups.size)
    weight = weights_about(error - columns @ groups.values)
    heated, drifting, _ = design.slices
    # Set free, without any drift: the temperature takes all that it can.
    static, root = np.delete(columns, drifting, axis=1), np.sqrt(weight)
    values = np.linalg.lstsq(static * root[:, None], error * root)[0]
    warm = columns[:, heated] @ values[heated]
    course = columns[:, drifting] @ drift_only.values[drifting]
    share = 2.0 * (clock - clock.min()) / (float(np.ptp(clock)) or 1.0) - 1.0
    rms, size = float(np.std(warm)), float(np.std(error[weight > 0]))
    return AgainstDrift(
        gain=2.0 * (heated_groups.evidence - drift_only.evidence),
        instead=float(followed(warm, np.vander(share, _SMOOTH + 1))),
        alike=float(followed(course, columns[:, heated])),
        rms=rms,
        slight=rms < max(_SLIGHT * groups.noise, _SLIGHT_SHARE * size),
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
        heat: Temperature terms that were found or are likest to a drift.
        drift: What they are against a drift in their place; None where there is none.
        shift: The part of them that is alike all over the axis, and its size in the unit of the
            error, where it may as well be a drift though the growth along the axis is not.
    """

    others: dict[Need, list[Term]]
    hidden: list[Term]
    heat: tuple[Term, ...] = ()
    drift: AgainstDrift | None = None
    shift: tuple[Term, float] | None = None


def look_for_confusion(
    chosen: Selection, needs: Sequence[Need], heat: Sequence[Term]
) -> Confusion:
    """Return what would replace the compensations that were found, or may be a drift."""
    others, hidden = dict[Need, list[Term]](), list[Term]()
    if needs and chosen.view.channel == "error":
        others, hidden = _substitutes(chosen, needs)
    columns = chosen.columns
    if not heat or not columns.drift.shape[1]:
        return Confusion(others, hidden)
    shifts = [term for term in heat if term.kind is Kind.HEAT_OFFSET]
    # Where no temperature was found, the offset that changes most like the drift.
    slow = chosen.slow()
    closest = max(shifts, key=lambda term: followed(slow, columns.of(term)))
    warm = [need.terms for need in needs if need.lead.kind in HEAT]
    terms = warm[0] if warm else (closest,)
    parts = [chosen.part(term) for term in chosen.terms if term not in terms]
    error = np.asarray(columns.view.error - np.sum(parts, axis=0))

    def compared(terms: Sequence[Term], beside: Sequence[Term]) -> AgainstDrift | None:
        warmth = np.hstack([columns.of(term) for term in terms])
        nuisance = np.hstack([columns.zeros, columns.runs, *map(columns.of, beside)])
        clock = columns.view.data.clock
        return against_drift(clock, warmth, error, nuisance, columns.drift)

    drift = compared(terms, ())
    growth = [term for term in terms if term.kind is Kind.HEAT_SLOPE]
    if not growth or drift is None or drift.doubtful:
        return Confusion(others, hidden, terms, drift)
    # A drift may have taken the shift that belongs to the growth.
    offsets = [term for term in terms if term.kind is Kind.HEAT_OFFSET]
    for shift in offsets or [dataclasses.replace(growth[0], kind=Kind.HEAT_OFFSET)]:
        alone = compared((shift,), [term for term in terms if term != shift])
        if alone is not None and alone.doubtful_part:
            return Confusion(others, hidden, terms, drift, (shift, alone.rms))
    return Confusion(others, hidden, terms, drift)


def _substitutes(
    chosen: Selection, needs: Sequence[Need]
) -> tuple[dict[Need, list[Term]], list[Term]]:
    """Return what explains the same as a compensation, and what cannot be seen."""
    columns, prior, count = chosen.columns, chosen.groups.variance, len(chosen.terms)
    others = [term for term in chosen.looked if term not in chosen.terms]
    extra = range(count, count + len(others))
    design = columns.design([*chosen.terms, *map(_changing, others)])
    rows = some_of(len(columns.view.error), _ROWS)
    error, weight = columns.view.error[rows], columns.weight[rows]
    wide = Groups.of(design.columns[rows], design.slices, error, weight)
    variance = _LOOSE * wide.variance
    variance[:count] = prior[chosen.index(chosen.terms)]
    variance[extra.stop :] = prior[len(chosen.design.terms) :]
    wide = dataclasses.replace(wide, variance=variance, noise=chosen.groups.noise)
    base = wide.without(extra)
    hidden: list[Term] = []
    for k, term in zip(extra, others, strict=True):
        part = design.slices[k]
        trace = np.trace(base.reduced(part)[:-1, :-1])
        if trace < _HIDDEN * np.trace(wide.gram[part, part]):
            hidden.append(term)
    result: dict[Need, list[Term]] = {}
    for need in needs:
        members = [chosen.terms.index(term) for term in need.terms]
        gain = max(base.gain(members), 1e-300)
        for k, term in zip(extra, others, strict=True):
            instead = wide.without([*({*members, *extra} - {k})])
            share = _PARTLY if term in hidden else _AS_WELL
            if not _contained(need, term) and instead.gain([k]) >= share * gain:
                result.setdefault(need, []).append(term)
    return result, hidden


def _changing(term: Term) -> Term:
    """Return a term without what is the same at any temperature: that is no sign of heat."""
    if term.kind is Kind.HEAT_SLOPE:
        return dataclasses.replace(term, kind=Kind.HEAT_CHANGE)
    return term


def _contained(need: Need, other: Term) -> bool:
    """Return whether the other is only a richer form, or another sensor, of the same."""
    if need.lead.kind in HEAT and other.kind in HEAT:
        return True
    count = 1 if other.kind in PUSHES else 2
    return any(
        other.kind in _CONTAINED.get(term.kind, ())
        and {*term.masters[:count]} <= {*other.masters[:count]}
        for term in need.terms
    )


def sensors_alike(chosen: Selection, need: Need) -> list[str]:
    """Return the sensors of a temperature, where others changed in the same way."""
    warm = chosen.view.data.temperature
    for sensor in dict.fromkeys(term.sensor for term in need.terms if term.sensor):
        sensors = [sensor]
        for name, other in warm.items():
            finite = np.isfinite(warm[sensor]) & np.isfinite(other)
            if name != sensor and finite.sum() > 2:
                share = followed(warm[sensor][finite], other[finite][:, None])
                sensors += [name] if share > _SAME_COURSE**2 else []
        if len(sensors) > 1:
            return sensors
    return []


def amount(chosen: Selection, rms: float) -> str:
    """Return a length, an angle or a current as a person writes it."""
    if chosen.view.channel == "current":
        return f"{rms:.3g}"
    return f"{1e3 * rms:.2g} {small_unit(chosen.view.unit)}"


def stays(
    chosen: Selection,
    label: str,
    masters: Sequence[str],
    rms: float,
    sentence: str,
    share: float | None = None,
    verdict: Verdict = "the kernel cannot express this",
) -> Unexplained:
    """Return what stays: no compensation holds it, or several could."""
    view, axes = chosen.view, tuple(dict.fromkeys(masters))
    part = min(rms**2 / chosen.square, 1.0) if share is None else share
    return Unexplained(
        axis=view.axis, masters=axes, rms=rms, share=part, unit=view.unit,
        sentence=sentence, what=label, verdict=verdict,
    )  # fmt: skip


def drifts(chosen: Selection) -> Iterator[Drift]:
    """Yield the drift of each measurement in which there is one, in the fewest pieces."""
    view, course, time = chosen.view, chosen.slow(), chosen.view.data.time
    if time is None or not chosen.columns.drift.shape[1]:
        return
    for rows in view.sources:
        clock, rms = time[rows], float(np.std(course[rows]))
        # Runs have an offset each, which a fit allows for.
        several = len(np.unique(view.data.run[rows])) > 1
        if several or not np.ptp(clock) > 0 or rms <= _FOLLOWED * chosen.noise:
            continue
        pieces = 0
        for pieces in _PIECES:
            knots = np.linspace(clock.min(), clock.max(), pieces + 1)
            share = followed(course[rows], node_shares(clock, knots))
            if rms * np.sqrt(1.0 - share) <= _FOLLOWED * chosen.noise:
                break
        follow = f"{pieces} straight pieces follow it."
        sentence = (
            f"Beside what was found the error of {view.axis} wanders in time by"
            f" {amount(chosen, rms)} rms, as the zero of an instrument does:"
            f" {'one straight piece follows it.' if pieces == 1 else follow}"
        )
        if rms >= max(_SLIGHT * chosen.noise, _SLIGHT_SHARE * np.sqrt(chosen.square)):
            sentence += (
                " That is much for an instrument: something may have warmed whose"
                " temperature was not recorded, or cannot be told from this."
            )
        source = int(view.data.source[rows[0]])
        yield Drift(view.axis, source, pieces, rms, view.unit, sentence)


def wandering_runs(chosen: Selection) -> Iterator[Unexplained]:
    """Yield what the runs of each measurement differ by, and drift meanwhile, where it is much."""
    view = chosen.view
    if view.channel != "error":
        return
    for rows in view.sources:
        rms = float(np.std(chosen.slow(runs=True)[rows]))
        least = max(_SLIGHT * chosen.noise, _MUCH * np.sqrt(chosen.square))
        if len(np.unique(view.data.run[rows])) > 1 and rms >= least:
            sentence = (
                f"The runs of {view.axis} differ, or drift meanwhile, by"
                f" {amount(chosen, rms)} rms beside what was found: the zero of the"
                " instrument, or what warmed while measuring. No position tells of it."
            )
            yield stays(chosen, f"runs of {view.axis}", (), rms, sentence)


def ripples(chosen: Selection) -> Iterator[Unexplained]:
    """Yield the strongest period of an error over each position that a table is too coarse for."""
    view = chosen.view
    for master, (low, high) in view.span.items() if view.channel == "error" else ():
        is_own, unit = master == view.axis, view.data.unit(master)
        turns, amplitude = _ripple(chosen, master)
        if not turns:
            continue
        rms, period = amplitude / float(np.sqrt(2.0)), (high - low) / turns
        nodes = int(np.ceil(_PER_PERIOD * turns)) + 1
        sentence = (
            f"The error of {view.axis} repeats every {period:.4g} {unit} of {master}"
            f" ({amount(chosen, rms)} rms), finer than a table that follows the rest:"
            f" one of {nodes} nodes would hold it, where a list may have that many."
        )
        label = f"periodic error of {view.axis} over {master}"
        yield stays(chosen, label, () if is_own else (master,), rms, sentence)


def _ripple(chosen: Selection, axis: str) -> tuple[float, float]:
    """Return periods per travel and amplitude in mm or ° of a fine period; 0 where none."""
    view, absent, u = chosen.view, (0.0, 0.0), chosen.view.scaled(axis)
    finite = np.isfinite(u)
    last = min(int(_FINEST * _BINS), view.places(axis) // 4)
    if view.places(axis) < 8 * _COARSE:
        return absent
    u, block = u[finite], view.block[finite]
    residual = np.clip(chosen.residual[finite], -4.0 * chosen.noise, 4.0 * chosen.noise)
    # Where places lie in rows, what is slow over them would show as fine lines.
    slow = np.stack([wave(u) for wave in smooth(2 * _COARSE)], axis=1)
    residual = residual - slow @ np.linalg.lstsq(slow, residual)[0]
    bins = np.minimum((u * _BINS).astype(np.int64), _BINS - 1)
    # What is there is there in either half of the recording, with the same phase.
    halves = [block % 2 == k for k in (0, 1)]
    sums = [np.bincount(bins[half], residual[half], _BINS) for half in halves]
    lines = [np.fft.rfft(sum_of, _PADDED * _BINS) for sum_of in sums]
    first, power = _PADDED * (_COARSE + 1), np.abs(lines[0] + lines[1]) ** 2
    peak = first + int(np.argmax(power[first : _PADDED * last]))
    chance = float(residual @ residual) * np.log((last - _COARSE - 1) / _CHANCE)
    if not power[peak] >= chance > 0:
        return absent
    amplitude = 2.0 * float(np.sqrt(power[peak])) / len(u)
    agreement = 4.0 * float(np.real(lines[0][peak] * np.conj(lines[1][peak])))
    if amplitude / np.sqrt(2.0) < chosen.least or agreement < 0.25 * power[peak]:
        return absent
    return peak / _PADDED, amplitude

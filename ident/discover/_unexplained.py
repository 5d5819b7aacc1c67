"""What stays unexplained, and why: in sentences for a person at the machine."""

from collections.abc import Iterator, Sequence

import numpy as np

from ._amounts import amount, clean_error, size_of
from ._compose import Beyond, Need
from ._confusion import Confused, Look
from ._features import columns_of
from ._periodic import Ripple
from ._result import Unexplained
from ._select import Selection
from ._terms import HEAT, Kind, Term
from ._view import AxisView
from ._wander import Wander

_MOST_NODES = 1000
"""Entries of a table over one position that every build has."""
_STRUCTURE = 1.15
"""Scatter, relative to that of neighbouring readings, at which something is left."""
_SLIGHT = 2.0
"""A slow change of that many standard deviations is a drift like any other."""
_SLIGHT_SHARE = 0.1
_ALIKE = 0.9
"""Share of a drift from which on a temperature that changes like it may be its cause."""
_LATE = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Lags behind a temperature at which that is looked for, as shares of the recording."""
_SAME_COURSE = 0.999
"""Correlation of two sensors from which on either does for the other."""
_WIGGLE = "Let the temperature rise and fall while measuring, more than once."


def confused_ones(selection: Selection, look: Look, unit: str) -> Iterator[Unexplained]:
    """Yield what several could explain; a slight drift aside, which anything may be."""
    for need in {id(each.need): each.need for each in look.confused}.values():
        mine = [each for each in look.confused if each.need is need]
        rms, share = size_of(selection, need.terms)
        if is_slight_drift(selection, need, look):
            continue
        names = _names(need, mine)
        sentence = (
            f"The data cannot tell: {' or '.join(names)} ({amount(rms, unit)} rms)."
            f" {_why_confused(selection.view, need, mine)}"
        )
        masters = [*need.masters, *(m for each in mine for m in each.other.masters)]
        yield Unexplained(
            selection.view.axis,
            " or ".join(names),
            tuple(dict.fromkeys(masters)),
            rms,
            share,
            unit,
            "the data cannot tell",
            sentence,
        )


def drifts(selection: Selection, look: Look, unit: str) -> Iterator[Unexplained]:
    """Yield temperatures in whose place a drift explains as much, and no small thing."""
    named = {each.other for each in look.confused}
    for term, rms in selection.drifting:
        if term in named or is_slight(selection, rms):
            continue
        whole = float(np.mean(clean_error(selection) ** 2)) or 1.0
        drift = Term(Kind.DRIFT, selection.view.axis).words
        sentence = (
            f"The data cannot tell: {term.words} or {drift} ({amount(rms, unit)} rms)."
            f" {_WIGGLE}"
        )
        yield Unexplained(
            selection.view.axis, f"{term.words} or {drift}", (), rms,
            float(min(rms**2 / whole, 1.0)), unit, "the data cannot tell", sentence,
        )  # fmt: skip


def sensors_alike(selection: Selection, need: Need) -> tuple[str, ...]:
    """Return the sensors of a temperature, where others changed in the same way."""
    data = selection.view.data
    for term in need.terms:
        if term.kind not in HEAT or term.sensor is None:
            continue
        mine = data.temperature[term.sensor]
        alike = [term.sensor]
        for name, other in data.temperature.items():
            known = np.isfinite(mine) & np.isfinite(other)
            if name == term.sensor or known.sum() < 3:
                continue
            if not np.ptp(mine[known]) > 0 or not np.ptp(other[known]) > 0:
                continue
            if abs(np.corrcoef(mine[known], other[known])[0, 1]) > _SAME_COURSE:
                alike.append(name)
        if len(alike) > 1:
            return tuple(alike)
    return ()


def which_sensor(
    selection: Selection, need: Need, sensors: Sequence[str], unit: str
) -> Unexplained:
    """Return that sensors changed alike, so that any of them may be the one."""
    axis = selection.view.axis
    rms, share = size_of(selection, need.terms)
    names = " or ".join(f"temperature of {axis} by {name}" for name in sensors)
    sentence = (
        f"The data cannot tell: {names} ({amount(rms, unit)} rms)."
        f" {' and '.join(sensors)} changed alike; measure once while they do not, as"
        " after a pause."
    )
    return Unexplained(
        axis, names, (), rms, share, unit, "the data cannot tell", sentence
    )


def heat_or_drift(
    selection: Selection,
    needs: Sequence[Need],
    heat: Sequence[Term],
    wanders: Sequence[Wander],
) -> Iterator[Unexplained]:
    """Yield large drifts that a temperature changes like, where none was taken."""
    if any(need.compensation == "temperature" for need in needs):
        return
    whole = float(np.mean(clean_error(selection) ** 2)) or 1.0
    sensors = dict.fromkeys(term.sensor for term in heat)
    span = float(np.ptp(selection.view.data.clock))
    shifts = [
        Term(Kind.HEAT_OFFSET, selection.view.axis, (), sensor, late * span)
        for sensor in sensors
        for late in _LATE
    ]
    said = {term for term, _ in selection.drifting}
    for wander in wanders:
        if is_slight(selection, wander.rms) or said:
            continue
        alike = [(_alike(selection, term, wander), term) for term in shifts]
        best, term = max(alike, key=lambda each: each[0], default=(0.0, None))
        if term is None or best < _ALIKE:
            continue
        drift = Term(Kind.DRIFT, wander.axis).words
        sentence = (
            f"The data cannot tell: {term.words} or {drift}"
            f" ({amount(wander.rms, wander.unit)} rms). {_WIGGLE}"
        )
        yield Unexplained(
            wander.axis, f"{term.words} or {drift}", (), wander.rms,
            float(min(wander.rms**2 / whole, 1.0)), wander.unit,
            "the data cannot tell", sentence,
        )  # fmt: skip


def _alike(selection: Selection, term: Term, wander: Wander) -> float:
    """Return the share of a drift that a temperature explains."""
    warm = columns_of(selection.view, term)[wander.rows, 0]
    known = np.isfinite(warm)
    if known.sum() < 2 or not np.ptp(warm[known]) > 0:
        return 0.0
    return float(np.corrcoef(warm[known], wander.course[known])[0, 1] ** 2)


def is_slight(selection: Selection, rms: float) -> bool:
    """Return whether a slow change is small enough to be a drift like any other."""
    whole = float(np.sqrt(np.mean(clean_error(selection) ** 2)))
    return rms < max(_SLIGHT * selection.noise, _SLIGHT_SHARE * whole)


def is_slight_drift(selection: Selection, need: Need, look: Look) -> bool:
    """Return whether a temperature is no more than a drift that changes alike."""
    others = {each.other.kind for each in look.confused if each.need is need}
    if Kind.DRIFT not in others:
        return False
    return is_slight(selection, size_of(selection, need.terms)[0])


def _names(need: Need, mine: Sequence[Confused]) -> list[str]:
    """Return what could be there; a plane gives way to the lines that suffice."""
    lines = [each.other for each in mine if each.other.kind is Kind.LINE]
    if need.compensation == "plane" and lines:
        inside = [term for term in need.terms if term.kind is Kind.LINE]
        return [term.words for term in dict.fromkeys([*inside, *lines])]
    return [need.terms[0].words, *(each.other.words for each in mine)]


def _why_confused(view: AxisView, need: Need, mine: Sequence[Confused]) -> str:
    other = mine[0].other
    if Kind.SPEED in {each.other.kind for each in mine}:
        return f"Measure {view.axis} at another feed too, or at standstill."
    if other.kind is Kind.DRIFT:
        return _WIGGLE
    if need.compensation == "temperature" or other.kind in HEAT:
        return "Measure once more at another temperature, in another order of places."
    axes = {view.axis} if not need.masters else set()
    axes |= {*need.masters, *other.masters}
    names = " and ".join(sorted(axes))
    if len(axes) > 1:
        return f"{names} went together; move them one without the other."
    return f"Measure with other motions of {names}."


def beyond_kernel(selection: Selection, beyond: Beyond, unit: str) -> Unexplained:
    rms, share = size_of(selection, beyond.terms)
    first = beyond.terms[0]
    sentence = f"{beyond.sentence.removesuffix('.')} ({amount(rms, unit)} rms)."
    return Unexplained(
        selection.view.axis, first.words, first.masters, rms, share, unit,
        "the kernel cannot express this", sentence,
    )  # fmt: skip


def periodic_one(selection: Selection, ripple: Ripple, unit: str) -> Unexplained:
    axis = selection.view.axis
    rms = ripple.amplitude / np.sqrt(2.0)
    kind = "leadscrew" if ripple.master == axis else "cross"
    remedy = f"more than the {_MOST_NODES} that a list has by default."
    if ripple.nodes <= _MOST_NODES:
        remedy = f"so a {kind} table of that many would hold it."
    sentence = (
        f"The error of {axis} repeats every {ripple.period:.4g} {unit} of"
        f" {ripple.master} ({amount(rms, unit)} rms), finer than a table that follows"
        f" the rest: it takes {ripple.nodes} nodes, {remedy}"
    )
    whole = float(np.mean(clean_error(selection) ** 2)) or 1.0
    masters = () if ripple.master == axis else (ripple.master,)
    return Unexplained(
        axis, f"periodic error of {axis} over {ripple.master}", masters, float(rms),
        float(min(rms**2 / whole, 1.0)), unit, "the kernel cannot express this",
        sentence,
    )  # fmt: skip


def what_is_left(
    selection: Selection, ripples: Sequence[Ripple], unit: str
) -> Iterator[Unexplained]:
    """Yield what is left beyond the scatter of neighbouring readings."""
    view = selection.view
    if view.data.time is None or len(view.error) < 1000:
        return
    left = selection.residual
    same = np.diff(view.data.source) == 0
    step = np.diff(view.data.clock)
    near = same & (step <= np.median(step[same]))
    apart = np.diff(left)[near]
    if len(apart) < 300:
        return
    white = 1.4826 * float(np.median(np.abs(apart))) / np.sqrt(2.0)
    known = sum(0.5 * ripple.amplitude**2 for ripple in ripples)
    extra = float(np.sqrt(max(selection.noise**2 - white**2 - known, 0.0)))
    if np.hypot(white, extra) < _STRUCTURE * white or extra < 3.0 * selection.least:
        return
    whole = float(np.mean(clean_error(selection) ** 2)) or 1.0
    sentence = (
        f"Another {amount(extra, unit)} rms of the error of {view.axis} is no scatter of"
        " single readings, and nothing that was recorded explains it."
    )
    yield Unexplained(
        view.axis, f"rest of the error of {view.axis}", (), float(extra),
        float(min(extra**2 / whole, 1.0)), unit, "the kernel cannot express this",
        sentence,
    )  # fmt: skip

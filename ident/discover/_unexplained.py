"""What stays unexplained, and why: in sentences for a person at the machine."""

from collections.abc import Iterator, Sequence

import numpy as np

from ._amounts import amount, clean_error, size_of
from ._compose import Beyond, Need
from ._confusion import Confused, Look
from ._periodic import Ripple
from ._result import Unexplained
from ._select import Selection
from ._terms import HEAT, Kind, Term
from ._view import AxisView

_MOST_NODES = 1000
"""Entries of a table over one position that every build has."""
_STRUCTURE = 1.15
"""Scatter, relative to that of neighbouring readings, at which something is left."""
_SLIGHT = 2.0
"""A slow change of that many standard deviations is a drift like any other."""
_SLIGHT_SHARE = 0.1
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

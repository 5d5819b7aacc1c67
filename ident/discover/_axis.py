"""Everything that is to be said of the error of one axis."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from ._amounts import amount, clean_error, size_of, sizes_of, stability_of
from ._compose import Need, compose
from ._confusion import Look, look_for_confusion
from ._library import Library, library_of
from ._observed import Observed
from ._periodic import find_ripples
from ._result import AxisSummary, Drift, Found, Rejected, Unexplained
from ._select import Selection, select_terms
from ._terms import PUSHES, Kind
from ._unexplained import (
    beyond_kernel,
    confused_ones,
    drifts,
    heat_or_drift,
    is_slight,
    is_slight_drift,
    periodic_one,
    sensors_alike,
    what_is_left,
    which_sensor,
)
from ._view import view_of
from ._wander import Wander, find_wander

_UNSURE = 0.3
"""Share of the resamples from which on a term is named though it is not taken."""


_WORTH_WORDS = 0.25
"""Standard deviations of a reading below which what stays is not spoken of: such as what
is left of a delay that was taken off."""


@dataclasses.dataclass(frozen=True)
class AxisFindings:
    """What the error of one axis asks for."""

    summary: AxisSummary
    found: tuple[Found, ...]
    rejected: tuple[Rejected, ...]
    unexplained: tuple[Unexplained, ...]
    drifts: tuple[Drift, ...] = ()


def examine_axis(observed: Observed, axis: str, axes: tuple[str, ...]) -> AxisFindings:
    """Return which compensations the error of an axis asks for.

    Args:
        observed: All that was measured.
        axis: With a measured error.
        axes: All axes of the machine.
    """
    view = view_of(observed, axis)
    library = library_of(view, axes)
    selection = select_terms(view, library, axes)
    unit = observed.unit(axis)
    sizes = sizes_of(selection)
    made = compose(sizes, view.data.modulo)
    look = look_for_confusion(selection, made.needs, selection.looked)
    doubtful = {id(each.need) for each in look.confused}
    twins = [
        (need, sensors)
        for need in made.needs
        if id(need) not in doubtful and (sensors := sensors_alike(selection, need))
    ]
    doubtful |= {id(need) for need, _ in twins}
    sure = [need for need in made.needs if id(need) not in doubtful]
    wanders = tuple(find_wander(selection, unit))
    # A fit of a group knows of the drift, even if it is the only one.
    overlap = len(sure) > 1 or bool(wanders)
    found = [_found(selection, need, unit, axis if overlap else None) for need in sure]
    found.sort(key=lambda each: -each.share)
    ripples = find_ripples(selection)
    unexplained = [
        *confused_ones(selection, look, unit),
        *(which_sensor(selection, need, names, unit) for need, names in twins),
        *drifts(selection, look, unit),
        *heat_or_drift(selection, made.needs, library.heat, wanders),
        *(
            beyond_kernel(selection, each, unit)
            for each in made.beyond
            if size_of(selection, each.terms)[0] > _WORTH_WORDS * selection.noise
        ),
        *(periodic_one(selection, each, unit) for each in ripples),
        *what_is_left(selection, ripples, unit),
    ]
    rms = float(np.sqrt(np.mean(clean_error(selection) ** 2)))
    rows = int(np.isfinite(observed.error[axis]).sum())
    return AxisFindings(
        AxisSummary(axis, "error", rows, rms, selection.noise, unit),
        tuple(found),
        tuple(_rejected(selection, library, made.needs, look)),
        tuple(unexplained),
        tuple(_drift(each, is_slight(selection, each.rms)) for each in wanders),
    )


def _drift(wander: Wander, slight: bool) -> Drift:
    pieces = "one straight piece"
    if wander.pieces > 1:
        pieces = f"{wander.pieces} straight pieces"
    sentence = (
        f"Beside what was found the error of {wander.axis} wanders in time by"
        f" {amount(wander.rms, wander.unit)} rms, as the zero of an instrument does:"
        f" {pieces} follow{'s' * (wander.pieces == 1)} it."
    )
    if not slight:
        sentence += (
            " That is much for an instrument: something may have warmed whose temperature"
            " was not recorded, or cannot be told from this."
        )
    return Drift(
        wander.axis, wander.source, wander.pieces, wander.rms, wander.unit, sentence
    )


def _found(selection: Selection, need: Need, unit: str, group: str | None) -> Found:
    rms, share = size_of(selection, need.terms)
    axis = selection.view.axis
    over = f" over {' and '.join(need.masters)}" if need.masters else ""
    if need.compensation == "crosstalk":
        over = f" from {need.masters[0]}"
    sentence = f"{need.compensation} of {axis}{over}: {amount(rms, unit)} rms,"
    sentence += f" {share:.0%} of the error. {need.words}"
    return Found(
        need.compensation, axis, need.masters, need.sensor, share, rms,
        stability_of(selection, need.terms), unit, dict(need.keys), group,
        sentence.strip(),
    )  # fmt: skip


_NAMES = {
    Kind.OWN: "leadscrew",
    Kind.REVERSAL: "backlash",
    Kind.LINE: "cross",
    Kind.SURFACE: "plane",
    Kind.HEAT_OFFSET: "temperature",
    Kind.HEAT_SLOPE: "temperature",
    Kind.PUSH: "crosstalk",
}


def _rejected(
    selection: Selection, library: Library, needs: Sequence[Need], look: Look
) -> Iterator[Rejected]:
    """Yield the compensations that are not there, and why each is not."""
    axis = selection.view.axis
    taken = {(need.compensation, need.masters[:1]) for need in needs}
    confused = {each.other for each in look.confused}
    slow = {term for term, _ in selection.drifting}
    held = {term for need in needs for term in need.terms}
    known = dict(zip(selection.design.terms, selection.frequency, strict=True))
    done: set[tuple[str, tuple[str, ...], str | None]] = set()
    for term in selection.looked:
        name = _NAMES.get(term.kind)
        if name is None or term in held or term in confused:
            continue
        if term.kind in PUSHES and (name, term.masters[:1]) in taken:
            continue
        if name in ("temperature", "leadscrew", "backlash", "plane"):
            if any(need.compensation == name for need in needs):
                continue
        key = (name, term.masters, term.sensor)
        if key in done:
            continue
        done.add(key)
        often = float(known.get(term, 0.0))
        reason = "nothing of it in the error"
        if term in slow:
            reason = "a drift of the instrument explains the same"
        elif term in look.hidden:
            reason = "cannot be seen beside what was found: they change together"
        elif often >= _UNSURE:
            reason = f"seen in {often:.0%} of the resamples only"
        elif often > 0:
            reason = "smaller than what is worth a compensation"
        yield Rejected(name, axis, term.masters, term.sensor, reason)
    for need in needs:
        if is_slight_drift(selection, need, look):
            reason = "no more than a drift of the instrument, which changes alike"
            yield Rejected(need.compensation, axis, (), need.sensor, reason)
    for name, masters, why in library.absent:
        yield Rejected(name, axis, masters, None, f"could not be looked for: {why}")

"""Everything that is to be said of the error of one axis."""

from collections.abc import Iterator, Sequence

import numpy as np

from ._columns import Columns
from ._data import AxisSummary, Discovery, Found, Observed, Rejected, Unexplained
from ._doubts import (
    Confusion,
    choose_heat,
    heat_or_drift,
    look_for_confusion,
    sensors_alike,
)
from ._left import amount, drifts, ripples, stays, structure_left
from ._select import Selection, Worth, select_terms
from ._terms import HEAT, Kind, Need, Term, compose
from ._view import Candidates, candidates_of, late_terms, view_of

_UNSURE = 0.3
"""Share of the resamples from which on a term is named though it is not taken."""
_WORTH_WORDS = 0.5
"""Standard deviations of a reading below which what stays is not spoken of: such as what is
left of a delay that was taken off."""
_SINGLE = ("temperature", "leadscrew", "backlash", "plane")
"""Compensations that an axis has once: where one is found, others of it are not spoken of."""


def examine_axis(observed: Observed, axis: str, axes: tuple[str, ...]) -> Discovery:
    """Return which compensations the error of an axis asks for.

    Args:
        observed: All that was measured.
        axis: With a measured error.
        axes: All axes of the machine.
    """
    kept = np.isfinite(observed.error[axis])
    view, worth = view_of(observed, axis, kept), Worth()
    candidates, columns = candidates_of(view, axes), Columns(view)
    terms = candidates.terms
    if candidates.heat:
        terms += choose_heat(columns, terms, candidates.heat, worth)
    found = select_terms(columns, terms, worth)
    more = list(late_terms(view, axes, found.terms))
    if more:
        second = select_terms(columns, [*found.terms, *more], worth, terms)
        if any(term in more for term in second.terms):
            found = second
    sizes = {term: found.size_of([term])[0] for term in found.terms}
    composed = compose(sizes, view.modulo)
    needs = [need for need in composed if need.compensation is not None]
    confusion = look_for_confusion(found, needs, candidates.heat)
    doubts = list(_doubts(found, confusion, needs))
    doubtful = {need for need, _ in doubts}
    rejected = list(_rejected(found, candidates, needs, confusion))
    for need in needs:
        drift = confusion.drift.get(need.terms)
        if drift is not None and drift.slight and not drift.known:
            doubtful.add(need)
            why = "no more than a drift of the instrument, which changes alike"
            rejected.append(Rejected("temperature", axis, (), need.sensor, why))
    sure = [need for need in needs if need not in doubtful]
    wanders, periods = tuple(drifts(found)), list(ripples(found))
    # A fit of a group knows of the drift, even if it is the only one.
    group = axis if len(sure) > 1 or wanders else None
    named = sorted(
        (_found(found, each, group) for each in sure), key=lambda e: -e.share
    )
    unexplained = [each for _, each in doubts]
    for need in composed:
        rms, share = found.size_of(need.terms)
        if need.compensation is None and rms > _WORTH_WORDS * found.noise:
            text = f"{need.words.removesuffix('.')} ({amount(found, rms)} rms)."
            what = need.terms[0].words
            unexplained.append(stays(found, what, need.masters, rms, text, share))
    unexplained += [*periods, *structure_left(found, periods)]
    rms = float(np.sqrt(np.mean(found.clean**2)))
    unit = observed.unit(axis)
    summary = AxisSummary(axis, "error", int(kept.sum()), rms, found.noise, unit)
    return Discovery(
        (summary,), tuple(named), tuple(rejected), tuple(unexplained), wanders
    )


def _found(found: Selection, need: Need, group: str | None) -> Found:
    """Return a compensation that the error asks for."""
    name, axis = str(need.compensation), found.view.axis
    rms, share = found.size_of(need.terms)
    over = f" over {' and '.join(need.masters)}" if need.masters else ""
    if name == "crosstalk":
        over = f" from {need.masters[0]}"
    sentence = f"{name} of {axis}{over}: {amount(found, rms)} rms,"
    sentence += f" {share:.0%} of the error. {need.words}"
    return Found(
        name, axis, need.masters, need.sensor, share, rms,
        found.stability_of(need.terms), found.view.data.unit(axis), dict(need.keys),
        group, sentence.strip(),
    )  # fmt: skip


def _doubts(
    found: Selection, confusion: Confusion, needs: Sequence[Need]
) -> Iterator[tuple[Need | None, Unexplained]]:
    """Yield what several could explain, with the compensation that it would be."""

    def cannot_tell(
        names: Sequence[str], masters: Sequence[str], rms: float, remedy: str
    ) -> Unexplained:
        what = " or ".join(names)
        text = f"The data cannot tell: {what} ({amount(found, rms)} rms). {remedy}"
        return stays(found, what, masters, rms, text, known=False)

    for need, others in confusion.others.items():
        names = [need.terms[0].words, *(each.words for each in others)]
        lines = [each for each in others if each.kind is Kind.LINE]
        if need.compensation == "plane" and lines:
            # A plane gives way to the lines that suffice.
            inside = [term for term in need.terms if term.kind is Kind.LINE]
            names = [term.words for term in dict.fromkeys([*inside, *lines])]
        masters = [*need.masters, *(name for each in others for name in each.masters)]
        rms, remedy = found.size_of(need.terms)[0], _remedy(found, need, others)
        yield need, cannot_tell(names, masters, rms, remedy)
    for terms, drift in confusion.drift.items():
        named = next((each for each in needs if each.terms == terms), None)
        if drift.doubtful and named not in confusion.others:
            what, remedy = heat_or_drift(terms[0].words, found.view.axis)
            yield named, cannot_tell([what], (), drift.rms, remedy)
    for need in needs:
        alike = sensors_alike(found, need)
        if alike and need not in confusion.others:
            names = [f"temperature of {found.view.axis} by {name}" for name in alike]
            remedy = f"{' and '.join(alike)} changed alike; measure once while they do"
            rms, _ = found.size_of(need.terms)
            yield need, cannot_tell(names, (), rms, f"{remedy} not, as after a pause.")


def _remedy(found: Selection, need: Need, others: Sequence[Term]) -> str:
    axis = found.view.axis
    if Kind.SPEED in {each.kind for each in others}:
        return f"Measure {axis} at another feed too, or at standstill."
    if need.compensation == "temperature" or others[0].kind in HEAT:
        return "Measure once more at another temperature, in another order of places."
    axes = {*(need.masters or (axis,)), *others[0].masters}
    names = " and ".join(sorted(axes))
    if len(axes) > 1:
        return f"{names} went together; move them one without the other."
    return f"Measure with other motions of {names}."


def _rejected(
    found: Selection,
    candidates: Candidates,
    needs: Sequence[Need],
    confusion: Confusion,
) -> Iterator[Rejected]:
    """Yield the compensations that are not there, and why each is not."""
    axis = found.view.axis
    taken = {(need.compensation, need.masters[:1]) for need in needs}
    names = {need.compensation for need in needs}
    held = {term for need in needs for term in need.terms}
    held |= {term for others in confusion.others.values() for term in others}
    often = dict(zip(found.design.terms, found.frequency, strict=True))
    slow = {term for terms, each in confusion.drift.items() for term in terms
            if not each.known and each.alike >= 0.9}  # fmt: skip
    reasons: dict[tuple[str, tuple[str, ...], str | None], str] = {}
    for term in found.looked:
        name = term.facts.compensation
        if name is None or term in held or (name in _SINGLE and name in names):
            continue
        if name == "crosstalk" and (name, term.masters[:1]) in taken:
            continue
        share = float(often.get(term, 0.0))
        reason = "nothing of it in the error"
        if term in slow:
            reason = "a drift of the instrument explains the same"
        elif term in confusion.hidden:
            reason = "cannot be seen beside what was found: they change together"
        elif share >= _UNSURE:
            reason = f"seen in {share:.0%} of the resamples only"
        elif share > 0:
            reason = "smaller than what is worth a compensation"
        reasons.setdefault((name, term.masters, term.sensor), reason)
    for (name, masters, sensor), reason in reasons.items():
        yield Rejected(name, axis, masters, sensor, reason)
    for name, masters, why in candidates.absent:
        yield Rejected(name, axis, masters, None, f"could not be looked for: {why}")

"""Everything that is to be said of the error of one axis."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from ._confusion import Confusion, look_for_confusion, sensors_alike
from ._data import AxisSummary, Discovery, Drift, Found, Observed, Rejected, Unexplained
from ._heat import choose_heat, heat_or_drift
from ._left import Ripple, Wander, find_ripples, find_wander, structure_left
from ._select import Columns, Selection, Worth, select_terms
from ._terms import HEAT, Kind, Need, Term, compose
from ._view import Candidates, candidates_of, late_terms, view_of

_UNSURE = 0.3
"""Share of the resamples from which on a term is named though it is not taken."""
_WORTH_WORDS = 0.5
"""Standard deviations of a reading below which what stays is not spoken of: such as what is
left of a delay that was taken off."""
_MOST_NODES = 1000
"""Entries of a table over one position that every build has."""
_SLIGHT, _SLIGHT_SHARE = 2.0, 0.1
"""Scatter of a reading, and share of the error, that the drift of any instrument has."""
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
    view = view_of(observed, axis, kept)
    candidates = candidates_of(view, axes)
    columns = Columns(view, Worth())
    heat: tuple[Term, ...] = ()
    if candidates.heat:
        heat = choose_heat(columns, candidates.terms, candidates.heat)
    found = _selected(columns, (*candidates.terms, *heat), axes)
    sizes = {term: found.size_of([term])[0] for term in found.terms}
    needs, beyond = compose(sizes, view.modulo)
    words = _Words(found, observed.unit(axis))
    confusion = look_for_confusion(found, needs, candidates.heat)
    doubts = [*words.confused(confusion, needs), *words.sensors(confusion, needs)]
    doubtful = {need for need, _ in doubts}
    rejected = list(_rejected(found, candidates, needs, confusion))
    for need in needs:
        drift = confusion.drift.get(need.terms)
        if drift is not None and drift.slight and not drift.known:
            doubtful.add(need)
            why = "no more than a drift of the instrument, which changes alike"
            rejected.append(Rejected(need.compensation, axis, (), need.sensor, why))
    sure = [need for need in needs if need not in doubtful]
    wanders, ripples = list(find_wander(found)), find_ripples(found)
    # A fit of a group knows of the drift, even if it is the only one.
    group = axis if len(sure) > 1 or wanders else None
    named = sorted((words.found(each, group) for each in sure), key=lambda e: -e.share)
    unexplained = [each for _, each in doubts]
    for each in beyond:
        rms, share = found.size_of(each.terms)
        if rms > _WORTH_WORDS * found.noise:
            text = f"{each.sentence.removesuffix('.')} ({words.amount(rms)} rms)."
            first = each.terms[0]
            unexplained.append(words.left(first.words, first.masters, rms, text, share))
    unexplained += [words.periodic(each) for each in ripples]
    extra = structure_left(found, ripples)
    if extra:
        text = (
            f"Another {words.amount(extra)} rms of the error of {axis} is no scatter of"
            " single readings, and nothing that was recorded explains it."
        )
        unexplained.append(words.left(f"rest of the error of {axis}", (), extra, text))
    rms = float(np.sqrt(np.mean(found.clean**2)))
    summary = AxisSummary(axis, "error", int(kept.sum()), rms, found.noise, words.unit)
    drifts = tuple(words.drift(each) for each in wanders)
    return Discovery(
        (summary,), tuple(named), tuple(rejected), tuple(unexplained), drifts
    )


def _selected(
    columns: Columns, terms: tuple[Term, ...], axes: tuple[str, ...]
) -> Selection:
    """Return the terms of an axis, what needs others to make sense looked for last."""
    found = select_terms(columns, terms)
    more = list(late_terms(columns.view, axes, found.terms))
    if more:
        second = select_terms(columns, [*found.terms, *more], found)
        if any(term in more for term in second.terms):
            found = dataclasses.replace(second, looked=terms)
    return found


class _Words:
    """Sentences for a person at the machine."""

    def __init__(self, selection: Selection, unit: str) -> None:
        self.selection, self.unit = selection, unit
        self.axis = selection.view.axis

    def amount(self, rms: float) -> str:
        """Return a length or angle as a person writes it."""
        return f"{1e3 * rms:.2g} {'µm' if self.unit == 'mm' else 'm°'}"

    def found(self, need: Need, group: str | None) -> Found:
        """Return a compensation that the error asks for."""
        rms, share = self.selection.size_of(need.terms)
        over = f" over {' and '.join(need.masters)}" if need.masters else ""
        if need.compensation == "crosstalk":
            over = f" from {need.masters[0]}"
        sentence = f"{need.compensation} of {self.axis}{over}: {self.amount(rms)} rms,"
        sentence += f" {share:.0%} of the error. {need.words}"
        stability = self.selection.stability_of(need.terms)
        return Found(
            need.compensation, self.axis, need.masters, need.sensor, share, rms,
            stability, self.unit, dict(need.keys), group, sentence.strip(),
        )  # fmt: skip

    def left(
        self,
        what: str,
        masters: Sequence[str],
        rms: float,
        sentence: str,
        share: float | None = None,
        known: bool = True,
    ) -> Unexplained:
        """Return what stays: no compensation holds it, or several could (``known`` false)."""
        if share is None:
            share = min(rms**2 / self.selection.square, 1.0)
        return Unexplained(
            self.axis, what, tuple(dict.fromkeys(masters)), rms, share, self.unit,
            "the kernel cannot express this" if known else "the data cannot tell", sentence,
        )  # fmt: skip

    def cannot_tell(
        self, names: Sequence[str], masters: Sequence[str], rms: float, remedy: str
    ) -> Unexplained:
        """Return that the data cannot tell which of several it is."""
        what = " or ".join(names)
        sentence = f"The data cannot tell: {what} ({self.amount(rms)} rms). {remedy}"
        return self.left(what, masters, rms, sentence, known=False)

    def confused(
        self, confusion: Confusion, needs: Sequence[Need]
    ) -> Iterator[tuple[Need | None, Unexplained]]:
        """Yield what several could explain."""
        for need, others in confusion.others.items():
            lines = [each for each in others if each.kind is Kind.LINE]
            names = [need.terms[0].words, *(each.words for each in others)]
            if need.compensation == "plane" and lines:
                # A plane gives way to the lines that suffice.
                inside = [term for term in need.terms if term.kind is Kind.LINE]
                names = [term.words for term in dict.fromkeys([*inside, *lines])]
            masters = [
                *need.masters,
                *(name for each in others for name in each.masters),
            ]
            rms, _ = self.selection.size_of(need.terms)
            remedy = self._remedy(need, others)
            yield need, self.cannot_tell(names, masters, rms, remedy)
        for terms, drift in confusion.drift.items():
            if drift.doubtful:
                named = next((each for each in needs if each.terms == terms), None)
                if named not in confusion.others or named is None:
                    what, remedy = heat_or_drift(terms[0].words, self.axis)
                    yield named, self.cannot_tell([what], (), drift.rms, remedy)

    def _remedy(self, need: Need, others: Sequence[Term]) -> str:
        kinds = {each.kind for each in others}
        if Kind.SPEED in kinds:
            return f"Measure {self.axis} at another feed too, or at standstill."
        if need.compensation == "temperature" or others[0].kind in HEAT:
            return (
                "Measure once more at another temperature, in another order of places."
            )
        axes = {*(need.masters or (self.axis,)), *others[0].masters}
        names = " and ".join(sorted(axes))
        if len(axes) > 1:
            return f"{names} went together; move them one without the other."
        return f"Measure with other motions of {names}."

    def sensors(
        self, confusion: Confusion, needs: Sequence[Need]
    ) -> Iterator[tuple[Need, Unexplained]]:
        """Yield that sensors changed alike, so that any of them may be the one."""
        for need in needs:
            alike = sensors_alike(self.selection, need)
            if alike and need not in confusion.others:
                names = [f"temperature of {self.axis} by {name}" for name in alike]
                remedy = (
                    f"{' and '.join(alike)} changed alike; measure once while they do"
                )
                rms, _ = self.selection.size_of(need.terms)
                yield (
                    need,
                    self.cannot_tell(
                        names, (), rms, f"{remedy} not, as after a pause."
                    ),
                )

    def periodic(self, ripple: Ripple) -> Unexplained:
        """Return a period that a table is too coarse for."""
        rms = float(ripple.amplitude / np.sqrt(2.0))
        own = ripple.master == self.axis
        remedy = f"more than the {_MOST_NODES} that a list has by default."
        if ripple.nodes <= _MOST_NODES:
            kind = "leadscrew" if own else "cross"
            remedy = f"so a {kind} table of that many would hold it."
        sentence = (
            f"The error of {self.axis} repeats every {ripple.period:.4g} {self.unit} of"
            f" {ripple.master} ({self.amount(rms)} rms), finer than a table that follows"
            f" the rest: it takes {ripple.nodes} nodes, {remedy}"
        )
        what = f"periodic error of {self.axis} over {ripple.master}"
        return self.left(what, () if own else (ripple.master,), rms, sentence)

    def drift(self, wander: Wander) -> Drift:
        """Return a slow change in time, and whether it is much for an instrument."""
        pieces = f"{wander.pieces} straight pieces follow it."
        if wander.pieces == 1:
            pieces = "one straight piece follows it."
        sentence = (
            f"Beside what was found the error of {self.axis} wanders in time by"
            f" {self.amount(wander.rms)} rms, as the zero of an instrument does: {pieces}"
        )
        size = _SLIGHT_SHARE * np.sqrt(self.selection.square)
        if wander.rms >= max(_SLIGHT * self.selection.noise, size):
            sentence += (
                " That is much for an instrument: something may have warmed whose"
                " temperature was not recorded, or cannot be told from this."
            )
        return Drift(
            self.axis, wander.source, wander.pieces, wander.rms, self.unit, sentence
        )


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

"""The headline of a fit: its verdict in one sentence, ready to act on."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ..job import (
    AbstractResult,
    Code,
    ErrorFigures,
    Judgement,
    MeasuredAgain,
    Reason,
    TableResult,
    Verdict,
)
from ._scale import Scale, percent

_DOES = {
    "sign": "the list doubles the error: sign. Controller or instrument counts the other"
    " way round than assumed",
    "unit": "the unit of the list is wrong",
    "shift": "the table is applied at another place",
    "twice": "the list is applied twice",
    "swapped": "each direction of motion gets what belongs to the other. Either the"
    " controller, or the directions of one of the two measurements, is the other way round",
    "other": "the list adds something else than it says",
    "wrong axis": "the list acts on another axis, follows another one, or is not active",
}
"""What a diagnosis means for the person who loaded the list."""


@dataclasses.dataclass(frozen=True)
class Headline:
    """One sentence on a fit; ``level`` is good, warn or bad, ``word`` stands in tables."""

    level: str
    word: str
    sentence: str


_STEADY = 0.5
"""Range in °C of a temperature that stayed as it was."""
_BETTER = 0.9
"""Error left, in that before, up to which it is called better."""
_LOOK = {
    Verdict.GOOD: ("good", "good", "ready"),
    Verdict.UNPROVEN: ("warn", "unproven", "unproven"),
    Verdict.UNDETERMINED: ("bad", "stop", "not determined"),
    Verdict.REJECTED: ("bad", "stop", "do not load"),
}
"""Level and word of each verdict, and what stands for it in one line over several fits."""
_DOUBTS = {Code.NO_GAIN: "no gain shown", Code.NO_EFFECT: "no effect shown"}
"""The same for fits without a gain to prove, by their first reason."""


def headline_of(fit: AbstractResult, scale: Scale) -> Headline:
    """Return the headline that stands at the top of a fit's section."""
    judgement = fit.judgement
    level, word, _ = _LOOK[judgement.verdict]
    if not judgement.reasons:
        return Headline(level, word, f"Ready to load: {_fall(fit, scale)}.")
    reason = judgement.reasons[0]
    return Headline(level, word, _SENTENCES[reason.code](fit, scale, reason))


def short_verdict(judgement: Judgement) -> str:
    """Return a verdict in a few words, for one line over several fits."""
    short = _LOOK[judgement.verdict][2]
    if judgement.verdict is not Verdict.UNPROVEN:
        return short
    if judgement.waits:
        return "computed; sign unproven"
    return _DOUBTS.get(judgement.reasons[0].code, short)


@dataclasses.dataclass(frozen=True)
class Front:
    """What the page says first of the whole job.

    Attributes:
        level: good, warn or bad: the worst of its fits.
        verdicts: Each verdict in words, worst first, and the fits that have it.
        unproven: Rules of the controller that written lists rest on and that no
            measurement has settled; empty where all are.
        loads: A list is worth the steps of the load sheet.
    """

    level: str
    verdicts: tuple[tuple[str, str], ...]
    unproven: str
    loads: bool


def front_of(fits: Sequence[tuple[str, AbstractResult]], worst: Verdict) -> Front:
    """Return what the page says first; ``fits`` are pairs of a heading and a result."""
    verdicts: dict[str, list[str]] = {}
    unproven: dict[str, None] = {}
    order = [*reversed(Verdict)]
    for heading, fit in sorted(fits, key=lambda p: order.index(p[1].judgement.verdict)):
        judgement = fit.judgement
        words = short_verdict(judgement)
        if judgement.has(Code.VERIFIED):
            words = "verified"
        verdicts.setdefault(words.capitalize(), []).append(heading)
        for reason in judgement.reasons:
            if reason.code is Code.ASSUMED and judgement.waits:
                unproven |= dict.fromkeys(reason.fields["conventions"])
    level = _LOOK[worst][0]
    summary = tuple((words, "; ".join(names)) for words, names in verdicts.items())
    names = ", ".join(name.replace("_", " ") for name in unproven)
    loads = any(fit.files and not fit.judgement.has(Code.NO_GAIN) for _, fit in fits)
    return Front(level, summary, names, loads)


_APART = 10.0
"""Times the scatter of a reading from which on runs that lie apart have zeros of their own."""
_NO_GAIN = {
    "run": " What was measured is scatter, drift, or runs that contradict each other, which no"
    " table takes away.",
    # A block that is left out takes all readings of its nodes with it: that shows what the
    # surroundings tell of a place, not whether the place would repeat.
    "block": " It is scatter, or an error that changes from node to node, which its"
    " surroundings do not tell: repeated runs would tell which.",
}
"""Why readings of a table would not have gained, by what was left out together."""


def _gate(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    names = ", ".join(
        f"{c.name.replace('_', ' ')} {c.value:.4g} {c.unit} (limit {c.limit:.4g})"
        for c in fit.gate
        if not c.passed
    )
    return f"Do not load: the gate stopped this list. {names}."


def _error(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    message = str(reason.fields["message"])
    return message if fit.left_out else f"Do not load yet: {message}"


def _no_gain(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    second = "" if fit.again is None else f"; {_again(fit, scale)}"
    explanation = ""
    if isinstance(fit, TableResult):
        explanation = _NO_GAIN[fit.held_out]
        offsets = [run.offset for run in fit.fit.runs]
        apart = max(offsets, default=0.0) - min(offsets, default=0.0)
        if apart > _APART * fit.fit.noise:
            sides = "; where they came from different sides, state their direction"
            explanation = (
                f" Its runs lie up to {scale.shown(apart)} apart: where each had"
                " a zero of its own, give it as a measurement of its own, with remove ="
                f' "offset"{sides if fit.fit.layout.branches == 1 else ""}.'
            )
    start = "Nothing shows yet that this list helps"
    if fit.judgement.verdict is Verdict.REJECTED:
        start = "This list would not help, do not load it"
    return f"{start}: {_fall(fit, scale)}{second}.{explanation}"


def _assumed(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    names = ", ".join(reason.fields["conventions"])
    if fit.again is not None:
        diagnosis = fit.again.diagnosis
        explanation = "it was not judged" if diagnosis is None else diagnosis.sentence
        return (
            f"Computed; sign unproven: {_again(fit, scale)}, yet {names} stays assumed:"
            f" {explanation}."
        )
    return (
        f"Computed; sign unproven: {_fall(fit, scale)}. No measurement has settled {names}:"
        " begin with the first step of the load sheet."
    )


def _diagnosed(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    assert fit.again is not None  # it made the diagnosis
    words = _diagnosis_of(fit.again)
    if fit.judgement.verdict is not Verdict.REJECTED:
        file, date = fit.again.source["file"], fit.again.source["date"]
        unseen = {} if fit.again.readings is None else fit.again.readings.unseen
        saw = " and ".join(_saw(fit, unseen))
        source = f"({file}, {date}){saw and f', which {saw}'}"
        doubt = " A slope may be all that the list adds: what is left is no proof."
        doubt *= "slope" in unseen
        return f"Not verified by a second measurement {source}{words}.{doubt}"
    does = _DOES[str(reason.fields["verdict"])]
    return f"Take the list out again: {does}{words}; {_again(fit, scale)}."


def _no_better(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    assert fit.again is not None  # its figures make the reason
    words = _diagnosis_of(fit.again)
    if fit.again.trend is not None:
        words = _moved(fit, scale, "Before it goes in again, find")
    found = _again(fit, scale)
    return f"Take the list out again: {found}, no better than before{words}."


def _moved(fit: AbstractResult, scale: Scale, find: str) -> str:
    """Return that a constant and slopes are all that is left more than predicted."""
    assert fit.again is not None  # its readings have them
    assert fit.again.trend is not None
    if fit.again.trend.fault:
        return (
            f". Unless {fit.axis} moved since by that (its temperature, or the zero of the"
            " instrument), take the other flank as the right one, and measure again"
        )
    return (
        f": without it {scale.shown(fit.again.trend.rest)} would be left, as"
        f" predicted. {find} what moved {fit.axis} since: its temperature, or the zero of the"
        " instrument"
    )


def _beside(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    again, compensations = fit.again, " and ".join(reason.fields["compensations"])
    assert again is not None  # it found them
    start, words = "Right by itself, as a part of", ""
    if not again.acts:
        start, words = "Not known yet, as one part of", _diagnosis_of(again)
    return (
        f"{start} what moves {fit.axis}: {_again(fit, scale)}, since"
        f" the {compensations} of {fit.axis} is wrong{words}. Mend that, and measure again."
    )


def _unowned(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    assert fit.again is not None  # it found them
    return (
        f"Not verified yet: {_again(fit, scale)}: state in {fit.again.source['file']} whose"
        " they are (datum or remove, as in the first job), and evaluate it once more."
    )


def _near(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    assert fit.again is not None  # it made the diagnosis
    return (
        f"Verified but for one place: {_fall(fit, scale)}; {_again(fit, scale)}"
        f"{_diagnosis_of(fit.again)}: measure near {reason.fields['where']} again."
    )


def _in_part(fit: AbstractResult, scale: Scale, reason: Reason) -> str:
    fields, ask = reason.fields, "measure again what it did not see"
    clauses = _saw(fit, fields)
    if "zero" in fields:
        clauses.append(
            f"does not show where {fit.axis} as a whole lies (remove, datum), so that"
            f" {fields['zero']} stays assumed"
        )
        ask = "measure again with one zero before and after, without remove and datum"
    elif {*fields} == {"slope"}:
        ask = "measure again with an instrument whose line is known, without remove"
    return (
        f"Verified in part: {_fall(fit, scale)}; {_again(fit, scale)}, which"
        f" {' and '.join(clauses)}: {ask}."
    )


def _saw(fit: AbstractResult, fields: Mapping[str, Any]) -> list[str]:
    """Return what a second measurement saw only, or did not see, as clauses."""
    unit, where, clauses = "°" if fit.unit == "deg" else "mm", [], []
    if "axis" in fields:
        low, high = (f"{fields[name]:.4g}" for name in ("low", "high"))
        place = f"at {low}" if low == high else f"from {low} to {high}"
        where.append(f"{fields['axis']} {place} {unit}")
    if "warmth" in fields:
        sensor, low, high = fields["warmth"]
        between = f"{low:.4g} to {high:.4g}" if high - low > _STEADY else f"{high:.4g}"
        where.append(f"{sensor} at {between} °C")
    if "direction" in fields:
        where.append(f"motion in {'+' if fields['direction'] > 0 else '−'} direction")
    if where:
        clauses.append(f"saw {' and '.join(where)} only")
    if "gap" in fields:
        axis, low, high = fields["gap"]
        clauses.append(f"saw nothing of {axis} between {low:.4g} and {high:.4g} {unit}")
    if "slope" in fields:
        over = " and ".join(fields["slope"])
        clauses.append(f'shows no slope over {over} (remove = "line")')
    return clauses


def _less_than_predicted(fit: AbstractResult, scale: Scale, _: Reason) -> str:
    again = fit.again
    assert again is not None  # the reason comes from it
    assert again.rms is not None
    better = again.rms <= _BETTER * again.before
    start = "Better, but less than predicted" if better else "Hardly any better"
    fall = _fall(fit, scale)
    if fit.group is not None:  # what was measured again is under all of its lists
        before, predicted = scale.figure(again.before), scale.shown(again.predicted)
        fall = (
            f"the error of {fit.axis} was to fall from {before} to {predicted} rms with all"
            " lists of its group"
        )
    words = _diagnosis_of(again)
    if again.trend is not None and again.acts:
        words += _moved(fit, scale, "Find")
    return f"{start}: {fall}; {_again(fit, scale)}{words}."


def _verified(fit: AbstractResult, scale: Scale, _: Reason) -> str:
    return f"Verified: {_fall(fit, scale)}; {_again(fit, scale)}."


def _nothing_written(fit: AbstractResult, scale: Scale, _: Reason) -> str:
    fall = _fall(fit, scale, listed=False)
    return f"Nothing to load, no list was asked for or needed: {fall}."


def _no_effect(fit: AbstractResult, scale: Scale, _: Reason) -> str:
    left = fit.error.get("before")
    size = "" if left is None else f" ({_size(left.sound, scale)}, about its median)"
    return (
        f"Nothing to load: no effect of the {fit.compensation} shows. The error of {fit.axis}"
        f" that remains{size} has another cause; axcomp discover looks for it."
    )


_SENTENCES: dict[Code, Callable[[AbstractResult, Scale, Reason], str]] = {
    Code.GATE: _gate,
    Code.ERROR: _error,
    Code.NOTHING_WRITTEN: _nothing_written,
    Code.NO_EFFECT: _no_effect,
    Code.NO_GAIN: _no_gain,
    Code.ASSUMED: _assumed,
    Code.DIAGNOSED: _diagnosed,
    Code.NO_BETTER: _no_better,
    Code.LESS_THAN_PREDICTED: _less_than_predicted,
    Code.BESIDE: _beside,
    Code.UNOWNED: _unowned,
    Code.NEAR: _near,
    Code.IN_PART: _in_part,
    Code.VERIFIED: _verified,
}
"""The first reason of a verdict in a sentence: with the fall of the error, and what a second
measurement found."""


def _diagnosis_of(again: MeasuredAgain) -> str:
    return "" if again.diagnosis is None else f" ({again.diagnosis.sentence})"


def _again(fit: AbstractResult, scale: Scale) -> str:
    second = fit.again
    assert second is not None  # the reasons that ask for it come from it
    source = f"{second.source['file']}, {second.source['date']}"
    text = f"a second measurement with the list active ({source})"
    if second.rms is None:
        return f"{text} shows what it does"
    mostly = "" if second.trend is None else f", nearly all of it {second.trend.words}"
    beyond = "" if second.readings is None else second.readings.beyond
    mostly += f" ({beyond})" if beyond else ""
    return f"{text} found {scale.shown(second.rms)} rms{mostly}"


def _fall(fit: AbstractResult, scale: Scale, listed: bool = True) -> str:
    before, after = fit.error.get("before"), fit.error.get("predicted")
    if before is None:
        return "nothing was predicted"
    before = before.sound
    seen = "events" if fit.held_out == "event" else "readings"
    error = fit.subject
    if fit.group is not None:
        error = f"what the rest of its group leaves of {error}"
    start = f"{error} is {_size(before, scale)}"
    if after is None:
        return f"{start}; nothing was predicted"
    after = after.sound
    end = _size(after, scale)
    if before.rms > 0 and after.rms < before.rms:
        return (
            f"on {seen} that the fit did not see, {error} falls from "
            f"{_size(before, scale)} to {end}, by {percent(1 - after.rms / before.rms)}"
        )
    return f"{start}, and {end} are predicted with the list" if listed else start


def _size(figures: ErrorFigures, scale: Scale) -> str:
    return f"{scale.shown(figures.rms)} rms (largest {scale.shown(figures.max)})"

"""The verdict on a fit as data: what is known of its list, and by what."""

import dataclasses
import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ._second import LESS

if TYPE_CHECKING:
    from ._result import AbstractResult

NO_GAIN = 0.98
"""Share of the error before that a list must undercut to count as a gain."""


GAIN = "gain"
"""The line of the gate that fails where readings held out would get plainly worse."""


class Verdict(enum.StrEnum):
    """What is known of the list of a fit, from best to worst."""

    GOOD = "good"
    UNPROVEN = "unproven"
    UNDETERMINED = "undetermined"
    REJECTED = "rejected"


class Code(enum.StrEnum):
    """Why a verdict is what it is; the fields of the reason are given in brackets."""

    GATE = "gate"
    """Checks failed [checks]."""
    ERROR = "error"
    """The job says so itself [message]."""
    NOTHING_WRITTEN = "nothing_written"
    """There is no list to load."""
    NO_EFFECT = "no_effect"
    """A list was asked for, and the readings show nothing that it would correct."""
    NO_GAIN = "no_gain"
    """Readings held out would not have gained by it; rejected where repeated runs show that they
    would plainly lose."""
    ASSUMED = "assumed"
    """Signs or owners that no measurement has settled [conventions]."""
    DIAGNOSED = "diagnosed"
    """The second measurement shows what the list does instead, or shows nothing sure
    [verdict, value]."""
    NO_BETTER = "no_better"
    """With the list active the error is no smaller than before."""
    LESS_THAN_PREDICTED = "less_than_predicted"
    """With the list active the error is smaller, by less than predicted."""
    BESIDE = "beside"
    """Another list of the axis does not do what it says [compensations], and this one does, or what
    is left does not tell."""
    UNOWNED = "unowned"
    """With the list active a constant or slope is left, and its job does not say whose
    [words]."""
    NEAR = "near"
    """It does what it says, but at one place [where]."""
    IN_PART = "in_part"
    """The second measurement saw a part of the travel only [axis, low, high], or one direction
    [direction], or some temperatures only [warmth: sensor, low, high], or nothing between two
    places [gap: axis, low, high], or no slope [slope: axes], or not where the axis as a whole
    lies [zero: the convention that says it]."""
    VERIFIED = "verified"
    """The second measurement shows what was predicted [file, sha256, date]."""


@dataclasses.dataclass(frozen=True)
class Reason:
    """One reason of a verdict, with the fields of its code."""

    code: Code
    fields: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def as_tree(self) -> dict[str, Any]:
        """Return it as result.json has it."""
        return {"code": str(self.code), **self.fields}


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Verdict and reasons of a fit, the weightiest reason first."""

    verdict: Verdict
    reasons: tuple[Reason, ...] = ()

    def has(self, code: Code) -> bool:
        """Return whether it rests on a reason."""
        return any(reason.code is code for reason in self.reasons)

    @property
    def waits(self) -> bool:
        """Whether a list that promises a gain waits for its sign or owner to be settled."""
        return self.has(Code.ASSUMED) and not self.has(Code.NO_GAIN)


def judgement_of(fit: "AbstractResult") -> Judgement:
    """Return the verdict on a fit, with what a second measurement says where there is one."""
    failed = [check.name for check in fit.gate if not check.passed]
    if failed == [GAIN]:
        return Judgement(Verdict.REJECTED, (Reason(Code.NO_GAIN),))
    if failed:
        return Judgement(Verdict.REJECTED, (Reason(Code.GATE, {"checks": failed}),))
    errors = [remark.message for remark in fit.remarks if remark.level == "error"]
    if errors:
        unwritten = fit.left_out or not fit.files
        verdict = Verdict.UNDETERMINED if unwritten else Verdict.REJECTED
        return Judgement(verdict, (Reason(Code.ERROR, {"message": errors[0]}),))
    if not fit.files and fit.no_effect:
        return Judgement(Verdict.UNPROVEN, (Reason(Code.NO_EFFECT),))
    if not fit.files:
        return Judgement(Verdict.GOOD, (Reason(Code.NOTHING_WRITTEN),))
    if (fault := _fault_measured(fit)) is not None:
        return Judgement(Verdict.REJECTED, (fault,))
    reasons = _doubts(fit)
    acts = fit.again is not None and fit.again.acts
    assumed = [
        rule.name
        for rule in fit.rules
        if rule.decides and rule.state == "assumed"
        # What a list does is seen; where the axis as a whole lies is not asked then.
        if not (acts and rule.decides == "zero")
    ]
    if assumed:
        reasons.append(Reason(Code.ASSUMED, {"conventions": assumed}))
    # Without figures of its own only a diagnosis can verify.
    unseen = fit.again is not None and fit.again.rms is None and not acts
    told = any(reason.code is Code.DIAGNOSED for reason in reasons)
    if fit.again is not None and (assumed or unseen) and not told:
        fields = {"verdict": fit.again.verdict, "value": None}
        reasons.append(Reason(Code.DIAGNOSED, fields))
    if reasons:
        return Judgement(Verdict.UNPROVEN, tuple(reasons))
    if fit.again is None:
        return Judgement(Verdict.GOOD)
    return Judgement(Verdict.GOOD, (Reason(Code.VERIFIED, fit.again.source),))


def _fault_measured(fit: "AbstractResult") -> Reason | None:
    """Return the fault that the second measurement shows, or None."""
    again = fit.again
    if again is None:
        return None
    excused = bool(again.beside) or (again.trend is not None and not again.trend.owned)
    if again.is_misread and (diagnosis := again.diagnosis) is not None:
        fields = {"verdict": diagnosis.verdict, "value": diagnosis.value}
        return Reason(Code.DIAGNOSED, fields)
    # Where no gain was promised only what is plainly worse speaks against the list.
    ratio = NO_GAIN if again.predicted < NO_GAIN * again.before else LESS
    if not excused and again.rms is not None and again.rms >= ratio * again.before:
        return Reason(Code.NO_BETTER)
    return None


def _doubts(fit: "AbstractResult") -> list[Reason]:
    """Return what figures leave open, the predicted ones and those measured again."""
    before, predicted = fit.error["before"].sound, fit.error["predicted"].sound
    again = fit.again
    if predicted.rms >= NO_GAIN * before.rms:
        return [Reason(Code.NO_GAIN)]
    if again is None:
        return []
    if again.beside:
        return [Reason(Code.BESIDE, {"compensations": again.beside})]
    if again.trend is not None and not again.trend.owned:
        return [Reason(Code.UNOWNED, {"words": again.trend.words})]
    if again.diagnosis is not None and again.diagnosis.near:
        return [Reason(Code.NEAR, {"where": again.diagnosis.near})]
    if again.readings is None:
        return []
    if again.readings.figures.sound.rms > LESS * again.predicted:
        return [Reason(Code.LESS_THAN_PREDICTED)]
    if again.readings.near:
        return [Reason(Code.NEAR, {"where": again.readings.near})]
    unseen = again.readings.unseen
    if unseen and not again.acts:  # what they do not show may be all that it adds
        return [Reason(Code.DIAGNOSED, {"verdict": again.verdict, "value": None})]
    return [Reason(Code.IN_PART, unseen)] if unseen else []

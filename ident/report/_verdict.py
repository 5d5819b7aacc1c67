"""The verdict at the top of a fit's section: one sentence, ready to act on."""

import dataclasses

from ..job import AbstractResult, ErrorFigures
from ._scale import Scale, percent
from ._second import SecondMeasurement


@dataclasses.dataclass(frozen=True)
class Verdict:
    """One sentence on a fit; ``level`` is good, warn or bad."""

    level: str
    sentence: str


def verdict_of(
    fit: AbstractResult, scale: Scale, second: SecondMeasurement | None
) -> Verdict:
    """Return the verdict that stands at the top of a fit's section."""
    failed = [check for check in fit.gate if not check.passed]
    loud = [remark for remark in fit.remarks if remark.level == "error"]
    numbers = _fall(fit, scale)
    if failed:
        names = ", ".join(
            f"{check.name.replace('_', ' ')} {check.value:.4g} {check.unit} "
            f"(limit {check.limit:.4g})"
            for check in failed
        )
        return Verdict("bad", f"Do not load: the gate stopped this list. {names}.")
    if fit.left_out and loud:
        return Verdict("bad", loud[0].message)
    if loud:
        return Verdict("bad", f"Do not load yet: {loud[0].message}")
    before, after = fit.error.get("before"), fit.error.get("predicted")
    if before and after and after.sound.rms >= 0.98 * before.sound.rms:
        return Verdict("warn", f"This list would not help: {numbers}.")
    if second is None and fit.verified_by is None:
        return Verdict(
            "good",
            f"Ready to load: {numbers}. Computed; not yet verified by a second "
            "measurement.",
        )
    if second is None:
        return Verdict(
            "good", f"Ready to load: {numbers}; verified by {fit.verified_by}."
        )
    return _verified(fit, scale, second, numbers)


def _verified(
    fit: AbstractResult, scale: Scale, second: SecondMeasurement, numbers: str
) -> Verdict:
    seen = second.figures.sound.rms
    before = fit.error["before"].sound.rms
    after = fit.error["predicted"].sound.rms
    found = (
        f"a second measurement with the list active ({second.name}) found "
        f"{scale.figure(seen)} {scale.error} rms"
    )
    if seen >= 0.98 * before:
        return Verdict(
            "bad", f"Take the list out again: {found}, no better than before."
        )
    if seen > 1.5 * after:
        return Verdict("warn", f"Better, but less than predicted: {numbers}; {found}.")
    return Verdict("good", f"Verified: {numbers}; {found}.")


def _fall(fit: AbstractResult, scale: Scale) -> str:
    before, after = fit.error.get("before"), fit.error.get("predicted")
    unit = scale.error
    if before is None:
        return "nothing was predicted"
    before = before.sound
    error = f"the error of {fit.axis}"
    if fit.group is not None:
        error = f"what the rest of its group leaves of {error}"
    start = f"{error} is {_size(before, scale)}"
    if after is None:
        return f"{start}; nothing was predicted"
    after = after.sound
    end = f"{scale.figure(after.rms)} {unit} rms (largest "
    end += f"{scale.figure(after.max)} {unit})"
    if before.rms > 0 and after.rms < before.rms:
        return (
            f"on readings that the fit did not see, {error} falls from "
            f"{_size(before, scale)} to {end}, by {percent(1 - after.rms / before.rms)}"
        )
    return f"{start}, and {end} are predicted with the list"


def _size(figures: ErrorFigures, scale: Scale) -> str:
    return (
        f"{scale.figure(figures.rms)} {scale.error} rms (largest "
        f"{scale.figure(figures.max)} {scale.error})"
    )

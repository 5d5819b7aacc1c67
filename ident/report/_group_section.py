"""A group of fits that were identified together, as a section of the page."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..job import Code, Remark
from ._body import Plot
from ._group_plots import share_plot, sum_plot
from ._scale import count, number, percent, scale_of
from ._section import Section

if TYPE_CHECKING:
    from ..job import AxisSum, GroupResult

_LEVELS = {"error": 0, "warning": 1, "info": 2}


@dataclasses.dataclass(frozen=True)
class SumRow:
    """One axis in the table of the sum, ready to print; all in ``unit``."""

    axis: str
    before: str
    predicted: str
    from_file: str
    noise: str
    largest: str
    unit: str


@dataclasses.dataclass(frozen=True)
class EffectRow:
    """One effect in the table of effects, ready to print."""

    name: str
    anchor: str
    size: str
    information: str
    written: bool
    why: str


@dataclasses.dataclass(frozen=True)
class GroupSection:
    """Everything that the page says of one group."""

    name: str
    heading: str
    level: str
    sentence: str
    remarks: tuple[Remark, ...]
    sums: tuple[SumRow, ...]
    effects: tuple[EffectRow, ...]
    plots: tuple[Plot, ...]
    lost: tuple[tuple[str, str], ...]
    free: tuple[tuple[str, str], ...]
    facts: tuple[tuple[str, str], ...]


def group_section(
    group: "GroupResult", place: int, sections: Sequence[Section]
) -> GroupSection:
    """Return the section of a group; ``place`` counts the groups from 1.

    Args:
        group: What the job found.
        place: Of the group.
        sections: Of all fits, in the order of the job.
    """
    missing = [each for each in group.effects if each.index is not None and each.why]
    own = [sections[index] for index in group.fits]
    proven = all(section.verdict.level == "good" for section in own)
    level = "warn" if missing or group.lost or not proven else "good"
    return GroupSection(
        name=f"group-{place}",
        heading=f"Identified together: group {group.name}",
        level=level,
        sentence=_opening(own) + _sentence(group, len(missing)),
        remarks=tuple(sorted(group.remarks, key=lambda r: _LEVELS.get(r.level, 3))),
        sums=tuple(_sum_row(one) for one in group.axes),
        effects=tuple(_effect_rows(group, sections)),
        plots=(share_plot(group), sum_plot(group)),
        lost=tuple((" and ".join(each.effects), each.sentence) for each in group.lost),
        free=tuple(
            (" and ".join(each.effects), f"{each.sentence} {each.rule}")
            for each in group.freedoms
        ),
        facts=tuple(_facts(group)),
    )


def _opening(sections: Sequence[Section]) -> str:
    """Return what the verdicts on the fits say of the group as a whole."""
    if any(section.fit.judgement.has(Code.ASSUMED) for section in sections):
        return "Computed; signs unproven. "
    return ""


def _sentence(group: "GroupResult", missing: int) -> str:
    parts = []
    for one in group.axes:
        scale = scale_of(one.unit)
        before, after = one.error["before"].sound.rms, one.error["predicted"].sound.rms
        words = (
            f"the error of {one.axis} falls from {scale.figure(before)} to"
            f" {scale.figure(after)} {scale.error} rms"
        )
        if after >= before:
            words = (
                f"the error of {one.axis} stays at {scale.figure(before)} {scale.error}"
                " rms"
            )
        parts.append(words)
    text = f"On readings that the fit did not see, {'; '.join(parts)}."
    fits = count(len(group.fits), "fit")
    if missing:
        text += f" {missing} of {fits} cannot be told from these readings as asked for."
    else:
        text += f" {fits[0].upper()}{fits[1:]} in one."
    return text


def _sum_row(one: "AxisSum") -> SumRow:
    scale = scale_of(one.unit)
    error = one.error
    return SumRow(
        axis=one.axis,
        before=scale.figure(error["before"].sound.rms),
        predicted=scale.figure(error["predicted"].sound.rms),
        from_file=scale.figure(error["from_file"].sound.rms),
        noise=scale.figure(one.noise),
        largest=scale.figure(error["predicted"].sound.max),
        unit=scale.error,
    )


def _effect_rows(group: "GroupResult", sections: Sequence[Section]) -> list[EffectRow]:
    units = {one.axis: scale_of(one.unit) for one in group.axes}
    rows = []
    for each in group.effects:
        scale = units.get(each.axis, scale_of("mm"))
        rows.append(
            EffectRow(
                name=each.name[:1].upper() + each.name[1:],
                anchor="" if each.index is None else sections[each.index].name,
                size=f"{number(each.rms * scale.factor)} {scale.error}",
                information=percent(each.information),
                written=each.written,
                why=each.why,
            )
        )
    return rows


def _facts(group: "GroupResult") -> Iterator[tuple[str, str]]:
    what = "run" if group.held_out == "run" else "stretch of the recording"
    yield (
        "Held out",
        f"A whole {what} at a time; all effects are fitted anew without it, and the"
        " whole sum is compared with what was read there.",
    )
    for one in group.axes:
        scale = scale_of(one.unit)
        words = f"{count(int(one.rows.size), 'reading')}"
        if one.wild.any():
            words += f", {int(one.wild.sum())} of them wild"
        if one.runs:
            largest = max(abs(run.offset) for run in one.runs)
            words += (
                f"; offsets of {count(len(one.runs), 'run')} up to"
                f" {number(largest * scale.factor)} {scale.error}"
            )
        yield (f"Readings of {one.axis}", f"{words}.")
    yield ("The fit itself", group.message)

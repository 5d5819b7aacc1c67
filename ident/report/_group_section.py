"""A group of fits that were identified together, as a section of the page."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..job import Code, Remark, by_level
from ._body import Plot
from ._group_plots import share_plot, sum_plot
from ._scale import Scale, count, scale_of
from ._section import Section

if TYPE_CHECKING:
    from ..job import GroupResult


@dataclasses.dataclass(frozen=True)
class GroupSection:
    """Everything that the page says of one group."""

    name: str
    heading: str
    level: str
    sentence: str
    remarks: tuple[Remark, ...]
    plots: tuple[Plot, ...]
    facts: tuple[tuple[str, str], ...]
    group: "GroupResult"

    @property
    def scales(self) -> dict[str, Scale]:
        """Display units by axis."""
        return {one.axis: scale_of(one.unit) for one in self.group.axes}


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
    assumed = any(one.fit.judgement.has(Code.ASSUMED) for one in own)
    opening = "Computed; signs unproven. " if assumed else ""
    level = "warn" if missing or group.lost or not proven else "good"
    return GroupSection(
        name=f"group-{place}",
        heading=f"Identified together: group {group.name}",
        level=level,
        sentence=opening + _sentence(group, len(missing)),
        remarks=by_level(group.remarks),
        plots=(share_plot(group), sum_plot(group)),
        facts=tuple(_facts(group)),
        group=group,
    )


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
                f" {scale.shown(largest)}"
            )
        yield (f"Readings of {one.axis}", f"{words}.")
    yield ("The fit itself", group.message)

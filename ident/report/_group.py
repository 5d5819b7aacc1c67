"""A group of fits that were identified together, as a section of the page: words and pictures.

How much each effect is, and what the whole sum leaves.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from ..job import Remark, by_level
from . import _style as style
from ._body import Plot
from ._scale import Scale, count, scale_of
from ._section import Section
from .table._fitted import bin_means, say_drawn

if TYPE_CHECKING:
    from ..job import AxisSum, GroupResult

_SLICES = 24


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
        return {axis_sum.axis: scale_of(axis_sum.unit) for axis_sum in self.group.axes}


def group_section(
    group: "GroupResult", place: int, sections: Sequence[Section]
) -> GroupSection:
    """Return the section of a group; ``place`` counts the groups from 1.

    `sections` are those of all fits, in the order of the job.
    """
    unidentified = [one for one in group.effects if one.index is not None and one.why]
    members = [sections[index] for index in group.fits]
    proven = all(section.verdict.level == "good" for section in members)
    assumed = any(section.fit.judgement.waits for section in members)
    opening = "Computed; signs unproven. " if assumed else ""
    level = "warn" if unidentified or group.confusions or not proven else "good"
    return GroupSection(
        name=f"group-{place}",
        heading=f"Identified together: group {group.name}",
        level=level,
        sentence=opening + _sentence(group, len(unidentified)),
        remarks=by_level(group.remarks),
        plots=(sum_plot(group),),
        facts=tuple(_facts(group)),
        group=group,
    )


def _sentence(group: "GroupResult", missing: int) -> str:
    parts = []
    for axis_sum in group.axes:
        scale = scale_of(axis_sum.unit)
        before, after = (axis_sum.error[k].sound.rms for k in ("before", "predicted"))
        words = (
            f"the error of {axis_sum.axis} falls from {scale.figure(before)} to"
            f" {scale.figure(after)} {scale.error} rms"
        )
        if after >= before:
            words = f"the error of {axis_sum.axis} stays at {scale.shown(before)} rms"
        parts.append(words)
    text = f"On readings that the fit did not see, {'; '.join(parts)}."
    fits = count(len(group.fits), "fit")
    if missing:
        text += f" {missing} of {fits} cannot be told from these readings as asked for."
    else:
        text += f" {fits[0].upper()}{fits[1:]} in one."
    return text


def _facts(group: "GroupResult") -> Iterator[tuple[str, str]]:
    for axis_sum in group.axes:
        scale = scale_of(axis_sum.unit)
        words = f"{count(int(axis_sum.rows.size), 'reading')}"
        if axis_sum.wild.any():
            words += f", {int(axis_sum.wild.sum())} of them wild"
        if axis_sum.runs:
            largest = max(abs(run.offset) for run in axis_sum.runs)
            words += (
                f"; offsets of {count(len(axis_sum.runs), 'run')} up to"
                f" {scale.shown(largest)}"
            )
        yield (f"Readings of {axis_sum.axis}", f"{words}.")
    yield ("The fit itself", group.message)


def sum_plot(group: "GroupResult") -> Plot:
    """Draw the error before and what the sum leaves, over time or order, axis by axis."""
    rows = len(group.axes)
    figure, panels = style.new_figure(2.2 * rows + 0.4, rows)
    sentences = []
    for k, (panel, axis_sum) in enumerate(zip(panels, group.axes, strict=True)):
        scale = scale_of(axis_sum.unit)
        _over_order(panel, group, axis_sum, scale, last=k == rows - 1)
        before, after = (axis_sum.error[k].sound.rms for k in ("before", "predicted"))
        ratio = after / axis_sum.noise if axis_sum.noise > 0 else float("nan")
        sentences.append(
            f"{axis_sum.axis}: {scale.shown(before)} rms before, {scale.shown(after)} predicted,"
            f" {ratio:.2f} times the scatter of a reading."
        )
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, markerscale=2.5)
    left_out = "run" if group.held_out == "run" else "stretch of the recording"
    most = max(axis_sum.rows.size for axis_sum in group.axes)
    caption = (
        f"{' '.join(sentences)} Each reading is predicted by lists that were fitted without"
        f" its {left_out}.{say_drawn(style.DRAWN_POINTS, most)}"
    )
    over = "time" if group.timed else "the order of measuring"
    title = f"The whole error over {over}, before and after"
    return Plot("sum", title, figure, caption)


def _over_order(
    panel: Axes, group: "GroupResult", axis_sum: "AxisSum", scale: Scale, last: bool
) -> None:
    place = group.order[axis_sum.rows]
    sound = np.flatnonzero(~axis_sum.wild)
    drawn = min(sound.size, style.DRAWN_POINTS)
    size = float(np.clip(90 / np.sqrt(max(drawn, 1)), 0.8, 3))
    for values, color, name in (
        (axis_sum.before, style.GREY, "before"),
        (axis_sum.predicted, style.BLUE, "predicted: left by the whole sum"),
    ):
        style.marks(
            panel, place[sound], values[sound] * scale.factor, size=size, alpha=0.5,
            color=color, label=name, most=style.DRAWN_POINTS,
        )  # fmt: skip
    bins = bin_means(place[sound], axis_sum.predicted[sound] * scale.factor, _SLICES)
    panel.plot(
        bins.centre, bins.mean, color=style.INK, linewidth=1.1, marker="s",
        markersize=2.4, label="mean of a slice",
    )  # fmt: skip
    panel.axhline(0, color=style.INK, linewidth=0.6)
    errors = np.concatenate([axis_sum.before[sound], axis_sum.predicted[sound]])
    low, high = np.quantile(errors * scale.factor, [0.002, 0.998])
    edge = 0.12 * max(high - low, 1e-9)
    panel.set_ylim(low - edge, high + edge)
    panel.set_ylabel(f"error of {axis_sum.axis} in {scale.error}")
    if last:
        panel.set_xlabel(
            "time in s" if group.timed else "row, in the order of measuring"
        )

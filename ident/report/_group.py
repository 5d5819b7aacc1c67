"""A group of fits that were identified together, as a section of the page: words and pictures.

How much each effect is, and what the whole sum leaves.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from ..job import Code, Remark, by_level
from . import _style as style
from ._body import Plot
from ._scale import Scale, count, grouped, number, scale_of
from ._section import Section
from .table._readings import bin_means
from .table._spread import draw_scatter

if TYPE_CHECKING:
    from ..job import AxisSum, EffectShare, GroupResult

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
            words = f"the error of {one.axis} stays at {scale.shown(before)} rms"
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


def share_plot(group: "GroupResult") -> Plot:
    """Draw the size of each effect and of what the sum leaves, axis by axis."""
    counts = [len(_effects(group, one)) + 2 for one in group.axes]
    figure, panels = style.new_figure(
        0.34 * sum(counts) + 0.75 * len(counts),
        rows=len(group.axes),
        gridspec_kw={"height_ratios": counts},
    )
    words = []
    for panel, one in zip(panels, group.axes, strict=True):
        scale = scale_of(one.unit)
        effects = _effects(group, one)
        left = one.error["predicted"].sound.rms
        names = [
            each.name.replace(f" of {each.axis}", "", 1)
            + (" (in no list)" if not each.written else "")
            for each in effects
        ]
        sizes = [each.rms for each in effects]
        colors = [style.BLUE if each.written else style.GREY for each in effects]
        names += ["left over (predicted)", "scatter of a reading"]
        sizes += [left, one.noise]
        colors += [style.ORANGE, "white"]
        places = np.arange(len(names))
        values = np.array(sizes) * scale.factor
        bars = panel.barh(places, values, color=colors, height=0.62)
        bars[-1].set_edgecolor(style.INK)
        bars[-1].set_linewidth(0.8)
        for place, value in zip(places, values, strict=True):
            panel.text(
                float(value), float(place), f" {number(float(value))}", va="center"
            )
        panel.set_yticks(places, names)
        panel.invert_yaxis()
        panel.grid(visible=False, axis="y")
        panel.set_xlim(0, 1.13 * float(values.max(initial=1e-9)))
        panel.set_title(one.axis)
        panel.set_xlabel(f"root mean square over the readings in {scale.error}")
        if effects:
            largest = max(effects, key=lambda each: each.rms)
            words.append(
                f"{one.axis}: most is the {largest.name}"
                f" ({scale.shown(largest.rms)}); what"
                f" is written leaves {scale.shown(left)}"
            )
    caption = (
        f"{'; '.join(words)}. Each bar is what one effect does to the readings, about its"
        " mean; effects may add up or cancel, so that the bars of an axis need not make"
        " up its whole error."
    )
    if any(not each.written for each in group.effects):
        caption += " Grey: in no list."
    return Plot("share", "How much each effect is", figure, caption)


def sum_plot(group: "GroupResult") -> Plot:
    """Draw the error before and what the sum leaves, over time or order, axis by axis."""
    rows = len(group.axes)
    figure, panels = style.new_figure(
        2.2 * rows + 0.4, rows=rows, columns=2, width_ratios=[3, 1]
    )
    said = []
    for k, one in enumerate(group.axes):
        scale = scale_of(one.unit)
        _over_order(panels[2 * k], group, one, scale, last=k == rows - 1)
        beside = panels[2 * k + 1]
        left = one.predicted[~one.wild] / max(one.noise, 1e-12)
        draw_scatter(beside, left)
        beside.set_yticks([])
        if k == rows - 1:
            beside.set_xlabel("left / scatter")
        said.append(_say(one, scale))
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, markerscale=2.5)
    what = "run" if group.held_out == "run" else "stretch of the recording"
    caption = (
        f"{' '.join(said)} Each reading is predicted by lists that were fitted without"
        f" its {what}."
    )
    drawn = max(int(one.rows.size) for one in group.axes)
    if drawn > style.DRAWN_POINTS:
        caption += (
            f" {grouped(style.DRAWN_POINTS)} of {grouped(drawn)} readings are drawn; the"
            " means use all of them."
        )
    over = "time" if group.timed else "the order of measuring"
    return Plot(
        "sum", f"The whole error over {over}, before and after", figure, caption
    )


def _over_order(
    panel: Axes, group: "GroupResult", one: "AxisSum", scale: Scale, last: bool
) -> None:
    where = group.order[one.rows]
    sound = np.flatnonzero(~one.wild)
    drawn = min(sound.size, style.DRAWN_POINTS)
    size = float(np.clip(90 / np.sqrt(max(drawn, 1)), 0.8, 3))
    for values, color, name in (
        (one.before, style.GREY, "before"),
        (one.predicted, style.BLUE, "predicted: left by the whole sum"),
    ):
        style.marks(
            panel, where[sound], values[sound] * scale.factor, size=size, alpha=0.5,
            color=color, label=name, most=style.DRAWN_POINTS,
        )  # fmt: skip
    bins = bin_means(where[sound], one.predicted[sound] * scale.factor, _SLICES)
    panel.plot(
        bins.centre, bins.mean, color=style.INK, linewidth=1.1, marker="s",
        markersize=2.4, label="mean of a slice",
    )  # fmt: skip
    panel.axhline(0, color=style.INK, linewidth=0.6)
    both = np.concatenate([one.before[sound], one.predicted[sound]]) * scale.factor
    low, high = np.quantile(both, [0.002, 0.998])
    edge = 0.12 * max(high - low, 1e-9)
    panel.set_ylim(low - edge, high + edge)
    panel.set_ylabel(f"error of {one.axis} in {scale.error}")
    if last:
        panel.set_xlabel(
            "time in s" if group.timed else "row, in the order of measuring"
        )


def _say(one: "AxisSum", scale: Scale) -> str:
    before = number(one.error["before"].sound.rms * scale.factor)
    after = one.error["predicted"].sound.rms
    ratio = after / one.noise if one.noise > 0 else float("nan")
    return (
        f"{one.axis}: {before} {scale.error} rms before,"
        f" {scale.shown(after)} predicted,"
        f" {ratio:.2f} times the scatter of a reading (line at the right)."
    )


def _effects(group: "GroupResult", one: "AxisSum") -> "list[EffectShare]":
    own = [each for each in group.effects if each.axis == one.axis]
    return sorted(own, key=lambda each: -each.rms)

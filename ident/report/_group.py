"""A group of fits that were identified together, as a section of the page: words and pictures.

How much each effect is, and what the whole sum leaves.
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from . import _style as style
from ._body import Plot
from ._scale import Scale, scale_of
from ._section import Section
from .table._fitted import bin_means, say_drawn

if TYPE_CHECKING:
    from ..job import AxisSum, GroupResult

_SLICES = 24


@dataclasses.dataclass(frozen=True)
class GroupSection:
    """What the page says of one group.

    Attributes:
        name: In anchors and names of files.
        group: What the job found.
        level: good, or warn.
        assumed: No measurement has settled the sign of one of its lists.
        missing: Fits of it that these readings cannot tell as they were asked for.
        plot: Of the whole sum.
    """

    name: str
    group: "GroupResult"
    level: str
    assumed: bool
    missing: int
    plot: Plot

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
    missing = sum(bool(one.index is not None and one.why) for one in group.effects)
    members = [sections[index] for index in group.fits]
    proven = all(section.verdict.level == "good" for section in members)
    level = "warn" if missing or group.confusions or not proven else "good"
    assumed = any(section.fit.judgement.waits for section in members)
    return GroupSection(
        f"group-{place}", group, level, assumed, missing, sum_plot(group)
    )


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

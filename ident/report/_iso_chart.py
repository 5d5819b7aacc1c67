"""The ISO 230-2 chart: all runs, the means with their ±2 s band, and A, E, B marked."""

import io
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from matplotlib.transforms import ScaledTranslation

from ...data.files import write_keeping
from ...data.measurements import (
    EDITION,
    Iso230,
    describe_iso230,
    widest_reversal,
    with_arrows,
)
from . import _style as style
from ._scale import Scale, scale_of

_SERIES = ("#7d8590", style.GREEN, "#7a3e9d")
_DASHES = {1: "-", -1: (0, (5, 1.6))}


def draw_iso_chart(
    tests: Mapping[str, Iso230],
    *,
    axis: str = "",
    unit: str = "mm",
    tolerance: float | None = None,
    caption: bool = True,
) -> "Figure":
    """Return the chart of one positioning test, or of several overlaid.

    Errors are drawn in µm (m° for a rotary axis) over positions in mm (°). The axis
    of errors holds everything that is drawn; nothing is cut off.

    Args:
        tests: Evaluations by name (``before``, ``after`` …), in the order of drawing;
            at most three.
        axis: Name of the axis, for the title.
        unit: ``mm`` or ``deg``, the unit of the evaluations.
        tolerance: In ``unit``; drawn as a band around the middle of the last test's A.
        caption: Whether to write the sentence under the plot; `describe_iso230`
            gives it for documents that set it themselves.
    """
    with style.house_style():
        figure, (axes,) = style.new_figure(6.0)
        figure.set_dpi(150)
        scale, single = scale_of(unit), len(tests) == 1
        axes.margins(y=0.08)
        axes.axhline(0.0, color=style.GREY, linewidth=0.8, zorder=1)
        for at, (name, test) in enumerate(tests.items()):
            colours = style.DIRECTION_COLOR
            if not single:
                colours = dict.fromkeys(colours, _SERIES[at])
            _draw_test(axes, test, colours, "" if single else f"{name} ", at)
        axes.set_ylim(axes.get_ylim())
        for at, (name, test) in enumerate(tests.items()):
            colour = style.INK if single else _SERIES[at]
            _draw_brackets(axes, test, colour, at, "" if single else name)
            _draw_reversal(axes, test, colour, scale)
        if tolerance is not None:
            _draw_tolerance(axes, list(tests.values())[-1], tolerance, scale)
        axes.set_xlabel(f"Position [{scale.position}]")
        axes.set_ylabel(f"Deviation actual − commanded [{scale.error}]")
        axes.set_title(_title(tests, axis), fontsize=10, weight="normal")
        figure.legend(
            loc="outside upper left", ncols=3, fontsize=9.5, handletextpad=0.5,
            columnspacing=1.2, borderaxespad=0.1,
        )  # fmt: skip
        if caption:
            lines = textwrap.wrap(iso_chart_sentence(tests, unit=unit), 98)
            text = "\n".join(lines)
            figure.supxlabel(text, x=0.02, ha="left", fontsize=8.5, linespacing=1.35)
    return figure


def iso_chart_sentence(tests: Mapping[str, Iso230], *, unit: str = "mm") -> str:
    """Return what the chart shows: how to read it, then the figures in words."""
    reading = "Thin lines are single runs, thick lines their means, bands ±2 s."
    return f"{reading} {describe_iso230(tests, unit=unit)}"


def write_chart(figure: Figure, folder: Path, stem: str) -> tuple[Path, Path]:
    """Write a figure as SVG and PNG into a folder; what they held is kept; return paths.

    Raises:
        OSError: If the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / f"{stem}.svg", folder / f"{stem}.png"
    # Equal input gives equal bytes.
    with style.house_style(), mpl.rc_context({"svg.hashsalt": "axcomp"}):
        for path in paths:
            form, content = path.suffix[1:], io.BytesIO()
            metadata = {"Date": None} if form == "svg" else None
            figure.savefig(content, format=form, metadata=metadata, facecolor="white")
            write_keeping(path, content.getvalue())
    return paths


def _title(tests: Mapping[str, Iso230], axis: str) -> str:
    test = next(iter(tests.values()))
    counts = [n for p in test.positions for n in (p.runs_up, p.runs_down) if n]
    runs = "–".join(map(str, sorted({min(counts), max(counts)})))
    opening = f"Axis {axis}: p" if axis else "P"
    sides = "both directions" if test.bidirectional else "one direction"
    return (
        f"{opening}ositioning by {EDITION} — {len(test.positions)} targets, {runs} "
        f"run{'s' if runs != '1' else ''}, {sides}"
    )


def _draw_test(
    axes: Axes, test: Iso230, colours: Mapping[int, str], prefix: str, at: int
) -> None:
    """Draw runs, means and ±2 s bands of one test."""
    for run in test.runs:
        color, dashes = colours[run.direction], _DASHES[run.direction]
        thin: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.4, "zorder": 2 + at}
        axes.plot(run.target, run.error * 1e3, color=color, linestyle=dashes, **thin)
    for direction, side, arrow in ((1, "up", "↑"), (-1, "down", "↓")):
        rows = [
            (p.target, getattr(p, f"mean_{side}"), getattr(p, f"s_{side}") or 0.0)
            for p in test.positions
            if getattr(p, f"mean_{side}") is not None
        ]
        if not rows:
            continue
        targets, means, spread = np.array(rows).T * [[1.0], [1e3], [2e3]]
        band = means - spread, means + spread
        properties: dict[str, Any] = {"color": colours[direction], "zorder": 4 + at}
        axes.fill_between(targets, *band, alpha=0.13, linewidth=0, **properties)
        properties |= {"marker": "^" if direction > 0 else "v", "markersize": 5.5}
        properties |= {"markeredgecolor": "white", "markeredgewidth": 0.7}
        properties |= {"linewidth": 1.8, "linestyle": _DASHES[direction]}
        axes.plot(targets, means, label=f"{prefix or 'mean '}{arrow}", **properties)


def _draw_brackets(axes: Axes, test: Iso230, colour: str, at: int, name: str) -> None:
    """Mark A and E as measured heights at the right of the plot."""
    systematic = "E" if test.E is not None else "E↑" if test.E_up is not None else "E↓"
    heights = {
        with_arrows(test.judged()[0]): test.accuracy_ends(),
        systematic: test.systematic_ends(),
    }
    inches, height = axes.figure.dpi_scale_trans, axes.get_yaxis_transform()
    for step, (label, ends) in enumerate(heights.items()):
        if ends is None:
            continue
        # In inches from the edge: a share of the width would change while it is laid out.
        distance = 0.1 + 0.29 * step + 0.6 * at
        transform = height + ScaledTranslation(distance, 0.0, inches)
        low, high = ends[0] * 1e3, ends[1] * 1e3
        bracket = "|-|,widthA=0.25,widthB=0.25"
        _draw_height(axes, 1.0, (low, high), bracket, colour, transform)
        words = f"{label} {name}{' ' if name else ''}= {high - low:.1f}"
        beside = transform + ScaledTranslation(0.06, 0.0, inches)
        look: dict[str, Any] = {"va": "center", "fontsize": 9.5, "color": colour}
        axes.text(1.0, (low + high) / 2, words, transform=beside, rotation=90, **look)


def _draw_reversal(axes: Axes, test: Iso230, colour: str, scale: Scale) -> None:
    """Mark the largest reversal between the two means."""
    widest = widest_reversal(test)
    if widest is None or widest.mean_up is None or widest.mean_down is None:
        return
    low, high = sorted((widest.mean_up * 1e3, widest.mean_down * 1e3))
    _draw_height(axes, widest.target, (low, high), "<->", colour, axes.transData)
    # What it is stands in the legend: a label beside the arrow would cover the curves.
    label = f"B = {high - low:.1f} {scale.error} at {widest.target:g} {scale.position}"
    axes.plot([], [], linestyle="none", marker="d", color=colour, label=label)


def _draw_height(
    axes: Axes, x: float, ends: tuple[float, float], arrow: str, colour: str, place: Any
) -> None:
    """Draw a measured height as an arrow or a bracket."""
    axes.add_patch(
        FancyArrowPatch(
            (x, ends[0]), (x, ends[1]), arrowstyle=arrow, shrinkA=0.0, shrinkB=0.0,
            mutation_scale=10.0, color=colour, linewidth=1.2, transform=place,
            clip_on=False, zorder=8,
        )
    )  # fmt: skip


def _draw_tolerance(axes: Axes, test: Iso230, tolerance: float, scale: Scale) -> None:
    """Draw the tolerance as a band around the middle of A."""
    ends = test.accuracy_ends() or test.systematic_ends()
    if ends is None:
        return
    middle, half = (ends[0] + ends[1]) / 2, tolerance / 2
    low, high = (middle - half) * 1e3, (middle + half) * 1e3
    label = f"tolerance {tolerance * 1e3:g} {scale.error}"
    axes.axhspan(low, high, facecolor="#e6f4ea", zorder=0, label=label)

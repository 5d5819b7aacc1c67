"""Marks on the ISO 230-2 chart: A and E beside it, B and the tolerance in it."""

from typing import TYPE_CHECKING, Any

from ...data.measurements import Iso230, widest_reversal, with_arrows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Drawn by hand: as a formula ("$…$") it would load matplotlib's whole formula parser.
_DOUBLE_ARROW = [
    *((0.0, 1.0), (0.35, 0.5), (0.08, 0.5), (0.08, -0.5), (0.35, -0.5)),
    *((0.0, -1.0), (-0.35, -0.5), (-0.08, -0.5), (-0.08, 0.5), (-0.35, 0.5)),
    (0.0, 1.0),
]


def draw_brackets(axes: "Axes", test: Iso230, colour: str, at: int, name: str) -> None:
    """Mark A and E as measured heights at the right of the plot."""
    limits = (test.accuracy_ends(), test.systematic_ends())
    labels = [
        with_arrows(test.judged()[0]),
        "E" if test.E is not None else _one_sided_e(test),
    ]
    beyond = axes.get_yaxis_transform()
    for step, (ends, label) in enumerate(zip(limits, labels, strict=True)):
        if ends is None:
            continue
        x = 1.02 + 0.06 * step + 0.125 * at
        low, high = ends[0] * 1e3, ends[1] * 1e3
        line: dict[str, Any] = {
            "color": colour,
            "clip_on": False,
            "transform": beyond,
            "linewidth": 1.2,
        }
        axes.plot([x, x], [low, high], **line)
        for end in (low, high):
            axes.plot([x - 0.007, x + 0.007], [end, end], **line)
            axes.plot(
                [0, x],
                [end, end],
                **{**line, "linewidth": 0.5, "alpha": 0.55, "linestyle": (0, (1, 2))},
            )
        axes.text(
            x + 0.012,
            (low + high) / 2,
            f"{label} {name}{' ' if name else ''}= {high - low:.1f}",
            transform=beyond,
            rotation=90,
            va="center",
            ha="left",
            fontsize=8.5,
            color=colour,
        )


def _one_sided_e(test: Iso230) -> str:
    return "E↑" if test.E_up is not None else "E↓"


def draw_reversal(
    axes: "Axes", test: Iso230, colour: str, small: str, long: str
) -> None:
    """Mark the largest reversal between the two means."""
    from matplotlib.path import Path
    from matplotlib.patheffects import withStroke

    widest = widest_reversal(test)
    if widest is None or widest.mean_up is None or widest.mean_down is None:
        return
    ends = sorted((widest.mean_up * 1e3, widest.mean_down * 1e3))
    axes.annotate(
        "",
        xy=(widest.target, ends[0]),
        xytext=(widest.target, ends[1]),
        arrowprops={
            "arrowstyle": "<->",
            "color": colour,
            "lw": 1.3,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=8,
    )
    targets = [item.target for item in test.positions]
    right = widest.target > (min(targets) + max(targets)) / 2
    axes.annotate(
        "B",
        xy=(widest.target, sum(ends) / 2),
        xytext=(-5 if right else 5, 0),
        textcoords="offset points",
        ha="right" if right else "left",
        va="center",
        fontsize=9,
        fontweight="bold",
        color=colour,
        path_effects=[withStroke(linewidth=3, foreground="white")],
        zorder=9,
    )
    # The figure stands in the legend: a label beside the arrow would cover the curves.
    axes.plot(
        [],
        [],
        linestyle="none",
        marker=Path(_DOUBLE_ARROW, closed=True),
        markersize=9,
        color=colour,
        label=f"B = {ends[1] - ends[0]:.1f} {small} at {widest.target:g} {long}",
    )


def draw_tolerance(axes: "Axes", test: Iso230, tolerance: float, small: str) -> None:
    """Draw the tolerance as a band around the middle of A."""
    ends = test.accuracy_ends() or test.systematic_ends()
    if ends is None:
        return
    middle = (ends[0] + ends[1]) / 2
    axes.axhspan(
        (middle - tolerance / 2) * 1e3,
        (middle + tolerance / 2) * 1e3,
        facecolor="#e6f4ea",
        edgecolor="none",
        zorder=0,
        label=f"tolerance {tolerance * 1e3:g} {small}",
    )

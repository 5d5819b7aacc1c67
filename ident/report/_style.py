"""One look for all plots: colour-blind safe, direction told by marker too, as SVG."""

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

# Okabe-Ito: distinguishable with every common kind of colour blindness and in grey.
BLUE = "#0072B2"
ORANGE = "#D55E00"
GREEN = "#009E73"
GREY = "#8c8c8c"
INK = "#222222"

DIRECTION_COLOR = {1: BLUE, -1: ORANGE, 0: BLUE}
DIRECTION_MARKER = {1: ">", -1: "<", 0: "o"}
DIRECTION_NAME = {1: "moving +", -1: "moving −", 0: "both directions"}

DIVERGING = "RdBu_r"
SEQUENTIAL = "cividis"

_VECTOR_POINTS = 600
"""More points than this in one layer are drawn as a picture inside the SVG."""
_DPI = 160
"""Of what is drawn as a picture inside an SVG."""
_TICKS = 6
"""Intervals of an axis at most."""
DRAWN_POINTS = 6000
"""More readings than this are thinned before drawing, and the caption says so."""

# Any: matplotlib spells out every key in its type, a plain dictionary does not match.
_RC: Any = {
    "font.family": "DejaVu Sans",
    # A phone shows 7.2 inches on 350 pixels: 11 points are 7.5 of them.
    "font.size": 11,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    # Nothing stands above a plot: to look for it takes longer than to draw the title.
    "axes.titley": 1.0,
    "axes.labelsize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#666666",
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.fontsize": 10.5,
    "legend.frameon": False,
    "hatch.linewidth": 0.6,
    "lines.linewidth": 1.3,
    # Names from a job may hold a dollar sign: never a formula.
    "text.parse_math": False,
    "svg.fonttype": "none",
    "figure.facecolor": "white",
}


def house_style() -> AbstractContextManager[None]:
    """Set the look of the plots for the time of a ``with`` block."""
    return mpl.rc_context(_RC)


def new_figure(
    height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure 7.2 inches wide and its axes, row by row."""
    figure = Figure(figsize=(7.2, height), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False, **options).ravel())
    for panel in axes:
        # More are not read on a phone; placing their labels is half of the drawing.
        if panel.name == "rectilinear":
            panel.locator_params(nbins=_TICKS)
    return figure, axes


def thin(size: int, limit: int = DRAWN_POINTS) -> Int[np.ndarray, " k"]:
    """Return ascending indices of at most ``limit`` of ``size`` readings.

    Drawn by lot with a fixed seed: a regular stride would pick the same column of a
    scanned grid again and again.
    """
    if size <= limit:
        return np.arange(size)
    chosen = np.random.default_rng(0).choice(size, limit, replace=False)
    return np.sort(chosen)


def borders(nodes: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    """Return the borders of the cells around the nodes."""
    if len(nodes) == 1:
        return np.array([nodes[0] - 0.5, nodes[0] + 0.5])
    inner = middles(nodes)
    return np.concatenate(
        [[2 * nodes[0] - inner[0]], inner, [2 * nodes[-1] - inner[-1]]]
    )


def heat(
    axes: Axes,
    nodes: Sequence[Float[np.ndarray, " _n"]],
    value: Float[np.ndarray, "j i"],
    limits: tuple[float, float],
    labels: Sequence[str],
) -> QuadMesh:
    """Draw a value per node of a plane, in colours that part at 0 where the limits lie about it."""
    axes.grid(False)
    mesh = axes.pcolormesh(
        *map(borders, nodes), value, cmap=DIVERGING if limits[0] < 0 else SEQUENTIAL,
        vmin=limits[0], vmax=limits[1], rasterized=True,
    )  # fmt: skip
    if 0.25 <= height_of(nodes) <= 1.2:
        axes.set_aspect("equal")
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    return mesh


def height_of(nodes: Sequence[Float[np.ndarray, " _n"]]) -> float:
    """Return how high a plane is, relative to its width."""
    return float(np.ptp(nodes[1])) / (float(np.ptp(nodes[0])) or 1.0)


def middles(nodes: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    return np.asarray((nodes[1:] + nodes[:-1]) / 2)


def draw_cloud(
    axes: Axes,
    where: Float[np.ndarray, " t"],
    value: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"],
    *,
    size: float | None = 3.0,
    names: Mapping[int, str] = DIRECTION_NAME,
    alpha: float = 0.7,
    most: int = 3000,
) -> None:
    """Draw readings as marks that tell their direction (±1, or 0), so many of each at most.

    Without a size in points marks are the smaller, the more there are.
    """
    for sign in (1, -1, 0):
        rows = np.flatnonzero(direction == sign)
        if rows.size:
            fitting = float(np.clip(90 / np.sqrt(rows.size), 1.2, 3))
            marks(
                axes, where[rows], value[rows], color=DIRECTION_COLOR[sign], alpha=alpha,
                marker=DIRECTION_MARKER[sign], label=names[sign], most=most,
                size=fitting if size is None else size,
            )  # fmt: skip


def marks(
    axes: Axes,
    across: Float[np.ndarray, " t"],
    up: Float[np.ndarray, " t"],
    *,
    color: str | tuple[float, ...] = BLUE,
    marker: str = "o",
    size: float = 3.0,
    alpha: float = 0.7,
    label: str | None = None,
    most: int = 3000,
) -> None:
    """Draw readings as marks, so many at most, and many as a picture inside the SVG."""
    rows = thin(len(across), most)
    axes.plot(
        across[rows], up[rows], linestyle="none", marker=marker, markersize=size,
        markeredgewidth=0, alpha=alpha, color=color, label=label,
        rasterized=rows.size > _VECTOR_POINTS,
    )  # fmt: skip


def side_by_side(
    height: float, titles: tuple[str, str], x_label: str, y_label: str
) -> tuple[Figure, list[Axes]]:
    """Return two panels with a line at 0, what each shows above it, and labels."""
    figure, panels = new_figure(height, columns=2, sharey=True)
    for panel, title in zip(panels, titles, strict=True):
        panel.axhline(0, color=INK, linewidth=0.7)
        panel.set_title(title)
        panel.set_xlabel(x_label)
    panels[0].set_ylabel(y_label)
    return figure, panels


def to_svg(figure: Figure, name: str) -> str:
    """Return a figure as the text of an SVG file, the same text every time.

    The figure is empty then: those of a page are a million objects.
    """
    text = io.StringIO()
    # Ids are hashed with the salt: equal shapes of two plots in one page stay apart.
    # No date, no creator: the bytes depend on the data alone.
    empty = {"Date": None, "Creator": None, "Format": None, "Type": None}
    with mpl.rc_context({**_RC, "svg.hashsalt": name}):
        figure.savefig(text, format="svg", dpi=_DPI, metadata=empty)
    # `clear` would make all axes anew.
    for axes in figure.axes:
        axes.remove()
    # Narrower fallbacks than the font that the plot was laid out with never overlap.
    return text.getvalue().replace(
        "'DejaVu Sans'", "'DejaVu Sans', Verdana, Arial, sans-serif"
    )


def to_inline(svg: str) -> str:
    """Return the ``<svg>`` element of an SVG file, fit to stand inside an HTML page."""
    element = svg[svg.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    # HTML knows both name spaces by itself; without them the page holds no address.
    element = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", element, count=4)
    # A style inside an inline SVG would reach the whole page; the page has its own.
    element = re.sub(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", "", element,
                     count=1, flags=re.DOTALL)  # fmt: skip
    return element.replace("<svg ", '<svg class="plot" aria-hidden="true" ', 1).strip()

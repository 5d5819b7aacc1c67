"""One look for all plots: colour-blind safe, direction told by marker too, as SVG."""

import contextlib
import io
import re
from collections.abc import Iterator
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Int
from matplotlib.axes import Axes
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
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

VECTOR_POINTS = 600
"""More points than this in one layer are drawn as a picture inside the SVG."""
_DPI = 160
"""Of what is drawn as a picture inside an SVG."""
DRAWN_POINTS = 6000
"""More readings than this are thinned before drawing, and the caption says so."""

# Any: matplotlib spells out every key in its type, a plain dictionary does not match.
_RC: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.labelsize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#666666",
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "hatch.linewidth": 0.6,
    "lines.linewidth": 1.3,
    # Names from a job may hold a dollar sign: never a formula.
    "text.parse_math": False,
    "svg.fonttype": "none",
    "figure.facecolor": "white",
}


@contextlib.contextmanager
def house_style() -> Iterator[None]:
    """Set the look of the plots for the time of a ``with`` block."""
    with mpl.rc_context(_RC):
        yield


def new_figure(
    height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure 7.2 inches wide and its axes, row by row."""
    figure = Figure(figsize=(7.2, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, list(axes.ravel())


def new_mosaic(height: float, rows: tuple[str, ...]) -> tuple[Figure, list[Axes]]:
    """Return a figure laid out by letters, one per panel, and its axes in order."""
    figure = Figure(figsize=(7.2, height), layout="constrained")
    panels = figure.subplot_mosaic("\n".join(rows), height_ratios=[0.62, 1.0])
    return figure, [panels[name] for name in sorted(panels)]


def thin(size: int, limit: int = DRAWN_POINTS) -> Int[np.ndarray, " k"]:
    """Return ascending indices of at most ``limit`` of ``size`` readings.

    Drawn by lot with a fixed seed: a regular stride would pick the same column of a
    scanned grid again and again.
    """
    if size <= limit:
        return np.arange(size)
    chosen = np.random.default_rng(0).choice(size, limit, replace=False)
    return np.sort(chosen)


def as_raster(size: int) -> bool:
    """Whether a layer of ``size`` points is better stored as a picture in the SVG."""
    return size > VECTOR_POINTS


class _Renderer(RendererSVG):
    """Writes the style of many equal markers once, around them, and not at each of them."""

    def draw_markers(
        self, gc: Any, marker: Any, trans: Any, path: Any, *rest: Any, **named: Any
    ) -> None:
        if len(path.vertices) < 4:
            super().draw_markers(gc, marker, trans, path, *rest, **named)
            return
        face = rest[1] if len(rest) > 1 else named.get("rgbFace")
        style = self._get_style_dict(gc, face)
        # Inherited by each marker; the opacity of a group would be that of all of them.
        opacity = style.pop("opacity", "")
        style |= {"fill-opacity": opacity, "stroke-opacity": opacity} if opacity else {}
        self.writer.start("g", style="; ".join(f"{k}: {v}" for k, v in style.items()))
        self._get_style = lambda *_: ""
        super().draw_markers(gc, marker, trans, path, *rest, **named)
        del self._get_style
        self.writer.end("g")


def to_svg(figure: Figure, name: str) -> str:
    """Return a figure as the text of an SVG file, the same text every time."""
    text = io.StringIO()
    # Ids are hashed with the salt: equal shapes of two plots in one page stay apart.
    with mpl.rc_context({**_RC, "svg.hashsalt": name}):
        # No date, no creator: the bytes depend on the data alone.
        empty = {"Date": None, "Creator": None, "Format": None, "Type": None}
        width, height = figure.get_size_inches()
        figure.dpi = 72
        FigureCanvasSVG(figure)  # whose widths of texts the layout goes by
        svg = _Renderer(72 * width, 72 * height, text, image_dpi=_DPI, metadata=empty)
        # `savefig` would draw twice, once for the layout alone: half of a report's time.
        renderer = MixedModeRenderer(figure, width, height, _DPI, svg)
        figure.draw(renderer)
        renderer.finalize()  # type: ignore[no-untyped-call]
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

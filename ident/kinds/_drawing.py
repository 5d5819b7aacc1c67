"""What plots of several compensations have in common: marks, and before beside after."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..report import _style as style
from ..report._style import marks as marks


def directed_marks(
    panel: Axes,
    direction: int,
    x: Float[np.ndarray, " t"],
    y: Float[np.ndarray, " t"],
    size: float = 3.0,
    alpha: float = 0.7,
) -> None:
    """Draw readings of one direction of motion, ±1, in its colour and with its marker."""
    marks(
        panel, x, y, color=style.DIRECTION_COLOR[direction], size=size, alpha=alpha,
        marker=style.DIRECTION_MARKER[direction], label=style.DIRECTION_NAME[direction],
    )  # fmt: skip


def side_by_side(
    height: float, titles: tuple[str, str], x_label: str, y_label: str
) -> tuple[Figure, list[Axes]]:
    """Return two panels with a line at 0, what each shows above it, and labels."""
    figure, panels = style.new_figure(height, columns=2, sharey=True)
    for panel, title in zip(panels, titles, strict=True):
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_title(title)
        panel.set_xlabel(x_label)
    panels[0].set_ylabel(y_label)
    return figure, panels


def left_out_words(count: int, noun: str = "wild reading") -> str:
    """Return that so many are not in a picture, to stand behind its caption."""
    if not count:
        return ""
    return f" {count} {noun}{' is' if count == 1 else 's are'} left out of the picture."

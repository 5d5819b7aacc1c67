"""A finished plot: picture, heading, and the sentence that says what to see in it."""

import dataclasses

from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True)
class Plot:
    """One plot of the report.

    Attributes:
        name: Part of the file name in ``plots/``, in lower case with hyphens.
        title: Heading over the plot.
        figure: The drawing.
        caption: What the reader should see in *this* data, computed from it.
    """

    name: str
    title: str
    figure: Figure
    caption: str

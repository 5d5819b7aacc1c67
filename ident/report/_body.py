"""The part of a section that differs from one kind of compensation to the other."""

import dataclasses
from collections.abc import Sequence

from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True)
class Plot:
    """One plot of the report.

    Its name is part of that of the file in ``plots/``, in lower case with hyphens; its
    caption says what the reader should see in *this* data, computed from it.
    """

    name: str
    title: str
    figure: Figure
    caption: str


@dataclasses.dataclass(frozen=True)
class WildRow:
    """One rejected reading, ready to print."""

    row: str
    where: str
    run: str
    error: str


@dataclasses.dataclass(frozen=True)
class Body:
    """Plots, most telling first, and sentences on how the result was found.

    Attributes:
        plots: Each with its caption.
        facts: Pairs of a heading and a plain sentence.
        wild: The largest rejected readings.
        wild_count: How many were rejected in all.
    """

    plots: Sequence[Plot]
    facts: Sequence[tuple[str, str]]
    wild: Sequence[WildRow] = ()
    wild_count: int = 0

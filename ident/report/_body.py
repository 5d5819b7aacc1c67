"""The part of a section that differs from one kind of compensation to the other."""

import dataclasses
from collections.abc import Sequence

from ._plot import Plot
from ._words import WildRow


@dataclasses.dataclass(frozen=True)
class Body:
    """Plots, most telling first, and sentences on how the result was found.

    Attributes:
        plots: Each with its caption.
        facts: Pairs of a heading and a plain sentence.
        wild: The largest rejected readings.
        wild_count: How many were rejected in all.
        wild_runs: Whether readings belong to runs.
    """

    plots: Sequence[Plot]
    facts: Sequence[tuple[str, str]]
    wild: Sequence[WildRow] = ()
    wild_count: int = 0
    wild_runs: bool = False

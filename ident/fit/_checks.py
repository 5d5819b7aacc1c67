"""What a table fit refuses before any work."""

import dataclasses
import re
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ..core._errors import FitError
from ._types import Samples, TableLayout

Smoothness = float | str | Mapping[str, float]
"""``"auto"``, a weight, or the weights of an earlier fit by name."""

_NAME = re.compile("order [24], axis [12]")


@dataclasses.dataclass(frozen=True)
class Extent:
    """How many readings there are and where they lie; extents of pieces add up.

    Attributes:
        counts: Readings per direction; all in the first where there is one table for both.
        low: Least position per axis.
        high: Largest one.
    """

    counts: Int[np.ndarray, " b"]
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]

    @classmethod
    def of(cls, layout: TableLayout, samples: Samples) -> "Extent":
        """Return the extent of readings; all of them must be finite numbers.

        Raises:
            FitError: If there are none, one is no number or has no weight, or there is no
                direction where the table needs one.
        """
        _refuse_gaps(samples)
        counts = np.array([len(samples.error)])
        if layout.branches == 2:
            if samples.branch is None:
                msg = (
                    "a table with two directions needs the direction of every reading."
                )
                raise FitError(msg)
            counts = np.bincount(samples.branch, minlength=2)
        # Column by column: NumPy is slow along the short axis.
        columns = samples.positions.T
        low = np.array([float(column.min()) for column in columns])
        return cls(counts, low, np.array([float(column.max()) for column in columns]))

    def __add__(self, other: "Extent") -> "Extent":
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return Extent(self.counts + other.counts, low, high)

    def check(self, layout: TableLayout, free: int, allow_gaps: bool) -> None:
        """Refuse readings that stand at one place or are too few.

        More than the free unknowns, which no prior holds, are needed; as many as nodes unless
        gaps are allowed.

        Raises:
            FitError: Naming what is missing.
        """
        for axis, nodes in enumerate(layout.nodes):
            if len(nodes) > 1 and self.low[axis] == self.high[axis]:
                msg = (
                    f"all readings stand at {float(self.low[axis]):g} along axis "
                    f"{axis + 1}, expected positions spread over {len(nodes)} nodes."
                )
                raise FitError(msg)
        needed = layout.effect.size // layout.branches
        names = ("positive", "negative") if layout.branches == 2 else ("",)
        for name, count in zip(names, self.counts, strict=True):
            if count < needed and not allow_gaps:
                where = f" in {name} direction" if name else ""
                msg = f"{count} readings{where} for {needed} nodes, expected at least {needed}."
                raise FitError(msg)
        if self.counts.sum() <= free:
            msg = (
                f"{self.counts.sum()} readings leave nothing to judge the noise by; "
                f"expected more than {free}."
            )
            raise FitError(msg)


def _refuse_gaps(samples: Samples) -> None:
    count = len(samples.error)
    if not count:
        msg = "found no readings, expected at least one per node."
        raise FitError(msg)
    for name in ("positions", "error", "weight", "order"):
        values = getattr(samples, name)
        if values is None:
            continue
        finite = np.isfinite(values)
        if not finite.all():
            row = int(np.argmin(finite.reshape(count, -1).all(axis=1)))
            msg = f"reading {row + 1}: {name} is not finite, expected numbers."
            raise FitError(msg)
    if samples.weight is not None and not (samples.weight > 0).all():
        msg = "weights must be positive."
        raise FitError(msg)


def check_layout(layout: TableLayout) -> None:
    """Refuse nodes that do not ascend."""
    for axis, nodes in enumerate(layout.nodes):
        if len(nodes) > 1 and not (nodes[1:] > nodes[:-1]).all():
            msg = f"nodes along axis {axis + 1} must ascend."
            raise FitError(msg)


def check_smoothness(smoothness: Smoothness) -> None:
    """Refuse a smoothness that is none."""
    if isinstance(smoothness, Mapping):
        for name, weight in smoothness.items():
            if not _NAME.fullmatch(str(name)) or not 0 <= weight < np.inf:
                msg = (
                    f"smoothness: found {name!r} = {weight!r}, "
                    "expected 'order 2, axis 1' and the like with weights >= 0."
                )
                raise FitError(msg)
    elif smoothness != "auto" and (
        isinstance(smoothness, str) or not 0 <= smoothness < np.inf
    ):
        msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0."
        raise FitError(msg)

"""What a table fit refuses before any work."""

import dataclasses
import re
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ..core._errors import FitError
from ._types import Samples, TableLayout

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
        """Return the extent of readings.

        Raises:
            FitError: If there is no direction where the table needs one.
        """
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
        return Extent(
            self.counts + other.counts,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
        )


def check_samples(
    layout: TableLayout, samples: Samples, smoothness: object, allow_gaps: bool
) -> None:
    """Refuse readings that cannot determine the table."""
    check_finite(samples)
    check_layout(layout)
    check_extent(layout, Extent.of(layout, samples), allow_gaps)
    check_smoothness(smoothness)


def check_finite(samples: Samples) -> None:
    """Refuse readings that are none, are no numbers, or have no weight."""
    count = len(samples.error)
    if not count:
        msg = "found no readings, expected at least one per node."
        raise FitError(msg)
    for name in ("positions", "error", "weight", "order"):
        values = getattr(samples, name)
        if values is not None and not np.isfinite(values).all():
            row = int(
                np.argwhere(~np.isfinite(values.reshape(count, -1)).all(axis=1))[0, 0]
            )
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


def check_extent(layout: TableLayout, extent: Extent, allow_gaps: bool) -> None:
    """Refuse readings that are too few or stand at one place."""
    for axis, nodes in enumerate(layout.nodes):
        if len(nodes) > 1 and extent.low[axis] == extent.high[axis]:
            where = float(extent.low[axis])
            msg = (
                f"all readings stand at {where:g} along axis {axis + 1}, "
                f"expected positions spread over {len(nodes)} nodes."
            )
            raise FitError(msg)
    if allow_gaps:
        return
    count_nodes = int(np.prod([len(nodes) for nodes in layout.nodes])) - int(
        layout.periodic
    )
    names = ("positive", "negative") if layout.branches == 2 else ("",)
    for name, number in zip(names, extent.counts, strict=True):
        if number < count_nodes:
            way = f" in {name} direction" if name else ""
            msg = (
                f"{number} readings{way} for {count_nodes} nodes, "
                f"expected at least {count_nodes}."
            )
            raise FitError(msg)


def check_smoothness(smoothness: object) -> None:
    """Refuse a smoothness that is none."""
    if isinstance(smoothness, Mapping):
        for name, weight in smoothness.items():
            if not _NAME.fullmatch(str(name)) or not 0 <= weight < np.inf:
                msg = (
                    f"smoothness: found {name!r} = {weight!r}, "
                    "expected 'order 2, axis 1' and the like with weights >= 0."
                )
                raise FitError(msg)
    elif isinstance(smoothness, str):
        if smoothness != "auto":
            msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0."
            raise FitError(msg)
    elif isinstance(smoothness, (int, float)) and not 0 <= smoothness < np.inf:
        msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0."
        raise FitError(msg)

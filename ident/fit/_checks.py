"""What a table fit refuses before any work."""

import re
from collections.abc import Mapping

import numpy as np

from ._errors import FitError
from ._types import Samples, TableLayout

_NAME = re.compile("order [24], axis [12]")


def check_samples(
    layout: TableLayout, samples: Samples, smoothness: object, allow_gaps: bool
) -> None:
    """Refuse readings that cannot determine the table."""
    count = len(samples.error)
    if count == 0:
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
    for axis, nodes in enumerate(layout.nodes):
        if len(nodes) > 1 and not (np.diff(nodes) > 0).all():
            msg = f"nodes along axis {axis + 1} must ascend."
            raise FitError(msg)
        if len(nodes) > 1 and np.ptp(samples.positions[:, axis]) == 0:
            where = float(samples.positions[0, axis])
            msg = (
                f"all readings stand at {where:g} along axis {axis + 1}, "
                f"expected positions spread over {len(nodes)} nodes."
            )
            raise FitError(msg)
    count_nodes = int(np.prod([len(nodes) for nodes in layout.nodes])) - int(
        layout.periodic
    )
    if layout.branches == 2:
        if samples.branch is None:
            msg = "a table with two directions needs the direction of every reading."
            raise FitError(msg)
        counts = np.bincount(samples.branch, minlength=2)
        for name, number in zip(("positive", "negative"), counts, strict=True):
            if number < count_nodes and not allow_gaps:
                msg = (
                    f"{number} readings in {name} direction for {count_nodes} nodes, "
                    f"expected at least {count_nodes}."
                )
                raise FitError(msg)
    elif count < count_nodes and not allow_gaps:
        msg = f"{count} readings for {count_nodes} nodes, expected at least {count_nodes}."
        raise FitError(msg)
    _check_smoothness(smoothness)


def _check_smoothness(smoothness: object) -> None:
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

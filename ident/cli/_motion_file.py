"""A motion file: columns that are called like roles, after the logical axis numbers."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..exchange import Motion


def read_motion(file: Path) -> "Motion":
    """Return the motion of a file, in mm, °, s and °C.

    Raises:
        MeasurementError: If an axis is no number, there is no position, or times do not
            ascend.
        OSError: If it cannot be read.
    """
    import numpy as np

    from ...data.measurements import MeasurementError, measurement, read_table
    from ..exchange import Motion

    def number(axis: str) -> int:
        found = axis.removeprefix("A")
        if not found.isdigit():
            reason = (
                f"found axis {axis!r}, expected A1, A2, … after the logical numbers"
            )
            raise MeasurementError(str(file), reason)
        return int(found)

    measured = measurement(read_table(file))
    motion = Motion.of(measured, number)
    if not motion.positions:
        reason = "found no position, expected a column such as A1.position"
        raise MeasurementError(str(file), reason)
    time = motion.time
    if time is not None and np.any(np.diff(time) <= 0):
        at = int(np.argmax(np.diff(time) <= 0))
        reason = (
            f"line {measured.lines[at + 1]}: found time {time[at + 1]:g} after"
            f" {time[at]:g}, expected ascending times"
        )
        raise MeasurementError(str(file), reason)
    return motion

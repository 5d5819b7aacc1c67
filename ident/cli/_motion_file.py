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

    measured = measurement(read_table(file))
    found: dict[str, dict[int, np.ndarray]] = {
        kind: {}
        for kind in ("position", "direction", "velocity", "acceleration", "actual")
    }
    for axis in measured.axes:
        number = axis.removeprefix("A")
        if not number.isdigit():
            reason = (
                f"found axis {axis!r}, expected A1, A2, … after the logical numbers"
            )
            raise MeasurementError(str(file), reason)
        for kind, columns in found.items():
            if (values := measured.get(f"{axis}.{kind}")) is not None:
                whole = kind == "direction"
                columns[int(number)] = np.asarray(values, np.int64 if whole else float)
    if not found["position"]:
        reason = "found no position, expected a column such as A1.position"
        raise MeasurementError(str(file), reason)
    time = measured.get("time")
    if time is not None and np.any(np.diff(time) <= 0):
        at = int(np.argmax(np.diff(time) <= 0))
        reason = (
            f"line {measured.lines[at + 1]}: found time {time[at + 1]:g} after"
            f" {time[at]:g}, expected ascending times"
        )
        raise MeasurementError(str(file), reason)
    head = "temperature."
    temperatures = {
        role.removeprefix(head): np.asarray(measured.values[role], float)
        for role in measured.values
        if role.startswith(head)
    }
    return Motion(
        positions=found["position"],
        directions=found["direction"],
        time=None if time is None else np.asarray(time, float),
        velocities=found["velocity"],
        accelerations=found["acceleration"],
        temperatures=temperatures,
        actuals=found["actual"],
        source=str(file),
    )

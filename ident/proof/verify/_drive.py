"""The position on the drive bus: which way it counts, how late it is, and what it adds."""

from collections.abc import Sequence

import numpy as np

from ....data.signals import estimate_delay
from ...exchange.controller._motion import Column
from ._log import Target

_REACH = 20
"""Cycles by which the drive bus may be late."""
_SURE = 3.0
"""Standard deviations from which on it is."""
_ENDS = 60
"""Rows at either end that the filter of the delay, and the delay, reach."""
_FEWEST = 3 * _ENDS
"""Rows from which on a log tells the delay."""

_COUNTED = 1.0
"""mm or ° of motion, or off zero, from which on a drive shows which way it counts."""
_ADDED = 0.1
"""mm or ° by which it may then differ from the command at standstill."""


def way_of_counting(position: Column, drive: Column) -> int:
    """Return 1 where a drive counts as its axis does, −1 where the other way, 0 if not shown.

    Shown by a motion of the axis, or where it stands, by the value itself.
    """
    if np.ptp(position) >= _COUNTED:
        slope = float(np.polyfit(position, drive, 1)[0])
        return int(np.sign(slope)) if 0.5 < abs(slope) < 2.0 else 0
    if np.min(np.abs(position)) >= _COUNTED:
        for way in (1, -1):
            if np.max(np.abs(way * drive - position)) < _ADDED:
                return way
    return 0


def drive_target(
    position: Column, drive: Column, listed: Sequence[Column], cyclic: bool
) -> tuple[Target, int, float]:
    """Return what the drive bus adds to the command, and by how many cycles it is late.

    The zero of the drive is free. Where the axis moves, its own motion tells how late
    the bus is: by whole cycles, which are taken out of the target, and by a part of one,
    which is still in what it adds. What the lists add goes with the velocity, too: it is
    no delay, by whatever factor it is there.

    Args:
        position: As commanded, in mm or °.
        drive: Position on the bus.
        listed: What each list adds.
        cyclic: The rows are cycles.
    """
    ones, rows = np.ones((len(position), 1)), np.arange(len(position))
    if not cyclic or len(rows) < _FEWEST:
        return Target.of(drive - position, ones), 0, 0.0
    velocity = np.gradient(position)
    shares = np.column_stack([ones, velocity, np.gradient(velocity)])
    design, interior = np.column_stack([shares, *listed]), slice(_ENDS, -_ENDS)
    lag, part, aligned = 0, 0.0, drive
    for _ in range(2):  # a delay of several cycles leaves something of it at first
        difference = (aligned - position)[interior]
        factors = np.linalg.lstsq(design[interior], difference, rcond=None)[0]
        without_lists = aligned - design[:, 3:] @ factors[3:]
        delay_fit = estimate_delay(position, without_lists, 1.0, longest=float(_REACH))
        significant = abs(delay_fit.seconds) > _SURE * delay_fit.standard_deviation
        delay = delay_fit.seconds if delay_fit.determined and significant else 0.0
        lag, part = lag + round(delay), delay - round(delay)
        aligned = drive[np.clip(rows + lag, 0, rows[-1])]
    if abs(part) < 0.02:
        return Target.of(aligned - position, ones), lag, 0.0
    difference = aligned - np.interp(rows - part, rows, position)
    return Target.of(difference, shares), lag, part

"""A log of sums: the position on the drive bus, or the sum of all offsets."""

from collections.abc import Mapping, Sequence

import numpy as np

from ....data.signals import estimate_delay
from ...exchange.controller._motion import Column
from ._channel import AbstractChannel
from ._hypothesis import SCALES
from ._log import Target
from ._search import Found, search

_SWEEPS = 4
"""Most rounds over the parts of a sum; two are the rule."""

_REACH = 20
"""Cycles by which the drive bus may be late."""
_SURE = 3.0
"""Standard deviations from which on it is."""
_ENDS = 60
"""Rows at either end that the filter of the delay, and the delay, reach."""
_FEWEST = 3 * _ENDS
"""Rows from which on a log tells the delay."""


def search_total(
    channels: Mapping[str, AbstractChannel], target: Target
) -> dict[str, Found]:
    """Return what explains each part of a sum, the others taken out of it.

    Starts from the factors that fit all parts jointly, then looks at one part after the
    other until none changes.
    """
    columns = {name: fitted.column(fitted.plain) for name, fitted in channels.items()}
    for name, scale in _factors(columns, channels, target).items():
        columns[name] = scale * columns[name]
    parts: dict[str, Found] = {}
    for _ in range(_SWEEPS):
        changed = False
        for name, channel in channels.items():
            remaining = [fitted for key, fitted in columns.items() if key != name]
            remainder = target.values - sum(remaining, np.zeros(len(target.values)))
            start = [parts[name].best] if name in parts else []
            fitted = search(channel, target.but(remainder), start)
            changed |= name not in parts or parts[name].best != fitted.best
            parts[name], columns[name] = fitted, fitted.column
        if not changed or len(channels) == 1:
            break
    return parts


def _factors(
    columns: Mapping[str, Column],
    channels: Mapping[str, AbstractChannel],
    target: Target,
) -> dict[str, float]:
    """Return for each part the factor nearest to what a joint fit says."""
    rows = next(iter(channels.values())).motion.judged
    names = [name for name, column in columns.items() if np.ptp(column[rows]) > 0]
    if not names:
        return {}
    design = np.stack([target.free_of(columns[name])[rows] for name in names], axis=1)
    fitted = np.linalg.lstsq(design, target.values[rows], rcond=None)[0]
    return {
        name: min(SCALES, key=lambda scale: abs(scale - value))
        for name, value in zip(names, fitted, strict=True)
    }


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

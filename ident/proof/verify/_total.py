"""A log of sums: the position on the drive bus, or the sum of all offsets."""

from collections.abc import Mapping

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

_FEWEST = 250
"""Rows from which on its delay is told."""


def search_total(
    channels: Mapping[str, AbstractChannel], target: Target
) -> dict[str, Found]:
    """Return what explains each part of a sum, the others taken out of it.

    Starts from the factors that fit all parts jointly, then looks at one part after the
    other until none changes.
    """
    columns = {name: one.column(one.plain) for name, one in channels.items()}
    for name, scale in _factors(columns, channels, target).items():
        columns[name] = scale * columns[name]
    found: dict[str, Found] = {}
    for _ in range(_SWEEPS):
        changed = False
        for name, channel in channels.items():
            others = [one for key, one in columns.items() if key != name]
            rest = target.values - sum(others, np.zeros(len(target.values)))
            start = [found[name].best] if name in found else []
            one = search(channel, target.but(rest), start)
            changed |= name not in found or found[name].best != one.best
            found[name], columns[name] = one, one.column
        if not changed or len(channels) == 1:
            break
    return found


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
    free = np.stack([target.free_of(columns[name])[rows] for name in names], axis=1)
    fitted = np.linalg.lstsq(free, target.values[rows], rcond=None)[0]
    return {
        name: min(SCALES, key=lambda scale: abs(scale - value))
        for name, value in zip(names, fitted, strict=True)
    }


def drive_target(
    position: Column, drive: Column, cyclic: bool
) -> tuple[Target, int, float]:
    """Return what the drive bus adds to the command, and by how many cycles it is late.

    The zero of the drive is free. Where the axis moves, its own motion tells how late
    the bus is: by whole cycles, which are taken out of the target, and by a part of one,
    which is still in what it adds.
    """
    ones, late, part = np.ones((len(position), 1)), 0, 0.0
    if cyclic and len(position) >= _FEWEST:
        found = estimate_delay(position, drive, 1.0, longest=_REACH)
        if found.determined:
            late = round(found.seconds)
            part = found.seconds - late
    # The ends that come round are not judged.
    aligned = np.roll(drive, -late)
    if abs(part) < 0.02:
        return Target.of(aligned - position, ones), late, 0.0
    rows = np.arange(len(position), dtype=float)
    velocity = np.gradient(position)
    shares = np.column_stack([ones, velocity, np.gradient(velocity)])
    apart = aligned - np.interp(rows - part, rows, position)
    return Target.of(apart, shares), late, part

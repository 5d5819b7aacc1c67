"""A log of sums: the position on the drive bus, or the sum of all offsets."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ._channel import AbstractChannel
from ._hypothesis import SCALES
from ._search import Found, search
from ._target import Target

_SWEEPS = 4
"""Most rounds over the parts of a sum; two are the rule."""

_REACH = 20
"""Cycles by which the drive bus may be late."""


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
    columns: Mapping[str, Float[np.ndarray, " t"]],
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
    position: Float[np.ndarray, " t"],
    drive: Float[np.ndarray, " t"],
    cyclic: bool,
) -> tuple[Target, int, float]:
    """Return what the drive bus adds to the command, and by how many cycles it is late.

    The zero of the drive is free. Where the axis moves, its own motion tells how late
    the bus is: by whole cycles, which are taken out of the target, and by a part of one,
    which is still in what it adds.
    """
    ones = np.ones((len(position), 1))
    if not cyclic or len(position) < 4 * _REACH or np.ptp(position) == 0:
        return Target.of(drive - position, ones), 0, 0.0
    late = _lateness(position, drive)
    # The ends that come round are not judged.
    aligned = np.roll(drive, -late)
    rows = np.arange(len(position), dtype=float)
    velocity = np.gradient(position)
    shares = np.column_stack([ones, velocity, np.gradient(velocity)])
    part, inside = 0.0, slice(_REACH, len(position) - _REACH)
    for _ in range(3):
        apart = aligned - np.interp(rows - part, rows, position)
        found = np.linalg.lstsq(shares[inside], apart[inside], rcond=None)[0]
        part -= float(found[1])
    if abs(part) < 0.02:
        return Target.of(aligned - position, ones), late, 0.0
    apart = aligned - np.interp(rows - part, rows, position)
    return Target.of(apart, shares), late, part


def _lateness(position: Float[np.ndarray, " t"], drive: Float[np.ndarray, " t"]) -> int:
    part = slice(_REACH, len(position) - _REACH)
    best, least = 0, np.inf
    for late in sorted(range(-_REACH + 1, _REACH), key=abs):
        apart = drive[part.start + late : part.stop + late] - position[part]
        spread = float(np.var(apart))
        if spread < 0.999 * least:
            best, least = late, spread
    return best

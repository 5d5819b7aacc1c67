"""Positions of an axis that goes round, as it went, not as its display begins anew."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

_KINDS = ("position", "encoder", "actual", "drive_position")
_WITHIN = 1.001
"""Turns that a display which begins anew covers at most: its noise passes the ends."""
_ALIKE = 3.0
"""Times a step in motion may be longer than the one beside it."""
_LONGER = 1.5
"""A step through the end of the turn is no longer than this times the longest other one."""


def unwound(
    columns: Mapping[str, np.ndarray], turns: Mapping[str, float]
) -> dict[str, Float[np.ndarray, " t"]]:
    """Return the positions that a display has wrapped into one turn, going on beyond it.

    Else an axis that passes the end of its turn seems to run all the way back: direction,
    speed and the delay of an instrument would be those of a motion that never was.

    Args:
        columns: By role, in the order of the file.
        turns: mm or ° of a turn, by axis.
    """
    found: dict[str, Float[np.ndarray, " t"]] = {}
    for axis, turn in turns.items():
        first = None
        for role in (f"{axis}.{kind}" for kind in _KINDS):
            if role not in columns:
                continue
            place = _unwound(columns[role], turn)
            first = place if first is None else first
            # One of them may begin before the end of a turn, and the other behind it.
            away = np.nan_to_num(np.median((first - place)[np.isfinite(first - place)]))
            found[role] = place + turn * np.round(away / turn)
    return found


def passed_end(
    place: Float[np.ndarray, " t"], turn: float = 360.0
) -> tuple[float, float] | None:
    """Return the first two positions between which a display begins anew in motion, or None.

    In motion: the step through the end of the turn goes on as those before and after it.
    """
    shown = place[np.isfinite(place)]
    if shown.size < 4 or np.ptp(shown) > _WITHIN * turn:
        return None
    steps = np.diff(shown)
    before, through, after = steps[:-2], steps[1:-1], steps[2:]
    wraps = np.abs(through) > 0.5 * turn
    through = through - turn * np.round(through / turn)
    for beside in (before, after):
        wraps &= (through * beside > 0.0) & (np.abs(through) < _ALIKE * np.abs(beside))
        wraps &= np.abs(beside) < _ALIKE * np.abs(through)
    if not wraps.any():
        return None
    at = int(np.argmax(wraps)) + 1
    return float(shown[at]), float(shown[at + 1])


def _unwound(place: Float[np.ndarray, " t"], turn: float) -> Float[np.ndarray, " t"]:
    finite = np.flatnonzero(np.isfinite(place))
    shown = place[finite]
    if finite.size < 3 or np.ptp(shown) > _WITHIN * turn:
        return place
    steps = np.diff(shown)
    through = steps - turn * np.round(steps / turn)
    wraps = np.abs(steps) > 0.5 * turn
    wraps &= np.abs(through) <= _LONGER * np.abs(steps[~wraps]).max(initial=0.0)
    result = place.copy()
    result[finite[1:]] = shown[1:] + np.cumsum(np.where(wraps, through - steps, 0.0))
    return result

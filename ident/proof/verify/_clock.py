"""By how much the offsets of a log were recorded later than its positions."""

import numpy as np

from ._channel import AbstractChannel
from ._hypothesis import FAULT
from ._search import Found

_PART = 0.1
"""Part of a cycle from which on a clock is off: a controller is late by whole ones."""


Explained = dict[tuple[int, str], tuple[AbstractChannel, Found]]
"""What explains each reported compensation, by axis and name."""


def worth(found: Explained) -> float:
    """Return the criterion of all that was found, the smaller the better."""
    return sum(one.rivals[0].criterion for _, one in found.values())


def clock_cost(rows: int) -> float:
    """Return what a clock that is off costs, beside one that is right."""
    return FAULT + float(np.log(rows))


def clock_of(found: Explained) -> float:
    """Return how many cycles later the offsets were recorded; 0 where none are broken.

    A controller can only be late by whole cycles. A part of one that all compensations
    share is the clock of the recording, and with it what most of them share.
    """
    late: list[float] = []
    weights: list[float] = []
    for channel, one in found.values():
        # A filter of two cycles is half a cycle late: only unfiltered ones count here.
        best = next(
            (r.hypothesis for r in one.rivals if r.hypothesis.change.cycles is None),
            one.best,
        )
        rows = channel.motion.judged
        column = best.scale * channel.column(best.change)
        slope = np.gradient(column)[rows.start - best.lag : rows.stop - best.lag]
        base = column[rows.start - best.lag : rows.stop - best.lag]
        target = one.residual + one.column[rows]
        power = float(slope @ slope)
        noise = float(np.mean(np.square(one.residual)))
        if power <= 100.0 * noise:
            continue
        late.append(best.lag - float((target - base) @ slope) / power)
        weights.append(power / noise)
    if not late:
        return 0.0
    turns = 2.0 * np.pi * np.array(late)
    centre = np.average(np.exp(1j * turns), weights=weights)
    part = float(np.angle(centre)) / (2.0 * np.pi)
    apart = np.angle(np.exp(1j * turns - 2j * np.pi * part)) / (2.0 * np.pi)
    allowed = _PART + 4.0 / np.sqrt(np.array(weights))
    if abs(part) < _PART or np.any(np.abs(apart) > allowed):
        return 0.0
    whole = np.round(np.array(late) - part)
    votes = {value: np.array(weights)[whole == value].sum() for value in whole}
    return float(max(votes, key=lambda value: votes[value])) + part

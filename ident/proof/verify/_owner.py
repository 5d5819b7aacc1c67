"""In whose list the data of a cross table stand, where a log tells it (S-10)."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ....data.lists import ListFile
from ....data.measurements import ControllerLog, LoggedOffset
from ....models import Conventions
from ...exchange import ExchangeError, Reading
from ...kinds import kinds
from ._channel import AbstractChannel
from ._judge import SETTLED
from ._lists import channels_of
from ._motion import LogMotion
from ._reports import number_of
from ._scan import few_rows, least_squares
from ._target import Target

_CHOICES = ("slave", "master")


def owners(
    lists: Sequence[ListFile],
    log: ControllerLog,
    names: Mapping[str, int],
    motion: LogMotion,
    reading: Reading,
) -> tuple[Reading, dict[str, str]]:
    """Return the rules with the axes that fit, and the rules that the log settles.

    A controller that reports what it adds to an axis says with it which one of the two
    axes of a table is compensated. Where both readings explain the log as well, that
    which is assumed stays. Rules are by compensation.
    """
    settled: dict[str, str] = {}
    for each in kinds():
        reported = {
            number_of(one.axis, names, str(log.source)): one
            for one in log.offsets
            if one.compensation == each.name and one.axis is not None
        }
        held = any(each.entries.is_in(one) for one in lists)
        if each.owner is None or not reported or not held:
            continue
        scores: dict[str, float] = {}
        for owner in _CHOICES:
            rules = _with(reading, each.owner, owner)
            try:
                channels = channels_of(lists, motion, rules)
            except ExchangeError:
                break  # the log lacks a position, or an axis has two tables
            parts = {axis: own.get(each.name) for axis, own in channels.items()}
            scores[owner] = sum(
                _left(parts.get(axis), one, motion) for axis, one in reported.items()
            )
        if len(scores) < len(_CHOICES):
            continue
        best = min(scores, key=lambda owner: scores[owner])
        if max(scores.values()) - scores[best] >= SETTLED:
            reading = _with(reading, each.owner, best)
            settled[each.name] = each.owner
    return reading, settled


def _with(reading: Reading, rule: str, choice: str) -> Reading:
    rules = {**reading.conventions.to_dict(), rule: choice}
    return dataclasses.replace(reading, conventions=Conventions.from_dict(rules))


def _left(
    channel: AbstractChannel | None, reported: LoggedOffset, motion: LogMotion
) -> float:
    """Return the criterion of what a table leaves of a column by any factor."""
    rows = few_rows(motion.judged)
    part = Target.of(reported.values, step=reported.step).at(rows)
    squares = part.power
    if channel is not None:
        none = np.zeros((1, len(channel.ways)))
        column = channel.columns_at(channel.plain, none, rows)
        squares = float(least_squares(part, column)[0])
    return part.criterion(squares, float(len(rows)))

"""From lists to channels: every compensation of every axis that can be judged."""

import copy
import dataclasses
from collections.abc import Mapping, Sequence

from ....data.lists import ListFile
from ...exchange import (
    ExchangeError,
    Reading,
    machine_lists,
    reversal_cycles,
)
from ._channel import AbstractChannel
from ._motion import LogMotion

ByAxis = Mapping[int, Mapping[str, AbstractChannel]]
"""Channels by logical axis number and compensation."""


def channels_of(
    lists: Sequence[ListFile], motion: LogMotion, reading: Reading
) -> ByAxis:
    """Return the channels of all lists, those that an axis list switches off left out.

    Raises:
        ExchangeError: If a list makes no table, an axis has two lists, or the log lacks
            the position of a master.
    """
    machine = machine_lists(lists)
    found: dict[int, dict[str, AbstractChannel]] = {}
    used = machine.in_use(reading.conventions)
    # What the other offsets enter comes last.
    for one in sorted(used, key=lambda one: (one.axis, one.kind.entries.comes_last)):
        parts = found.setdefault(one.axis, {})
        reversal = reversal_cycles(machine.machine.get(one.axis))
        channel = one.kind.log_channel
        parts[one.name] = channel(one, motion, reading, reversal, dict(parts))
    if not any(found.values()):
        names = ", ".join(one.source for one in lists)
        raise ExchangeError(
            where=names or "lists",
            found="no compensation that is active",
            expected="at least one table, or an axis list with a compensation",
        )
    return {axis: parts for axis, parts in found.items() if parts}


def unfiltered(channel: AbstractChannel) -> AbstractChannel:
    """Return a channel as the objects report it that know no filters."""
    plain = copy.copy(channel)
    plain.cycles = 0
    return plain


def at_clock(channel: AbstractChannel, clock: float) -> AbstractChannel:
    """Return a channel as it is read some part of a cycle later."""
    late = copy.copy(channel)
    late.motion = dataclasses.replace(channel.motion, clock=clock)
    return late

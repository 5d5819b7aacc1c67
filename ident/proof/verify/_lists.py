"""From lists to channels: every compensation of every axis that can be judged."""

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ....data.lists import ListFile
from ....models import Conventions
from ...exchange import (
    ExchangeError,
    Increments,
    InUse,
    backlash_from_list,
    cross_from_list,
    crosstalk_from_list,
    friction_from_list,
    leadscrew_from_list,
    machine_lists,
    plane_from_list,
    reversal_cycles,
    temperature_from_list,
)
from ._channel import AbstractChannel
from ._dynamic import CrosstalkChannel, FrictionChannel
from ._motion import LogMotion
from ._steps import BacklashChannel, TemperatureChannel
from ._tables import TableChannel

ByAxis = Mapping[int, Mapping[str, AbstractChannel]]
"""Channels by logical axis number and compensation."""

_SCREW = "kw.ssfk"


def channels_of(
    lists: Sequence[ListFile],
    motion: LogMotion,
    conventions: Conventions,
    increment: Increments = None,
) -> ByAxis:
    """Return the channels of all lists, those that an axis list switches off left out.

    Raises:
        ExchangeError: If a list makes no table, an axis has two lists, or the log lacks
            the position of a master.
    """
    machine = machine_lists(lists)
    found: dict[int, dict[str, AbstractChannel]] = {}
    used = machine.in_use(conventions)
    # The leadscrew comes last: the other offsets enter it.
    for one in sorted(used, key=lambda one: (one.axis, one.name == "leadscrew")):
        parts = found.setdefault(one.axis, {})
        reversal = reversal_cycles(machine.machine.get(one.axis))
        parts[one.name] = channel_of(
            one, motion, conventions, increment, reversal, dict(parts)
        )
    if not any(found.values()):
        names = ", ".join(one.source for one in lists)
        raise ExchangeError(
            where=names or "lists",
            found="no compensation that is active",
            expected="at least one table, or an axis list with a compensation",
        )
    return {axis: parts for axis, parts in found.items() if parts}


def channel_of(
    one: InUse,
    motion: LogMotion,
    conventions: Conventions,
    increment: Increments = None,
    reversal: int = 0,
    others: Mapping[str, AbstractChannel] | None = None,
) -> AbstractChannel:
    """Return the channel of one compensation along a motion.

    Args:
        one: The compensation, and where it stands.
        motion: Of a log, or independent places.
        conventions: Rules of the controller.
        increment: Worth of an encoder increment for lists with ``unit 0``.
        reversal: Cycles over which a reversal is spread (P-AXIS-00243).
        others: Channels of the same axis, whose offsets enter a leadscrew table.
    """
    axis, listing, ranges = one.axis, one.listing, motion.ranges
    if one.name == "backlash":
        return BacklashChannel(
            axis, motion, conventions, lambda rules: backlash_from_list(listing, rules)
        )
    if one.name == "temperature":
        return TemperatureChannel(
            axis,
            motion,
            conventions,
            lambda rules: temperature_from_list(listing, rules),
        )
    if one.name == "crosstalk":
        return CrosstalkChannel(
            axis, motion, conventions, one.masters,
            lambda rules: crosstalk_from_list(listing, rules),
        )  # fmt: skip
    if one.name == "friction":
        return FrictionChannel(
            axis, motion, conventions, lambda rules: friction_from_list(listing, rules)
        )
    if one.name == "cross":
        known = sorted(motion.path.positions)
        swaps = tuple((number,) for number in known if (number,) != one.masters)
        return TableChannel(
            axis, "cross", motion, conventions, one.masters,
            lambda rules: cross_from_list(listing, rules, increment, modulo=ranges),
            swaps=swaps, listed=listing.integer("kw.crosscomp.n_cycles") or 0,
            relevant=("table_filter",),
        )  # fmt: skip
    if one.name == "plane":
        first, second = one.masters
        return TableChannel(
            axis, "plane", motion, conventions, one.masters,
            lambda rules: plane_from_list(listing, rules, increment, modulo=ranges),
            swaps=((second, first),),
            listed=listing.integer("kw.crosscomp2.n_cycles") or 0,
            relevant=("plane_index", "table_filter"),
        )  # fmt: skip
    alone = listing.boolean(f"{_SCREW}.set_pos_without_comp")
    return TableChannel(
        axis, "leadscrew", motion, conventions, one.masters,
        lambda rules: leadscrew_from_list(
            listing, rules, increment, modulo=ranges.get(axis)
        ),
        cycles=reversal if listing.boolean(f"{_SCREW}.bilateral") else 0,
        added=None if alone else _added(others or {}),
        relevant=() if alone or not others else ("leadscrew_input",),
    )  # fmt: skip


def _added(
    others: Mapping[str, AbstractChannel],
) -> Callable[[Conventions], np.ndarray | None]:
    """Return what the other offsets add to the position of a leadscrew (S-23)."""
    columns = [
        one.column(one.plain) for name, one in others.items() if name != "friction"
    ]
    whole = sum(columns[1:], columns[0]) if columns else None

    def added(rules: Conventions) -> np.ndarray | None:
        return None if rules.leadscrew_input == "none" else whole

    return added


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

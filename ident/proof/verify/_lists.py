"""What lists and log hold: axes, motion, channels, reports, and whose a cross table is (S-10)."""

import copy
import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ....data.lists import ListFile
from ....data.measurements import ControllerLog, LoggedOffset
from ....models import Conventions
from ...exchange import (
    ExchangeError,
    Motion,
    Ranges,
    Reading,
    axis_number,
    expect,
    machine_lists,
    reversal_cycles,
)
from ...kinds import kinds
from ._channel import AbstractChannel
from ._judge import SETTLED
from ._log import LogMotion, Target
from ._scan import few_of, least_squares

_CHOICES = ("slave", "master")

ByAxis = Mapping[int, Mapping[str, AbstractChannel]]
"""Channels by logical axis number and compensation."""

Numbering = Callable[[str], int]
"""From the name of an axis in a log to its logical number."""


def channels_of(
    lists: Sequence[ListFile], motion: LogMotion, reading: Reading
) -> ByAxis:
    """Return the channels of all lists, those that an axis list switches off left out."""
    machine = machine_lists(lists)
    channels: dict[int, dict[str, AbstractChannel]] = {}
    uses = machine.in_use(reading.conventions)
    # What the other offsets enter comes last.
    for use in sorted(uses, key=lambda use: (use.axis, use.kind.entries.comes_last)):
        parts = channels.setdefault(use.axis, {})
        reversal = reversal_cycles(machine.machine.get(use.axis))
        channel = use.kind.log_channel
        parts[use.name] = channel(use, motion, reading, reversal, dict(parts))
    names = ", ".join(use.source for use in lists) or "lists"
    expected = "at least one table, or an axis list with a compensation"
    expect(channels, names, "no compensation that is active", expected)
    return channels


def changed(channel: AbstractChannel, **fields: object) -> AbstractChannel:
    """Return a channel with other attributes."""
    copied = copy.copy(channel)
    vars(copied).update(fields)
    return copied


def numbering(lists: Sequence[ListFile], source: str) -> Numbering:
    """Return what gives the logical number of an axis of a log: A3, or a name in a list.

    It raises an `ExchangeError` that names the source for any other.
    """
    numbers = {name.casefold(): axis for name, axis in _names(lists).items()}

    def number(text: str) -> int:
        match = re.fullmatch(r"A([0-9]+)", text)
        if match:
            return int(match[1])
        names = f"kopf.log_achs_name: {', '.join(sorted(numbers)) or 'none'}"
        expected = f"A1, A2, … after the logical numbers, or a name in a list ({names})"
        expect(text.casefold() in numbers, source, f"axis {text!r}", expected)
        return numbers[text.casefold()]

    return number


def turns_in_log(lists: Sequence[ListFile], ranges: Ranges) -> dict[str, float]:
    """Return mm or ° of a turn, of axes that go round, by what a log may call them."""
    names = {**{f"A{axis}": axis for axis in ranges}, **_names(lists)}
    spans = {axis: high - low for axis, (low, high) in ranges.items()}
    return {name: spans[axis] for name, axis in names.items() if axis in spans}


def _names(lists: Sequence[ListFile]) -> dict[str, int]:
    """Return the axis number that each name in a list stands for."""
    found = ((listing, listing.text("kopf.log_achs_name")) for listing in lists)
    return {
        name.strip(): axis_number(listing)
        for listing, name in found
        if name and listing.kind == "compensation"
    }


def motion_of(log: ControllerLog, number: Numbering, ranges: Ranges) -> LogMotion:
    """Return the motion of a log, by logical axis number."""
    drives = {
        number(role.partition(".")[0]): log.motion.require(role)
        for role in log.motion.values
        if role.endswith(".drive_position")
    }
    acting = {
        (number(offset.axis), offset.compensation): offset.acts
        for offset in log.offsets
        if offset.axis is not None and offset.acts is not None and offset.acts.any()
    }
    path: dict[str, Any] = {**vars(Motion.of(log.motion, number)), "ranges": ranges}
    return LogMotion(**path, cycle=log.cycle, drives=drives, acting=acting)


def reports_of(
    log: ControllerLog, number: Numbering, channels: ByAxis
) -> tuple[dict[tuple[int, str], LoggedOffset], list[str]]:
    """Return what was reported by axis and compensation, and what is not judged."""
    reports: dict[tuple[int, str], LoggedOffset] = {}
    ignored = ", ".join(map(repr, log.ignored))
    remarks = [f"Columns that are not used: {ignored}."] if ignored else []
    if log.dropped:
        words = f"{log.dropped} cycles that the recorder dropped, of {log.motion.rows},"
        remarks.append(f"{words} were filled in from those beside them.")
    for offset in log.offsets:
        if offset.compensation == "offset":
            continue
        if offset.acts is not None and not offset.acts.all():
            off = 100.0 * (1.0 - float(offset.acts.mean()))
            words = "its state says so, and nothing is expected there"
            remarks.append(f"{offset.column}: off in {off:.0f} % of the rows; {words}.")
        if offset.axis is None:
            name = offset.compensation
            owners = [axis for axis, parts in channels.items() if name in parts]
            axis = owners[0] if owners else 0
            found = f"column {offset.column!r} without an axis"
            several = f"{len(owners)} axes have {name}"
            expected = f"the axis before it, as in A{axis}.{offset.column}: {several}"
            expect(len(owners) < 2, str(log.source), found, expected)
        else:
            axis = number(offset.axis)
        if offset.compensation not in channels.get(axis, {}):
            words = "is logged, but no list that is active has it"
            remarks.append(f"{offset.column}: {offset.compensation} {words}.")
        elif (axis, offset.compensation) not in reports or offset.filtered:
            reports[axis, offset.compensation] = offset
    return reports, remarks


def owners(
    lists: Sequence[ListFile],
    log: ControllerLog,
    number: Numbering,
    motion: LogMotion,
    reading: Reading,
) -> tuple[Reading, dict[str, str]]:
    """Return the rules with the axes that fit, and the rules that the log settles.

    A controller that reports what it adds to an axis says with it which one of the two
    axes of a table is compensated. Where both readings explain the log as well, that
    which is assumed stays. Rules are by compensation.
    """
    owner_rules: dict[str, str] = {}
    for kind in kinds():
        reported = {
            number(offset.axis): offset
            for offset in log.offsets
            if offset.compensation == kind.name and offset.axis is not None
        }
        listed = any(kind.entries.is_in(listing) for listing in lists)
        if kind.owner is None or not reported or not listed:
            continue
        rules = reading.conventions.to_dict()
        by_owner = {owner: {**rules, kind.owner: owner} for owner in _CHOICES}
        owned = {
            owner: dataclasses.replace(reading, conventions=Conventions.from_dict(each))
            for owner, each in by_owner.items()
        }
        try:
            choices = [channels_of(lists, motion, each) for each in owned.values()]
        except ExchangeError:
            continue  # the log lacks a position, or an axis has two tables
        scores = [
            sum(
                _residual_criterion(parts.get(axis, {}).get(kind.name), report, motion)
                for axis, report in reported.items()
            )
            for parts in choices
        ]
        if max(scores) - min(scores) >= SETTLED:
            reading = owned[_CHOICES[scores.index(min(scores))]]
            owner_rules[kind.name] = kind.owner
    return reading, owner_rules


def _residual_criterion(
    channel: AbstractChannel | None, reported: LoggedOffset, motion: LogMotion
) -> float:
    """Return the criterion of what a table leaves of a column by any factor."""
    rows = few_of(np.arange(motion.rows)[motion.judged])
    part = Target.of(reported.values, step=reported.step).at(rows)
    squares = np.array([part.power])
    if channel is not None:
        unshifted = np.zeros((1, len(channel.ways)))
        column = channel.columns_at(channel.plain, unshifted, rows)
        squares = least_squares(part, column)
    return float(part.criterion(squares, float(len(rows)))[0])

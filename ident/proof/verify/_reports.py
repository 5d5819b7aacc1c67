"""What a log reports, by logical axis number and compensation."""

import re
from collections.abc import Mapping, Sequence

from ....data.lists import ListFile
from ....data.measurements import ControllerLog, LoggedOffset
from ...exchange import ExchangeError, Motion, Ranges, axis_number
from ._channel import AbstractChannel
from ._motion import LogMotion


def axis_names(lists: Sequence[ListFile]) -> dict[str, int]:
    """Return the logical numbers of the axes by the names that the lists give them."""
    found: dict[str, int] = {}
    for listing in lists:
        name = listing.text("kopf.log_achs_name")
        if name and listing.kind == "compensation":
            found[name.strip().casefold()] = axis_number(listing)
    return found


def number_of(text: str, names: Mapping[str, int], source: str) -> int:
    match = re.fullmatch(r"A([0-9]+)", text)
    if match:
        return int(match[1])
    if text.casefold() not in names:
        known = ", ".join(sorted(names)) or "none"
        raise ExchangeError(
            where=source,
            found=f"axis {text!r}",
            expected="A1, A2, … after the logical numbers, or a name in a list"
            f" (kopf.log_achs_name: {known})",
        )
    return names[text.casefold()]


def motion_of(
    log: ControllerLog, names: Mapping[str, int], ranges: Ranges
) -> LogMotion:
    """Return the motion of a log, by logical axis number."""

    def number(name: str) -> int:
        return number_of(name, names, str(log.source))

    drives = {
        number(role.partition(".")[0]): log.motion.require(role)
        for role in log.motion.values
        if role.endswith(".drive_position")
    }
    path = Motion.of(log.motion, number)
    return LogMotion(path, log.cycle, ranges=ranges, drives=drives)


def reports_of(
    log: ControllerLog,
    names: Mapping[str, int],
    channels: Mapping[int, Mapping[str, AbstractChannel]],
) -> tuple[dict[tuple[int, str], LoggedOffset], list[str]]:
    """Return what was reported by axis and compensation, and what is not judged."""
    found: dict[tuple[int, str], LoggedOffset] = {}
    ignored = ", ".join(map(repr, log.ignored))
    remarks = [f"Columns that are not used: {ignored}."] if ignored else []
    for one in log.offsets:
        if one.compensation == "offset":
            continue
        if one.axis is None:
            having = [
                axis for axis, parts in channels.items() if one.compensation in parts
            ]
            if len(having) > 1:
                raise ExchangeError(
                    where=str(log.source),
                    found=f"column {one.column!r} without an axis",
                    expected="the axis before it, as in"
                    f" A{having[0]}.{one.column}: {len(having)} axes have"
                    f" {one.compensation}",
                )
            axis = having[0] if having else 0
        else:
            axis = number_of(one.axis, names, str(log.source))
        if one.compensation not in channels.get(axis, {}):
            words = "is logged, but no list that is active has it"
            remarks.append(f"{one.column}: {one.compensation} {words}.")
        elif (axis, one.compensation) not in found or one.filtered:
            found[axis, one.compensation] = one
    return found, remarks

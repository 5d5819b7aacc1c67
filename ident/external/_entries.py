"""List entries and NC lines that go with an external compensation."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ...data.lists import EXTERNAL_LIMITS, ListFile, Value, new_list
from ..exchange import LIST_UNITS, to_add
from ..exchange._units import expect, round_to_list
from ..kinds import kind
from ._extremes import Extremes

EXTERNAL = "configuration.position_controller.enable_external_compensation_ifc"
"""Entry of the start-up list that opens the interface (P-STUP-00110)."""

_UNS32 = (0, 2**32 - 1)
_WARNING = 1.1
_ERROR = 1.5
"""Room over the largest figure in the workspace."""
_FADING = 13.5
"""An offset o fades as o·s(d/z), s(u) = u²(3 − 2u), at the distance d < z of the limit. An axis
that stops there with a moves at v² = 2·a·d: |s''| ≤ 6 and |s'| ≤ 1.5 give 13.5·o·a/z."""
_ROUNDING = 1e-4
"""mm or ° by which rounding to increments may move an offset."""


@dataclasses.dataclass(frozen=True)
class ExternalAxis:
    """Limits of one axis for an external compensation, in mm and mm/s² (or °).

    Attributes:
        warning: P-AXIS-00743.
        error: P-AXIS-00744.
        acceleration: P-AXIS-00745; None: that of the axis (P-AXIS-00008) holds, which
            these lists do not show.
    """

    warning: float
    error: float
    acceleration: float | None


def entries_of_external_axis(limits: ExternalAxis) -> dict[str, int | str]:
    """Return the entries of an axis list for an external compensation.

    Raises:
        ExchangeError: If the error limit is 0, which the controller refuses (70585), or
            a number does not fit.
    """
    where, found = f"{EXTERNAL_LIMITS}.err_limit", f"{limits.error:g}"
    expect(limits.error > 0, where, found, "a limit above 0 (70585)")
    entries: dict[str, int | str] = {}
    for name, value in (("warn_limit", limits.warning), ("err_limit", limits.error)):
        where = f"{EXTERNAL_LIMITS}.{name}"
        entries[where] = int(round_to_list(np.asarray(value), where, _UNS32))
    if limits.acceleration is not None:
        # Rounded down: never more than was asked for.
        entries[f"{EXTERNAL_LIMITS}.max_a"] = int(np.floor(limits.acceleration))
    return entries


def limits_of(
    found: Extremes, cycle_time: float, stopping: float
) -> tuple[ExternalAxis, ...]:
    """Return the limits per axis that let a model through and little else.

    The warning comes 10 % and 0.1 µm above the largest offset of the workspace, the error
    50 % and 1 µm above it; the acceleration leaves 50 %, and what rounding to increments
    and the fading before a software limit add.

    Args:
        found: Of the workspace.
        cycle_time: In s.
        stopping: Acceleration of the axes over the width of the zone before a software
            limit, in which they stop and the offsets fade out.
    """
    noise = 2.0 * _ROUNDING / cycle_time**2
    fading = _FADING * stopping * found.offset
    return tuple(
        ExternalAxis(
            warning=_up(_WARNING * offset + 1e-4),
            error=_up(_ERROR * offset + 1e-3),
            acceleration=float(math.ceil(_ERROR * acceleration + noise)),
        )
        for offset, acceleration in zip(
            found.offset, found.acceleration + fading, strict=True
        )
    )


def _up(value: float) -> float:
    return math.ceil(value * LIST_UNITS - 1e-9) / LIST_UNITS


def list_fragments(
    axes: Sequence[int],
    limits: Sequence[ExternalAxis],
    replaced: Mapping[int, Sequence[str]],
) -> dict[str, ListFile]:
    """Return the entries to add to axis and start-up lists, by file name.

    Args:
        axes: Logical numbers.
        limits: Per axis.
        replaced: Compensations by axis that the external one takes over: their lists are
            switched off, or the machine would be corrected twice.

    Raises:
        ExchangeError: If a limit does not fit its entry.
    """
    found: dict[str, ListFile] = {}
    for axis, limit in zip(axes, limits, strict=True):
        values: dict[str, Value] = dict(entries_of_external_axis(limit))
        off = {kind(name).activation: 0 for name in replaced.get(axis, ())}
        comment = [
            "P-AXIS-00743, 744, 745 of the external compensation. Where max_a is above"
            " P-AXIS-00008 (its default), a lower feed or smoother tables are needed.",
        ]
        if off:
            comment.append(
                "What is 0 is now part of the external compensation: both together would"
                " correct twice."
            )
        listing = to_add(axis, values | off, *comment)
        found[listing.source] = listing
    start: dict[str, Value] = {EXTERNAL: 1}
    comment = [
        "Entry to add to hochlauf.lis (P-STUP-00110): no whole start-up list."
        " Takes effect after a restart."
    ]
    name = "hochlauf.add.lis"
    found[name] = dataclasses.replace(new_list(start, comment=comment), source=name)
    return found

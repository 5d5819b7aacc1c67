"""External compensation: limits in axis lists, tables as offsets, units of its interface."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ....data.lists import ListFile
from ....models import (
    ExternalCompensation,
    OffsetPart,
    OffsetStack,
)
from ...kinds import kinds
from .._machine_lists import InUse, Reading, axes_in_use, machine_lists
from .._units import expect, round_to_list
from ._controller import columns_of, model_of

INTERFACE_UNITS = 10**8
"""Units of the interface per mm or °: its integers count 1e-8 of them."""

EXTERNAL = "configuration.position_controller.enable_external_compensation_ifc"
"""Entry of the start-up list that opens the interface (P-STUP-00110)."""

_EXTERNAL = "lr_param.ext_comp"
_UNS32 = (0, 2**32 - 1)


def from_interface(values: Int[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return integers of the interface in mm or °."""
    return np.asarray(values, dtype=np.int64) / INTERFACE_UNITS


def external_from_lists(
    lists: Sequence[ListFile],
    reading: Reading,
    *,
    axes: Sequence[int] | None = None,
) -> ExternalCompensation:
    """Return the tables of a machine as one external compensation.

    Cross, plane and leadscrew tables that are active; all else needs more than
    positions and is left out.

    Args:
        lists: Compensation and axis lists in any order.
        reading: How they are read.
        axes: Logical numbers, one per column of the positions; all that the lists name,
            ascending, where it is left out.

    Raises:
        ExchangeError: If a list makes no table, names an axis that is not among
            `axes`, or has a table for each direction of motion.
    """
    machine = machine_lists(lists)
    used = machine.in_use(reading.conventions)
    order = [each.name for each in kinds()]
    tables = [one for one in used if one.kind.table]
    tables.sort(key=lambda one: order.index(one.name))
    numbers = tuple(axes) if axes is not None else axes_in_use(tables, machine)
    columns = columns_of(tables, numbers)
    parts = tuple(_part(one, columns, reading) for one in tables)
    return ExternalCompensation(OffsetStack(parts, axes=len(numbers)))


def _part(one: InUse, columns: Mapping[int, int], reading: Reading) -> OffsetPart:
    model = model_of(one, reading)
    entries = one.kind.entries
    expect(
        not entries.turns(model),
        f"{one.listing.source}: {one.kind.prefix}.bilateral",
        "1, a table for each direction of motion",
        "0: an external compensation knows positions only",
    )
    return OffsetPart(
        model,
        columns[one.axis],
        tuple(columns[master] for master in one.masters),
        compensated=entries.sees_offsets(one.listing, reading.conventions),
    )


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
    where, found = f"{_EXTERNAL}.err_limit", f"{limits.error:g}"
    expect(limits.error > 0, where, found, "a limit above 0 (70585)")
    entries: dict[str, int | str] = {}
    for name, value in (("warn_limit", limits.warning), ("err_limit", limits.error)):
        where = f"{_EXTERNAL}.{name}"
        entries[where] = int(round_to_list(np.asarray(value), where, _UNS32))
    if limits.acceleration is not None:
        # Rounded down: never more than was asked for.
        entries[f"{_EXTERNAL}.max_a"] = int(np.floor(limits.acceleration))
    return entries

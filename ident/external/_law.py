"""The tables of lists as one external compensation, and the units of its interface."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ...data.lists import ListFile
from ...models import ExternalCompensation, OffsetPart, OffsetStack
from ..exchange import InUse, Reading, axes_in_use, columns_of, machine_lists, model_of
from ..exchange._units import expect
from ..kinds import kinds

INTERFACE_UNITS = 10**8
"""Units of the interface per mm or °: its integers count 1e-8 of them."""


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

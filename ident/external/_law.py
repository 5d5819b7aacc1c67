"""The tables of lists as one external compensation, and the units of its interface."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ...data.lists import ListFile
from ...models import ExternalCompensation, OffsetPart, OffsetStack
from ..exchange import InUse, Reading, axes_in_use, columns_of, machine_lists
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

    Those of `tables_in`; all else that is active is left out.

    Args:
        lists: Compensation and axis lists in any order.
        reading: How they are read.
        axes: Logical numbers, one per column of the positions; all that the lists name,
            ascending, where it is left out.

    Raises:
        ExchangeError: If a list makes no table, or names an axis that is not among
            `axes`.
    """
    machine = machine_lists(lists)
    tables = tables_in(machine.in_use(reading.conventions), reading)
    numbers = tuple(axes) if axes is not None else axes_in_use(tables, machine)
    columns = columns_of(tables, numbers)
    parts = tuple(_part(one, columns, reading) for one in tables)
    return ExternalCompensation(OffsetStack(parts, axes=len(numbers)))


def tables_in(used: Sequence[InUse], reading: Reading) -> list[InUse]:
    """Return cross, plane and leadscrew tables that need positions only, in this order.

    Raises:
        ExchangeError: If a list makes no table.
    """
    order = [each.name for each in kinds()]
    tables = [one for one in used if one.kind.table]
    tables = [one for one in tables if not one.kind.entries.turns(one.model(reading))]
    return sorted(tables, key=lambda one: order.index(one.name))


def _part(one: InUse, columns: Mapping[int, int], reading: Reading) -> OffsetPart:
    return OffsetPart(
        one.model(reading),
        columns[one.axis],
        tuple(columns[master] for master in one.masters),
        compensated=one.kind.entries.sees_offsets(one.listing, reading.conventions),
    )

"""All lists of a machine → its `PositionController`."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ....data.lists import ListFile
from ....models import AxisCompensations, PositionController
from .._machine_lists import (
    InUse,
    MachineLists,
    Reading,
    axes_in_use,
    machine_lists,
    reversal_cycles,
)
from .._units import ExchangeError


def controller_from_lists(
    lists: Sequence[ListFile], reading: Reading, *, axes: Sequence[int] | None = None
) -> PositionController:
    """Return the position controller of a machine with these lists loaded.

    Args:
        lists: Compensation and axis lists in any order.
        reading: How they are read.
        axes: Logical numbers of the machine's axes, one per column of the motion; all
            that the lists name, ascending, where it is left out.

    Raises:
        ExchangeError: If a list makes no table, an axis has two lists, or a list names
            an axis that the machine lacks.
    """
    machine = machine_lists(lists)
    uses = machine.in_use(reading.conventions, reading.lines)
    numbers = axes_in_use(uses, machine) if axes is None else tuple(axes)
    return controller_of(uses, machine, numbers, reading)


def controller_of(
    used: Sequence[InUse], lists: MachineLists, numbers: Sequence[int], reading: Reading
) -> PositionController:
    """Return the position controller that has these compensations, and no others."""
    columns, axes = columns_of(used, numbers), []
    for number in numbers:
        mine = [use for use in used if use.axis == number]
        axes.append(_axis(mine, columns, lists.machine.get(number), reading))
    return PositionController(axes=tuple(axes), conventions=reading.conventions)


def columns_of(used: Sequence[InUse], numbers: Sequence[int]) -> dict[int, int]:
    """Return the column of each axis.

    Raises:
        ExchangeError: If a compensation names an axis that has none.
    """
    for use in used:
        for axis in (use.axis, *use.masters):
            if axis not in numbers:
                role = "axis" if axis == use.axis else "master axis"
                listing = ", ".join(map(str, numbers))
                raise ExchangeError(
                    where=f"{use.listing.source}: {use.name}",
                    found=f"{role} {axis}, which the machine lacks",
                    expected=f"one of its axes, {listing}",
                )
    return {number: k for k, number in enumerate(numbers)}


def _axis(
    uses: Sequence[InUse],
    columns: Mapping[int, int],
    machine: ListFile | None,
    reading: Reading,
) -> AxisCompensations:
    """Return the compensations of one axis, masters by their columns."""
    parts: dict[str, Any] = {}
    for use in uses:
        masters = tuple(columns[master] for master in use.masters)
        model = use.model(reading)
        parts |= use.kind.entries.installed(model, masters, use.listing)
    fields = {field.name for field in dataclasses.fields(AxisCompensations)}
    parts["further"] = {name: parts.pop(name) for name in parts.keys() - fields}
    manual = () if reading.commanded else tuple(o.name for o in uses if o.manual)
    cycles = reversal_cycles(machine)
    return AxisCompensations(**parts, reversal_cycles=cycles, manual=manual)

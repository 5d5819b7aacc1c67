"""All lists of a machine → its `PositionController`."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ...data.lists import ListFile
from ...models import (
    AxisCompensations,
    Conventions,
    Coupled,
    PositionController,
    TemperatureLine,
)
from ._axis_list import backlash_from_list, reversal_cycles, temperature_from_list
from ._cross import cross_from_list
from ._crosstalk import crosstalk_from_list
from ._errors import ExchangeError
from ._friction import friction_from_list
from ._identity import Increments, flag, optional
from ._leadscrew import leadscrew_from_list
from ._machine_lists import PREFIXES, InUse, MachineLists, axes_in_use, machine_lists
from ._modulo import Ranges
from ._plane import plane_from_list


@dataclasses.dataclass(frozen=True)
class Reading:
    """How lists are read; see `controller_from_lists`."""

    conventions: Conventions
    increment: Increments = None
    modulo: Ranges = dataclasses.field(default_factory=dict)
    lines: Mapping[int, TemperatureLine] = dataclasses.field(default_factory=dict)
    commanded: bool = False


def controller_from_lists(
    lists: Sequence[ListFile],
    conventions: Conventions,
    increment: Increments = None,
    *,
    axes: Sequence[int] | None = None,
    modulo: Ranges | None = None,
    lines: Mapping[int, TemperatureLine] | None = None,
    commanded: bool = False,
) -> PositionController:
    """Return the position controller of a machine with these lists loaded.

    Args:
        lists: Compensation and axis lists in any order.
        conventions: Rules of the controller.
        increment: Worth of an encoder increment for lists with ``unit 0``.
        axes: Logical numbers of the machine's axes, one per column of the motion; all
            that the lists name, ascending, where it is left out.
        modulo: Range in ° by axis, for the axes that turn.
        lines: Temperature lines as a PLC makes them, by axis, instead of those that
            stand in the axis list.
        commanded: What waits for COMP ON is taken as switched on.

    Raises:
        ExchangeError: If a list makes no table, an axis has two lists, or a list names
            an axis that the machine lacks.
    """
    machine = machine_lists(lists)
    used = machine.in_use(conventions, lines or ())
    numbers = axes_in_use(used, machine) if axes is None else tuple(axes)
    reading = Reading(conventions, increment, modulo or {}, lines or {}, commanded)
    return controller_of(used, machine, numbers, reading)


def controller_of(
    used: Sequence[InUse],
    lists: MachineLists,
    numbers: Sequence[int],
    reading: Reading,
) -> PositionController:
    """Return the position controller that has these compensations, and no others.

    Raises:
        ExchangeError: As `controller_from_lists`.
    """
    for one in used:
        _refuse_unknown(one, numbers)
    columns = {number: k for k, number in enumerate(numbers)}
    return PositionController(
        axes=tuple(
            _axis(
                [one for one in used if one.axis == number],
                columns,
                lists.machine.get(number),
                reading,
            )
            for number in numbers
        ),
        conventions=reading.conventions,
    )


def _refuse_unknown(one: InUse, numbers: Sequence[int]) -> None:
    for axis in (one.axis, *one.masters):
        if axis not in numbers:
            role = "axis" if axis == one.axis else "master axis"
            known = ", ".join(map(str, numbers))
            raise ExchangeError(
                where=f"{one.listing.source}: {one.name}",
                found=f"{role} {axis}, which the machine lacks",
                expected=f"one of its axes, {known}",
            )


def _axis(
    used: Sequence[InUse],
    columns: Mapping[int, int],
    machine: ListFile | None,
    reading: Reading,
) -> AxisCompensations:
    """Return the compensations of one axis, masters by their columns."""
    parts: dict[str, Any] = {}
    for one in used:
        masters = tuple(columns[master] for master in one.masters)
        parts[one.name] = _law(one, masters, reading)
        if one.name == "leadscrew":
            parts["leadscrew_alone"] = flag(
                one.listing, f"{PREFIXES['leadscrew']}.set_pos_without_comp"
            )
    manual = () if reading.commanded else tuple(o.name for o in used if o.manual)
    return AxisCompensations(
        **parts, reversal_cycles=reversal_cycles(machine), manual=manual
    )


def _law(one: InUse, masters: tuple[int, ...], reading: Reading) -> object:
    model = model_of(one, reading)
    if one.name in ("cross", "plane"):
        return Coupled(model, masters, _switching(one.listing, PREFIXES[one.name]))
    return Coupled(model, masters) if one.name == "crosstalk" else model


def model_of(one: InUse, reading: Reading) -> Any:
    """Return the model of a compensation that lists hold; its masters left out.

    Raises:
        ExchangeError: If its entries make none.
    """
    rules, increment, ranges = reading.conventions, reading.increment, reading.modulo
    listing = one.listing
    if one.name == "cross":
        return cross_from_list(listing, rules, increment, modulo=ranges)
    if one.name == "plane":
        return plane_from_list(listing, rules, increment, modulo=ranges)
    if one.name == "crosstalk":
        return crosstalk_from_list(listing, rules)
    if one.name == "leadscrew":
        return leadscrew_from_list(
            listing, rules, increment, modulo=ranges.get(one.axis)
        )
    if one.name == "friction":
        return friction_from_list(listing, rules)
    if one.name == "backlash":
        return backlash_from_list(listing, rules)
    if one.axis in ranges:
        raise ExchangeError(
            where=f"{listing.source}: lr_param.temp_comp_coefficient",
            found=f"temperature compensation of the rotary axis {one.axis}",
            expected="a linear axis: the manuals give no unit for a rotary one",
        )
    return reading.lines.get(one.axis) or temperature_from_list(listing, rules)


def _switching(listing: ListFile, prefix: str) -> int:
    cycles = optional(listing, f"{prefix}.n_cycles")
    if cycles < 0:
        raise ExchangeError(
            where=f"{listing.source}: {prefix}.n_cycles",
            found=str(cycles),
            expected="0 or more",
        )
    return cycles

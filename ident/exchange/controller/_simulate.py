"""The controller of a machine, and what its lists, or those of an axis, add along a motion."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....data.lists import ListFile
from ....models import (
    AxisCompensations,
    Conventions,
    Motion as ControllerMotion,
    PositionController,
)
from ...core import filled
from ...kinds import kinds
from .._machine_lists import (
    REVERSAL_CYCLES,
    InUse,
    MachineLists,
    Reading,
    axes_in_use,
    machine_lists,
    reversal_cycles,
)
from .._nodes import as_array
from .._units import ExchangeError, expect
from ._events import ControllerEvent, homed_rows, loaded_versions, selected_rows
from ._motion import Column, Motion, direction_of_motion

_SMALLEST = 256
"""Motions are padded to powers of two from here on: few shapes to compile."""
_BY_ACTUAL = ("crosstalk_input", "direction_source", "plane_input")
"""Conventions that may take actual positions."""


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
    return _controller_of(uses, machine, numbers, reading)


def _controller_of(
    used: Sequence[InUse], lists: MachineLists, numbers: Sequence[int], reading: Reading
) -> PositionController:
    """Return the position controller that has these compensations, and no others."""
    columns, axes = columns_of(used, numbers), list[AxisCompensations]()
    fields = {field.name for field in dataclasses.fields(AxisCompensations)}
    for number in numbers:
        uses = [use for use in used if use.axis == number]
        parts: dict[str, Any] = {}
        for use in uses:
            masters = tuple(columns[master] for master in use.masters)
            model = use.model(reading)
            parts |= use.kind.entries.installed(model, masters, use.listing)
        parts["further"] = {name: parts.pop(name) for name in parts.keys() - fields}
        manual = () if reading.commanded else tuple(o.name for o in uses if o.manual)
        cycles = reversal_cycles(lists.machine.get(number))
        axes.append(AxisCompensations(**parts, reversal_cycles=cycles, manual=manual))
    return PositionController(axes=tuple(axes), conventions=reading.conventions)


def columns_of(used: Sequence[InUse], numbers: Sequence[int]) -> dict[int, int]:
    """Return the column of each axis.

    Raises:
        ExchangeError: If a compensation names an axis that has none.
    """
    for use in used:
        for axis in (use.axis, *use.masters):
            role = "axis" if axis == use.axis else "master axis"
            where, found = use.listing.source, f"{role} {axis}, which the machine lacks"
            expected = f"one of its axes, {', '.join(map(str, numbers))}"
            expect(axis in numbers, f"{where}: {use.name}", found, expected)
    return {number: k for k, number in enumerate(numbers)}


@dataclasses.dataclass(frozen=True)
class AxisOffsets:
    """What an axis's lists add, per row.

    Attributes:
        axis: Logical number.
        parts: Position offsets by compensation in mm or °, those that are active.
        total: Their sum.
        left_out: Compensations that are active and could not be computed.
        current: Current of the friction compensation in drive units; None: it has none.
        remarks: What the user should know: why something was left out, or that it waits
            for a command.
    """

    axis: int
    parts: Mapping[str, Column]
    total: Column
    left_out: tuple[str, ...]
    current: Column | None = None
    remarks: tuple[str, ...] = ()


def simulate(
    lists: Sequence[ListFile],
    motion: Motion,
    reading: Reading,
    *,
    cycle_time: float | None = None,
    only: Callable[[InUse], bool] | None = None,
    events: Sequence[ControllerEvent] | None = None,
) -> tuple[AxisOffsets, ...]:
    """Return what the controller adds to each axis along a motion.

    Without an axis list everything in a list is active; with one, what its activation
    bits say, what waits for COMP ON included unless there are events. Without time the rows
    stand for themselves: neither filters nor delays.

    Where lists are loaded again, the old table goes and the new one comes as at COMP OFF and
    ON: over the cycles of each, both at the same time (S-06).

    Args:
        lists: Compensation and axis lists in any order, as they are loaded in the first row.
        motion: Commanded motion.
        reading: How the lists are read.
        cycle_time: Of the controller in s, to hold the time step of the motion against.
        only: Which compensations are computed; None: all. Axes that have none of them are
            left out.
        events: In the order of their rows; None: everything has been on and homed for
            long, also what waits for COMP ON.

    Raises:
        ExchangeError: If a list makes no table, an axis has two lists, or the motion
            lacks an axis, has bad values, or no time for events; if a list that is loaded
            again replaces none.
    """
    timed = events is None or motion.time is not None
    expect(timed, motion.source, "no time", "time, for events")
    motion.check(cycle_time)
    motion = dataclasses.replace(motion, ranges=reading.modulo)
    reading = dataclasses.replace(reading, commanded=events is None)
    versions, spans = loaded_versions(lists, events or (), motion.rows)
    added: dict[tuple[int, str], Column] = {}
    why: dict[InUse, str | None] = {}
    axes: set[int] = set()
    for version, new in versions:
        machine = machine_lists(version)
        every = machine.in_use(reading.conventions, reading.lines)
        used = [use for use in every if only is None or only(use)]
        some = machine.compensation or any(use.kind.holder == "axis" for use in used)
        sources = ", ".join(listing.source for listing in version) or "lists"
        expect(some, sources, "no compensation list", "at least one (kopf.*, kw.*)")
        lacks = {use: use.kind.entries.lacks(use, motion, reading) for use in used}
        computed = [use for use in used if lacks[use] is None]
        for use in computed:
            for axis in use.kind.entries.looks_at(use, motion, reading):
                motion.position(axis, f"for the {use.name} of A{use.axis}")
        numbers = axes_in_use(used, machine)
        controller = _controller_of(computed, machine, numbers, reading)
        whole = _controller_motion(motion, numbers, reading.conventions)
        if events is not None:
            others = [event for event in events if event.action != "reload"]
            windows = {
                (use.axis, use.name): spans[id(use.listing)]
                for use in used
                if id(use.listing) in spans
            }
            homed = homed_rows(others, numbers, motion.rows)
            active = selected_rows(controller, others, numbers, motion.rows, windows)
            whole = dataclasses.replace(whole, homed=homed, active=active)
        offsets = _run(controller, whole, settled=motion.time is None)
        for use in computed:
            # What was there before a list was loaded again is added already.
            if new is None or use.listing is new:
                rows = offsets[use.name][:, numbers.index(use.axis)]
                added[use.axis, use.name] = rows + added.get((use.axis, use.name), 0.0)
        why |= lacks
        axes |= {use.axis for use in used}
        axes |= set(machine.compensation) if only is None else set()
    waiting = events is not None
    return tuple(_axis(axis, added, why, motion, waiting) for axis in sorted(axes))


def _controller_motion(
    motion: Motion, numbers: Sequence[int], conventions: Conventions
) -> ControllerMotion:
    """Return the motion as the controller takes it, a column per axis.

    What no compensation needs and the motion does not have is 0. Directions are given where
    the controller cannot tell them by positions. A motion without the actual positions that
    conventions take is refused.
    """
    zeros = np.zeros(motion.rows)

    def table(columns: Mapping[int, Column | None]) -> Float[Array, "t a"]:
        rates = [columns.get(number) for number in numbers]
        return as_array(np.stack([zeros if c is None else c for c in rates], axis=1))

    def rates(actual: bool) -> list[Float[Array, "t a"]]:
        pairs = {number: motion.rates(number, actual) for number in numbers}
        return [table({n: pair[k] for n, pair in pairs.items()}) for k in (0, 1)]

    by_actual = [name for name in _BY_ACTUAL if getattr(conventions, name) == "actual"]
    if by_actual and not motion.actuals:
        like = f"columns such as A{numbers[0]}.actual, as the convention {by_actual[0]}"
        raise ExchangeError(motion.source, "no actual positions", f"{like} takes them")
    signs: dict[int, Column | None] = {}
    places = motion.actuals if "direction_source" in by_actual else motion.positions
    for axis in numbers:
        if axis in motion.directions:
            signs[axis] = motion.directions[axis].astype(float)
        elif motion.time is not None and axis in places:
            place = motion.unwrapped(axis, places[axis])
            signs[axis] = direction_of_motion(place, 0).astype(float)
    velocity, acceleration = rates(actual=False)
    fast, pushed = rates(True) if "crosstalk_input" in by_actual else (None, None)
    warm = list(motion.temperatures.values())
    # An axis without an actual position of its own is where it is commanded.
    actual = {**motion.positions, **motion.actuals} if motion.actuals else None
    return ControllerMotion(
        position=table(motion.positions),
        velocity=velocity,
        acceleration=acceleration,
        temperature=as_array(np.stack(warm, axis=1)) if warm else None,
        direction=table(signs) if motion.directions or motion.ranges else None,
        actual=None if actual is None else table(actual),
        actual_velocity=fast,
        actual_acceleration=pushed,
    )


def _run(
    controller: PositionController, motion: ControllerMotion, *, settled: bool
) -> dict[str, np.ndarray]:
    """Return each compensation of all axes, shape ``(t, a)``."""
    rows = motion.cycles
    if rows == 0:
        return dict.fromkeys(controller.installed, np.zeros(motion.position.shape))
    # The last row is repeated: the axes stand, as they would.
    whole: ControllerMotion = jax.tree.map(
        lambda column: jnp.asarray(filled(np.asarray(column), _SMALLEST)), motion
    )
    moves = (jnp.arange(whole.cycles) < rows)[:, None]
    rates = {name: getattr(whole, name) for name in ("velocity", "acceleration")}
    still = {name: jnp.where(moves, rate, 0.0) for name, rate in rates.items()}
    whole = dataclasses.replace(whole, **still)
    if settled:
        offsets = controller.settled(whole)
    else:
        offsets, _ = controller.run(controller.start(), whole)
    names = controller.installed
    return {name: np.asarray(offsets.part(name))[:rows] for name in names}


def _axis(
    axis: int,
    added: Mapping[tuple[int, str], Column],
    why: Mapping[InUse, str | None],
    motion: Motion,
    waiting: bool,
) -> AxisOffsets:
    """Return what is added to an axis; why something is not computed, by what is in use."""
    act = [kind for kind in kinds() if (axis, kind.name) in added]
    parts = {kind.name: added[axis, kind.name] for kind in act if not kind.adds_current}
    currents = [added[axis, kind.name] for kind in act if kind.adds_current]
    mine = {entry: reason for entry, reason in why.items() if entry.axis == axis}
    out = {entry.name: reason for entry, reason in mine.items() if reason is not None}
    words = "stands in the list and is not computed"
    remarks = [f"{name} {words}: {reason}" for name, reason in out.items()]
    remarks += [
        f"{entry.name} waits for COMP ON in the NC program (manual_activation 1); it is"
        " computed as switched on"
        for entry, reason in mine.items()
        if entry.manual and reason is None and not waiting
    ]
    if act and not motion.is_even:
        remarks.append(
            f"the time steps of {motion.source} differ: filters and delays take each row"
            " as one cycle"
        )
    return AxisOffsets(
        axis=axis,
        parts=parts,
        total=sum(parts.values(), np.zeros(motion.rows)),
        left_out=tuple(out),
        current=sum(currents[1:], currents[0]) if currents else None,
        remarks=tuple(dict.fromkeys(f"A{axis}: {words}" for words in remarks)),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class AxisLists:
    """The lists of one axis, and how the controller reads them.

    What is asked of them raises an `ExchangeError` where an entry that decides it is
    unreadable, or where the lists make no table.

    Attributes:
        axis: Logical number.
        compensation: Its compensation list, or None.
        machine: Its axis list, or None: then everything in the compensation list acts.
        reading: How they are read; what waits for COMP ON is taken as switched on.
    """

    axis: int
    compensation: ListFile | None
    machine: ListFile | None
    reading: Reading

    @functools.cached_property
    def files(self) -> tuple[ListFile, ...]:
        """Those that say something, as lists of this axis also where they do not say so."""
        number, lists = "kopf.achs_nr", list[ListFile]()
        if self.compensation is not None and self.compensation.kind == "compensation":
            lists.append(self.compensation)
        if (machine := self.machine) is not None:
            # One that names no compensation is an axis list all the same: all are off.
            stated = {REVERSAL_CYCLES: reversal_cycles(machine)}
            lists.append(machine if machine.kind == "axis" else machine.merge(stated))
        return tuple(
            one if one.integer(number) else one.merge({number: self.axis})
            for one in lists
        )

    @functools.cached_property
    def in_use(self) -> tuple[InUse, ...]:
        """What acts by these files, by some conventions on another axis."""
        rules, lines = self.reading.conventions, self.reading.lines
        return tuple(machine_lists(self.files).in_use(rules, lines))

    @functools.cached_property
    def used(self) -> Mapping[str, InUse]:
        """What adds to the position of the axis, by compensation."""
        mine = {entry.name: entry for entry in self.in_use if entry.axis == self.axis}
        places = [kind.name for kind in kinds() if not kind.adds_current]
        return {name: mine[name] for name in places if name in mine}

    def inputs(self, name: str) -> tuple[int, ...]:
        """Return the axes over whose positions a compensation acts at standstill."""
        entry = self.used[name]
        return entry.kind.entries.inputs(entry.masters)

    def acts(self, name: str) -> bool:
        """Return whether it adds something: a table of zeros does not."""
        entry = self.used.get(name)
        return entry is not None and not entry.kind.entries.adds_nothing(entry.listing)

    @functools.cached_property
    def models(self) -> Mapping[str, object]:
        """The model of each compensation."""
        return {name: use.model(self.reading) for name, use in self.used.items()}

    def turns(self, name: str) -> bool:
        """Return whether it adds something else in either direction."""
        return self.used[name].kind.entries.turns(self.models[name])

    def parts(self, motion: Motion) -> dict[str, Column]:
        """Return what the controller adds, by compensation, in mm or °.

        What the motion lacks positions, temperatures, a velocity or an acceleration for is
        left out.
        """

        def is_known(use: InUse) -> bool:
            if use.axis != self.axis or use.kind.adds_current:
                return False
            looks_at = use.kind.entries.looks_at(use, motion, self.reading)
            return all(axis in motion.positions for axis in looks_at)

        if not any(map(is_known, self.used.values())):
            return {}
        (axis,) = simulate(self.files, motion, self.reading, only=is_known)
        return dict(axis.parts)

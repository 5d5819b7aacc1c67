"""What the lists of a machine add along a motion: each compensation, and the sum."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....data.lists import ListFile
from ....models import (
    Conventions,
    Motion as ControllerMotion,
    Offsets,
    PositionController,
)
from ...core import filled
from ...kinds import kinds
from .._machine_lists import InUse, Reading, axes_in_use, machine_lists
from .._nodes import as_array
from .._units import expect
from ._controller import controller_of
from ._events import (
    ControllerEvent,
    homed_rows,
    loaded_versions,
    selected_rows,
)
from ._motion import Motion, direction_of_motion

_SMALLEST = 256
"""Motions are padded to powers of two from here on: few shapes to compile."""


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
    parts: Mapping[str, Float[np.ndarray, " t"]]
    total: Float[np.ndarray, " t"]
    left_out: tuple[str, ...]
    current: Float[np.ndarray, " t"] | None = None
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
    added: dict[tuple[int, str], Float[np.ndarray, " t"]] = {}
    why: dict[InUse, str | None] = {}
    shown: set[int] = set()
    known: set[int] = set()
    for version in versions:
        machine = machine_lists(version)
        used = [
            one
            for one in machine.in_use(reading.conventions, reading.lines)
            if only is None or only(one)
        ]
        expect(
            machine.compensation or any(one.kind.holder == "axis" for one in used),
            ", ".join(one.source for one in version) or "lists",
            "no compensation list",
            "at least one (kopf.*, kw.*)",
        )
        lacks = {one: one.kind.entries.lacks(one, motion, reading) for one in used}
        computed = [one for one in used if lacks[one] is None]
        for one in computed:
            for axis in one.kind.entries.looks_at(one, motion):
                motion.position(axis, f"for {one.kind.noun} of A{one.axis}")
        numbers = axes_in_use(used, machine)
        controller = controller_of(computed, machine, numbers, reading)
        whole = _controller_motion(motion, numbers, reading.conventions)
        if events is not None:
            others = [one for one in events if one.action != "reload"]
            windows = {
                (one.axis, one.name): spans[id(one.listing)]
                for one in used
                if id(one.listing) in spans
            }
            homed = homed_rows(others, numbers, motion.rows)
            active = selected_rows(controller, others, numbers, motion.rows, windows)
            whole = dataclasses.replace(whole, homed=homed, active=active)
        found = _run(controller, whole, settled=motion.time is None)
        loaded = {id(one) for one in version} - known
        for one in computed:
            # What was there before a list was loaded again is added already.
            if not known or id(one.listing) in loaded:
                rows = found[one.name][:, numbers.index(one.axis)]
                added[one.axis, one.name] = rows + added.get((one.axis, one.name), 0.0)
        why |= lacks
        known |= loaded
        shown |= {one.axis for one in used}
        shown |= set(machine.compensation) if only is None else set()
    return tuple(
        _axis(
            axis,
            added,
            {one: reason for one, reason in why.items() if one.axis == axis},
            motion,
            waiting=events is not None,
        )
        for axis in sorted(shown)
    )


def _controller_motion(
    motion: Motion, numbers: Sequence[int], conventions: Conventions
) -> ControllerMotion:
    """Return the motion as the controller takes it, a column per axis.

    What no compensation needs and the motion does not have is 0.

    Raises:
        ExchangeError: If the conventions take actual positions and there are none.
    """
    none = np.zeros(motion.rows)

    def table(
        columns: Sequence[Float[np.ndarray, " t"] | None],
    ) -> Float[Array, "t a"]:
        return as_array(np.stack([none if c is None else c for c in columns], axis=1))

    def rates(actual: bool) -> list[Float[Array, "t a"]]:
        pairs = [motion.rates(n, actual) for n in numbers]
        return [table([pair[k] for pair in pairs]) for k in (0, 1)]

    actual = _actuals(motion, numbers, conventions)
    by_actual = conventions.crosstalk_input == "actual"
    velocity, acceleration = rates(actual=False)
    velocities, accelerations = rates(actual=True) if by_actual else (None, None)
    return ControllerMotion(
        position=table([motion.positions.get(n) for n in numbers]),
        velocity=velocity,
        acceleration=acceleration,
        temperature=(
            table(list(motion.temperatures.values())) if motion.temperatures else None
        ),
        direction=_directions(motion, numbers, conventions),
        actual=actual,
        actual_velocity=velocities,
        actual_acceleration=accelerations,
    )


def _directions(
    motion: Motion, numbers: Sequence[int], conventions: Conventions
) -> Float[Array, "t a"] | None:
    """Return the directions where the controller cannot tell them by positions."""
    if not motion.directions and not motion.ranges:
        return None
    places = motion.positions
    if conventions.direction_source == "actual":
        places = motion.actuals
    columns = []
    for axis in numbers:
        found = motion.directions.get(axis)
        if found is None and motion.time is not None and axis in places:
            found = direction_of_motion(motion.unwrapped(axis, places[axis]), 0)
        columns.append(np.zeros(motion.rows) if found is None else found.astype(float))
    return as_array(np.stack(columns, axis=1))


def _actuals(
    motion: Motion, numbers: Sequence[int], conventions: Conventions
) -> Float[Array, "t a"] | None:
    if motion.actuals:
        # An axis without its own is where it is commanded.
        either = {**motion.positions, **motion.actuals}
        none = np.zeros(motion.rows)
        return as_array(np.stack([either.get(n, none) for n in numbers], axis=1))
    for name in ("crosstalk_input", "direction_source", "plane_input"):
        like = (
            f"columns such as A{numbers[0]}.actual, as the convention {name} takes them"
        )
        commanded = getattr(conventions, name) != "actual"
        expect(commanded, motion.source, "no actual positions", like)
    return None


def _run(
    controller: PositionController, motion: ControllerMotion, *, settled: bool
) -> dict[str, np.ndarray]:
    """Return each compensation of all axes, shape ``(t, a)``."""
    rows = motion.cycles
    if rows == 0:
        none = np.zeros(motion.position.shape)
        return {name: none for name in controller.installed}
    whole = _padded(motion)
    offsets: Offsets
    if settled:
        offsets = controller.settled(whole)
    else:
        offsets, _ = controller.run(controller.start(), whole)
    return {
        name: np.asarray(offsets.part(name))[:rows] for name in controller.installed
    }


def _padded(motion: ControllerMotion) -> ControllerMotion:
    """Return the motion with its last row repeated: the axes stand, as they would."""
    longer: ControllerMotion = jax.tree.map(
        lambda rows: jnp.asarray(filled(np.asarray(rows), _SMALLEST)), motion
    )
    moves = (jnp.arange(longer.cycles) < motion.cycles)[:, None]
    return dataclasses.replace(
        longer,
        velocity=jnp.where(moves, longer.velocity, 0.0),
        acceleration=jnp.where(moves, longer.acceleration, 0.0),
    )


def _axis(
    axis: int,
    added: Mapping[tuple[int, str], Float[np.ndarray, " t"]],
    why: Mapping[InUse, str | None],
    motion: Motion,
    *,
    waiting: bool,
) -> AxisOffsets:
    """Return what is added to an axis; why something is not computed, by what is in use."""
    own = [each for each in kinds() if (axis, each.name) in added]
    parts = {each.name: added[axis, each.name] for each in own if not each.adds_current}
    currents = [added[axis, each.name] for each in own if each.adds_current]
    out = {one.name: reason for one, reason in why.items() if reason is not None}
    remarks = [
        f"A{axis}: {name} stands in the list and is not computed: {reason}"
        for name, reason in out.items()
    ]
    remarks += [
        f"A{axis}: {one.name} waits for COMP ON in the NC program"
        " (manual_activation 1); it is computed as switched on"
        for one, reason in why.items()
        if one.manual and reason is None and not waiting
    ]
    if own and not motion.is_even:
        remarks.append(
            f"A{axis}: the time steps of {motion.source} differ: filters and delays"
            " take each row as one cycle"
        )
    return AxisOffsets(
        axis=axis,
        parts=parts,
        total=sum(parts.values(), np.zeros(motion.rows)),
        left_out=tuple(out),
        current=sum(currents[1:], currents[0]) if currents else None,
        remarks=tuple(dict.fromkeys(remarks)),
    )

"""What the lists of a machine add along a motion: each compensation, and the sum."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...data.lists import ListFile
from ...models import (
    Conventions,
    Motion as ControllerMotion,
    Offsets,
    PositionController,
    TemperatureLine,
)
from ..kinds import kinds
from ._controller import controller_of
from ._controller_motion import controller_motion
from ._errors import ExchangeError
from ._identity import Increments
from ._machine_lists import InUse, Reading, axes_in_use, machine_lists
from ._modulo import Ranges
from ._motion import Motion

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
    conventions: Conventions,
    increment: Increments = None,
    *,
    modulo: Ranges | None = None,
    lines: Mapping[int, TemperatureLine] | None = None,
    cycle_time: float | None = None,
    only: Callable[[InUse], bool] | None = None,
) -> tuple[AxisOffsets, ...]:
    """Return what the controller adds to each axis along a motion.

    Without an axis list everything in a list is active; with one, what its activation
    bits say, what waits for COMP ON included. Without time the rows stand for
    themselves: neither filters nor delays.

    Args:
        lists: Compensation and axis lists in any order.
        motion: Commanded motion.
        conventions: Rules of the controller.
        increment: Worth of an encoder increment for lists with ``unit 0``.
        modulo: Range in ° by axis, for the axes that turn.
        lines: Temperature lines as a PLC makes them, by axis.
        cycle_time: Of the controller in s, to hold the time step of the motion against.
        only: Which compensations are computed; None: all. Axes that have none of them are
            left out.

    Raises:
        ExchangeError: If a list makes no table, an axis has two lists, or the motion
            lacks an axis or has bad values.
    """
    motion.check(cycle_time)
    machine = machine_lists(lists)
    used = machine.in_use(conventions, lines or ())
    if only is not None:
        used = tuple(one for one in used if only(one))
    own = {one.axis for one in used if one.kind.holder == "axis"}
    if not machine.compensation and not own:
        names = ", ".join(one.source for one in lists)
        raise ExchangeError(
            where=names or "lists",
            found="no compensation list",
            expected="at least one (kopf.*, kw.*)",
        )
    reading = Reading(conventions, increment, modulo or {}, lines or {}, commanded=True)
    why = {one: one.kind.entries.lacks(one, motion, reading) for one in used}
    computed = [one for one in used if why[one] is None]
    for one in computed:
        for axis in one.kind.entries.looks_at(one, motion):
            motion.position(axis, f"for {one.kind.noun} of A{one.axis}")
    numbers = axes_in_use(used, machine)
    controller = controller_of(computed, machine, numbers, reading)
    found = _run(controller, motion, numbers, reading)
    listed = set(machine.compensation) if only is None else set[int]()
    shown = sorted({one.axis for one in used} | listed)
    return tuple(
        _axis(axis, numbers.index(axis), found, {o: w for o, w in why.items()
                                                 if o.axis == axis}, motion)
        for axis in shown
    )  # fmt: skip


def _run(
    controller: PositionController,
    motion: Motion,
    numbers: Sequence[int],
    reading: Reading,
) -> dict[str, np.ndarray]:
    """Return each compensation of all axes, shape ``(t, a)``."""
    rows = motion.rows
    if rows == 0:
        return {name: np.zeros((0, len(numbers))) for name in controller.installed}
    whole = _padded(controller_motion(motion, numbers, reading))
    offsets: Offsets
    if motion.time is None:
        offsets = controller.settled(whole)
    else:
        offsets, _ = controller.run(controller.start(), whole)
    return {
        name: np.asarray(offsets.part(name))[:rows] for name in controller.installed
    }


def _padded(motion: ControllerMotion) -> ControllerMotion:
    """Return the motion with its last row repeated: the axes stand, as they would."""
    size = max(_SMALLEST, 1 << max(motion.cycles - 1, 0).bit_length())
    more = ((0, size - motion.cycles), (0, 0))
    longer: ControllerMotion = jax.tree.map(
        lambda rows: jnp.pad(rows, more, mode="edge"), motion
    )
    still = (jnp.pad(motion.velocity, more), jnp.pad(motion.acceleration, more))
    return ControllerMotion(
        longer.position, *still, longer.temperature,
        direction=longer.direction, actual=longer.actual,
        actual_velocity=longer.actual_velocity,
        actual_acceleration=longer.actual_acceleration,
    )  # fmt: skip


def _axis(
    axis: int,
    column: int,
    found: Mapping[str, np.ndarray],
    why: Mapping[InUse, str | None],
    motion: Motion,
) -> AxisOffsets:
    here = {one.name for one, reason in why.items() if reason is None}
    parts, currents = {}, []
    for each in kinds():
        if each.name in here:
            rows = np.ascontiguousarray(found[each.name][:, column])
            if each.adds_current:
                currents.append(rows)
            else:
                parts[each.name] = rows
    remarks = [
        f"A{axis}: {one.name} stands in the list and is not computed: {reason}"
        for one, reason in why.items()
        if reason is not None
    ]
    remarks += [
        f"A{axis}: {one.name} waits for COMP ON in the NC program"
        " (manual_activation 1); it is computed as switched on"
        for one, reason in why.items()
        if one.manual and reason is None
    ]
    if here and not motion.is_even:
        remarks.append(
            f"A{axis}: the time steps of {motion.source} differ: filters and delays"
            " take each row as one cycle"
        )
    return AxisOffsets(
        axis=axis,
        parts=parts,
        total=sum(parts.values(), np.zeros(motion.rows)),
        left_out=tuple(one.name for one, reason in why.items() if reason is not None),
        current=sum(currents[1:], currents[0]) if currents else None,
        remarks=tuple(remarks),
    )

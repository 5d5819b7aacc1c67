"""What friction and its list do to a circle: quadrant spikes, simulated."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...models import (
    AbstractFriction,
    FrictionCompensation,
    FrictionTable,
)
from ._course import ServoLoop, course_of

_ENTRIES = 32
"""Entries to which a list is filled up: lists of any length are one program."""
_UNROLL = 4
"""Cycles that the simulation takes at a time: faster, and compiled as soon."""


@dataclasses.dataclass(frozen=True)
class CircularTest:
    """The last turn of a circle, one entry per cycle.

    Attributes:
        angle: In degrees, 0 where the axis turns at its positive end.
        without: Radial deviation in mm without the list.
        with_list: The same with it.
        radius: In mm.
        feed: Along the circle, in mm/s.
        loop: The control loop that was assumed.
    """

    angle: Float[np.ndarray, " t"]
    without: Float[np.ndarray, " t"]
    with_list: Float[np.ndarray, " t"]
    radius: float
    feed: float
    loop: ServoLoop

    @property
    def spikes(self) -> tuple[float, float]:
        """Largest radial deviation in mm without and with the list."""
        return (
            float(np.max(np.abs(self.without))),
            float(np.max(np.abs(self.with_list))),
        )


def circular_test(
    law: AbstractFriction,
    inertia: float,
    compensation: FrictionCompensation,
    *,
    out_unit: float = 1.0,
    radius: float = 50.0,
    feed: float = 2000.0 / 60.0,
    loop: ServoLoop | None = None,
    cycle: float = 0.001,
) -> CircularTest:
    """Return how an axis with friction draws its half of a circle, with and without list.

    The other axis is perfect, so that all that is seen comes from this one. Friction
    acts as the law says, with sticking at rest; the torque follows at once.

    Args:
        law: Friction of the axis in units of current over mm/s.
        inertia: Current per mm/s².
        compensation: The friction list.
        out_unit: Current that one unit of the list is.
        radius: Of the circle in mm.
        feed: Along the circle in mm/s.
        loop: The control loop; a usual one if left out.
        cycle: Of the controller in s.
    """
    course = course_of(radius, feed, ServoLoop() if loop is None else loop, cycle)
    run = _follow(
        law,
        jnp.asarray(inertia),
        _filled_up(compensation),
        jnp.asarray(out_unit),
        jnp.asarray(course.motion),
        jnp.asarray(course.gains),
        jnp.asarray(course.arcs),
    )
    without, with_list = course.deviation(np.asarray(run))
    return CircularTest(
        angle=course.angle,
        without=without,
        with_list=with_list,
        radius=radius,
        feed=feed,
        loop=course.loop,
    )


def _filled_up(compensation: FrictionCompensation) -> FrictionCompensation:
    """Return a list with more entries where it is held above: any length is one program."""
    table = compensation.law
    if not isinstance(table, FrictionTable) or not table.held_above:
        return compensation
    lack = -table.nodes.count % _ENTRIES
    points, values = np.asarray(table.nodes.points), np.asarray(table.values)
    beyond = points[-1] + max(points[-1], 1.0) * np.arange(1.0, lack + 1.0)
    longer = {
        id(table.nodes.points): np.append(points, beyond),
        id(table.values): np.pad(values, (0, lack), "edge"),
    }
    leaves, tree = jax.tree.flatten(compensation)
    found: FrictionCompensation = jax.tree.unflatten(
        tree, [longer.get(id(leaf), leaf) for leaf in leaves]
    )
    return found


@eqx.filter_jit
def _follow(
    law: AbstractFriction,
    inertia: Float[Array, ""],
    compensation: FrictionCompensation,
    out_unit: Float[Array, ""],
    motion: Float[Array, "t 3"],
    gains: Float[Array, " 4"],
    arcs: Int[Array, "s a"],
) -> Float[Array, "s a2"]:
    """Return where the axis is on each arc, in mm: all without, then all with its list.

    A step of the second order per cycle, over which the drive pushes evenly. Where an
    axis comes to rest on the way, the rest of the cycle begins anew from there. What
    friction takes until half of a step, which foretells the speed there, is what it took
    in the middle of the step before, or at rest: the law is asked once per step.
    """
    start = compensation.start()
    listed = compensation.run(start, motion[:, 0], motion[:, 1])[0]
    added = out_unit * listed[arcs]
    added = jnp.concatenate([jnp.zeros_like(added), added], axis=1)
    motion = jnp.concatenate([motion[arcs], motion[arcs]], axis=1)
    kv, kp, per_time, cycle = gains

    def slowing(speed: Array, way: Array) -> Array:
        found: Array = law.level(speed, way) / inertia
        return found

    rest = jnp.zeros(added.shape[1])
    held = slowing(rest, rest + 1.0), slowing(rest, rest - 1.0)

    def cycle_of(
        state: tuple[Array, Array, Array, Array], now: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array, Array], Array]:
        place, speed, integral, taken = state
        (wanted, fast, push), extra = now[0].T, now[1]
        lag = fast + kv * (wanted - place) - speed
        integral = integral + kp * per_time * lag * cycle
        free = push + kp * lag + integral + extra / inertia
        rests = speed == 0.0
        way = jnp.where(jnp.where(rests, free, speed) < 0.0, -1.0, 1.0)
        taken = jnp.where(rests, jnp.where(way < 0.0, held[1], held[0]), taken)
        half = jnp.maximum(way * (speed + 0.5 * cycle * (free - way * taken)), 0.0)
        taken = slowing(half, way)
        after = speed + cycle * (free - way * taken)
        onward = place + 0.5 * cycle * (speed + after)
        # At rest on the way: friction takes what it can get, and the axis sticks, or
        # goes the other way for what is left of the cycle.
        begun = jnp.abs(speed) + jnp.abs(after)
        until = cycle * jnp.abs(speed) / jnp.where(begun > 0.0, begun, 1.0)
        stop = place + 0.5 * until * speed
        holds = jnp.where(free < 0.0, held[1], held[0])
        over = jnp.maximum(jnp.abs(free) - holds, 0.0)
        back = jnp.sign(free) * over * (cycle - until)
        goes_on = way * after > 0.0
        speed_after = jnp.where(goes_on, after, back)
        place_after = jnp.where(goes_on, onward, stop + 0.5 * (cycle - until) * back)
        taken = jnp.where(goes_on, taken, holds)
        return (place_after, speed_after, integral, taken), place

    place, speed = motion[0, :, 0], motion[0, :, 1]
    taken = slowing(jnp.abs(speed), jnp.where(speed < 0.0, -1.0, 1.0))
    state = place, speed, rest, taken
    return jax.lax.scan(cycle_of, state, (motion, added), unroll=_UNROLL)[1]

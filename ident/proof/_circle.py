"""What friction and its list do to a circle: quadrant spikes, simulated."""

import dataclasses
import math
from functools import lru_cache
from typing import ClassVar

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

_FORGOTTEN = 30.0
"""Time constants of the loop after which nothing is left of how it began."""
_GAINS = 50.0, 300.0, 100.0
"""Of a cascade with velocity feed-forward, in 1/s: position gain Kv, bandwidth of the velocity
loop, and one over its integral time."""
_ARCS = 16
"""Arcs of the turn that are followed side by side, each from when it would be forgotten."""
_ENTRIES = 32
"""Entries to which a list is filled up: lists of any length are one program."""


@dataclasses.dataclass(frozen=True)
class CircularTest:
    """The last turn of a circle, one entry per cycle.

    Attributes:
        angle: In degrees, 0 where the axis turns at its positive end.
        without: Radial deviation in mm without the list.
        with_list: The same with it.
        radius: Of the circle in mm.
        feed: Along it, in mm/s.
        loop: The control loop that is assumed.
    """

    angle: Float[np.ndarray, " t"]
    without: Float[np.ndarray, " t"]
    with_list: Float[np.ndarray, " t"]
    radius: ClassVar[float] = 50.0
    feed: ClassVar[float] = 2000.0 / 60.0
    loop: ClassVar[str] = "Kv 50 1/s, velocity loop 300 1/s with 10 ms integral time"

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
        cycle: Of the controller in s.
    """
    phase, places, given = _course(cycle)
    numbers = jnp.asarray(inertia), jnp.asarray(out_unit)
    found = _follow(law, _filled_up(compensation), numbers, *given)
    place = np.empty((len(phase), 2))
    place[places] = np.asarray(found)[-len(places) :]
    # The other axis does not err: this one's share of the radius is cos of the angle.
    radial = (place.T - CircularTest.radius * np.cos(phase)) * np.cos(phase)
    return CircularTest(
        angle=np.rad2deg(phase - phase[0]),
        without=radial[0],
        with_list=radial[1],
    )


@lru_cache
def _course(
    cycle: float,
) -> tuple[Float[np.ndarray, " t"], Int[np.ndarray, "s a"], tuple[Array, ...]]:
    """Return the phase of the last turn, the places in it of each arc, and what `_follow` takes.

    The same for every axis of a controller.
    """
    radius = CircularTest.radius
    speed = CircularTest.feed / radius
    turn = round(2 * np.pi / (speed * cycle))
    # By then the loop has forgotten how it began; the turn that is shown is a later one.
    before = min(math.ceil(_FORGOTTEN / (min(_GAINS) * cycle)), 2 * turn)
    # Half a cycle on: the axis does not stand at a sample, as it would not in truth.
    phase = speed * cycle * (np.arange(-before, turn) + 2 * turn + 0.5)
    position, velocity = radius * np.cos(phase), -radius * speed * np.sin(phase)
    length = -(-turn // _ARCS)
    begins = np.minimum(length * np.arange(_ARCS), turn - length)
    arcs = begins + np.arange(before + length)[:, None]
    motion = np.stack([position, velocity, -speed * speed * position])
    given = tuple(map(jnp.asarray, (motion, np.array([*_GAINS, cycle]), arcs)))
    return phase[before:], arcs[before:] - before, given


def _filled_up(compensation: FrictionCompensation) -> FrictionCompensation:
    """Return a list with more entries where it is held above: any length is one program."""
    table = compensation.law
    if not isinstance(table, FrictionTable) or not table.held_above:
        return compensation
    lack = -table.nodes.count % _ENTRIES
    points, values = np.asarray(table.nodes.points), np.asarray(table.values)
    beyond = points[-1] + max(points[-1], 1.0) * np.arange(1.0, lack + 1.0)
    longer = np.append(points, beyond), np.pad(values, (0, lack), "edge")
    found: FrictionCompensation = eqx.tree_at(
        lambda one: (one.law.nodes.points, one.law.values), compensation, longer
    )
    return found


@eqx.filter_jit
def _follow(
    law: AbstractFriction,
    compensation: FrictionCompensation,
    numbers: tuple[Float[Array, ""], Float[Array, ""]],
    motion: Float[Array, "3 t"],
    gains: Float[Array, " 4"],
    arcs: Int[Array, "s a"],
) -> Float[Array, "s a 2"]:
    """Return where the axis is on each arc, in mm: without its list, and with it.

    A step of the second order per cycle, over which the drive pushes evenly. Where an
    axis comes to rest on the way, the rest of the cycle begins anew from there. What
    friction takes until half of a step, which foretells the speed there, is what it took
    in the middle of the step before, or at rest: the law is asked once per step.
    """
    (inertia, out_unit), start = numbers, compensation.start()
    listed = compensation.run(start, motion[0], motion[1])[0]
    # All arcs without the list, then all with it, in one row.
    added = out_unit * listed[arcs]
    added = jnp.concatenate([jnp.zeros_like(added), added], axis=1)
    motion = jnp.moveaxis(motion[:, jnp.concatenate([arcs, arcs], axis=1)], 1, 0)
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
        (wanted, fast, push), extra = now
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

    place, speed, _ = motion[0]
    taken = slowing(jnp.abs(speed), jnp.where(speed < 0.0, -1.0, 1.0))
    state = place, speed, rest, taken
    # Two steps at a time: a step of so few arcs costs little more than to begin it.
    places = jax.lax.scan(cycle_of, state, (motion, added), unroll=2)[1]
    return jnp.stack(jnp.split(places, 2, axis=1), axis=2)

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

from ...models import AbstractFriction, FrictionCompensation, FrictionTable

_FORGOTTEN = 20.0
"""Time constants of the loop after which its state at the start no longer matters."""
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
        return float(np.abs(self.without).max()), float(np.abs(self.with_list).max())


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
    phase, places, course = _course(cycle)
    numbers = jnp.asarray(inertia), jnp.asarray(out_unit)
    driven = _follow(law, _filled_up(compensation), numbers, *course)
    place = np.empty((len(phase), 2))
    place[places] = np.asarray(driven)[-len(places) :]
    # The other axis does not err: this one's share of the radius is cos of the angle.
    radial = (place.T - CircularTest.radius * np.cos(phase)) * np.cos(phase)
    return CircularTest(
        angle=np.rad2deg(phase - phase[0]), without=radial[0], with_list=radial[1]
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
    lead = min(math.ceil(_FORGOTTEN / (min(_GAINS) * cycle)), 2 * turn)
    # Half a cycle on: the axis does not stand at a sample, as it would not in truth.
    phase = speed * cycle * (np.arange(-lead, turn) + 2 * turn + 0.5)
    position, velocity = radius * np.cos(phase), -radius * speed * np.sin(phase)
    length = -(-turn // _ARCS)
    starts = np.minimum(length * np.arange(_ARCS), turn - length)
    arcs = starts + np.arange(lead + length)[:, None]
    motion = np.stack([position, velocity, -speed * speed * position])
    arrays = tuple(map(jnp.asarray, (motion, np.array([*_GAINS, cycle]), arcs)))
    return phase[lead:], arcs[lead:] - lead, arrays


def _filled_up(compensation: FrictionCompensation) -> FrictionCompensation:
    """Return a list with more entries where it is held above: any length is one program."""
    table = compensation.law
    if not isinstance(table, FrictionTable) or not table.held_above:
        return compensation
    lack = -table.nodes.count % _ENTRIES
    points, values = np.asarray(table.nodes.points), np.asarray(table.values)
    beyond = points[-1] + max(points[-1], 1.0) * np.arange(1.0, lack + 1.0)
    longer = np.append(points, beyond), np.pad(values, (0, lack), "edge")
    filled: FrictionCompensation = eqx.tree_at(
        lambda friction: (friction.law.nodes.points, friction.law.values),
        compensation,
        longer,
    )
    return filled


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

    def slowing(speed: Array, direction: Array) -> Array:
        friction: Array = law.level(speed, direction) / inertia
        return friction

    zeros = jnp.zeros(added.shape[1])
    breakaway = slowing(zeros, zeros + 1.0), slowing(zeros, zeros - 1.0)

    def cycle_of(
        state: tuple[Array, Array, Array, Array], inputs: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array, Array], Array]:
        place, speed, integral, friction = state
        (target, fast, push), extra = inputs
        lag = fast + kv * (target - place) - speed
        integral = integral + kp * per_time * lag * cycle
        drive = push + kp * lag + integral + extra / inertia
        rests = speed == 0.0
        direction = jnp.where(jnp.where(rests, drive, speed) < 0.0, -1.0, 1.0)
        friction = jnp.where(
            rests, jnp.where(direction < 0.0, breakaway[1], breakaway[0]), friction
        )
        half_speed = jnp.maximum(
            direction * (speed + 0.5 * cycle * (drive - direction * friction)), 0.0
        )
        friction = slowing(half_speed, direction)
        end_speed = speed + cycle * (drive - direction * friction)
        onward = place + 0.5 * cycle * (speed + end_speed)
        # At rest on the way: friction takes what it can get, and the axis sticks, or
        # goes the other way for what is left of the cycle.
        total = jnp.abs(speed) + jnp.abs(end_speed)
        until = cycle * jnp.abs(speed) / jnp.where(total > 0.0, total, 1.0)
        stop = place + 0.5 * until * speed
        holds = jnp.where(drive < 0.0, breakaway[1], breakaway[0])
        excess = jnp.maximum(jnp.abs(drive) - holds, 0.0)
        return_speed = jnp.sign(drive) * excess * (cycle - until)
        keeps_direction = direction * end_speed > 0.0
        speed_after = jnp.where(keeps_direction, end_speed, return_speed)
        place_after = jnp.where(
            keeps_direction, onward, stop + 0.5 * (cycle - until) * return_speed
        )
        friction = jnp.where(keeps_direction, friction, holds)
        return (place_after, speed_after, integral, friction), place

    place, speed, _ = motion[0]
    friction = slowing(jnp.abs(speed), jnp.where(speed < 0.0, -1.0, 1.0))
    state = place, speed, zeros, friction
    # Two steps at a time: a step of so few arcs costs little more than to begin it.
    places = jax.lax.scan(cycle_of, state, (motion, added), unroll=2)[1]
    return jnp.stack(jnp.split(places, 2, axis=1), axis=2)

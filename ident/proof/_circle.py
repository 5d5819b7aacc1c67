"""What friction and its list do to a circle: quadrant spikes, simulated."""

import dataclasses
import math
from collections.abc import Hashable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...models import (
    AbstractFriction,
    FrictionCompensation,
    FrictionTable,
    Setpoints,
)
from ..fit import in_group

_FORGOTTEN = 40.0
"""Time constants of the loop after which nothing is left of how it began."""
_BESIDE = 8
"""Circles that are followed side by side."""
_ENTRIES = 32
"""Entries to which a list is filled up: lists of any length are one program."""


@dataclasses.dataclass(frozen=True)
class ServoLoop:
    """A cascade of position and velocity control with velocity feed-forward.

    Attributes:
        position_gain: Kv in 1/s.
        velocity_gain: Bandwidth of the velocity loop in 1/s.
        integral_time: Of the velocity loop, in s.
    """

    position_gain: float = 50.0
    velocity_gain: float = 300.0
    integral_time: float = 0.01

    def __str__(self) -> str:
        return (
            f"Kv {self.position_gain:g} 1/s, velocity loop {self.velocity_gain:g} 1/s"
            f" with {1e3 * self.integral_time:g} ms integral time"
        )


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
    loop = ServoLoop() if loop is None else loop
    speed = feed / radius
    turn = round(2 * np.pi / (speed * cycle))
    # By then the loop has forgotten how it began; the turn that is shown is a later one.
    slowest = min(loop.position_gain, loop.velocity_gain, 1.0 / loop.integral_time)
    before = min(math.ceil(_FORGOTTEN / (slowest * cycle)), 2 * turn)
    # Half a cycle on: the axis does not stand at a sample, as it would not in truth.
    phase = speed * cycle * (np.arange(-before, turn) + 2 * turn + 0.5)
    position = radius * np.cos(phase)
    velocity = -radius * speed * np.sin(phase)
    whole = _filled_up(compensation)
    listed = whole.run(whole.start(), position, velocity)[0]
    gains = (loop.position_gain, loop.velocity_gain, 1.0 / loop.integral_time, cycle)
    one = _Circle(
        law=law,
        inertia=inertia,
        motion=np.stack([position, velocity, -speed * speed * position], axis=1),
        added=out_unit * np.asarray(listed),
        gains=gains,
    )
    runs = in_group(_follow_all, [one])[0]
    # Along the radius: this axis has cos of the angle, the other one does not err.
    without, with_list = ((runs.T - position) * np.cos(phase))[:, before:]
    angle = phase[before:]
    return CircularTest(
        angle=np.rad2deg(angle - angle[0]),
        without=without,
        with_list=with_list,
        radius=radius,
        feed=feed,
        loop=loop,
    )


def _filled_up(compensation: FrictionCompensation) -> FrictionCompensation:
    """Return the same list with more entries behind the last one, where that is held."""
    table = compensation.law
    if not isinstance(table, FrictionTable) or not table.held_above:
        return compensation
    lack = -table.nodes.count % _ENTRIES
    points, values = np.asarray(table.nodes.points), np.asarray(table.values)
    beyond = points[-1] + np.arange(1.0, lack + 1.0) * max(points[-1], 1.0)
    more = dataclasses.replace(
        table,
        nodes=Setpoints(jnp.asarray(np.concatenate([points, beyond]))),
        values=jnp.asarray(np.concatenate([values, np.full(lack, values[-1])])),
    )
    return dataclasses.replace(compensation, law=more)


@dataclasses.dataclass(frozen=True, eq=False)
class _Circle:
    """A circle to follow: gains as in `ServoLoop`, and the cycle in s."""

    law: AbstractFriction
    inertia: float
    motion: Float[np.ndarray, "t 3"]
    added: Float[np.ndarray, " t"]
    gains: tuple[float, float, float, float]

    @property
    def kind(self) -> tuple[Hashable, ...]:
        """Circles of one kind go together: laws alike, and the same motion."""
        leaves, tree = jax.tree.flatten(self.law)
        shapes = tuple(np.shape(leaf) for leaf in leaves)
        return tree, shapes, self.gains, self.motion.tobytes()


def _follow_all(circles: Sequence[_Circle]) -> list[Float[np.ndarray, "t 2"]]:
    """Return where the axes are in each cycle, in mm, without and with their lists.

    Always so many side by side, the last one over and over where there are less: one
    program, and the same numbers in any company.
    """
    places: dict[Hashable, list[int]] = {}
    for place, each in enumerate(circles):
        places.setdefault(each.kind, []).append(place)
    found: dict[int, np.ndarray] = {}
    for own in places.values():
        for start in range(0, len(own), _BESIDE):
            some = own[start : start + _BESIDE]
            full = [circles[k] for k in some + some[-1:] * (_BESIDE - len(some))]
            laws = jax.tree.map(
                lambda *leaves: np.stack(leaves), *(c.law for c in full)
            )
            added = np.stack([c.added for c in full], axis=1)
            runs = _follow(
                laws,
                jnp.array([c.inertia for c in full]),
                jnp.asarray(full[0].motion),
                jnp.asarray(np.stack([np.zeros_like(added), added], axis=2)),
                jnp.array(full[0].gains),
            )
            for lane, place in enumerate(some):
                found[place] = np.asarray(runs[:, lane])
    return [found[place] for place in range(len(circles))]


@eqx.filter_jit
def _follow(
    laws: AbstractFriction,
    inertia: Float[Array, " j"],
    motion: Float[Array, "t 3"],
    added: Float[Array, "t j 2"],
    gains: Float[Array, " 4"],
) -> Float[Array, "t j 2"]:
    """Return where the axes are in each cycle, in mm.

    A step of the second order per cycle, over which the drive pushes evenly. Where an
    axis comes to rest on the way, the rest of the cycle begins anew from there.
    """
    kv, kp, per_time, cycle = gains
    mass = inertia[:, None]

    @eqx.filter_vmap
    def level(law: AbstractFriction, speed: Array, way: Array) -> Array:
        return law.level(speed, way)

    def slowing(speed: Array, way: Array) -> Array:
        found: Array = level(laws, speed, way) / mass
        return found

    rest = jnp.zeros(added.shape[1:])
    held = slowing(rest, rest + 1.0), slowing(rest, rest - 1.0)

    def cycle_of(
        state: tuple[Array, Array, Array], now: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array], Array]:
        place, speed, integral = state
        (wanted, fast, push), extra = now
        lag = fast + kv * (wanted - place) - speed
        integral = integral + kp * per_time * lag * cycle
        free = push + kp * lag + integral + extra / mass
        way = jnp.where(jnp.where(speed == 0.0, free, speed) < 0.0, -1.0, 1.0)
        slower = free - way * slowing(jnp.abs(speed), way)
        half = jnp.maximum(way * (speed + 0.5 * cycle * slower), 0.0)
        after = speed + cycle * (free - way * slowing(half, way))
        onward = place + 0.5 * cycle * (speed + after)
        # At rest on the way: friction takes what it can get, and the axis sticks, or
        # goes the other way for what is left of the cycle.
        begun = jnp.abs(speed) + jnp.abs(after)
        until = cycle * jnp.abs(speed) / jnp.where(begun > 0.0, begun, 1.0)
        stop = place + 0.5 * until * speed
        over = jnp.maximum(jnp.abs(free) - jnp.where(free < 0.0, held[1], held[0]), 0.0)
        back = jnp.sign(free) * over * (cycle - until)
        goes_on = way * after > 0.0
        speed_after = jnp.where(goes_on, after, back)
        place_after = jnp.where(goes_on, onward, stop + 0.5 * (cycle - until) * back)
        return (place_after, speed_after, integral), place

    start = (motion[0, 0] + rest, motion[0, 1] + rest, rest)
    return jax.lax.scan(cycle_of, start, (motion, added))[1]

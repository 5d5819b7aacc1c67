"""What friction and its list do to a circle: quadrant spikes, simulated."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...models import AbstractFriction, FrictionCompensation

_SUBSTEPS = 8
_TURNS = 3


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
    count = _TURNS * round(2 * np.pi / (speed * cycle))
    # Half a cycle on: the axis does not stand at a sample, as it would not in truth.
    phase = speed * cycle * (np.arange(count) + 0.5)
    position = radius * np.cos(phase)
    velocity = -radius * speed * np.sin(phase)
    acceleration = -speed * speed * position
    listed = compensation.run(compensation.start(), position, velocity)[0]
    added = out_unit * np.asarray(listed)
    motion = jnp.asarray(np.stack([position, velocity, acceleration], axis=1))
    gains = jnp.array(
        [loop.position_gain, loop.velocity_gain, 1.0 / loop.integral_time, cycle]
    )
    runs = [
        np.asarray(_follow(law, jnp.asarray(inertia), motion, jnp.asarray(each), gains))
        for each in (np.zeros(count), added)
    ]
    last = slice(count - count // _TURNS, count)
    # Along the radius: this axis has cos of the angle, the other one does not err.
    without, with_list = (((each - position) * np.cos(phase))[last] for each in runs)
    return CircularTest(
        angle=np.rad2deg(phase[last] - phase[last][0]),
        without=without,
        with_list=with_list,
        radius=radius,
        feed=feed,
        loop=loop,
    )


@eqx.filter_jit
def _follow(
    law: AbstractFriction,
    inertia: Float[Array, ""],
    motion: Float[Array, "t 3"],
    added: Float[Array, " t"],
    gains: Float[Array, " 4"],
) -> Float[Array, " t"]:
    """Return where the axis is in each cycle, in mm."""
    kv, kp, per_time, cycle = gains
    step = cycle / _SUBSTEPS

    def cycle_of(
        state: tuple[Array, Array, Array], now: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array], Array]:
        place, speed, integral = state
        (wanted, fast, push), extra = now
        lag = fast + kv * (wanted - place) - speed
        integral = integral + kp * per_time * lag * cycle
        drive = inertia * (push + kp * lag + integral) + extra

        def substep(_: Array, inner: tuple[Array, Array]) -> tuple[Array, Array]:
            at, moving = inner
            free = moving + step * drive / inertia
            # Friction takes what it can get, down to rest: the axis sticks.
            level = law.level(jnp.abs(moving)[None], jnp.sign(free)[None])[0]
            left = jnp.maximum(jnp.abs(free) - step * level / inertia, 0.0)
            after = jnp.sign(free) * left
            return at + step * after, after

        place_after, speed_after = jax.lax.fori_loop(
            0, _SUBSTEPS, substep, (place, speed)
        )
        return (place_after, speed_after, integral), place

    start = (motion[0, 0], motion[0, 1], jnp.zeros(()))
    return jax.lax.scan(cycle_of, start, (motion, added))[1]

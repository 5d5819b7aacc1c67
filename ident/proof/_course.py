"""Which way a circle goes, and the control loop that follows it."""

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Float, Int

_FORGOTTEN = 40.0
"""Time constants of the loop after which nothing is left of how it began."""
_ARCS = 8
"""Parts of a circle that are followed side by side."""


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


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """Which way a circle goes.

    Attributes:
        loop: The control loop that follows it.
        cycle: In s.
        phase: Angle in each cycle in rad.
        motion: Place, speed and acceleration of the axis in mm and s.
        before: Cycles before the turn that is shown.
    """

    loop: ServoLoop
    cycle: float
    phase: Float[np.ndarray, " t"]
    motion: Float[np.ndarray, "t 3"]
    before: int

    @property
    def gains(self) -> tuple[float, float, float, float]:
        """Of the loop, and the cycle."""
        loop = self.loop
        per_time = 1.0 / loop.integral_time
        return loop.position_gain, loop.velocity_gain, per_time, self.cycle

    @functools.cached_property
    def angle(self) -> Float[np.ndarray, " s"]:
        """Angle in the cycles of the turn that is shown, in degrees from its begin."""
        phase = self.phase[self.before :]
        return np.asarray(np.rad2deg(phase - phase[0]))

    @functools.cached_property
    def radial(self) -> Float[np.ndarray, " s"]:
        """How much of a deviation of this axis lies along the radius in these cycles."""
        return np.asarray(np.cos(self.phase[self.before :]))

    @functools.cached_property
    def arcs(self) -> Int[np.ndarray, "s a"]:
        """Cycles of the arcs of the turn that is shown; each begins that much before it.

        Where the loop has forgotten by then how it began, they are followed side by side.
        """
        many = _ARCS if self.before < 2 * len(self.angle) else 1
        length = -(-len(self.angle) // many)
        cycles = np.arange(self.before + length)[:, None] + length * np.arange(many)
        return np.asarray(np.minimum(cycles, len(self.phase) - 1))

    def deviation(self, places: Float[np.ndarray, "s a2"]) -> Float[np.ndarray, "2 t"]:
        """Return the radial deviation in mm of axes that are at these places.

        This axis has cos of the angle; the other one does not err.

        Args:
            places: In mm, on each of the arcs, first of one axis, then of the other.
        """
        shown = places[self.before :].T.reshape(2, -1)[:, : len(self.angle)]
        return np.asarray((shown - self.motion[self.before :, 0]) * self.radial)


@functools.lru_cache(maxsize=8)
def course_of(radius: float, feed: float, loop: ServoLoop, cycle: float) -> Course:
    """Return the way of a circle, one object for all that go it."""
    speed = feed / radius
    turn = round(2 * np.pi / (speed * cycle))
    # By then the loop has forgotten how it began; the turn that is shown is a later one.
    slowest = min(loop.position_gain, loop.velocity_gain, 1.0 / loop.integral_time)
    before = min(math.ceil(_FORGOTTEN / (slowest * cycle)), 2 * turn)
    # Half a cycle on: the axis does not stand at a sample, as it would not in truth.
    phase = speed * cycle * (np.arange(-before, turn) + 2 * turn + 0.5)
    position = radius * np.cos(phase)
    velocity = -radius * speed * np.sin(phase)
    motion = np.stack([position, velocity, -speed * speed * position], axis=1)
    return Course(loop, cycle, phase, motion, before)

"""The position loop of an axis: how its encoder follows the command."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ._programme import CYCLE


@dataclasses.dataclass(frozen=True)
class AxisLoop:
    """A position controller over a fast velocity loop, all of it linear.

    Attributes:
        gain: Kv in 1/s: at constant speed the axis stays behind by speed / gain.
        feed_forward: Share of the commanded velocity that is fed forward; it takes that
            share off the following error.
        settling: Time constant of the velocity loop in s.
        compliance: How far a step of the friction by 1 A would push the axis away at most,
            about twice over, in mm; the integrator takes it back.
        integral_time: Of that integrator in s.
    """

    gain: float
    feed_forward: float
    settling: float
    compliance: float
    integral_time: float

    def follow(self, command: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return the encoder's position, or its derivative for a command's derivative."""
        return self._respond([self.feed_forward, self.gain], [], command)

    def yielding(self, current: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return by how much friction (in A, less what is fed forward) moves the axis."""
        push = -self.compliance * (current - current[0])
        return self._respond([1.0, 0.0], [self.integral_time], push)

    def _respond(
        self, above: list[float], lags: list[float], given: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        from scipy.signal import bilinear, lfilter

        below = np.array([self.settling, 1.0, self.gain])
        for lag in lags:
            below = np.convolve(below, [lag, 1.0])
        found = bilinear(above, below, fs=1.0 / CYCLE)
        b, a = (np.asarray(part, dtype=float) for part in found)
        start = given[0]
        level = start * np.sum(b) / np.sum(a)
        return np.asarray(lfilter(b, a, given - start) + level)


def directions(
    velocity: Float[np.ndarray, " t"], slow: float = 0.2
) -> Float[np.ndarray, " t"]:
    """Return the direction of the last motion, ±1, and 1 before the first.

    What is slower than ``slow`` (mm/s) is the creeping of a loop that settles.
    """
    moving = np.flatnonzero(np.abs(velocity) > slow)
    last = np.searchsorted(moving, np.arange(len(velocity)), side="right") - 1
    signs = np.concatenate([[1.0], np.sign(velocity[moving])])
    return np.asarray(signs[last + 1])

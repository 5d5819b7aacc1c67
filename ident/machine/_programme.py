"""A programme of motion: lines, circles and pauses, cycle by cycle."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ._sources import Column, Columns

CYCLE = 0.001
"""Cycle of the controller in s."""


@dataclasses.dataclass(frozen=True)
class Programme:
    """Commanded motion, one row per cycle; mm and s.

    Attributes:
        time: Of the controller, from 0.
        position: By axis.
        velocity: By axis.
        acceleration: By axis.
    """

    time: Column
    position: Columns
    velocity: Columns
    acceleration: Columns


class Path:
    """Builds a programme piece by piece; speeds rise and fall without a jump in force.

    It starts from a place in mm; its largest acceleration along the path is in mm/s².
    """

    def __init__(self, start: Mapping[str, float], acceleration: float) -> None:
        self.axes = tuple(start)
        self.acceleration = acceleration
        self.place = np.array([start[axis] for axis in self.axes])
        self._pieces: list[np.ndarray] = []
        self._rows = 0

    @property
    def seconds(self) -> float:
        """How long the programme takes so far."""
        return self._rows * CYCLE

    def rest(self, seconds: float) -> None:
        """Stand still."""
        piece = np.zeros((round(seconds / CYCLE), 3, len(self.axes)))
        piece[:, 0] = self.place
        self._add(piece)

    def line(self, feed: float, **target: float) -> None:
        """Move to a target in mm at a feed in mm/s; axes left out stay."""
        goal = np.array(
            [target.get(a, p) for a, p in zip(self.axes, self.place, strict=True)]
        )
        move = goal - self.place
        length = float(np.linalg.norm(move))
        if length < 1e-9:
            return
        along = _profile(length, feed, self.acceleration)
        piece = along[:, :, None] * (move / length)
        piece[:, 0] += self.place
        self._add(piece)
        self.place = goal

    def circle(
        self, first: str, second: str, radius: float, feed: float, turns: float
    ) -> None:
        """Draw a circle from where the axes are, to the left of it the centre.

        A negative number of turns goes clockwise.
        """
        s, v, a = _profile(2 * np.pi * radius * abs(turns), feed, self.acceleration).T
        sign = np.sign(turns)
        angle, speed, rate = sign * s / radius, sign * v / radius, sign * a / radius
        columns = [self.axes.index(first), self.axes.index(second)]
        piece = np.zeros((len(s), 3, len(self.axes)))
        piece[:, 0] = self.place
        sine, cosine = np.sin(angle), np.cos(angle)
        piece[:, 0, columns[0]] += radius * (cosine - 1.0)
        piece[:, 0, columns[1]] += radius * sine
        piece[:, 1, columns[0]] = -radius * sine * speed
        piece[:, 1, columns[1]] = radius * cosine * speed
        piece[:, 2, columns[0]] = -radius * (cosine * speed**2 + sine * rate)
        piece[:, 2, columns[1]] = radius * (-sine * speed**2 + cosine * rate)
        self._add(piece)
        self.place = piece[-1, 0].copy()

    def programme(self) -> Programme:
        """Return everything so far."""
        rows = np.concatenate(self._pieces)
        parts = (
            {
                axis: np.ascontiguousarray(rows[:, k, c])
                for c, axis in enumerate(self.axes)
            }
            for k in range(3)
        )
        return Programme(np.arange(len(rows)) * CYCLE, *parts)

    def _add(self, piece: np.ndarray) -> None:
        self._pieces.append(piece)
        self._rows += len(piece)


def _profile(length: float, feed: float, peak: float) -> Float[np.ndarray, "n 3"]:
    """Return distance, speed and acceleration along a path from rest to rest.

    The speed rises as a raised cosine, so that the acceleration has no jump; its peak is
    `peak` where times were not rounded to cycles.
    """
    # Peak of the acceleration: π v / (2 ramp). Both ramps together cover v · ramp.
    speed = min(feed, np.sqrt(2.0 * peak * length / np.pi))
    ramp = max(int(np.ceil(0.5 * np.pi * speed / peak / CYCLE)), 2)
    cruise = max(int(np.ceil((length / speed) / CYCLE)) - ramp, 0)
    rise, whole = ramp * CYCLE, (ramp + cruise) * CYCLE
    speed = length / whole
    time = CYCLE * np.arange(1, 2 * ramp + cruise + 1)
    up = np.clip(time / rise, 0.0, 1.0)
    down = np.clip((time - whole) / rise, 0.0, 1.0)

    def distance(share: np.ndarray) -> np.ndarray:
        return 0.5 * rise * (share - np.sin(np.pi * share) / np.pi)

    middle = np.clip(time - rise, 0.0, whole - rise)
    fall = rise * down - distance(down)
    s = speed * (distance(up) + middle + fall)
    v = 0.5 * speed * (np.cos(np.pi * down) - np.cos(np.pi * up))
    a = 0.5 * speed * np.pi / rise * (np.sin(np.pi * up) - np.sin(np.pi * down))
    return np.stack([s, v, a], axis=1)

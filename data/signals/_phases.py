"""What an axis does in a recording: rest, constant speed, reversals."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float, Int

from ._motion import Motion
from ._order import median, quantile

_SURE = 5.0
"""Standard deviations of the velocity from which on its sign is certain."""
_RINGING = 0.2
"""Share of acceleration over circular bandwidth that a filter overshoots by, at most.

Of the Butterworth filter at a sudden stop; 0.08 at the end of a ramp, splines 0.08."""


@dataclasses.dataclass(frozen=True)
class Plateau:
    """A stretch of constant speed.

    Attributes:
        start: First row.
        stop: Row behind the last one.
        velocity: Mean in mm/s or °/s, with its sign.
        velocity_deviation: Standard deviation of that mean from position noise.
        ripple: Standard deviation of the velocity along the stretch.
    """

    start: int
    stop: int
    velocity: float
    velocity_deviation: float
    ripple: float

    @property
    def direction(self) -> int:
        """+1 towards larger positions, else −1."""
        return 1 if self.velocity > 0.0 else -1

    @property
    def rows(self) -> slice:
        """Its rows."""
        return slice(self.start, self.stop)


@dataclasses.dataclass(frozen=True)
class Reversal:
    """A change of the direction of motion.

    Attributes:
        row: Where the position is farthest.
        before: Direction before, ±1.
        position: There, in mm or °.
        dwell: Seconds in which no direction is certain.
    """

    row: int
    before: int
    position: float
    dwell: float


@dataclasses.dataclass(frozen=True)
class Phases:
    """What the axis does at each row, and its stretches.

    Attributes:
        motion: That they are of.
        direction: +1 or −1 where the sign of the velocity is certain, else 0.
        slowest: Speed in mm/s or °/s below which the sign of the velocity is not
            certain.
        shortest_rest: In s.
        shortest_plateau: In s, after the ends are cut off.
        tolerance: Share of its speed by which a plateau may vary.
        least_travel: Way in mm or ° on either side that makes a reversal, or None.
    """

    motion: Motion
    direction: Int[np.ndarray, " t"]
    slowest: float
    shortest_rest: float
    shortest_plateau: float
    tolerance: float
    least_travel: float | None

    # Stretches are looked for when they are asked for.

    @functools.cached_property
    def rest(self) -> Bool[np.ndarray, " t"]:
        """Standstill: no direction for at least the shortest rest."""
        standing = (self.direction == 0) & self.motion.settled
        least = max(1, round(self.shortest_rest / self.motion.step))
        return _long_runs(standing, least)

    @functools.cached_property
    def reversals(self) -> tuple[Reversal, ...]:
        """Changes of direction with enough way on both sides, in order."""
        motion, travel = self.motion, self.least_travel
        if travel is None:
            per_speed = 1.0 / (2.0 * np.pi * motion.bandwidth)
            strongest = quantile(_ringing(motion), 0.99)
            travel = max(10.0 * motion.position_noise, 5.0 * strongest * per_speed)
        return _reversals(motion, self.direction, travel, self.shortest_rest)

    @functools.cached_property
    def plateaus(self) -> tuple[Plateau, ...]:
        """Stretches of constant speed, in order."""
        return _plateaus(
            self.motion, self.direction, self.shortest_plateau, self.tolerance
        )


def find_phases(
    motion: Motion,
    *,
    shortest_rest: float = 0.05,
    shortest_plateau: float = 0.1,
    tolerance: float = 0.02,
    least_travel: float | None = None,
) -> Phases:
    """Return rest, directions, stretches of constant speed and reversals.

    All thresholds follow from what `Motion` knows of itself: a direction counts from
    five standard deviations of the velocity on, and from what the filter may ring with
    behind a change of acceleration. A stretch of constant
    speed is one over which the velocity changes by less than a share of itself (or by
    no more than its noise); what a neighbouring acceleration smears into it, within
    half a period of the bandwidth, is cut off.

    Args:
        motion: As derived from positions.
        shortest_rest: In s.
        shortest_plateau: In s, after the ends are cut off.
        tolerance: Share of its speed by which a plateau may vary.
        least_travel: Way in mm or ° on either side that makes a reversal; where left
            out, ten times the noise of the positions, or what the filter may ring with.
    """
    slowest = _SURE * motion.velocity_noise
    certain = motion.settled & (np.abs(motion.velocity) > slowest + _ringing(motion))
    direction = np.where(certain, np.sign(motion.velocity), 0.0).astype(np.int64)
    return Phases(
        motion=motion,
        direction=direction,
        slowest=slowest,
        shortest_rest=shortest_rest,
        shortest_plateau=shortest_plateau,
        tolerance=tolerance,
        least_travel=least_travel,
    )


def _ringing(motion: Motion) -> Float[np.ndarray, " t"]:
    """Return the speed up to which the filter may show motion where there is none."""
    from scipy.ndimage import maximum_filter1d

    window = 1 + 2 * max(1, round(2.0 / motion.bandwidth / motion.step))
    strongest = maximum_filter1d(np.abs(motion.acceleration), window, mode="nearest")
    ringing: Float[np.ndarray, " t"] = (
        _RINGING * strongest / (2.0 * np.pi * motion.bandwidth)
    )
    return ringing


def _runs(mask: Bool[np.ndarray, " t"]) -> Int[np.ndarray, "n 2"]:
    """Return first row and row behind the last of each run of true."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)])


def _long_runs(mask: Bool[np.ndarray, " t"], least: int) -> Bool[np.ndarray, " t"]:
    long = np.zeros(mask.size, dtype=bool)
    for start, stop in _runs(mask).tolist():
        long[start:stop] = stop - start >= least
    return long


def _reversals(
    motion: Motion, direction: Int[np.ndarray, " t"], travel: float, pause: float
) -> tuple[Reversal, ...]:
    """Return changes between certain directions with enough way on both sides.

    A leg ends with its direction or with a pause: what a filter or noise shows before
    an axis starts is a leg of its own, and too short to count.
    """
    moving = np.flatnonzero(direction)
    if not moving.size:
        return ()
    signs = direction[moving]
    paused = np.diff(motion.time[moving]) >= pause
    turns = np.flatnonzero((signs[1:] != signs[:-1]) | paused)
    first = moving[np.concatenate([[0], turns + 1])]
    last = moving[np.concatenate([turns, [-1]])]
    far = np.abs(motion.position[last] - motion.position[first]) >= travel
    first, last = first[far], last[far]
    # Legs in the same direction, one after the other, are one.
    turns = np.flatnonzero(np.diff(direction[first]))
    reversals = []
    for before, after in zip(
        last[turns].tolist(), first[turns + 1].tolist(), strict=True
    ):
        sign = int(direction[before])
        span = slice(before, after + 1)
        row = span.start + int((sign * motion.position[span]).argmax())
        dwell = float(motion.time[after] - motion.time[before])
        reversals.append(Reversal(row, sign, float(motion.position[row]), dwell))
    return tuple(reversals)


def _plateaus(
    motion: Motion,
    direction: Int[np.ndarray, " t"],
    shortest: float,
    tolerance: float,
) -> tuple[Plateau, ...]:
    step = motion.step
    least = max(4, round(shortest / step))
    cut = max(1, round(0.5 / motion.bandwidth / step))
    plateaus: list[Plateau] = []
    for sign in (1, -1):
        one_way = (direction == sign) & motion.settled
        for start, stop in _runs(one_way).tolist():
            for a, b in _steady(motion.velocity[start:stop], tolerance, motion, least):
                first, last = start + a + cut, start + b - cut
                if last - first >= least:
                    plateaus.append(_plateau(motion, first, last))
    return tuple(sorted(plateaus, key=lambda plateau: plateau.start))


def _steady(
    velocity: Float[np.ndarray, " n"], tolerance: float, motion: Motion, least: int
) -> list[tuple[int, int]]:
    """Return stretches in which the velocity stays close to its own median.

    From the longest stretch of small change over the shortest duration outwards: the
    change over that many samples is a running test of slope that noise hardly moves.
    """
    if velocity.size < least:
        return []
    width = max(2, least // 2)
    sums = np.cumsum(np.concatenate([[0.0], velocity]))
    means = (sums[width:] - sums[:-width]) / width
    if means.size <= width:
        return [(0, velocity.size)] if _even(velocity, tolerance, motion) else []
    change = np.abs(means[width:] - means[:-width])
    level = 0.5 * np.abs(means[width:] + means[:-width])
    noise = _SURE * motion.velocity_noise / width**0.5
    quiet = change <= np.maximum(tolerance * level, noise)
    stretches = []
    for start, stop in _runs(quiet).tolist():
        # Test k compares samples k … k + width with k + width … k + 2 width.
        a, b = start, stop - 1 + 2 * width
        middle = median(velocity[a:b])
        bound = max(tolerance * abs(middle), _SURE * motion.velocity_noise)
        close = np.abs(velocity[a:b] - middle) <= bound
        longest = max(_runs(close).tolist(), key=lambda run: run[1] - run[0])
        stretches.append((a + longest[0], a + longest[1]))
    return stretches


def _even(velocity: Float[np.ndarray, " n"], tolerance: float, motion: Motion) -> bool:
    middle = median(velocity)
    bound = max(tolerance * abs(middle), _SURE * motion.velocity_noise)
    return bool(np.all(np.abs(velocity - middle) <= bound))


def _plateau(motion: Motion, start: int, stop: int) -> Plateau:
    """Return the mean speed as the way over the time, and how well it is known."""
    duration = float(motion.time[stop - 1] - motion.time[start])
    distance = float(motion.position[stop - 1] - motion.position[start])
    return Plateau(
        start=start,
        stop=stop,
        velocity=distance / duration,
        velocity_deviation=2.0**0.5 * motion.position_noise / duration,
        ripple=float(np.std(motion.velocity[start:stop])),
    )

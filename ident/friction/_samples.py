"""What a drive recorded: motion and current, sample by sample."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.signals import find_saturation, median
from ..core import FitError

_JUMP = 0.5
"""Deviation of a time step from the cycle, in cycles, that starts a new piece."""
_REST = 1e-3
"""Share of the highest speed below which an axis counts as standing, where none is stated."""
_ONE = 1e-6
"""Share of it by which speeds differ that are one."""
_DIRECTION = 0.01
"""Share of the samples in motion that a direction needs to count as recorded."""

Trace = Float[np.ndarray, " t"]
"""A number for each sample of a recording, or for each velocity asked for."""


@dataclasses.dataclass(frozen=True)
class DriveSamples:
    """One recording of one axis; all arrays have one entry per sample and no NaN.

    Rotary axes have ° where mm is written.

    Attributes:
        time: In s, ascending; where it jumps, a new piece begins.
        velocity: In mm/s, as smoothed as its noise asks for.
        current: In drive units, positive where the drive pushes in positive direction.
        acceleration: In mm/s², from the same filter as the velocity.
        instrument_velocity: A velocity free of measurement noise that moves alike, such as the
            commanded one, in mm/s.
        instrument_acceleration: Likewise in mm/s²; both are there or none.
        loads: Further loads that enter linearly, by name, such as the sine of an arm's angle
            for its weight; any unit.
        moving: Whether the axis moves; left out: faster than a thousandth of the highest speed.
        position: Measured, in mm; only the output-error fit needs it.
        unit: ``"mm"``, or ``"°"`` for a rotary axis: all lengths are in it.
    """

    time: Trace
    velocity: Trace
    current: Trace
    acceleration: Trace
    instrument_velocity: Trace | None = None
    instrument_acceleration: Trace | None = None
    loads: Mapping[str, Trace] = dataclasses.field(default_factory=dict)
    moving: Bool[np.ndarray, " t"] | None = None
    position: Trace | None = None
    unit: str = "mm"

    @cached_property
    def cycle(self) -> float:
        """Time from sample to sample in s."""
        return median(np.diff(self.time))

    @cached_property
    def piece(self) -> Int[np.ndarray, " t"]:
        """Index of the stretch of even time steps that each sample belongs to."""
        jumps = np.abs(np.diff(self.time) - self.cycle) > _JUMP * self.cycle
        return np.concatenate([[0], np.cumsum(jumps)])

    @cached_property
    def in_motion(self) -> Bool[np.ndarray, " t"]:
        """Which samples count as moving."""
        if self.moving is not None:
            return self.moving
        speed = np.abs(self.velocity)
        return np.asarray(speed > _REST * speed.max())

    @cached_property
    def saturated(self) -> Bool[np.ndarray, " t"]:
        """Which samples stand at the limit of the drive, which is not 0."""
        return np.asarray(find_saturation(self.current).rows & (self.current != 0))

    @cached_property
    def directions(self) -> tuple[bool, bool]:
        """Whether motion in positive and in negative direction was recorded."""
        share = float(np.mean(self.velocity[self.in_motion] > 0))
        return share >= _DIRECTION, share <= 1 - _DIRECTION

    def take(self, keep: Bool[np.ndarray, " t"]) -> "DriveSamples":
        """Return the samples for which ``keep`` is true; gaps in time part the pieces."""
        arrays = {
            field.name: values[keep]
            for field in dataclasses.fields(self)
            if isinstance(values := getattr(self, field.name), np.ndarray)
        }
        loads = {name: values[keep] for name, values in self.loads.items()}
        return dataclasses.replace(self, loads=loads, **arrays)


def check_samples(samples: DriveSamples) -> None:
    """Refuse what no fit can use.

    Raises:
        FitError: If arrays differ in length, hold NaN, or show no motion.
    """
    count, msg = len(samples.time), ""
    arrays = vars(samples) | dict(samples.loads)
    if count < 2:
        msg = f"found {count} samples of the drive, expected a recording."
        raise FitError(msg)
    for name, values in arrays.items():
        if not isinstance(values, np.ndarray):
            continue
        bad = np.flatnonzero(~np.isfinite(values))
        if len(values) != count:
            msg = f"{name} has {len(values)} samples, expected {count} as time has."
        elif len(bad):
            msg = f"sample {bad[0] + 1}: {name} is not finite, expected numbers."
        if msg:
            raise FitError(msg)
    backward = np.flatnonzero(np.diff(samples.time) <= 0)
    speeds = np.abs(samples.velocity[samples.in_motion])
    if len(backward):
        row = int(backward[0]) + 1
        msg = (
            f"sample {row + 1}: the clock goes from {samples.time[row - 1]:.6g} s to "
            f"{samples.time[row]:.6g} s, expected ascending times: record them with more digits."
        )
    elif not speeds.any():
        msg = "the axis does not move in this recording: nothing is known of friction."
    elif np.ptp(speeds) <= _ONE * speeds.max():
        msg = "the axis moves at one speed only, expected several: friction is a law of speed."
    elif not samples.current.any():
        msg = "the current is 0 throughout, expected the drive's torque feedback."
    if msg:
        raise FitError(msg)

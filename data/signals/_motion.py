"""Velocity and acceleration from positions, with the noise that they carry."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float

from ._clock import Clock, read_clock
from ._errors import SignalError, check_lengths
from ._filter import SETTLING, bandwidth, central_differences, zero_phase
from ._noise import noise_gain, noise_of, third_differences
from ._order import median

_FEW = 8
"""Samples at both ends of a record where an interpolating spline has hardly forgotten them."""
_SPLINE = 1.17, 6.01
"""Noise in velocity and acceleration of an interpolating spline, per step and its square."""
_QUARTER = 0.3186
"""Lower quartile of the absolute value of normal noise, in its standard deviation."""
_SETTLING = 2.0
"""As `SETTLING`, for a spline, whose ends are free: in periods of its bandwidth."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """A motion derived from recorded positions; mm or °, per s and s².

    Attributes:
        time: In s.
        position: Smoothed.
        velocity: Of the smoothed position.
        acceleration: Of the smoothed position.
        bandwidth: In Hz: slower changes are left, faster ones taken out (1/√2 is left
            of one at this frequency).
        position_noise: Standard deviation of the white noise on the recorded positions.
        velocity_noise: What it becomes in the velocity, of all rows or of each.
        acceleration_noise: What it becomes in the acceleration.
        settled: False within reach of an end of the record or of a jump of the clock,
            where the values rest on one side only.
        clock: How the times run.
        noise_in_motion: As `position_noise`, where the axis is fast: times that are not those
            of the samples show there.
    """

    time: Float[np.ndarray, " t"]
    position: Float[np.ndarray, " t"]
    velocity: Float[np.ndarray, " t"]
    acceleration: Float[np.ndarray, " t"]
    bandwidth: float
    position_noise: float
    velocity_noise: float | Float[np.ndarray, " t"]
    acceleration_noise: float
    settled: Bool[np.ndarray, " t"]
    clock: Clock
    noise_in_motion: float

    @functools.cached_property
    def noise_of_peak(self) -> tuple[float, float]:
        """Noise of the acceleration in the largest one, in general and where the axis is fast."""
        peak = float(np.abs(self.acceleration).max(where=self.settled, initial=1e-300))
        gain = self.acceleration_noise / max(self.position_noise, 1e-300)
        return self.acceleration_noise / peak, gain * self.noise_in_motion / peak

    @functools.cached_property
    def step(self) -> float:
        """Median of all steps of the times in s, jumps back among them."""
        if all(jump.step > 0.0 for jump in self.clock.jumps):
            return self.clock.sample_time  # the same of the steps that rise
        return median(np.diff(self.time))


def motion_of(
    time: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    *,
    cutoff: float,
    clock: Clock | None = None,
) -> Motion:
    """Return the motion by a filter where the steps of time are equal, else by a spline.

    Args:
        time: In s, rising within segments.
        position: In mm or °.
        cutoff: Of one pass of the filter, or bandwidth of the spline, in Hz; infinity: of the
            spline through all positions.
        clock: Of the times; read from them where left out.

    Raises:
        SignalError: If the cutoff does not fit the steps, or there are too few samples.
    """
    clock = clock or read_clock(time)
    if np.isinf(cutoff):
        return _interpolated(time, position, clock)
    if clock.uniform:
        return filtered_motion(time, position, cutoff=cutoff, clock=clock)
    return smoothed_motion(time, position, bandwidth=cutoff, clock=clock)


def filtered_motion(
    time: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    *,
    cutoff: float = 100.0,
    order: int = 4,
    clock: Clock | None = None,
) -> Motion:
    """Return the motion by a zero-phase Butterworth filter and central differences.

    With the defaults this is the evaluation of the EMPS benchmark (Janot, Gautier and
    Brunot, 2019) before its decimation; see `zero_phase`, `central_differences` and
    `decimate`. Segments between jumps of the clock are taken each for itself; those too
    short to filter have no settled sample and are left unfiltered.

    Args:
        time: In s, with equal steps but for jumps.
        position: In mm or °.
        cutoff: Of one pass of the filter in Hz.
        order: Of one pass.
        clock: Of the times; read from them where left out.

    Raises:
        SignalError: If the steps are not equal (`smoothed_motion` takes such), the
            cutoff does not fit them, or there are too few samples.
    """
    check_lengths("motion", time.size, position.size, least=8)
    clock = clock or read_clock(time)
    if not clock.uniform:
        found = f"steps of {1e3 * clock.sample_time:g} ms ± {1e3 * clock.jitter:.2g} ms"
        what = "filtered motion"
        raise SignalError(what, found, "equal steps, or `smoothed_motion`")
    step = clock.sample_time
    margin = max(2, round(SETTLING / cutoff / step))
    least = max(3 * (order + 1) + 1, 2 * margin + 1)
    rows = np.zeros((3, time.size))
    settled = np.zeros(time.size, dtype=bool)
    for segment in clock.segments:
        part = position[segment]
        if part.size < least:
            rows[0, segment] = part
            if part.size > 1:
                rows[1, segment] = central_differences(part, step)
            continue
        rows[:, segment] = _by_filter(part, step, cutoff, order)
        settled[segment.start + margin : segment.stop - margin] = True
    noise = noise_of(position)
    gains = _gains(step, cutoff, order, 10 * max(margin, 20))
    return Motion(
        time=time,
        position=rows[0],
        velocity=rows[1],
        acceleration=rows[2],
        bandwidth=bandwidth(cutoff, order),
        position_noise=noise,
        velocity_noise=noise * gains[0],
        acceleration_noise=noise * gains[1],
        settled=settled,
        clock=clock,
        noise_in_motion=_noise_in_motion(position - rows[0], rows[1], settled),
    )


def _interpolated(
    time: Float[np.ndarray, " t"], position: Float[np.ndarray, " t"], clock: Clock
) -> Motion:
    """Return the motion of the cubic spline through all positions, which takes nothing out."""
    from scipy.interpolate import CubicSpline

    rows, settled = np.zeros((3, time.size)), np.zeros(time.size, dtype=bool)
    for segment in clock.segments:
        part, instants = position[segment], time[segment]
        rows[0, segment] = part
        if part.size < 2 * _FEW:
            rows[1, segment] = np.gradient(part, instants) if part.size > 1 else 0.0
            continue
        spline = CubicSpline(instants - instants[0], part)
        rows[1:, segment] = [spline(instants - instants[0], k) for k in (1, 2)]
        settled[segment.start + _FEW : segment.stop - _FEW] = True
    third = np.pad(third_differences(position), (1, 2))
    moving = _noise_in_motion(third, rows[1], settled)
    noise, step = max(noise_of(position), moving), clock.sample_time
    return Motion(
        time=time,
        position=rows[0],
        velocity=rows[1],
        acceleration=rows[2],
        bandwidth=0.5 / step,
        position_noise=noise,
        velocity_noise=_SPLINE[0] * noise / step,
        acceleration_noise=_SPLINE[1] * noise / step**2,
        settled=settled,
        clock=clock,
        noise_in_motion=moving,
    )


def _noise_in_motion(
    taken_out: Float[np.ndarray, " t"],
    velocity: Float[np.ndarray, " t"],
    settled: Bool[np.ndarray, " t"],
) -> float:
    """Return the standard deviation of what was taken out of positions where an axis is fast."""
    speed = np.where(settled, np.abs(velocity), 0.0)
    fast = speed > 0.5 * speed.max(initial=0.0)
    # Where it gets faster, more than noise is taken out: the lower quarter.
    return (
        float(np.quantile(np.abs(taken_out[fast]), 0.25)) / _QUARTER
        if fast.any()
        else 0.0
    )


def _by_filter(
    values: Float[np.ndarray, " n"], step: float, cutoff: float, order: int
) -> Float[np.ndarray, "3 n"]:
    """Return what a filter leaves of positions, its rate, and the rate of that."""
    smooth = zero_phase(values, step, cutoff=cutoff, order=order)
    rate = central_differences(smooth, step)
    return np.stack([smooth, rate, central_differences(rate, step)])


@functools.lru_cache(maxsize=64)
def _gains(step: float, cutoff: float, order: int, length: int) -> tuple[float, float]:
    """Return what white noise of 1 becomes in the velocity and in the acceleration.

    Recordings with the same clock share it.
    """

    def gain(row: int) -> float:
        return noise_gain(lambda x: _by_filter(x, step, cutoff, order)[row], length)

    return gain(1), gain(2)


def smoothed_motion(
    time: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    *,
    bandwidth: float,
    clock: Clock | None = None,
) -> Motion:
    r"""Return the motion by a cubic smoothing spline of a stated bandwidth.

    The spline that minimises $\sum (x_t - f(t))^2 + \lambda \int \ddot f^2$ leaves
    $1/(1 + \lambda h \omega^4)$ of a vibration (Silverman, Annals of Statistics 12(3),
    1984), so $\lambda = (\sqrt 2 - 1)/(h (2\pi b)^4)$ leaves $1/\sqrt 2$ at the
    bandwidth $b$. Steps $h$ need not be equal.

    Args:
        time: In s, rising within segments.
        position: In mm or °.
        bandwidth: In Hz.
        clock: Of the times; read from them where left out.

    Raises:
        SignalError: If there are too few samples or the bandwidth is not below a
            quarter of the sample rate.
    """
    from scipy.interpolate import make_smoothing_spline

    check_lengths("motion", time.size, position.size, least=8)
    clock = clock or read_clock(time)
    step = clock.sample_time
    if not 0.0 < bandwidth <= 0.25 / step:
        found, limit = f"a bandwidth of {bandwidth:g} Hz", 0.25 / step
        expected = (
            f"more than 0 and at most {limit:g} Hz (a quarter of the sample rate)"
        )
        what = "smoothed motion"
        raise SignalError(what, found, expected)
    strength = (2.0**0.5 - 1.0) / (step * (2.0 * np.pi * bandwidth) ** 4)
    margin = max(2, round(_SETTLING / bandwidth / step))
    rows = np.zeros((3, time.size))
    settled = np.zeros(time.size, dtype=bool)
    for segment in clock.segments:
        part, instants = position[segment], time[segment]
        if part.size < max(8, 2 * margin + 1):
            rows[0, segment] = part
            if part.size > 1:
                rows[1, segment] = np.gradient(part, instants)
            continue
        spline = make_smoothing_spline(instants - instants[0], part, lam=strength)
        for order in range(3):
            rows[order, segment] = spline(instants - instants[0], nu=order)
        settled[segment.start + margin : segment.stop - margin] = True

    def gain(order: int) -> float:
        length = 10 * max(margin, 20)
        grid = step * np.arange(2 * length + 1)
        return noise_gain(
            lambda x: make_smoothing_spline(grid, x, lam=strength)(grid, nu=order),
            length,
        )

    noise = noise_of(position, time)
    return Motion(
        time=time,
        position=rows[0],
        velocity=rows[1],
        acceleration=rows[2],
        bandwidth=bandwidth,
        position_noise=noise,
        velocity_noise=noise * gain(1),
        acceleration_noise=noise * gain(2),
        settled=settled,
        clock=clock,
        noise_in_motion=_noise_in_motion(position - rows[0], rows[1], settled),
    )

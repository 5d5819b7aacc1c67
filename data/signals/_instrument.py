"""How late an external instrument is against the encoder of a moving axis."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ._aligned import InstrumentClock, aligned_error, encoder_spline, first_motion
from ._errors import check_lengths
from ._windows import Solution, Windows

_LEAST_WINDOWS = 6
_MOST_ROWS = 20_000
_STEPS, _NEAR = 12, 0.05
"""Steps at most, and the step in standard deviations that is the last: a reading that changes
its side of a turn moves the delay by as much, to and fro."""
_SURE = 3.0
_INDEPENDENT = 0.003
_DOUBT = 2.0
"""Scatters of the error that the doubt about the delay may make at speed."""


def estimate_instrument(
    time: Float[np.ndarray, " t"],
    encoder: Float[np.ndarray, " t"],
    reference: Float[np.ndarray, " t"],
    *,
    others: Float[np.ndarray, "t k"] | None = None,
    longest: float = 0.05,
) -> InstrumentClock:
    r"""Return how late a reference is, and how its clock runs, from an axis in motion.

    The reference shows $x(t - \tau) + e$, so that reference − encoder has a part
    $-\tau v$: that part is told from the true error, which a delay must not take up, by
    changes of speed. In windows of 1.5 s the true error is linear in the positions of all
    axes; beside it, over the whole record, stands what changes with the direction (backlash,
    which bends along the travel) and with accelerations. What is left in
    proportion to the velocity is the delay, and to velocity times time the rate of the
    clock. Readings that contradict the others count less. Standard deviations are those
    that the scatter between windows shows.

    Args:
        time: In s, ascending.
        encoder: Of the axis itself, in mm or °.
        reference: Of the external instrument, same unit; NaN = missed.
        others: Encoders of the other axes, whose positions enter the error as well.
        longest: Delay in s, of either sign, that is looked for.

    Raises:
        SignalError: If the record is shorter than a few samples.
    """
    check_lengths("instrument clock", time.size, encoder.size, reference.size, least=8)
    spline = encoder_spline(time, encoder)
    middle = 0.5 * float(time[0] + time[-1])
    half = max(0.5 * float(time[-1] - time[0]), 1e-9)
    clock = InstrumentClock(0.0, 0.0, middle, np.inf, np.inf, False, "")
    if spline is None:
        return _judged(clock, None, half, longest, "nothing moves")
    axes = [] if others is None else [encoder_spline(time, axis) for axis in others.T]
    splines = [axis for axis in axes if axis is not None]
    row = np.arange(time.size)
    chosen = row % max(1, time.size // _MOST_ROWS) == 0
    # From which side the axis came before its first motion, nobody knows.
    chosen &= row >= first_motion(time, encoder)
    solution = None
    for with_rate in (True, False):
        clock = dataclasses.replace(clock, rate=0.0)
        for _ in range(_STEPS):
            aligned = aligned_error(time, encoder, reference, clock, spline=spline)
            rows = chosen & aligned.valid
            system = Windows(aligned, rows, spline, splines, middle, half)
            if system.count < _LEAST_WINDOWS:
                return _judged(clock, None, half, longest, "its speed hardly changes")
            solution = system.solve(with_rate)
            if solution.independent < _INDEPENDENT:
                reason = "at one speed a backlash looks like a delay"
                return _judged(clock, solution, half, longest, reason)
            clock = dataclasses.replace(
                clock,
                delay=float(np.clip(clock.delay + solution.delay, -longest, longest)),
                rate=clock.rate + solution.rate / half,
            )
            if abs(solution.delay) < _NEAR * solution.deviation:
                break
        # A rate that does not show is none.
        if solution is None or abs(clock.rate) * half > _SURE * solution.rate_deviation:
            break
    return _judged(clock, solution, half, longest, "")


def _judged(
    clock: InstrumentClock,
    solution: Solution | None,
    half: float,
    longest: float,
    reason: str,
) -> InstrumentClock:
    """Return the clock with its verdict: is it known well enough to be taken off?"""
    if solution is not None:
        clock = dataclasses.replace(
            clock,
            standard_deviation=solution.deviation,
            rate_deviation=solution.rate_deviation / half if clock.rate else 0.0,
        )
        doubt = solution.deviation * solution.speed
        if not reason and abs(clock.delay) >= longest:
            reason = f"it is longer than the {1e3 * longest:g} ms that were looked for"
        elif not reason and not doubt < _DOUBT * solution.scatter:
            reason = (
                f"{1e6 * solution.deviation:.2g} µs of doubt are {1e3 * doubt:.2g} µm (or"
                f" m°) at {solution.speed:.3g} per s"
            )
    return dataclasses.replace(
        clock, determined=not reason, statement=_words(clock, reason)
    )


def _words(clock: InstrumentClock, reason: str) -> str:
    if reason:
        return f"the delay of the instrument cannot be told: {reason}"
    word = "late" if clock.delay >= 0 else "early"
    words = (
        f"the instrument is {1e3 * abs(clock.delay):.4f} ms ±"
        f" {1e3 * clock.standard_deviation:.2g} ms {word}"
    )
    if clock.rate:
        slow = "slow" if clock.rate > 0 else "fast"
        words += f", its clock {1e6 * abs(clock.rate):.3g} ppm {slow}"
    return words

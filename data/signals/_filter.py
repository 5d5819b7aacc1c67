"""Zero-phase filters, differences and decimation: the same for all signals of a fit.

A fit that compares signals must filter them alike; what is done to the velocity has to
be done to the current. These functions are linear and shift nothing in time.
"""

import functools
from typing import Any

import numpy as np
from jaxtyping import Float

from ._errors import SignalError, check_lengths

_PAD = 3
"""Length of the reflected ends in orders of the filter, as MATLAB's filtfilt has it."""
SETTLING = 4.0
"""Periods of the cutoff within which an end of the record shows, by more than 1e-4."""


def zero_phase(
    values: Float[np.ndarray, "t *k"],
    sample_time: float,
    *,
    cutoff: float,
    order: int = 4,
) -> Float[np.ndarray, "t *k"]:
    """Return signals after a Butterworth low pass that runs forwards and backwards.

    Both passes together have no phase and twice the order; at the cutoff they leave one
    half, and `bandwidth` tells where they leave 1/√2.

    Args:
        values: Along the first axis.
        sample_time: In s, constant.
        cutoff: Of one pass in Hz.
        order: Of one pass.

    Raises:
        SignalError: If the cutoff is not below half the sample rate, or there are too
            few samples.
    """
    from scipy.signal import lfilter

    nyquist = 0.5 / sample_time
    if not 0.0 < cutoff < nyquist:
        expected = f"more than 0 and less than {nyquist:g} Hz (half the sample rate)"
        what = "zero-phase filter"
        raise SignalError(what, f"a cutoff of {cutoff:g} Hz", expected)
    check_lengths("zero-phase filter", len(values), least=_PAD * (order + 1) + 1)
    numerator, denominator, state = _low_pass(order, cutoff / nyquist)
    state = state.reshape(-1, *(1,) * (values.ndim - 1))
    pad = _PAD * (order + 1)
    before = 2.0 * values[:1] - values[pad:0:-1]
    behind = 2.0 * values[-1:] - values[-2 : -pad - 2 : -1]
    smooth: np.ndarray = np.concatenate([before, values, behind])
    for _ in ("forwards", "backwards"):
        start = state * smooth[:1]
        smooth = lfilter(numerator, denominator, smooth, axis=0, zi=start)[0][::-1]
    return smooth[pad:-pad]


@functools.lru_cache(maxsize=64)
def _low_pass(
    order: int, cutoff: float
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"], Float[np.ndarray, " s"]]:
    """Return both polynomials of a Butterworth filter and its state at a constant of 1.

    The cutoff is in half sample rates. All this takes longer than its use on a short
    recording, so that `scipy.signal.filtfilt`, which has the state anew, is not used.
    """
    from scipy.signal import butter, lfilter_zi

    polynomials: Any = butter(order, cutoff)
    return polynomials[0], polynomials[1], lfilter_zi(*polynomials)


def bandwidth(cutoff: float, order: int = 4) -> float:
    """Return the frequency in Hz at which `zero_phase` leaves 1/√2 of a signal."""
    return float(cutoff * (2.0**0.5 - 1.0) ** (0.5 / order))


def central_differences(
    values: Float[np.ndarray, "t *k"], sample_time: float
) -> Float[np.ndarray, "t *k"]:
    """Return rates per s from the neighbours on both sides; one-sided at the ends."""
    check_lengths("central differences", len(values), least=2)
    rates = np.empty_like(values)  # as `np.gradient` has them
    rates[1:-1] = (values[2:] - values[:-2]) / (2.0 * sample_time)
    rates[0] = (values[1] - values[0]) / sample_time
    rates[-1] = (values[-1] - values[-2]) / sample_time
    return rates


def decimate(
    values: Float[np.ndarray, "t *k"], factor: int
) -> Float[np.ndarray, "n *k"]:
    """Return every `factor`-th sample, after a zero-phase low pass against aliases.

    The columns of a regression are decimated alike (parallel decimation), ``sign(v)``
    among them, formed before. A symmetric FIR filter with Hamming window of 20 times
    the factor (`scipy.signal.decimate`), which unlike the recursive one has no
    transient at the ends.
    """
    from scipy.signal import decimate as decimated

    if factor == 1:
        return values
    check_lengths("decimation", len(values), least=20 * factor + 1)
    fewer: np.ndarray = decimated(values, factor, ftype="fir", axis=0)
    return fewer

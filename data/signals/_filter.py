"""Zero-phase filters, differences and decimation: the same for all signals of a fit.

A fit that compares signals must filter them alike; what is done to the velocity has to
be done to the current. These functions are linear and shift nothing in time.
"""

import numpy as np
from jaxtyping import Float

from ._errors import SignalError, check_lengths

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
    from scipy.signal import butter, filtfilt

    nyquist = 0.5 / sample_time
    if not 0.0 < cutoff < nyquist:
        expected = f"more than 0 and less than {nyquist:g} Hz (half the sample rate)"
        what = "zero-phase filter"
        raise SignalError(what, f"a cutoff of {cutoff:g} Hz", expected)
    check_lengths("zero-phase filter", len(values), least=3 * (order + 1) + 1)
    ahead, back = np.asarray(butter(order, cutoff / nyquist))
    smooth: np.ndarray = filtfilt(ahead, back, values, axis=0)
    return smooth


def bandwidth(cutoff: float, order: int = 4) -> float:
    """Return the frequency in Hz at which `zero_phase` leaves 1/√2 of a signal."""
    return float(cutoff * (2.0**0.5 - 1.0) ** (0.5 / order))


def central_differences(
    values: Float[np.ndarray, "t *k"], sample_time: float
) -> Float[np.ndarray, "t *k"]:
    """Return rates per s from the neighbours on both sides; one-sided at the ends."""
    check_lengths("central differences", len(values), least=2)
    rates: np.ndarray = np.gradient(values, sample_time, axis=0)
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

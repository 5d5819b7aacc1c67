"""One low-pass for both sides of the equation, with fewer samples left after it.

What is filtered alike on both sides keeps a linear equation true: current, acceleration and
the friction computed from the velocity all go through the same filter, so that it takes away
noise without a shift or a smear that one side would see and the other not. (The "parallel
filter" of the robotics literature: Gautier, Janot and others.)
"""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.signal import firwin, oaconvolve

_REACH = 10
"""Half the length of the filter in samples after decimation."""
RATE = 100.0
"""Samples per s that are left where nothing else is asked for."""


@final
@dataclasses.dataclass(frozen=True)
class Decimation:
    """A zero-phase FIR low-pass and every ``factor``-th sample of what it gives.

    Attributes:
        kernel: Taps, symmetric, with sum 1.
        centres: Samples on which the kernel is centred; it lies within one piece entirely.
    """

    kernel: Float[np.ndarray, " k"]
    centres: Int[np.ndarray, " s"]
    factor: int

    def __call__(self, columns: Float[np.ndarray, "t c"]) -> Float[np.ndarray, "s c"]:
        """Return the filtered, thinned columns."""
        if self.factor == 1:
            return np.asarray(columns[self.centres])
        full = oaconvolve(columns, self.kernel[:, None], mode="same", axes=0)
        return np.asarray(full[self.centres])

    def mostly(self, mask: Bool[np.ndarray, " t"]) -> Bool[np.ndarray, " s"]:
        """Return where more than half of the filter's weight lies on true samples."""
        return np.asarray(self(mask.astype(float)[:, None])[:, 0] > 0.5)


def decimation(piece: Int[np.ndarray, " t"], factor: int) -> Decimation:
    """Return the filter for samples in the given pieces; factor 1 filters nothing."""
    if factor == 1:
        return Decimation(np.ones(1), np.arange(len(piece)), 1)
    half = _REACH * factor
    kernel = firwin(2 * half + 1, 1.0 / factor, window="hamming")
    first = np.flatnonzero(np.concatenate([[True], np.diff(piece) != 0]))
    last = np.append(first[1:], len(piece))
    centres = [
        np.arange(a + half, b - half, factor) for a, b in zip(first, last, strict=True)
    ]
    return Decimation(np.asarray(kernel), np.concatenate(centres).astype(int), factor)


def default_factor(cycle: float) -> int:
    """Return the factor that leaves about a hundred samples per second."""
    return max(1, round(1.0 / (RATE * cycle)))

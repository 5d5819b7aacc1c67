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
from scipy.signal import firwin

_REACH = 10
"""Half the length of the filter in samples after decimation."""
_BLOCK = 32
"""Rows that are filtered at a time."""
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
            return columns  # all samples are centres
        columns = np.ascontiguousarray(columns)
        breaks = np.flatnonzero(np.diff(self.centres) != self.factor) + 1
        runs = np.split(self.centres, breaks)
        return np.concatenate([self._run(columns, run) for run in runs])

    def _run(self, columns: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """Return rows at evenly spaced centres: one small matrix product per few of them."""
        width, half = columns.shape[1], len(self.kernel) // 2
        whole = len(centres) // _BLOCK
        rows = np.empty((len(centres), width))
        for count, first, blocks in (
            (_BLOCK, 0, whole),
            (len(centres) - whole * _BLOCK, whole * _BLOCK, 1),
        ):
            if not count or not blocks:
                continue
            band = _band(self.kernel, self.factor, count)
            start = columns[centres[first] - half :]
            step, item = columns.strides
            view = np.lib.stride_tricks.as_strided(
                start,
                (blocks, band.shape[1], width),
                (count * self.factor * step, step, item),
            )
            found = band @ view
            rows[first : first + count * blocks] = found.reshape(-1, width)
        return rows

    def mostly(self, mask: Bool[np.ndarray, " t"]) -> Bool[np.ndarray, " s"]:
        """Return where more than half of the filter's weight lies on true samples."""
        return np.asarray(self(mask.astype(float)[:, None])[:, 0] > 0.5)


def _band(kernel: np.ndarray, factor: int, count: int) -> np.ndarray:
    """Return the kernel in every row, each ``factor`` further on than the one above."""
    band = np.zeros((count, (count - 1) * factor + len(kernel)))
    for row in range(count):
        band[row, row * factor : row * factor + len(kernel)] = kernel
    return band


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

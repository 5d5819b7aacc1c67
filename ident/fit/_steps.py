r"""Readings in whole steps of a coarse instrument: what it rounds off every time.

Where repeats scatter by less than a step they are rounded alike, and no number of them tells
what was rounded off. For steps $q$ and noise $s$ the mean of many repeats at a place is off with
the variance $q^2 \sum_k e^{-(2\pi k s/q)^2} / (2\pi^2 k^2)$ over places: $q^2/12$ without
noise, nothing from half a step on. The scatter of the repeats lacks as much of $s^2 + q^2/12$,
which tells $s$. Where no place was read twice the noise of the readings holds it all.

Source: B. Widrow, I. Kollár, Quantization Noise, Cambridge University Press, 2008.
"""

import dataclasses
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.ndimage import median

from ...data.signals import NORMAL

_MANY = 20_000
"""Readings up to which steps are looked for: longer recordings, in motion, repeat no place."""
_NONE, _WHOLE, _FEWEST = 1e-9, 0.01, 3
"""Difference in mm or ° that is none; how near whole numbers of steps are; single steps that must
be seen: one wild reading makes two large ones."""
_MOST, _FAR = 3, 8.0
"""Readings of a place of which most are the majority, and robust deviations that are far off."""
_NOISE = np.linspace(0.0, 0.6, 61)
_ORDER = np.arange(1, 500)
_COMMON = np.exp(-np.square(2 * np.pi * np.outer(_NOISE, _ORDER))) @ (
    0.5 / np.square(np.pi * _ORDER)
)
"""Variance that repeats have in common, by the noise, both in steps."""
_SCATTER = np.square(_NOISE) + 1.0 / 12.0 - _COMMON
"""Variance of the repeats at a place."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Steps:
    """The steps of an instrument, and the readings that it took at the same places.

    Attributes:
        size: Of a step in mm or °; 0 where none shows.
        order: Readings by place.
        again: Whether the next reading in that order is of the same place.
    """

    size: float
    order: Int[np.ndarray, " t"]
    again: Bool[np.ndarray, " s"]

    @classmethod
    def of(
        cls, error: Float[np.ndarray, " t"], places: Sequence[Shaped[np.ndarray, " t"]]
    ) -> "Steps":
        """Return the steps of readings; places that are equal in all arrays are the same."""
        if not places or not 1 < len(error) <= _MANY:
            return cls(0.0, np.zeros(0, np.int64), np.zeros(0, bool))
        order = np.lexsort([*places])
        again = np.all([np.diff(column[order]) == 0.0 for column in places], axis=0)
        # At one place they differ by whole steps whatever was taken off at each place.
        change = np.diff(error[order])
        size = _step_of(change[again])
        if size == 0.0 and again.any():
            size = _step_of(change)
        return cls(size, order, again)

    def off_the_most(
        self, residual: Float[np.ndarray, " t"]
    ) -> tuple[Bool[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return which readings lie far off most of their place, and the median of each place.

        A loss takes them for its noise where they are many; the repeats of a place tell better.
        """
        if not self.again.any():
            return np.zeros(len(residual), bool), np.zeros(len(residual))
        place = np.empty(len(self.order), np.int64)
        place[self.order] = np.concatenate([[0], np.cumsum(~self.again)])
        count = np.bincount(place)
        middle = median(residual, place, np.arange(len(count)))[place]
        compared = count[place] >= _MOST
        off = np.abs(residual - middle)
        scatter = NORMAL * float(np.median(off[compared])) if compared.any() else 0.0
        return compared & (off > max(_FAR * scatter, 3.0 * self.size, _NONE)), middle

    def common(
        self, residual: Float[np.ndarray, " t"], wild: Bool[np.ndarray, " t"]
    ) -> float:
        """Return the variance in mm² or °² of what is rounded off every time; wild do not count."""
        if self.size == 0.0:
            return 0.0
        good = ~wild[self.order]
        change = np.diff(residual[self.order])[self.again & good[1:] & good[:-1]]
        scatter = 0.5 * np.mean(np.square(change / self.size)) if change.size else 1.0
        return float(self.size**2 * np.interp(scatter, _SCATTER, _COMMON, right=0.0))


def _step_of(differences: Float[np.ndarray, " d"]) -> float:
    """Return the smallest difference where all are whole multiples of it, else 0."""
    size = np.abs(np.asarray(differences, dtype=float))
    size = size[size > _NONE]
    step = float(size.min(initial=np.inf))
    count = np.rint(size / step)
    whole = np.abs(size / step - count) < _WHOLE
    return step if np.sum(count == 1.0) >= _FEWEST and whole.all() else 0.0

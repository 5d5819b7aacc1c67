"""Take off what is the instrument's: an arbitrary zero, an arbitrary slope."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float, Shaped

from ..core import WILD

_PASSES = 20
_TUNING = 1.345
"""Huber's constant: 95 % efficiency on clean data."""
ENOUGH = 20_000
"""Readings, and up to twice as many, that judge a zero."""

Kind = Literal["none", "offset", "line"]


@dataclasses.dataclass(frozen=True)
class Zero:
    """An offset, or a line (over two masters, a plane).

    Attributes:
        centre: Position at which the first coefficient stands, one per master.
        coefficients: Offset in mm or °, then slopes, if any.
    """

    centre: Float[np.ndarray, " d"]
    coefficients: Float[np.ndarray, " k"]

    def off(
        self, error: Float[np.ndarray, " t"], positions: Float[np.ndarray, "t d"]
    ) -> Float[np.ndarray, " t"]:
        """Return errors without it."""
        design = _design(positions - self.centre, len(self.coefficients) > 1)
        return np.asarray(error - design @ self.coefficients)


def without_zero(
    error: Float[np.ndarray, " t"],
    positions: Sequence[Float[np.ndarray, " t"]],
    kind: Kind,
    run: Shaped[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, " t"]:
    """Return the error without its mean, or without the line (plane) through it.

    Of very many readings every n-th one judges them. Rows with a NaN stay as they are.

    Args:
        error: In mm or °.
        positions: Of each master; none: the error hangs on no place.
        kind: ``none``, ``offset`` or ``line`` (over two masters, a plane).
        run: Of each reading: an offset of its own makes none of it wild.
    """
    places = np.stack([*positions] or [np.zeros(len(error))], axis=1)
    finite = np.isfinite(error) & np.isfinite(places).all(axis=1)
    if kind == "none" or not finite.any():
        return error
    error_of, at = error[finite], places[finite]
    step = step_of(len(error_of))
    result = error.copy()
    runs = None if run is None else run[finite][::step]
    zero = zero_of(error_of[::step], at[::step], kind, runs)
    result[finite] = zero.off(error_of, at)
    return result


def step_of(count: int) -> int:
    """Return n where every n-th of so many readings judges the zero."""
    return max(1, count // ENOUGH)


def zero_of(
    error: Float[np.ndarray, " t"],
    positions: Float[np.ndarray, "t d"],
    kind: Kind,
    run: Shaped[np.ndarray, " t"] | None = None,
) -> Zero:
    """Return the mean of errors, or the line (plane) through them.

    Of all readings but the wild ones, which Huber's loss tells from the rest: what the table
    holds itself and offsets of runs scatter as well, and count in full.
    """
    centre = positions.mean(axis=0)
    # Centred, so that the columns stay apart from each other.
    design = _design(positions - centre, kind == "line")
    weight = np.ones(len(error))
    solution = np.zeros(design.shape[1])
    for _ in range(_PASSES):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(design * root[:, None], error * root)[0]
        size = np.abs(error - design @ solution)
        scale = 1.4826 * float(np.median(size))
        if scale == 0.0:
            break
        new = np.minimum(1.0, _TUNING * scale / np.maximum(size, 1e-300))
        settled = float(np.max(np.abs(new - weight))) < 1e-6
        weight = new
        if settled:
            break
    left = error - design @ solution
    if run is not None:
        from scipy import ndimage  # loads more than a job without runs needs

        labels, own = np.unique(run, return_inverse=True)
        left = left - ndimage.median(left, own, np.arange(len(labels)))[own]
    scale = 1.4826 * float(np.median(np.abs(left)))
    if scale > 0.0:  # else runs of one reading, or no noise: nothing tells wild ones
        believed = np.abs(left) <= WILD * scale
        solution = np.linalg.lstsq(design[believed], error[believed])[0]
    return Zero(centre, solution)


def _design(
    positions: Float[np.ndarray, "t d"], line: bool
) -> Float[np.ndarray, "t k"]:
    columns = [np.ones(len(positions))]
    if line:
        columns += list(positions.T)
    return np.stack(columns, axis=1)

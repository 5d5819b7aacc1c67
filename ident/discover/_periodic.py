"""Periodic errors that a table is too coarse for, in what everything else leaves."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ._basis import waves
from ._select import Selection
from ._view import AxisView

_BINS = 4096
_CHANCE = 1e-4
"""Probability that noise alone shows a line as strong, over all periods."""
_COARSE = 24.0
"""Periods per travel up to which the features hold them."""
_FINEST = 0.25
"""Cycles per bin up to which a period is looked for."""


@dataclasses.dataclass(frozen=True)
class Ripple:
    """A periodic error.

    Attributes:
        master: Axis over whose position it repeats.
        period: In mm or °.
        amplitude: In mm or °.
        nodes: Entries that a table over the travel needs for it, six per period.
    """

    master: str
    period: float
    amplitude: float
    nodes: int


def find_ripples(found: Selection) -> tuple[Ripple, ...]:
    """Return the strongest periodic error over each position, where there is one."""
    view = found.view
    left = np.clip(found.residual, -4.0 * found.noise, 4.0 * found.noise)
    ripples = (_over(view, name, left, found.least) for name in view.span)
    return tuple(each for each in ripples if each is not None)


def _over(
    view: AxisView, axis: str, residual: Float[np.ndarray, " t"], least: float
) -> Ripple | None:
    u = view.scaled(axis)
    known = np.isfinite(u)
    u, left, block = u[known], residual[known], view.block[known]
    if view.places(axis) < 8 * _COARSE:
        return None
    # Where places lie in rows, what is slow over them would show as fine lines.
    slow = waves(u, int(2 * _COARSE), False)
    left = left - slow @ np.linalg.lstsq(slow, left)[0]
    whole, count = _spectrum(u, left)
    total = float(left @ left)
    if not total > 0:
        return None
    power = np.abs(whole) ** 2 / total
    first = int(np.ceil(_COARSE)) + 1
    last = int(_FINEST * _BINS)
    if view.places(axis) < 4 * last:
        last = view.places(axis) // 4
    if last <= first:
        return None
    at = first + int(np.argmax(power[first:last]))
    if power[at] < np.log((last - first) / _CHANCE):
        return None
    # What is there is there in either half of the recording, with the same phase.
    halves = [_spectrum(u[block % 2 == k], left[block % 2 == k]) for k in (0, 1)]
    values = [2.0 * part[at] / max(rows, 1) for part, rows in halves]
    amplitude = 2.0 * abs(whole[at]) / count
    agreement = float(np.real(values[0] * np.conj(values[1])))
    if amplitude / np.sqrt(2.0) < least or agreement < 0.25 * amplitude**2:
        return None
    low, high = view.span[axis]
    place = _between(u, left, at)
    return Ripple(axis, (high - low) / place, amplitude, int(np.ceil(6.0 * place)) + 1)


def _spectrum(
    u: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]
) -> tuple[np.ndarray, int]:
    at = np.minimum((u * _BINS).astype(np.int64), _BINS - 1)
    return np.fft.rfft(np.bincount(at, values, _BINS)), len(u)


def _between(
    u: Float[np.ndarray, " n"], left: Float[np.ndarray, " n"], at: int
) -> float:
    """Return the number of periods per travel, between the whole ones, that fits best."""
    tried = at + np.linspace(-1.0, 1.0, 41)
    fits = [abs(left @ np.exp(-2j * np.pi * each * u)) for each in tried]
    return float(tried[int(np.argmax(fits))])

"""What stays when all that was found is taken off: drifts, fine periods, structure."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ._features import smooth
from ._select import Selection

_PIECES = (1, 2, 3, 4, 6, 8, 12, 16, 20)
"""Straight pieces that a drift may have."""
_WORTH = 0.25
"""Of the scatter of a reading: what is smaller is left where it is."""
_BINS = 4096
"""Places along a position between which readings are not told apart."""
_CHANCE = 1e-4
"""Probability that noise alone shows a line as strong, over all periods."""
_COARSE = 24
"""Periods per travel up to which the features hold them."""
_FINEST = 0.25
"""Cycles per bin up to which a period is looked for."""
_STRUCTURE = 1.15
"""Scatter, relative to that of neighbouring readings, at which something is left."""
_ENOUGH, _PAIRS = 1000, 300
"""Readings, and neighbours among them, from which on that is told."""


@dataclasses.dataclass(frozen=True)
class Wander:
    """A slow change of one measurement that nothing that was found explains.

    Attributes:
        source: Number of the measurement.
        pieces: Straight pieces in time that follow it.
        rms: In mm or ° about its mean.
    """

    source: int
    pieces: int
    rms: float


def find_wander(found: Selection) -> Iterator[Wander]:
    """Yield the drift of each measurement of an axis in which there is one.

    How large it is, the evidence says; its pieces are the fewest that follow it.
    """
    view, drift = found.view, found.columns.drift
    if view.data.time is None or not drift.shape[1]:
        return
    course = found.part(len(found.design.slices) - 1)
    for rows in view.sources():
        clock = view.data.time[rows]
        rms = float(np.std(course[rows]))
        # Runs have an offset each, which a fit allows for.
        several = len(np.unique(view.data.run[rows])) > 1
        if several or not np.ptp(clock) > 0 or rms <= _WORTH * found.noise:
            continue
        share = (clock - clock.min()) / np.ptp(clock)
        pieces = _PIECES[-1]
        for pieces in _PIECES:
            hats = _hats(share, pieces)
            left = course[rows] - hats @ np.linalg.lstsq(hats, course[rows])[0]
            if float(np.std(left)) <= _WORTH * found.noise:
                break
        yield Wander(int(view.data.source[rows[0]]), pieces, rms)


def _hats(place: Float[np.ndarray, " n"], pieces: int) -> Float[np.ndarray, "n k"]:
    """Return the values at the knots of a line of so many pieces over 0 to 1."""
    knots = np.arange(pieces + 1) / pieces
    return np.maximum(1.0 - np.abs(place[:, None] - knots) * pieces, 0.0)


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


def find_ripples(found: Selection) -> list[Ripple]:
    """Return the strongest periodic error over each position that a table is too coarse for."""
    ripples = (_ripple_over(found, name) for name in found.view.span)
    return [each for each in ripples if each is not None]


def _ripple_over(found: Selection, axis: str) -> Ripple | None:
    view = found.view
    u = view.scaled(axis)
    known = np.isfinite(u)
    last = min(int(_FINEST * _BINS), view.places(axis) // 4)
    if view.places(axis) < 8 * _COARSE or last <= _COARSE + 1:
        return None
    u, block = u[known], view.block[known]
    left = np.clip(found.residual[known], -4.0 * found.noise, 4.0 * found.noise)
    # Where places lie in rows, what is slow over them would show as fine lines.
    slow = np.stack([wave(u) for wave in smooth(2 * _COARSE)], axis=1)
    left = left - slow @ np.linalg.lstsq(slow, left)[0]
    bins = np.minimum((u * _BINS).astype(np.int64), _BINS - 1)

    def line_of(rows: np.ndarray) -> np.ndarray:
        return np.fft.rfft(np.bincount(bins[rows], left[rows], _BINS))

    whole, total = line_of(known[known]), float(left @ left)
    power = np.abs(whole[_COARSE + 1 : last]) ** 2
    at = _COARSE + 1 + int(np.argmax(power))
    if not power.max() >= total * np.log((last - _COARSE - 1) / _CHANCE) > 0:
        return None
    # What is there is there in either half of the recording, with the same phase.
    halves = [block % 2 == k for k in (0, 1)]
    values = [2.0 * line_of(half)[at] / max(int(half.sum()), 1) for half in halves]
    amplitude = 2.0 * float(abs(whole[at])) / len(u)
    agreement = float(np.real(values[0] * np.conj(values[1])))
    if amplitude / np.sqrt(2.0) < found.least or agreement < 0.25 * amplitude**2:
        return None
    tried = at + np.linspace(-1.0, 1.0, 41)
    fits = [abs(left @ np.exp(-2j * np.pi * each * u)) for each in tried]
    turns = float(tried[int(np.argmax(fits))])
    low, high = view.span[axis]
    return Ripple(axis, (high - low) / turns, amplitude, int(np.ceil(6.0 * turns)) + 1)


def structure_left(found: Selection, ripples: Sequence[Ripple]) -> float:
    """Return the rms of what is left beyond the scatter of neighbours; 0 where it is slight."""
    view = found.view
    if view.data.time is None or len(view.error) < _ENOUGH:
        return 0.0
    step, same = np.diff(view.data.clock), np.diff(view.data.source) == 0
    near = same & (step <= np.median(step[same]))
    apart = np.diff(found.residual)[near]
    if len(apart) < _PAIRS:
        return 0.0
    white = 1.4826 * float(np.median(np.abs(apart))) / np.sqrt(2.0)
    known = sum(0.5 * each.amplitude**2 for each in ripples)
    extra = float(np.sqrt(max(found.noise**2 - white**2 - known, 0.0)))
    slight = np.hypot(white, extra) < _STRUCTURE * white or extra < 3.0 * found.least
    return 0.0 if slight else extra

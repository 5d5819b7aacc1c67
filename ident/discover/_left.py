"""What stays when all that was found is taken off: drifts, fine periods, structure."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ..core import regress
from ._features import smooth
from ._select import Selection

_PIECES = (1, 2, 3, 4, 6, 8, 12, 16, 20)
"""Straight pieces that a drift may have."""
_MOST, _FEWEST = 200, 16
"""Stretches of a recording that are compared; with fewer, nothing is said."""
_EACH = 10
"""Readings of a stretch, at least."""
_SURE = 4.0
"""Deviations by which stretches that were left out must be predicted better by a drift."""
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

    The means of stretches in time are predicted from the stretches beside them, by drifts of
    more and more pieces: one that is there predicts stretches that it was not fitted to.
    """
    view = found.view
    if view.data.time is None:
        return
    first = len(found.design.terms)
    slow = [found.part(g) for g in range(first, len(found.design.slices))]
    known = found.residual + np.sum(slow, axis=0)
    for rows in view.sources():
        rows = rows[found.weight[rows] > 0]
        if len(np.unique(view.data.run[rows])) > 1:
            continue  # Runs have an offset each.
        clock, source = view.data.time[rows], int(view.data.source[rows[0]])
        count = min(_MOST, len(rows) // _EACH)
        if count < _FEWEST or not np.ptp(clock) > 0:
            continue
        share = (clock - clock.min()) / np.ptp(clock)
        pieces = _pieces(share, known[rows], found.weight[rows], count, found.noise)
        if not pieces:
            continue
        hats = _hats(share, pieces)
        hats = hats[:, hats.any(axis=0)]
        fit = regress(
            hats, known[rows], weight=found.weight[rows], loss="gauss", quick=True
        )
        rms = float(np.std(known[rows] - fit.residual))
        if rms > _WORTH * found.noise:
            yield Wander(source, pieces, rms)


def _pieces(
    share: Float[np.ndarray, " n"],
    left: Float[np.ndarray, " n"],
    weight: Float[np.ndarray, " n"],
    count: int,
    noise: float,
) -> int:
    """Return how many pieces a drift needs; 0 where there is none."""
    at = np.minimum((share * count).astype(np.int64), count - 1)
    total = np.bincount(at, weight, count)
    full = np.flatnonzero(np.bincount(at, minlength=count) >= _EACH // 2)
    if len(full) < _FEWEST:
        return 0
    mean = np.bincount(at, weight * left, count)[full] / total[full]
    place = np.bincount(at, weight * share, count)[full] / total[full]
    sure = noise / np.sqrt(total[full])
    none = _missed(np.ones((len(full), 1)), mean, sure)
    tried = {
        pieces: _missed(_hats(place, pieces), mean, sure)
        for pieces in _PIECES
        if 4 * (pieces + 1) <= len(full)
    }
    best = min(tried.values(), key=np.mean)
    gain = none - best
    if not gain.mean() > _SURE * gain.std() / np.sqrt(len(gain)):
        return 0
    # What a drift of fewer pieces leaves beyond chance is as small as it matters.
    worth = 1.0 + (_WORTH * noise / float(np.median(sure))) ** 2
    enough = max(worth, 1.25 * float(best.mean()))
    return next(k for k, missed in tried.items() if float(missed.mean()) <= enough)


def _missed(
    columns: Float[np.ndarray, "b k"],
    mean: Float[np.ndarray, " b"],
    sure: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " b"]:
    """Return squares, over their variance, of each stretch predicted by every other one."""
    scaled, target = columns / sure[:, None], mean / sure
    missed = np.empty(len(mean))
    for turn in (0, 1):
        out = np.arange(len(mean)) % 2 == turn
        values = np.linalg.lstsq(scaled[~out], target[~out])[0]
        missed[out] = (target[out] - scaled[out] @ values) ** 2
    return missed


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

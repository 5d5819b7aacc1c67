"""How the error wanders in time beside all that was found: the drift of an instrument."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from ._select import Selection

_PIECES = (1, 2, 3, 4, 6, 8, 12, 16, 20)
"""Straight pieces that a drift may have."""
_MOST, _FEWEST = 200, 16
"""Stretches of a recording that are compared; below the fewest, nothing is told."""
_EACH = 10
"""Readings of a stretch, at least."""
_SURE = 4.0
"""Deviations by which stretches that were left out must be told better with a drift."""
_WORTH = 0.25
"""Of the scatter of a reading: what is smaller is left where it is."""


@dataclasses.dataclass(frozen=True)
class Wander:
    """A slow change that nothing that was found explains.

    Attributes:
        axis: Whose error shows it.
        source: Number of the measurement.
        pieces: Straight pieces in time that follow it.
        rms: In mm or ° about its mean.
        unit: Of `rms`.
        course: The error without all that was found, per row of the measurement, smoothed.
        rows: These rows of the view of the axis.
    """

    axis: str
    source: int
    pieces: int
    rms: float
    unit: str
    course: Float[np.ndarray, " n"]
    rows: Int[np.ndarray, " n"]


def find_wander(found: Selection, unit: str) -> Iterator[Wander]:
    """Yield the drift of each measurement of an axis in which it is told.

    The means of stretches in time are predicted from the stretches beside them, by
    drifts of more and more pieces: one that is there tells of stretches that it was not
    fitted to.

    Args:
        found: Terms of the axis.
        unit: Of its error.
    """
    view = found.view
    if view.data.time is None:
        return
    known = found.residual + _slow(found)
    for source in np.unique(view.data.source):
        rows = np.flatnonzero(view.data.source == source)
        if len(np.unique(view.data.run[rows])) > 1:
            continue  # Runs have an offset each.
        clock = view.data.time[rows]
        count = min(_MOST, len(rows) // _EACH)
        if count < _FEWEST or not np.ptp(clock) > 0:
            continue
        share = (clock - clock.min()) / np.ptp(clock)
        pieces = _pieces(share, known[rows], found.weight[rows], count, found.noise)
        if not pieces:
            continue
        weight = np.sqrt(found.weight[rows])
        hats = _hats(share, pieces)
        values = np.linalg.lstsq(hats * weight[:, None], known[rows] * weight)[0]
        course = hats @ values
        course -= course.mean()
        rms = float(np.sqrt(np.mean(course**2)))
        if rms > _WORTH * found.noise:
            yield Wander(view.axis, int(source), pieces, rms, unit, course, rows)


def _slow(found: Selection) -> Float[np.ndarray, " t"]:
    """Return what the selection took for zeros and drifts."""
    first = len(found.design.terms)
    parts = [found.part(g) for g in range(first, found.design.groups)]
    return np.asarray(np.sum(parts, axis=0)) if parts else np.zeros(len(found.weight))


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
    typical = float(np.median(sure))
    worth = 1.0 + (_WORTH * noise / typical) ** 2
    enough = max(worth, 1.25 * float(best.mean()))
    return next(k for k, missed in tried.items() if float(missed.mean()) <= enough)


def _missed(
    columns: Float[np.ndarray, "b k"],
    mean: Float[np.ndarray, " b"],
    sure: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " b"]:
    """Return squares, over their variance, of every other stretch told by the others."""
    scaled, target = columns / sure[:, None], mean / sure
    missed = np.empty(len(mean))
    for turn in (0, 1):
        out = np.arange(len(mean)) % 2 == turn
        values = np.linalg.lstsq(scaled[~out], target[~out])[0]
        missed[out] = (target[out] - scaled[out] @ values) ** 2
    return missed


def _hats(place: Float[np.ndarray, " n"], pieces: int) -> Float[np.ndarray, "n k"]:
    """Return the hat functions of a line of so many pieces over 0 to 1."""
    knots = np.arange(pieces + 1) / pieces
    distance = np.abs(place[:, None] - knots) * pieces
    return np.maximum(1.0 - distance, 0.0)

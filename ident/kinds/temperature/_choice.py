"""Which law, which lag, which intersection: what predicts readings best that it has not seen.

A law is fitted robustly to all readings once; with the weights that the loss left them it is
fitted again without each block and judged on that block. Neighbours in time share their
drift, and readings of one stay their temperature: they are held out together.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import FitError, Regression, node_shares
from ._line import Data, Line, Pair, Shape, Structure, fit_line, laid_out
from ._types import LawScore, Meeting

MOST_NODES = 5
"""A law that the PLC interpolates needs no more."""
_BLOCKS, _FOLDS = 20, 5
_VISIT = 0.05
"""Share of the range of temperatures that counts as staying where it is."""
_MATTERS = 0.02
"""Share of the squared held-out residuals by which a richer law must be better."""
_LIMIT = 5.0
"""Residuals in scales beyond which a held-out reading counts no more."""
_GRID = 14
"""Lags that are tried, over what the clock can show."""
_SURE = 3.0
"""Deviations by which the coefficient must change for the lines to meet somewhere."""
_FAR = 1e3
"""Distance of the intersection, in measured ranges, from which on there is none."""


@dataclasses.dataclass(frozen=True)
class Score:
    """Squared held-out residuals in scales, limited, per reading."""

    loss: Float[np.ndarray, " t"]
    blocks: Int[np.ndarray, " t"]
    scale: float

    @property
    def rms(self) -> float:
        """Root mean square in mm."""
        return self.scale * float(np.sqrt(self.loss.mean()))

    def worse_than(self, other: "Score") -> bool:
        """Tell whether this one predicts worse: by more than chance, and by enough to matter.

        Chance is one standard error over the blocks, which share their drift; a real gain may
        sit in a single block (a transient), so more cannot be asked. What matters is a share
        of the loss.
        """
        gain = self.loss - other.loss
        sums = np.bincount(self.blocks, gain)[np.bincount(self.blocks) > 0]
        spread = float(np.std(sums, ddof=1) * np.sqrt(len(sums)))
        total = float(gain.sum())
        return total > spread and total > _MATTERS * float(other.loss.sum())


def choose_shape(
    data: Data, reference: float, lags: Pair, loss: str
) -> tuple[Shape, tuple[LawScore, ...], Score]:
    """Return the simplest law that predicts no worse than the best by more than chance.

    Raises:
        FitError: If not even the simplest law can be held to readings left out.
    """
    own = [sensor is not None for sensor in data.sensors]
    shapes = [
        Shape(one, two)
        for one in (range(1, MOST_NODES + 1) if own[0] else (1,))
        for two in (range(1, MOST_NODES) if own[1] else (0,))
    ]
    tried: list[tuple[Shape, Score]] = []
    scale = None
    for shape in sorted(shapes, key=lambda each: (-each.size, -each.offset)):
        fitted = _fitted(data, shape, reference, lags, loss)
        if fitted is None:
            continue
        scale = _scale_of(fitted[1].residual) if scale is None else scale
        score = _held_out(data, *fitted, scale)
        if score is not None:
            tried.append((shape, score))
    if not tried:
        msg = "too few readings to tell which law they follow: give the law."
        raise FitError(msg)
    _, best = min(tried, key=lambda each: each[1].rms)
    good = [each for each in tried if not each[1].worse_than(best)]
    chosen, score = min(good, key=lambda each: (each[0].size, each[1].rms))
    scores = tuple(
        LawScore(shape.offset, shape.coefficient, each.rms, shape == chosen)
        for shape, each in reversed(tried)
    )
    return chosen, scores, score


def find_lags(
    data: Data, reference: float, loss: str
) -> tuple[Pair, tuple[bool, bool]]:
    """Return the lags in s of offset and coefficient, and whether the sensor is the late one.

    Tried with laws that can bend, on a grid, then refined. A lag is taken where it predicts
    held-out readings better by more than chance.
    """
    shape = Shape(
        1 if data.sensors[0] is None else 3, 0 if data.sensors[1] is None else 2
    )
    none = (0.0, 0.0)
    still = _fitted(data, shape, reference, none, loss)
    if still is None:
        return none, (False, False)
    scale = _scale_of(still[1].residual)
    low, high = data.lag_range
    # Not quite to the ends of what could show: 5 readings, half of the log.
    grid = np.geomspace(5.0 * low, high / 6.0, _GRID)
    groups = data.lag_groups

    def cost(lags: Pair) -> float:
        fitted = _fitted(data, shape, reference, lags, loss)
        if fitted is None:
            return np.inf
        return float(np.minimum((fitted[1].residual / scale) ** 2, _LIMIT**2).sum())

    def on_grid(sign: float) -> Pair:
        lags = none
        for group in groups * len(groups):
            trials = [_moved(lags, group, sign * value) for value in (0.0, *grid)]
            lags = min(trials, key=cost)
        return lags

    ahead, late = on_grid(1.0), on_grid(-1.0)
    free = [group for group in groups if ahead[group[0]] > 0]
    start = _fitted(data, shape, reference, ahead, loss)
    if free and start is not None:
        ahead = fit_line(start[0], data, loss, False, free, quick=True)[0].lags
    scores = {}
    for lags in {none, ahead, late}:
        fitted = _fitted(data, shape, reference, lags, loss)
        score = None if fitted is None else _held_out(data, *fitted, scale)
        if score is not None:
            scores[lags] = score
    best = min(scores, key=lambda lags: scores[lags].rms, default=none)
    if none not in scores or not scores[none].worse_than(scores[best]):
        return none, (False, False)
    if best == ahead:
        return ahead, (False, False)
    return none, (late[0] < 0, late[1] < 0)


def _moved(lags: Pair, group: Sequence[int], value: float) -> Pair:
    one, other = (value if k in group else lags[k] for k in (0, 1))
    return float(one), float(other)


def find_meeting(
    line: Line,
    found: Regression,
    data: Data,
    scale: float | None,
    loss: str,
    free: Sequence[tuple[int, ...]],
) -> tuple[tuple[Line, Regression] | None, Meeting, float | None]:
    """Return the fit with a constant offset where the lines meet, or None and why not.

    Args:
        line: With an offset of its own.
        found: Its regression.
        data: All readings.
        scale: Of the residuals in mm where laws were compared.
        loss: As for `regress`.
        free: Lags that are fitted.

    Returns:
        The fit, the reason, and the deviation in mm where that is the reason.
    """
    shape = line.shape
    slopes = line.value[shape.offset :]
    if len(slopes) < 2:
        return None, "parallel", None
    part = slice(shape.offset, shape.size)
    pick = np.zeros(len(slopes))
    pick[0], pick[-1] = -1.0, 1.0
    deviation = float(np.sqrt(max(pick @ found.covariance[part, part] @ pick, 0.0)))
    if not abs(slopes[-1] - slopes[0]) > _SURE * deviation:
        return None, "unsure slope", None
    if data.sensors[0] not in (None, data.sensors[1]) and shape.offset > 1:
        return None, "two sensors", None
    theta = data.structure(line.lags)
    offset = node_shares(theta[0], line.nodes[0]) @ line.value[: shape.offset]
    slope = node_shares(theta[1], line.nodes[1]) @ slopes
    rise = slope - slope.mean()
    start = line.reference - float(rise @ (offset - offset.mean())) / float(rise @ rise)
    span = float(np.ptp(data.position))
    if abs(start - line.reference) > _FAR * span:
        return None, "too far", None
    begin = laid_out(theta, Shape(1, len(slopes)), start, line.lags)
    if begin is None:
        return None, "too few", None
    thin = data.thinned()
    begin, _ = fit_line(begin, thin, loss, True, free, quick=True)
    met, regression = fit_line(begin, data, loss, True, free)
    if shape.offset > 1:
        scale = _scale_of(found.residual) if scale is None else scale
        both = [
            _held_out(thin, each, fit_line(each, thin, loss, quick=True)[1], scale)
            for each in (met, line)
        ]
        if both[0] is None or (both[1] is not None and both[0].worse_than(both[1])):
            return None, "not one point", None
    sure = float(regression.standard_deviation[len(met.value)])
    if not sure < max(10.0 * span, abs(met.reference)):
        return None, "uncertain", sure
    return (met, regression), "met", None


def _fitted(
    data: Data, shape: Shape, reference: float, lags: Pair, loss: str
) -> tuple[Line, Regression] | None:
    """Return a law with its node values fitted; None where the readings are too few."""
    line = laid_out(data.structure(lags), shape, reference, lags)
    if line is None or len(data.error) <= shape.size:
        return None
    try:
        return fit_line(line, data, loss, quick=True)
    except FitError:
        return None


def _held_out(data: Data, line: Line, found: Regression, scale: float) -> Score | None:
    """Return the score of a law: fitted to all other blocks, judged on each.

    None where what is left of the readings does not tell the law.
    """
    blocks = time_blocks(data)
    groups = blocks % _FOLDS if blocks.max() + 1 > 2 * _FOLDS else blocks
    theta, root = data.structure(line.lags), np.sqrt(found.share)
    loss = np.zeros(len(blocks))
    for group in np.unique(groups):
        out = groups == group
        rest = theta[0][~out], theta[1][~out]
        other = laid_out(rest, line.shape, line.reference, line.lags)
        if other is None:
            return None
        columns = other.columns(theta, data.position)
        weighted = columns[~out] * root[~out, None]
        weighted = weighted.T @ weighted
        right = columns[~out].T @ (found.share[~out] * data.error[~out])
        size = np.sqrt(np.diag(weighted))
        if not (size > 0).all():
            return None
        value, _, rank, _ = np.linalg.lstsq(
            weighted / np.outer(size, size), right / size, rcond=1e-12
        )
        if rank < len(value):
            return None
        left = (data.error[out] - columns[out] @ (value / size)) / scale
        loss[out] = np.minimum(left**2, _LIMIT**2) * ~_beyond(data, theta, out)
    return Score(loss, blocks, scale)


def time_blocks(data: Data) -> Int[np.ndarray, " t"]:
    """Return the block of each reading: stretches of time, or stays at one temperature."""
    which = 0 if data.sensors[0] is not None else 1
    theta = data.structure((0.0, 0.0))[which]
    limit = _VISIT * max(float(np.ptp(theta)), 1e-9)
    stay = np.zeros(len(theta), np.int64)
    start, number = theta[0], 0
    for row, value in enumerate(theta):
        if abs(value - start) > limit:
            start, number = value, number + 1
        stay[row] = number
    if number + 1 >= _BLOCKS or number + 1 < 3:
        return np.arange(len(theta)) * _BLOCKS // len(theta)
    return stay


def _beyond(
    data: Data, theta: Structure, out: Bool[np.ndarray, " t"]
) -> Bool[np.ndarray, " m"]:
    """Return which held-out readings lie beyond all temperatures that are left.

    No law claims anything there: judging by them would reward what luckily extends.
    """
    result = np.zeros(int(out.sum()), bool)
    for sensor, warm in zip(data.sensors, theta, strict=True):
        if sensor is not None:
            rest = warm[~out]
            result |= (warm[out] < rest.min()) | (warm[out] > rest.max())
    return result


def _scale_of(residual: Float[np.ndarray, " t"]) -> float:
    """Return the scale of residuals that a few wild ones do not change."""
    middle = 1.4826 * float(np.median(np.abs(residual)))
    return max(middle, 1e-9, 1e-6 * float(np.ptp(residual)))

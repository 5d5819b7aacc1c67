"""Which law and which lag: what predicts readings best that it has not seen."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize_scalar

from ...core._errors import FitError
from ._laws import MOST_NODES, Shape
from ._line import Data, Line, fit_linear, lag_grid, laid_out
from ._types import LawScore

_BLOCKS, _FOLDS = 20, 5
_VISIT = 0.05
"""Share of the range of temperatures that counts as staying where it is."""
_MATTERS = 0.02
"""Share of the squared held-out residuals by which a richer law must be better."""
_LIMIT = 5.0
"""Residuals in scales beyond which a held-out reading counts no more."""


def time_blocks(data: Data) -> Int[np.ndarray, " t"]:
    """Return the block of each reading: stretches of time, or stays at one temperature.

    Neighbours in time share their drift, and readings of one stay their temperature: they are
    held out together.
    """
    sensor = data.sensors[0] if data.sensors[0] is not None else data.sensors[1]
    theta = data.structure((0.0, 0.0))[0 if data.sensors[0] is not None else 1]
    limit = _VISIT * max(float(np.ptp(theta)), 1e-9) if sensor is not None else 1.0
    stay = np.zeros(len(theta), np.int64)
    start, number = theta[0], 0
    for row, value in enumerate(theta):
        if abs(value - start) > limit:
            start, number = value, number + 1
        stay[row] = number
    if number + 1 >= _BLOCKS or number + 1 < 3:
        return np.arange(len(theta)) * _BLOCKS // len(theta)
    return stay


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


def held_out(
    data: Data, make: Callable[[Data], Line | None], scale: float
) -> Score | None:
    """Return the score of a law: fitted to all other blocks, judged on each.

    Args:
        data: Readings.
        make: Returns a fitted line, or None where the readings are too few for it.
        scale: Of the residuals in mm.
    """
    blocks = time_blocks(data)
    groups = blocks % _FOLDS if blocks.max() + 1 > 2 * _FOLDS else blocks
    loss = np.zeros(len(blocks))
    for group in np.unique(groups):
        out = groups == group
        line = make(data.take(~out))
        if line is None:
            return None
        left = (data.error[out] - line.predict(data.take(out))) / scale
        loss[out] = np.minimum(left**2, _LIMIT**2) * ~_beyond(data, out)
    return Score(loss, blocks, scale)


def _beyond(data: Data, out: Bool[np.ndarray, " t"]) -> Bool[np.ndarray, " m"]:
    """Return which held-out readings lie beyond all temperatures that are left.

    No law claims anything there: judging by them would reward what luckily extends.
    """
    result = np.zeros(int(out.sum()), bool)
    for sensor, theta in zip(data.sensors, data.structure((0.0, 0.0)), strict=True):
        if sensor is not None:
            rest = theta[~out]
            result |= (theta[out] < rest.min()) | (theta[out] > rest.max())
    return result


def linear_maker(
    shape: Shape, reference: float, lags: tuple[float, float], loss: str
) -> Callable[[Data], Line | None]:
    """Return what fits a law of this shape at fixed reference and lags."""

    def make(data: Data) -> Line | None:
        line = laid_out(data, shape, reference, lags)
        if line is None or len(data.error) <= shape.size:
            return None
        try:
            return fit_linear(line, data, loss)
        except FitError:
            return None

    return make


def robust_scale(residual: Float[np.ndarray, " t"]) -> float:
    """Return the scale of residuals that a few wild ones do not change."""
    middle = 1.4826 * float(np.median(np.abs(residual)))
    return max(middle, 1e-9, 1e-6 * float(np.ptp(residual)))


def choose_shape(
    data: Data,
    shapes: Sequence[Shape],
    reference: float,
    lags: tuple[float, float],
    loss: str,
) -> tuple[Shape, tuple[LawScore, ...], Score]:
    """Return the simplest law that predicts no worse than the best by more than chance.

    Raises:
        FitError: If not even the simplest law can be held to readings left out.
    """
    tried: list[tuple[Shape, Score]] = []
    scale = None
    for shape in sorted(shapes, key=lambda each: (-each.size, -each.offset)):
        line = linear_maker(shape, reference, lags, loss)(data)
        if line is None:
            continue
        if scale is None:
            scale = robust_scale(data.error - line.predict(data))
        score = held_out(data, linear_maker(shape, reference, lags, loss), scale)
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


def shapes_for(offset: bool, coefficient: bool) -> tuple[Shape, ...]:
    """Return the laws to compare."""
    first = range(1, MOST_NODES + 1) if offset else (1,)
    second = range(1, MOST_NODES) if coefficient else (0,)
    return tuple(Shape(one, two) for one in first for two in second)


def _searched(
    cost: Callable[[tuple[float, float]], float],
    lags: tuple[float, float],
    group: Sequence[int],
    grid: Float[np.ndarray, " g"],
) -> tuple[float, float]:
    """Return the lags with those of a group at their best: none, on the grid, or between."""

    def moved(value: float) -> tuple[float, float]:
        each = [value if k in group else lags[k] for k in (0, 1)]
        return each[0], each[1]

    costs = [cost(moved(float(value))) for value in grid]
    best = int(np.argmin(costs))
    sign = float(np.sign(grid[0]))
    low, high = (
        np.log(abs(float(grid[k])))
        for k in (max(best - 1, 0), min(best + 1, len(grid) - 1))
    )
    found = minimize_scalar(
        lambda log: cost(moved(sign * float(np.exp(log)))),
        bounds=(low, high), method="bounded", options={"xatol": 0.05, "maxiter": 12},
    )  # fmt: skip
    tried = [moved(0.0), moved(float(grid[best])), moved(sign * float(np.exp(found.x)))]
    return min(tried, key=cost)


def find_lags(
    data: Data, reference: float, loss: str, shape: Shape
) -> tuple[tuple[float, float], tuple[bool, bool]]:
    """Return the lags in s of offset and coefficient, and whether the sensor is the late one.

    A lag is taken where it predicts held-out readings better by more than chance.
    """
    grid = lag_grid(data)
    none = linear_maker(shape, reference, (0.0, 0.0), loss)(data)
    if none is None:
        return (0.0, 0.0), (False, False)
    scale = robust_scale(data.error - none.predict(data))

    def cost(lags: tuple[float, float]) -> float:
        line = linear_maker(shape, reference, lags, loss)(data)
        if line is None:
            return np.inf
        left = (data.error - line.predict(data)) / scale
        return float(np.minimum(left**2, _LIMIT**2).sum())

    numbers = [k for k, sensor in enumerate(data.sensors) if sensor is not None]
    shared = len(numbers) == 2 and data.sensors[0] == data.sensors[1]
    candidates: list[tuple[float, float]] = []
    for sign in (1.0, -1.0):
        lags = (0.0, 0.0)
        for group in [numbers] if shared else [[k] for k in numbers] * len(numbers):
            lags = _searched(cost, lags, group, sign * grid)
        candidates.append(lags)
    scores = {
        lags: held_out(data, linear_maker(shape, reference, lags, loss), scale)
        for lags in {(0.0, 0.0), *candidates}
    }
    still = scores[0.0, 0.0]
    ahead, late = candidates
    known = [lags for lags in (ahead, late) if scores[lags] is not None]
    if still is None or not known:
        return (0.0, 0.0), (False, False)

    def rms(lags: tuple[float, float]) -> float:
        score = scores[lags]
        return np.inf if score is None else score.rms

    best = min(known, key=rms)
    score = scores[best]
    if score is None or not still.worse_than(score):
        return (0.0, 0.0), (False, False)
    if best == late:
        return (0.0, 0.0), (late[0] < 0, late[1] < 0)
    return ahead, (False, False)

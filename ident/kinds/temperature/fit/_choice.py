"""Which law and which lag: what predicts readings best that it has not seen.

A law is fitted robustly to all readings once; with the weights that the loss left them it is
fitted again without each block and judged on that block. Neighbours in time share their
drift, and readings of one stay their temperature: they are held out together.
"""

import itertools
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from ....core import FitError, Regression, simplest
from ....fit.joint import Temperature
from ._estimate import LawScore
from ._line import FOLDS, Data, Shape, fit_line, laid_out, shape_of

Fitted = tuple[Temperature, Regression]
"""A line, and the regression whose coefficients begin with its node values."""
_MOST_NODES = 5
"""A law that the PLC interpolates needs no more."""
_MOST_TURNS = 10
"""Blocks that are left out one after the other; of more, some together."""
_FEW = 20
"""Readings below which no lag is looked for."""
_MATTERS = 0.02
"""Share of the squared held-out residuals by which a richer law must be better."""
_LIMIT = 5.0
"""Residuals in scales beyond which a reading counts no more for a lag."""
_GRID = 14
"""Lags that are tried, over what the clock can show."""


def choose_law(
    data: Data, lags: Mapping[str, float]
) -> tuple[Shape, tuple[LawScore, ...]]:
    """Return the simplest law that predicts no worse than the best by more than chance.

    Returns:
        Nodes of the law, and what was compared: nothing where the law is given.

    Raises:
        FitError: If not even the simplest law can be held to readings left out.
    """
    given, laws = data.given_law, data.line.sensors
    if len(given) == len(laws):
        return tuple(given[law] for law in laws), ()
    most = {"offset": _MOST_NODES, "coefficient": _MOST_NODES - 1}
    shapes = itertools.product(
        *([given[law]] if law in given else range(1, most[law] + 1) for law in laws)
    )
    tried, scale = dict[Shape, Float[np.ndarray, " t"]](), 0.0
    for shape in sorted(shapes, key=lambda each: (-sum(each), -each[0])):
        fitted = _fitted(data, shape, lags)
        if fitted is None:
            continue
        scale = scale or _scale_of(fitted)
        left = _left_out(data, fitted)
        if left is not None:
            tried[shape] = left
    if not tried:
        msg = "too few readings to tell which law they follow: give the law."
        raise FitError(msg)
    sizes = [sum(shape) for shape in tried]
    best, rms = simplest(list(tried.values()), sizes, scale, data.blocks, _MATTERS)
    chosen = list(tried)[best]
    scores = [
        LawScore(shape[0], sum(shape[1:]), float(each), shape == chosen)
        for shape, each in zip(tried, rms, strict=True)
    ]
    return chosen, tuple(reversed(scores))


def choose_lags(data: Data) -> dict[str, float]:
    """Return the lag in s of each sensor; a negative one is late itself.

    Tried with laws that can bend, on a grid, then refined. A lag is taken where it predicts
    held-out readings better by more than chance.
    """
    none = data.given_lags
    if not data.open_lags or len(data.error) < _FEW:
        return none
    bent = {"offset": 3 if "offset" in data.moved else 1, "coefficient": 2}
    shape = tuple(bent[law] for law in data.line.sensors)
    still = _fitted(data, shape, none)
    if still is None:
        return none
    scale, (low, high) = _scale_of(still), data.lag_range
    # Not quite to the ends of what could show: 5 readings, half of the log.
    grid = np.geomspace(5.0 * low, high / 6.0, _GRID)

    def cost(lags: Mapping[str, float]) -> float:
        fitted = _fitted(data, shape, lags)
        if fitted is None:
            return np.inf
        ratio = np.abs(fitted[1].residual) / scale
        return float(np.square(np.minimum(ratio, _LIMIT)).sum())

    lags = none
    for sensor in data.open_lags * len(data.open_lags):
        values = (0.0, *grid.tolist(), *(-grid).tolist())
        lags = min((lags | {sensor: value} for value in values), key=cost)
    free = [sensor for sensor in data.open_lags if lags[sensor] > 0]
    fitted = _fitted(data, shape, lags)
    if free and fitted is not None:
        line, _ = fit_line(fitted[0], data, free, quick=True)
        lags = {sensor: float(line.lags[sensor]) for sensor in data.sensors}
        fitted = _fitted(data, shape, lags)
    if fitted is None:
        return none
    left = [_left_out(data, each) for each in (still, fitted)]
    known = [each for each in left if each is not None]
    if len(known) < 2:
        return none
    better, _ = simplest(known, (0, 1), scale, data.blocks, _MATTERS)
    return lags if better else none


def _fitted(data: Data, shape: Shape, lags: Mapping[str, float]) -> Fitted | None:
    """Return a law with its node values fitted; None where the readings are too few."""
    line = data.laid_out(shape, lags)
    if line is None or len(data.error) <= sum(shape):
        return None
    try:
        return fit_line(line, data, quick=True)
    except FitError:
        return None


def _left_out(data: Data, fitted: Fitted) -> Float[np.ndarray, " t"] | None:
    """Return what a law fitted to all other blocks leaves of each reading in mm.

    None where what is left of the readings does not tell the law. Beyond all temperatures
    that are left no law claims anything, and nothing counts: judging there would reward
    what luckily extends.
    """
    groups = data.blocks
    if groups.max() + 1 > _MOST_TURNS:
        groups = groups % FOLDS
    left, inside = leave_out(data, fitted, groups)
    return None if np.isnan(left).any() else np.where(inside, left, 0.0)


def leave_out(
    data: Data, fitted: Fitted, groups: Int[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
    """Return what a line fitted without its group leaves of each reading in mm.

    Reference, lags, number of nodes and the weights that the loss left the readings are those
    of the line; its nodes lie over the temperatures of the others.

    Returns:
        NaN where the others do not tell the law; and which readings lie within the
        temperatures of the others.
    """
    line, found = fitted
    inputs, root = data.inputs(line), np.sqrt(found.share)
    theta = inputs[: len(line.sensors)]
    left, inside = np.full(len(groups), np.nan), np.ones(len(groups), bool)
    for group in np.unique(groups):
        out = groups == group
        for warm in theta:
            low, high = warm[~out].min(), warm[~out].max()
            inside[out] &= (warm[out] >= low) & (warm[out] <= high)
        other = laid_out(line, [warm[~out] for warm in theta], shape_of(line))
        if other is None:
            continue
        columns = other.rows(inputs)[1]
        design = columns[~out] * root[~out, None]
        size = np.sqrt(np.square(design).sum(axis=0))
        if not (size > 0).all():
            continue
        aim = root[~out] * data.error[~out]
        value, _, rank, _ = np.linalg.lstsq(design / size, aim, rcond=1e-6)
        if rank == len(value):
            left[out] = data.error[out] - columns[out] @ (value / size)
    return left, inside


def _scale_of(fitted: Fitted) -> float:
    """Return the scale of residuals that a few wild ones do not change."""
    residual = fitted[1].residual
    middle = 1.4826 * float(np.median(np.abs(residual)))
    return max(middle, 1e-9, 1e-6 * float(np.ptp(residual)))

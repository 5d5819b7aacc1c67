"""Which law, which lag, which intersection: what predicts readings best that it has not seen.

A law is fitted robustly to all readings once; with the weights that the loss left them it is
fitted again without each block and judged on that block. Neighbours in time share their
drift, and readings of one stay their temperature: they are held out together.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import FitError, Regression, node_shares, simplest
from ...fit.joint import Temperature
from ._estimate import LawScore, Meeting
from ._line import Data, Shape, fit_line, laid_out, shape_of

Fitted = tuple[Temperature, Regression]
"""A line, and the regression whose coefficients begin with its node values."""
MOST_NODES = 5
"""A law that the PLC interpolates needs no more."""
BLOCKS, FOLDS = 20, 5
"""Stretches of time, and in how many turns they are left out, far from each other."""
_VISIT = 0.05
"""Share of the range of temperatures that counts as staying where it is."""
_FEW = 20
"""Readings below which no lag is looked for."""
_MATTERS = 0.02
"""Share of the squared held-out residuals by which a richer law must be better."""
_LIMIT = 5.0
"""Residuals in scales beyond which a reading counts no more for a lag."""
_GRID = 14
"""Lags that are tried, over what the clock can show."""
_SURE = 3.0
"""Deviations by which the coefficient must change for the lines to meet somewhere."""
_FAR = 1e3
"""Distance of the intersection, in measured ranges, from which on there is none."""


@dataclasses.dataclass(frozen=True)
class Contest:
    """Readings that choose: thinned, in blocks that are held out together.

    Attributes:
        data: The readings.
        blocks: Number of the block of each.
    """

    data: Data
    blocks: Int[np.ndarray, " t"]

    @classmethod
    def of(cls, data: Data) -> "Contest":
        """Return the contest over readings, in stays at one temperature or stretches of time."""
        data = data.thinned()
        theta = data.whole.temperature[data.sensors[0]][:: data.every]
        limit = _VISIT * max(float(np.ptp(theta)), 1e-9)
        stay = np.zeros(len(theta), np.int64)
        start, number = theta[0], 0
        for row, value in enumerate(theta):
            if abs(value - start) > limit:
                start, number = value, number + 1
            stay[row] = number
        if not 3 <= number + 1 < BLOCKS:
            stay = np.arange(len(theta)) * BLOCKS // len(theta)
        return cls(data, stay)

    def fitted(self, shape: Shape, lags: Mapping[str, float]) -> Fitted | None:
        """Return a law with its node values fitted; None where the readings are too few."""
        line = self.data.laid_out(shape, lags)
        if line is None or len(self.data.error) <= sum(shape):
            return None
        try:
            return fit_line(line, self.data, quick=True)
        except FitError:
            return None

    def left_out(
        self, line: Temperature, found: Regression
    ) -> Float[np.ndarray, " t"] | None:
        """Return what a law fitted to all other blocks leaves of each reading in mm.

        None where what is left of the readings does not tell the law. Beyond all temperatures
        that are left no law claims anything, and nothing counts: judging there would reward
        what luckily extends.
        """
        groups = self.blocks
        if groups.max() + 1 > 2 * FOLDS:
            groups = groups % FOLDS
        left, inside = leave_out(line, found, self.data, groups)
        return None if np.isnan(left).any() else np.where(inside, left, 0.0)

    def shape(
        self, lags: Mapping[str, float]
    ) -> tuple[Shape, tuple[LawScore, ...], float | None]:
        """Return the simplest law that predicts no worse than the best by more than chance.

        Returns:
            Nodes of the law, what was compared, and the scale of the residuals in mm; nothing
            is compared where the job gives the law.

        Raises:
            FitError: If not even the simplest law can be held to readings left out.
        """
        given, laws = self.data.given_law, self.data.line.sensors
        if len(given) == len(laws):
            return tuple(given[law] for law in laws), (), None
        most = {"offset": MOST_NODES, "coefficient": MOST_NODES - 1}
        shapes = itertools.product(
            *([given[law]] if law in given else range(1, most[law] + 1) for law in laws)
        )
        tried, scale = dict[Shape, Float[np.ndarray, " t"]](), 0.0
        for shape in sorted(shapes, key=lambda each: (-sum(each), -each[0])):
            fitted = self.fitted(shape, lags)
            if fitted is None:
                continue
            scale = scale or scale_of(fitted[1].residual)
            left = self.left_out(*fitted)
            if left is not None:
                tried[shape] = left
        if not tried:
            msg = "too few readings to tell which law they follow: give the law."
            raise FitError(msg)
        sizes = [sum(shape) for shape in tried]
        best, rms = simplest(list(tried.values()), sizes, scale, self.blocks, _MATTERS)
        chosen = list(tried)[best]
        scores = [
            LawScore(shape[0], sum(shape[1:]), float(each), shape == chosen)
            for shape, each in zip(tried, rms, strict=True)
        ]
        return chosen, tuple(reversed(scores)), scale

    def lags(self) -> dict[str, float]:
        """Return the lag in s of each sensor; a negative one is late itself.

        Tried with laws that can bend, on a grid, then refined. A lag is taken where it
        predicts held-out readings better by more than chance.
        """
        data, none = self.data, self.data.given_lags
        if not data.open_lags or len(data.error) < _FEW:
            return none
        bent = {"offset": 3 if "offset" in data.moved else 1, "coefficient": 2}
        shape = tuple(bent[law] for law in data.line.sensors)
        still = self.fitted(shape, none)
        if still is None:
            return none
        scale = scale_of(still[1].residual)
        low, high = data.lag_range
        # Not quite to the ends of what could show: 5 readings, half of the log.
        grid = np.geomspace(5.0 * low, high / 6.0, _GRID)

        def cost(lags: Mapping[str, float]) -> float:
            fitted = self.fitted(shape, lags)
            if fitted is None:
                return np.inf
            ratio = np.abs(fitted[1].residual) / scale
            return float(np.square(np.minimum(ratio, _LIMIT)).sum())

        lags = none
        for sensor in data.open_lags * len(data.open_lags):
            values = (0.0, *grid.tolist(), *(-grid).tolist())
            lags = min((lags | {sensor: value} for value in values), key=cost)
        free = [sensor for sensor in data.open_lags if lags[sensor] > 0]
        fitted = self.fitted(shape, lags)
        if free and fitted is not None:
            line, _ = fit_line(fitted[0], data, False, free, quick=True)
            lags = {sensor: float(line.lags[sensor]) for sensor in data.sensors}
            fitted = self.fitted(shape, lags)
        if fitted is None or not self._better(fitted, still, scale):
            return none
        return lags

    def _better(self, richer: Fitted, plain: Fitted, scale: float) -> bool:
        """Return whether a law predicts better than a plainer one by more than chance."""
        left = [self.left_out(*each) for each in (plain, richer)]
        known = [each for each in left if each is not None]
        if len(known) < len(left):
            return False
        return bool(simplest(known, (0, 1), scale, self.blocks, _MATTERS)[0])

    def meeting(
        self,
        fitted: Fitted,
        data: Data,
        scale: float | None,
        free: Sequence[str],
    ) -> tuple[Fitted | None, Meeting, float | None]:
        """Return the fit with a constant offset where the lines meet, or None and why not.

        Args:
            fitted: With an offset of its own.
            data: All readings.
            scale: Of the residuals in mm where laws were compared.
            free: Sensors whose lag is fitted.

        Returns:
            The fit, the reason, and the deviation in mm where that is the reason.
        """
        line, found = fitted
        count, last = len(line.nodes["offset"]), line.size - 1
        values = line.split(found.coefficients)
        slopes = values["coefficient"]
        if len(slopes) < 2:
            return None, "parallel", None
        ends = found.covariance[np.ix_([count, last], [count, last])]
        deviation = np.sqrt(max(ends[0, 0] + ends[1, 1] - 2.0 * ends[0, 1], 0.0))
        if not abs(slopes[-1] - slopes[0]) > _SURE * deviation:
            return None, "unsure slope", None
        if len(data.sensors) > 1 and count > 1:
            return None, "two sensors", None
        offset, slope = (
            node_shares(warm, line.nodes[law]) @ values[law]
            for law, warm in zip(line.sensors, data.warmth(line), strict=True)
        )
        rise = slope - slope.mean()
        away = -float(rise @ (offset - offset.mean())) / float(rise @ rise)
        span = float(np.ptp(data.position))
        if abs(away) > _FAR * span:
            return None, "too far", None
        begin = laid_out(
            dataclasses.replace(line, reference=line.reference + away),
            data.warmth(line),
            (1, len(slopes)),
        )
        if begin is None:
            return None, "too few", None
        begin, _ = fit_line(begin, self.data, True, free, quick=True)
        met, regression = fit_line(begin, data, True, free)
        if count > 1:
            first, second = (
                (each, fit_line(each, self.data, quick=True)[1]) for each in (met, line)
            )
            scale = scale_of(found.residual) if scale is None else scale
            if self.left_out(*first) is None or self._better(second, first, scale):
                return None, "not one point", None
        sure = float(regression.standard_deviation[met.size])
        if not sure < max(10.0 * span, abs(met.reference)):
            return None, "uncertain", sure
        return (met, regression), "met", None


def leave_out(
    line: Temperature, found: Regression, data: Data, groups: Int[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
    """Return what a line fitted without its group leaves of each reading in mm.

    Reference, lags, number of nodes and the weights that the loss left the readings are those
    of the line; its nodes lie over the temperatures of the others.

    Returns:
        NaN where the others do not tell the law; and which readings lie within the
        temperatures of the others.
    """
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


def scale_of(residual: Float[np.ndarray, " t"]) -> float:
    """Return the scale of residuals that a few wild ones do not change."""
    middle = 1.4826 * float(np.median(np.abs(residual)))
    return max(middle, 1e-9, 1e-6 * float(np.ptp(residual)))

"""Which law, which lag, which intersection: what predicts readings best that it has not seen.

A law is fitted robustly to all readings once; with the weights that the loss left them it is
fitted again without each block and judged on that block. Neighbours in time share their
drift, and readings of one stay their temperature: they are held out together.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ...core import FitError, Regression, node_shares, simplest
from ._line import Data, Line, Pair, Shape, fit_line, laid_out
from ._types import LawScore, Meeting

MOST_NODES = 5
"""A law that the PLC interpolates needs no more."""
_BLOCKS, _FOLDS = 20, 5
_VISIT = 0.05
"""Share of the range of temperatures that counts as staying where it is."""
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
        loss: As for `regress`.
    """

    data: Data
    blocks: Int[np.ndarray, " t"]
    loss: str

    @classmethod
    def of(cls, data: Data, loss: str) -> "Contest":
        """Return the contest over readings, in stays at one temperature or stretches of time."""
        data = data.thinned()
        theta = data.structure((0.0, 0.0))[0 if data.sensors[0] is not None else 1]
        limit = _VISIT * max(float(np.ptp(theta)), 1e-9)
        stay = np.zeros(len(theta), np.int64)
        start, number = theta[0], 0
        for row, value in enumerate(theta):
            if abs(value - start) > limit:
                start, number = value, number + 1
            stay[row] = number
        if not 3 <= number + 1 < _BLOCKS:
            stay = np.arange(len(theta)) * _BLOCKS // len(theta)
        return cls(data, stay, loss)

    def fitted(
        self, shape: Shape, reference: float, lags: Pair
    ) -> tuple[Line, Regression] | None:
        """Return a law with its node values fitted; None where the readings are too few."""
        line = laid_out(self.data.structure(lags), shape, reference, lags)
        if line is None or len(self.data.error) <= sum(shape):
            return None
        try:
            return fit_line(line, self.data, self.loss, quick=True)
        except FitError:
            return None

    def left_out(self, line: Line, found: Regression) -> Float[np.ndarray, " t"] | None:
        """Return what a law fitted to all other blocks leaves of each reading in mm.

        None where what is left of the readings does not tell the law. Beyond all temperatures
        that are left no law claims anything, and nothing counts: judging there would reward
        what luckily extends.
        """
        data, groups = self.data, self.blocks
        if groups.max() + 1 > 2 * _FOLDS:
            groups = groups % _FOLDS
        theta, root = data.structure(line.lags), np.sqrt(found.share)
        result = np.zeros(len(groups))
        for group in np.unique(groups):
            out = groups == group
            rest = theta[0][~out], theta[1][~out]
            other = laid_out(rest, line.shape, line.reference, line.lags)
            if other is None:
                return None
            columns = other.columns(theta, data.position)
            design = columns[~out] * root[~out, None]
            size = np.sqrt(np.square(design).sum(axis=0))
            if not (size > 0).all():
                return None
            aim = root[~out] * data.error[~out]
            value, _, rank, _ = np.linalg.lstsq(design / size, aim, rcond=1e-6)
            if rank < len(value):
                return None
            inside = np.all(
                [
                    (warm[out] >= warm[~out].min()) & (warm[out] <= warm[~out].max())
                    for warm in theta
                ],
                axis=0,
            )
            left = data.error[out] - columns[out] @ (value / size)
            result[out] = np.where(inside, left, 0.0)
        return result

    def shape(
        self, reference: float, lags: Pair
    ) -> tuple[Shape, tuple[LawScore, ...], float]:
        """Return the simplest law that predicts no worse than the best by more than chance.

        Returns:
            Nodes of the law, what was compared, and the scale of the residuals in mm.

        Raises:
            FitError: If not even the simplest law can be held to readings left out.
        """
        own = [sensor is not None for sensor in self.data.sensors]
        shapes = [
            (one, two)
            for one in (range(1, MOST_NODES + 1) if own[0] else (1,))
            for two in (range(1, MOST_NODES) if own[1] else (0,))
        ]
        tried, scale = dict[Shape, Float[np.ndarray, " t"]](), 0.0
        for shape in sorted(shapes, key=lambda each: (-sum(each), -each[0])):
            fitted = self.fitted(shape, reference, lags)
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
            LawScore(*shape, float(each), shape == chosen)
            for shape, each in zip(tried, rms, strict=True)
        ]
        return chosen, tuple(reversed(scores)), scale

    def lags(self, reference: float) -> tuple[Pair, tuple[bool, bool]]:
        """Return the lags in s of offset and coefficient, and whether the sensor is late.

        Tried with laws that can bend, on a grid, then refined; a negative lag is one of the
        sensor behind the structure. A lag is taken where it predicts held-out readings better
        by more than chance.
        """
        data, none, nothing = self.data, (0.0, 0.0), (False, False)
        shape = 1 if data.sensors[0] is None else 3, 0 if data.sensors[1] is None else 2
        still = self.fitted(shape, reference, none)
        if still is None:
            return none, nothing
        scale = scale_of(still[1].residual)
        low, high = data.lag_range
        # Not quite to the ends of what could show: 5 readings, half of the log.
        grid = np.geomspace(5.0 * low, high / 6.0, _GRID)

        def cost(lags: Pair) -> float:
            fitted = self.fitted(shape, reference, lags)
            if fitted is None:
                return np.inf
            ratio = np.abs(fitted[1].residual) / scale
            return float(np.square(np.minimum(ratio, _LIMIT)).sum())

        lags = none
        for group in data.lag_groups * len(data.lag_groups):
            trials = []
            for value in (0.0, *grid.tolist(), *(-grid).tolist()):
                one, other = (value if k in group else lags[k] for k in (0, 1))
                trials.append((one, other))
            lags = min(trials, key=cost)
        free = [group for group in data.lag_groups if lags[group[0]] > 0]
        fitted = self.fitted(shape, reference, lags)
        if free and fitted is not None:
            lags = fit_line(fitted[0], data, self.loss, False, free, quick=True)[0].lags
            fitted = self.fitted(shape, reference, lags)
        if fitted is None:
            return none, nothing
        tried = [self.left_out(*each) for each in (still, fitted)]
        left = [each for each in tried if each is not None]
        if len(left) < 2 or not simplest(left, (0, 1), scale, self.blocks, _MATTERS)[0]:
            return none, nothing
        return (max(lags[0], 0.0), max(lags[1], 0.0)), (lags[0] < 0, lags[1] < 0)

    def meeting(
        self,
        line: Line,
        found: Regression,
        data: Data,
        scale: float | None,
        free: list[tuple[int, ...]],
    ) -> tuple[tuple[Line, Regression] | None, Meeting, float | None]:
        """Return the fit with a constant offset where the lines meet, or None and why not.

        Args:
            line: With an offset of its own.
            found: Its regression.
            data: All readings.
            scale: Of the residuals in mm where laws were compared.
            free: Lags that are fitted.

        Returns:
            The fit, the reason, and the deviation in mm where that is the reason.
        """
        count, slopes = line.shape[0], line.value[line.shape[0] :]
        if len(slopes) < 2:
            return None, "parallel", None
        first, last = count, sum(line.shape) - 1
        ends = found.covariance[np.ix_([first, last], [first, last])]
        deviation = np.sqrt(max(ends[0, 0] + ends[1, 1] - 2.0 * ends[0, 1], 0.0))
        if not abs(slopes[-1] - slopes[0]) > _SURE * deviation:
            return None, "unsure slope", None
        if data.sensors[0] not in (None, data.sensors[1]) and count > 1:
            return None, "two sensors", None
        theta = data.structure(line.lags)
        offset = node_shares(theta[0], line.nodes[0]) @ line.value[:count]
        slope = node_shares(theta[1], line.nodes[1]) @ slopes
        rise = slope - slope.mean()
        away = -float(rise @ (offset - offset.mean())) / float(rise @ rise)
        span = float(np.ptp(data.position))
        if abs(away) > _FAR * span:
            return None, "too far", None
        shape = 1, len(slopes)
        begin = laid_out(theta, shape, line.reference + away, line.lags)
        if begin is None:
            return None, "too few", None
        begin, _ = fit_line(begin, self.data, self.loss, True, free, quick=True)
        met, regression = fit_line(begin, data, self.loss, True, free)
        if count > 1:
            tried = [
                self.left_out(each, fit_line(each, self.data, self.loss, quick=True)[1])
                for each in (met, line)
            ]
            left = [each for each in tried if each is not None]
            scale = scale_of(found.residual) if scale is None else scale
            if (
                tried[0] is None
                or (
                    simplest(left, (0, 1)[: len(left)], scale, self.blocks, _MATTERS)[0]
                )
            ):
                return None, "not one point", None
        sure = float(regression.standard_deviation[len(met.value)])
        if not sure < max(10.0 * span, abs(met.reference)):
            return None, "uncertain", sure
        return (met, regression), "met", None


def scale_of(residual: Float[np.ndarray, " t"]) -> float:
    """Return the scale of residuals that a few wild ones do not change."""
    middle = 1.4826 * float(np.median(np.abs(residual)))
    return max(middle, 1e-9, 1e-6 * float(np.ptp(residual)))

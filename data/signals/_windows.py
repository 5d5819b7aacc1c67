"""Delay and rate of an instrument by regression in windows of a second or two."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ._aligned import AlignedError, travel_direction
from ._noise import NORMAL

_WINDOW = 1.5
"""s: within it the true error is linear in the positions, as far as a delay goes."""
_PIECES = 40
"""Of the travel: over all of it the true error bends as a cubic spline, both ways alike."""
_STRETCHES = 8
"""Of the travel: over all of it what changes with the direction bends likewise."""
_AT_TURN = 5
"""Samples on both sides of a turn."""
_LEAST_ROWS = 8
_HEAVY = 2.5
"""Robust standard deviations beyond which a reading counts less and less."""
_REWEIGHTED = 8


@dataclasses.dataclass(frozen=True)
class Solution:
    """One step towards delay and rate, and how sure it is.

    Attributes:
        delay: In s.
        rate: In s per half the record.
        deviation: Of the delay.
        rate_deviation: Of the rate.
        scatter: Of what is left of the error.
        speed: At which the axis moves fast.
        independent: Share of the delay's column that the others cannot express.
    """

    delay: float
    rate: float
    deviation: float
    rate_deviation: float
    scatter: float
    speed: float
    independent: float


@dataclasses.dataclass(frozen=True)
class _Pass:
    """One weighted regression.

    Attributes:
        design: Columns less the lines of the windows.
        normal: Their normal matrix.
        values: Per column.
        residual: Of the error.
        scatter: Of that, robust.
        weight: For the next one.
        bend: Likewise, mean square of the functions that bend with the direction, by scatter².
    """

    design: Float[np.ndarray, "n k"]
    normal: Float[np.ndarray, "k k"]
    values: Float[np.ndarray, " k"]
    residual: Float[np.ndarray, " n"]
    scatter: float
    weight: Float[np.ndarray, " n"]
    bend: float


class Windows:
    """Sums of a regression in windows, in each a line over all positions of its own."""

    def __init__(
        self,
        aligned: AlignedError,
        valid: Bool[np.ndarray, " t"],
        spline: Any,
        others: Sequence[Any],
        middle: float,
        half: float,
    ) -> None:
        rows = np.flatnonzero(valid)
        at = aligned.instants[rows]
        speed = np.asarray(spline(at, 1))
        # By the samples: after a stop the spline through them swings.
        before = np.maximum(np.searchsorted(spline.x, at, side="right") - 1, 0)
        way = travel_direction(spline(spline.x))
        sign = way[before].astype(float)
        number = np.floor((at - at[:1]) / _WINDOW).astype(np.int64)
        number = np.unique(number, return_inverse=True)[1].reshape(-1)
        keep = _changing(number, speed) & ~_turning(way)[before]
        rows, at, speed, sign = (array[keep] for array in (rows, at, speed, sign))
        self.number = np.unique(number[keep], return_inverse=True)[1].reshape(-1)
        self.count = int(self.number.max(initial=-1)) + 1
        self.speed = float(np.percentile(np.abs(speed), 90)) if rows.size else 0.0
        self.error = aligned.error[rows]
        axes = [spline, *others]
        self.places = [np.asarray(axis(at)) for axis in axes]
        place = self.places[0]
        span = max(float(np.ptp(place)), 1e-12) if rows.size else 1.0
        centred = (place - place.mean()) / span if rows.size else place
        elapsed = (at - middle) / half
        table, play = (
            _smooth(centred, pieces) if rows.size else centred[:, None]
            for pieces in (_PIECES, _STRETCHES)
        )
        self.bends = play.shape[1]
        rates = [np.asarray(axis(at, 2)) for axis in axes]
        # The first two are what is asked for; e = −τ v.
        self.columns = np.stack(
            [
                *(-speed, -speed * elapsed, sign, sign * centred),
                *(*rates, *table.T, *(sign[:, None] * play).T),
            ],
            axis=1,
        )

    def solve(self, with_rate: bool) -> "Solution":
        """Return the change of delay and rate that the errors ask for."""
        use = [k for k in range(self.columns.shape[1]) if with_rate or k != 1]
        columns = self.columns[:, use]
        scale = np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-300)
        columns = columns / scale
        fit = self._weighted(columns, np.ones(len(self.error)), 1.0)
        for _ in range(_REWEIGHTED):
            fit = self._weighted(columns, fit.weight, fit.bend)
        design, residual, weight = fit.design, fit.residual, fit.weight
        scores = np.stack(
            [
                np.bincount(self.number, weight * residual * c, self.count)
                for c in design.T
            ],
            axis=1,
        )
        inverse = np.linalg.inv(fit.normal)
        spread = np.diag(inverse @ (scores.T @ scores) @ inverse)
        # Few windows scatter less than they should beside so many columns.
        white = fit.scatter**2 * np.diag(inverse)
        deviation = np.sqrt(np.maximum(spread, white)) / scale
        values = fit.values / scale
        return Solution(
            delay=float(values[0]),
            rate=float(values[1]) if with_rate else 0.0,
            deviation=float(deviation[0]),
            rate_deviation=float(deviation[1]) if with_rate else np.inf,
            scatter=fit.scatter,
            speed=self.speed,
            independent=float(1.0 / (inverse[0, 0] * fit.normal[0, 0])),
        )

    def _weighted(
        self,
        columns: Float[np.ndarray, "n k"],
        weight: Float[np.ndarray, " n"],
        bend: float,
    ) -> "_Pass":
        """Return one weighted regression, and the weights that its residuals ask for.

        By how much what changes with the direction bends is chosen by the evidence (MacKay,
        Neural Computation 4, 1992): where the speed depends on the place alone, as in one swing
        again and again, a bend looks like a delay, and only its usual size tells them apart.
        """
        flat, design = self._without_lines(columns, weight)
        normal = (design * weight[:, None]).T @ design
        normal += 1e-12 * np.trace(normal) * np.eye(columns.shape[1])
        bent = range(columns.shape[1] - self.bends, columns.shape[1])
        normal[bent, bent] += 1.0 / bend
        values = np.linalg.solve(normal, design.T @ (weight * flat))
        residual = flat - design @ values
        scatter = NORMAL * float(np.median(np.abs(residual)))
        new = 1.0 / (1.0 + (residual / max(_HEAVY * scatter, 1e-15)) ** 2)
        told = self.bends - np.linalg.inv(normal)[bent, bent].sum() / bend
        square = float(np.sum(values[bent] ** 2)) / max(scatter, 1e-15) ** 2
        return _Pass(
            *(design, normal, values, residual, scatter, new),
            bend=float(np.clip(square / max(told, 1e-3), 1e-6, 1e6)),
        )

    def _without_lines(
        self, columns: Float[np.ndarray, "n k"], weight: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
        """Return error and columns less each window's line over the positions."""
        # Windows follow each other: the rows of each are one piece.
        starts = np.searchsorted(self.number, np.arange(self.count))
        total = np.maximum(np.add.reduceat(weight, starts), 1e-12)

        def mean(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
            sums = np.add.reduceat(weight[:, None] * values, starts, axis=0)
            return np.asarray((sums / total[:, None])[self.number])

        def flat(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
            residual = values - mean(values)
            for base, power in lines:
                residual = residual - base * mean(base * residual) / power
            return np.asarray(residual)

        lines: list[tuple[np.ndarray, np.ndarray]] = []
        for place in self.places:
            column = place[:, None]
            centred, base = column - mean(column), flat(column)
            # What moves along with another axis has no line of its own.
            square = mean(base * base)
            tiny = square <= 1e-6 * mean(centred * centred) + 1e-12
            lines.append((np.where(tiny, 0.0, base), np.where(tiny, 1.0, square)))
        return flat(self.error[:, None])[:, 0], flat(columns)


def _smooth(place: Float[np.ndarray, " n"], pieces: int) -> Float[np.ndarray, "n k"]:
    """Return functions of a place that bend: constant and slope are those of the windows."""
    from scipy.interpolate import BSpline

    inner = np.linspace(place.min(), place.max(), pieces + 1)
    knots = np.pad(inner, 3, mode="edge")
    return np.asarray(BSpline.design_matrix(place, knots, 3).toarray()[:, 1:-1])


def _turning(way: Int[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
    """Return the samples at a turn, where the direction is not known to the sample.

    Where an axis turns it is slow: nothing else tells a play from a delay as much.
    """
    turns = np.flatnonzero(np.diff(way))
    around = turns[:, None] + np.arange(1 - _AT_TURN, _AT_TURN + 1)
    near = np.zeros(way.size, bool)
    near[np.clip(around, 0, way.size - 1)] = True
    return near


def _changing(
    number: Int[np.ndarray, " n"], speed: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Return the rows of windows in which the speed changes, and that are not too few."""
    if not number.size:
        return np.zeros(0, dtype=bool)
    count = int(number.max()) + 1
    size = np.bincount(number, minlength=count)
    mean = np.bincount(number, speed, count) / np.maximum(size, 1)
    spread = np.bincount(number, (speed - mean[number]) ** 2, count)
    peak = np.abs(speed).max()
    valid = (size >= _LEAST_ROWS) & (spread / np.maximum(size, 1) > (0.02 * peak) ** 2)
    return np.asarray(valid[number] & (peak > 0))

"""Lags between sensors and structure by variable projection.

For a trial lag only the columns of the temperature change: everything else is eliminated
once, the rest is a problem of a few unknowns, and the restricted likelihood is a function of
the logarithm of the lag alone.

Source: G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from .._errors import FitError
from ..thermal._clocked import Clocked
from ._arrow import Arrow
from ._data import JointData
from ._design import Design
from ._effect import AbstractEffect
from ._passes import Stand
from ._temperature import TemperatureEffect

_GRID = 14
_NEWTON, _LARGEST, _SETTLED = 12, 0.7, 1e-4
"""Steps at most, the largest one in a logarithm, and the one that ends them."""
_WORTH = 4.0
"""Gain in evidence below which there is no lag."""
_STEP, _LEAST = 0.05, 1e-3
"""Step in a logarithm for slope and curvature: to begin with, and the smallest one."""
_RIDGE = 1e-9


@dataclasses.dataclass(frozen=True)
class FoundLag:
    """The lag of one sensor in s, its standard deviation, and what it moves.

    Attributes:
        value: Time constant in s; 0 = none shows.
        deviation: Of it, in s.
        slope: Change of all unknowns per s.
    """

    value: float
    deviation: float
    slope: Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class _Heated:
    """A temperature over the rows that are fitted, for one lag after the other."""

    effect: TemperatureEffect
    taken: JointData
    rows: Int[np.ndarray, " r"]
    clocks: Mapping[str, Clocked]

    def columns(self, lags: Mapping[str, float]) -> Float[np.ndarray, "r p"]:
        """Return its columns for trial lags; sensors that have none keep theirs."""
        warm = {}
        for sensor, own in self.effect.lags.items():
            lag = lags.get(sensor, 0.0 if isinstance(own, str) else own)
            clock = self.clocks.get(sensor)
            if clock is None or not lag:
                warm[sensor] = self.taken.column(
                    "temperature", sensor, self.effect.name
                )
            else:
                warm[sensor] = clock.structure(lag)[self.rows]
        return self.effect.columns(self.taken, warm)[0]


@dataclasses.dataclass(frozen=True)
class _Rest:
    """Everything but the temperatures, eliminated.

    The factor of the fit has the temperatures in it; `response` and `inner` take them out:
    where they are held, the others solve as with them, less what the temperatures did.
    """

    arrow: Arrow
    response: Float[np.ndarray, "n k"]
    inner: Float[np.ndarray, "k k"]
    across: sp.csr_array
    target: Float[np.ndarray, " r"]
    base: Float[np.ndarray, " n"]
    square: float
    free: int
    own: Int[np.ndarray, " k"]
    heated: tuple[_Heated, ...]

    def solve(self, right: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return the solution with the temperatures held at zero."""
        found = self.arrow.solve(right)
        found = found - self.response @ np.linalg.solve(self.inner, found[self.own])
        found[self.own] = 0.0
        return np.asarray(found)

    def profile(
        self, lags: Mapping[str, float]
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return the evidence of trial lags, up to a constant, and all unknowns."""
        columns = np.hstack([each.columns(lags) for each in self.heated])
        columns = columns * (self.target != 0.0)[:, None]
        beside = np.asarray(self.across @ columns)
        beside[self.own] = 0.0
        through = self.solve(beside)
        schur = columns.T @ columns - beside.T @ through
        right = columns.T @ self.target - beside.T @ self.base
        scale = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-300))
        scaled = schur / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
        values = np.linalg.solve(scaled, right / scale) / scale
        square = max(self.square - float(right @ values), 1e-300)
        _, logdet = np.linalg.slogdet(scaled * np.outer(scale, scale))
        theta = self.base - through @ values
        theta[self.own] = values
        return self.free * float(np.log(square)) + float(logdet), theta


def sensors_to_fit(effects: Sequence[AbstractEffect]) -> tuple[str, ...]:
    """Return the sensors whose lag is to be fitted."""
    return tuple(
        dict.fromkeys(
            sensor
            for effect in effects
            if isinstance(effect, TemperatureEffect)
            for sensor, lag in effect.lags.items()
            if lag == "fit"
        )
    )


def find_lags(
    design: Design,
    data: JointData,
    stand: Stand,
    sensors: tuple[str, ...],
    near: Mapping[str, float] | None = None,
) -> dict[str, FoundLag]:
    """Return the lags with the best evidence, smoothness and weights of readings as they are.

    Args:
        design: Columns; the present lags do not matter.
        data: All rows: a lag remembers those that are not fitted.
        stand: A fit with any lags.
        sensors: Whose lag to find.
        near: Lags that are about right, so that no others are tried; 0 = none showed.

    Raises:
        FitError: If there is no clock.
    """
    if data.time is None:
        msg = f"axis {design.axis}: a lag needs the time of every reading, found none."
        raise FitError(msg)
    rest = _rest(design, data, stand)
    low, high = _bounds(data.time)
    lags = {sensor: (near or {}).get(sensor, 0.0) for sensor in sensors}
    grid = np.linspace(low, high, _GRID)

    for sensor, known in list(lags.items()):
        # One after the other roughly; then all together.
        logs = np.log([known]) if known > 0.0 else grid
        costs = [rest.profile({**lags, sensor: float(np.exp(log))})[0] for log in logs]
        still = rest.profile({**lags, sensor: 0.0})[0]
        best = int(np.argmin(costs))
        shows = still - costs[best] > _WORTH
        lags[sensor] = float(np.exp(logs[best])) if shows else 0.0
    return _together(rest, design.size, lags, (low, high))


def _together(
    rest: _Rest,
    size: int,
    lags: Mapping[str, float],
    ends: tuple[float, float],
) -> dict[str, FoundLag]:
    """Return all lags above 0 at their best, by Newton steps in their logarithms."""
    names = [sensor for sensor, lag in lags.items() if lag > 0.0]
    result = {sensor: FoundLag(0.0, 0.0, np.zeros(size)) for sensor in lags}
    if not names:
        return result

    def at(logs: Float[np.ndarray, " m"]) -> tuple[float, Float[np.ndarray, " n"]]:
        trial = dict(zip(names, np.exp(logs).tolist(), strict=True))
        return rest.profile({**lags, **trial})

    logs = np.log([lags[sensor] for sensor in names])
    value = at(logs)[0]
    width = np.full(len(logs), _STEP)
    for _ in range(_NEWTON):
        slope, curvature, slopes = _derivatives(at, logs, value, width)
        eigenvalues, vectors = np.linalg.eigh(curvature)
        # Away from the minimum the curvature may be of the wrong sign.
        steep = np.abs(eigenvalues)
        steep = np.maximum(steep, 1e-6 * steep.max() + 1e-12)
        # Two deviations: wider ones would see how lopsided the evidence is.
        width = np.sqrt(8.0 / np.maximum(np.abs(np.diag(curvature)), 1e-12))
        width = np.clip(width, _LEAST, _STEP)
        step = -(vectors / steep) @ (vectors.T @ slope)
        step *= min(1.0, _LARGEST / max(float(np.abs(step).max()), 1e-12))
        while True:
            trial = np.clip(logs + step, *ends)
            fresh = at(trial)[0]
            if fresh <= value or np.abs(step).max() < _SETTLED:
                break
            step = 0.5 * step
        done = bool((np.abs(trial - logs) < np.maximum(_SETTLED, 0.01 * width)).all())
        if fresh <= value:
            logs, value = trial, fresh
        if done:
            break
    slope, curvature, slopes = _derivatives(at, logs, value, width)
    # Minus twice the log-likelihood: the covariance is two over its curvature.
    curvature = curvature + 1e-12 * np.eye(len(logs))
    spread = np.sqrt(np.abs(np.diag(2.0 * np.linalg.inv(curvature))))
    for k, sensor in enumerate(names):
        lag = float(np.exp(logs[k]))
        result[sensor] = FoundLag(lag, lag * float(spread[k]), slopes[k] / lag)
    return result


def _derivatives(
    at: Callable[[Float[np.ndarray, " m"]], tuple[float, Float[np.ndarray, " n"]]],
    logs: Float[np.ndarray, " m"],
    value: float,
    width: Float[np.ndarray, " m"],
) -> tuple[
    Float[np.ndarray, " m"], Float[np.ndarray, "m m"], list[Float[np.ndarray, " n"]]
]:
    """Return slope and curvature of the evidence, and the slopes of the unknowns."""
    count = len(logs)
    unit = np.diag(width)
    ends = [(at(logs + step), at(logs - step)) for step in unit]
    both = 2.0 * width
    slope = np.array([up[0] - down[0] for up, down in ends]) / both
    bent = np.array([up[0] - 2.0 * value + down[0] for up, down in ends])
    curvature = np.diag(bent / width**2)
    for i in range(count):
        for j in range(i):
            four = [
                sign * at(logs + a * unit[i] + b * unit[j])[0]
                for a, b, sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
            ]
            curvature[i, j] = curvature[j, i] = sum(four) / (both[i] * both[j])
    slopes = [
        (up[1] - down[1]) / wide for (up, down), wide in zip(ends, both, strict=True)
    ]
    return slope, curvature, slopes


def _rest(design: Design, data: JointData, stand: Stand) -> _Rest:
    solution = stand.solution
    problem = solution.problem
    sums = problem.sums
    own = np.concatenate(
        [
            design.places_of(number)
            for number, effect in enumerate(design.effects)
            if isinstance(effect, TemperatureEffect)
        ]
    )
    arrow = solution.arrow
    unit = np.zeros((design.size, len(own)))
    unit[own, np.arange(len(own))] = 1.0
    response = arrow.solve(unit)
    target = np.where(sums.active, stand.pseudo + design.columns @ problem.theta, 0.0)
    across = sp.csr_array(design.columns.T)
    vector = np.asarray(across @ target)
    vector[own] = 0.0
    rest = _Rest(
        arrow=arrow,
        response=response,
        inner=response[own],
        across=across,
        target=target,
        base=vector,
        square=float(target @ target),
        free=problem.free,
        own=own,
        heated=(),
    )
    base = rest.solve(vector)
    taken = data.take(design.rows)
    heated = tuple(
        _Heated(effect, taken, design.rows, _clocks(effect, data))
        for effect in design.effects
        if isinstance(effect, TemperatureEffect)
    )
    return dataclasses.replace(
        rest, base=base, square=rest.square - float(vector @ base), heated=heated
    )


def _clocks(effect: TemperatureEffect, data: JointData) -> dict[str, Clocked]:
    """Return the clock of each sensor that any lag belongs to."""
    return {
        sensor: effect.clocked(data, sensor)
        for sensor, lag in effect.lags.items()
        if isinstance(lag, str) or lag > 0.0 or data.time is not None
    }


def _bounds(time: Float[np.ndarray, " t"]) -> tuple[float, float]:
    """Return the logarithms of the shortest and the longest lag that a clock could show."""
    clock = np.unique(time[np.isfinite(time)])
    if len(clock) < 3:
        msg = "all readings have the same time, expected a clock that runs."
        raise FitError(msg)
    span = float(clock[-1] - clock[0])
    gap = float(np.median(np.diff(clock)))
    return float(np.log(max(gap, 1e-4 * span))), float(np.log(span))

"""Lags between sensors and structure by variable projection.

For a trial lag only the columns of the temperature change: everything else is eliminated
once, the rest is a problem of a few unknowns, and the restricted likelihood is a function of
the logarithm of the lag alone.

Source: G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
"""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from .._errors import FitError
from ._arrow import Arrow, arrow_of
from ._data import JointData
from ._design import Design
from ._passes import Stand
from ._temperature import TemperatureEffect

_AWAY = 1e12
"""Weight, relative to its information, that takes an unknown out of a system."""
_GRID = 14
_NEWTON, _LARGEST, _SETTLED = 12, 0.7, 1e-4
"""Steps at most, the largest one in a logarithm, and the one that ends them."""
_WORTH = 4.0
"""Gain in evidence below which there is no lag."""
_STEP = 0.05
"""Step in a logarithm for slope and curvature."""
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
class _Rest:
    """Everything but the temperatures, eliminated."""

    arrow: Arrow
    columns: sp.csr_array
    target: Float[np.ndarray, " r"]
    vector: Float[np.ndarray, " n"]
    base: Float[np.ndarray, " n"]
    square: float
    free: int
    own: Int[np.ndarray, " k"]


def sensors_to_fit(design: Design) -> tuple[str, ...]:
    """Return the sensors whose lag is to be fitted."""
    return tuple(
        dict.fromkeys(
            sensor
            for effect in design.effects
            if isinstance(effect, TemperatureEffect)
            for sensor, lag in effect.lags.items()
            if lag == "fit"
        )
    )


def find_lags(
    design: Design, data: JointData, stand: Stand, sensors: tuple[str, ...]
) -> dict[str, FoundLag]:
    """Return the lags with the best evidence, smoothness and weights of readings as they are.

    Args:
        design: Columns; the present lags do not matter.
        data: All rows: a lag remembers those that are not fitted.
        stand: A fit with any lags.
        sensors: Whose lag to find.

    Raises:
        FitError: If there is no clock.
    """
    if data.time is None:
        msg = f"axis {design.axis}: a lag needs the time of every reading, found none."
        raise FitError(msg)
    rest = _rest(design, stand)
    low, high = _bounds(data.time)
    lags = dict.fromkeys(sensors, 0.0)
    grid = np.linspace(low, high, _GRID)

    for sensor in sensors:
        # One after the other roughly; then all together.
        costs = [
            _profile(rest, design, data, {**lags, sensor: float(np.exp(log))})[0]
            for log in grid
        ]
        still = _profile(rest, design, data, lags)[0]
        best = int(np.argmin(costs))
        if still - costs[best] > _WORTH:
            lags[sensor] = float(np.exp(grid[best]))
    return _together(rest, design, data, lags, (low, high))


def _together(
    rest: _Rest,
    design: Design,
    data: JointData,
    lags: Mapping[str, float],
    ends: tuple[float, float],
) -> dict[str, FoundLag]:
    """Return all lags above 0 at their best, by Newton steps in their logarithms."""
    names = [sensor for sensor, lag in lags.items() if lag > 0.0]
    result = {sensor: FoundLag(0.0, 0.0, np.zeros(design.size)) for sensor in lags}
    if not names:
        return result

    def at(logs: Float[np.ndarray, " m"]) -> tuple[float, Float[np.ndarray, " n"]]:
        trial = dict(zip(names, np.exp(logs).tolist(), strict=True))
        return _profile(rest, design, data, {**lags, **trial})

    logs = np.log([lags[sensor] for sensor in names])
    value = at(logs)[0]
    for _ in range(_NEWTON):
        slope, curvature, slopes = _derivatives(at, logs, value)
        eigenvalues, vectors = np.linalg.eigh(curvature)
        # Away from the minimum the curvature may be of the wrong sign.
        size = np.maximum(np.abs(eigenvalues), 1e-6 * np.abs(eigenvalues).max() + 1e-12)
        step = -(vectors / size) @ (vectors.T @ slope)
        step *= min(1.0, _LARGEST / max(float(np.abs(step).max()), 1e-12))
        while True:
            trial = np.clip(logs + step, *ends)
            fresh = at(trial)[0]
            if fresh <= value or np.abs(step).max() < _SETTLED:
                break
            step = 0.5 * step
        done = float(np.abs(trial - logs).max()) < _SETTLED
        if fresh <= value:
            logs, value = trial, fresh
        if done:
            break
    slope, curvature, slopes = _derivatives(at, logs, value)
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
) -> tuple[
    Float[np.ndarray, " m"], Float[np.ndarray, "m m"], list[Float[np.ndarray, " n"]]
]:
    """Return slope and curvature of the evidence, and the slopes of the unknowns."""
    count = len(logs)
    unit = _STEP * np.eye(count)
    ends = [(at(logs + step), at(logs - step)) for step in unit]
    slope = np.array([(up[0] - down[0]) / (2.0 * _STEP) for up, down in ends])
    curvature = np.diag([(u[0] - 2.0 * value + d[0]) / _STEP**2 for u, d in ends])
    for i in range(count):
        for j in range(i):
            four = [
                sign * at(logs + a * unit[i] + b * unit[j])[0]
                for a, b, sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
            ]
            curvature[i, j] = curvature[j, i] = sum(four) / (4.0 * _STEP**2)
    slopes = [(up[1] - down[1]) / (2.0 * _STEP) for up, down in ends]
    return slope, curvature, slopes


def _rest(design: Design, stand: Stand) -> _Rest:
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
    pins = problem.pins.copy()
    typical = float(np.median(sums.diagonal[sums.diagonal > 0]))
    pins[own] = _AWAY * np.maximum(sums.diagonal[own], typical)
    arrow = arrow_of(sums, problem.weights, solution.values, pins)
    if arrow is None:
        msg = f"axis {design.axis}: the effects beside the temperature are not determined."
        raise FitError(msg)
    target = np.where(sums.active, stand.pseudo + design.columns @ problem.theta, 0.0)
    vector = np.asarray(design.columns.T @ target)
    vector[own] = 0.0
    base = arrow.solve(vector)
    square = float(target @ target) - float(vector @ base)
    return _Rest(arrow, design.columns, target, vector, base, square, problem.free, own)


def _profile(
    rest: _Rest, design: Design, data: JointData, lags: Mapping[str, float]
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Return the evidence of trial lags, up to a constant, and all unknowns."""
    parts = [
        effect.lagging({s: lags[s] for s in effect.sensor_names if s in lags}).block(
            data
        )
        for effect in design.effects
        if isinstance(effect, TemperatureEffect)
    ]
    columns = np.hstack([part.columns[design.rows].toarray() for part in parts])
    active = rest.target != 0.0
    columns = columns * active[:, None]
    beside = np.asarray(rest.columns.T @ columns)
    beside[rest.own] = 0.0
    through = rest.arrow.solve(beside)
    schur = columns.T @ columns - beside.T @ through
    right = columns.T @ rest.target - beside.T @ rest.base
    scale = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-300))
    scaled = schur / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
    values = np.linalg.solve(scaled, right / scale) / scale
    square = max(rest.square - float(right @ values), 1e-300)
    _, logdet = np.linalg.slogdet(scaled * np.outer(scale, scale))
    theta = rest.base - through @ values
    theta[rest.own] = values
    return rest.free * float(np.log(square)) + float(logdet), theta


def _bounds(time: Float[np.ndarray, " t"]) -> tuple[float, float]:
    """Return the logarithms of the shortest and the longest lag that a clock could show."""
    clock = np.unique(time[np.isfinite(time)])
    if len(clock) < 3:
        msg = "all readings have the same time, expected a clock that runs."
        raise FitError(msg)
    span = float(clock[-1] - clock[0])
    gap = float(np.median(np.diff(clock)))
    return float(np.log(max(gap, 1e-4 * span))), float(np.log(span))

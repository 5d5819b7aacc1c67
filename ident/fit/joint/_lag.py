"""Lags between sensors and structure by variable projection.

For a trial lag only the columns of the temperature change: everything else is eliminated
once, the rest is a problem of a few unknowns, and the restricted likelihood is a function of
the logarithm of the lag alone.

Source: G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from ...core import Estimate, FitError
from ._data import JointData
from ._design import Design
from ._effect import AbstractEffect
from ._eliminated import Rest, eliminated
from ._temperature import TemperatureEffect

_GRID = 14
_WORTH = 4.0
"""Gain in evidence below which there is no lag."""
_STEP, _LEAST = 0.05, 1e-3
"""Step in a logarithm for slope and curvature: to begin with, and the smallest one."""


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
    fit: Estimate,
    pseudo: Float[np.ndarray, " r"],
    sensors: tuple[str, ...],
    near: Mapping[str, float] | None = None,
) -> dict[str, FoundLag]:
    """Return the lags with the best evidence, smoothness and weights of readings as they are.

    Args:
        design: Columns; the present lags do not matter.
        data: All rows: a lag remembers those that are not fitted.
        fit: A fit with any lags.
        pseudo: Its pseudo-readings.
        sensors: Whose lag to find.
        near: Lags that are about right, so that no others are tried; 0 = none showed.

    Raises:
        FitError: If there is no clock.
    """
    if data.time is None:
        msg = f"axis {design.axis}: a lag needs the time of every reading, found none."
        raise FitError(msg)
    rest = eliminated(design, data, fit, pseudo)
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
    rest: Rest,
    size: int,
    lags: Mapping[str, float],
    ends: tuple[float, float],
) -> dict[str, FoundLag]:
    """Return all lags above 0 at their best, their logarithms searched."""
    names = [sensor for sensor, lag in lags.items() if lag > 0.0]
    result = {sensor: FoundLag(0.0, 0.0, np.zeros(size)) for sensor in lags}
    if not names:
        return result

    def at(logs: Float[np.ndarray, " m"]) -> tuple[float, Float[np.ndarray, " n"]]:
        trial = dict(zip(names, np.exp(logs).tolist(), strict=True))
        return rest.profile({**lags, **trial})

    start = np.log([lags[sensor] for sensor in names])
    best = minimize(
        lambda logs: at(logs)[0], start, method="L-BFGS-B", jac="3-point",
        bounds=[ends] * len(names), options={"ftol": 1e-12, "gtol": 1e-4},
    )  # fmt: skip
    logs, value = np.asarray(best.x), float(best.fun)
    width = np.full(len(logs), _STEP)
    for _ in range(2):
        # Two deviations: wider ones would see how lopsided the evidence is.
        _, curvature, _ = _derivatives(at, logs, value, width)
        width = np.sqrt(8.0 / np.maximum(np.abs(np.diag(curvature)), 1e-12))
        width = np.clip(width, _LEAST, _STEP)
    _, curvature, slopes = _derivatives(at, logs, value, width)
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


def _bounds(time: Float[np.ndarray, " t"]) -> tuple[float, float]:
    """Return the logarithms of the shortest and the longest lag that a clock could show."""
    clock = np.unique(time[np.isfinite(time)])
    if len(clock) < 3:
        msg = "all readings have the same time, expected a clock that runs."
        raise FitError(msg)
    span = float(clock[-1] - clock[0])
    gap = float(np.median(np.diff(clock)))
    return float(np.log(max(gap, 1e-4 * span))), float(np.log(span))

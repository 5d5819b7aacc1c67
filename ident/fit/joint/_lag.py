"""Lags between sensors and structure by variable projection.

For a trial lag only the columns of the temperatures change: everything else is eliminated
once, the rest is a problem of a few unknowns, and the restricted likelihood is a function of
the logarithms of the lags alone.

Source: G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from ...core import ArrowFactor, Estimate, FitError
from ._data import JointData
from ._design import Design
from ._effect import AbstractEffect
from ._temperature import TemperatureEffect

_GRID = 14
_WORTH = 4.0
"""Gain in evidence below which there is no lag."""
_STEP, _LEAST = 0.025, 5e-4
"""Step in a logarithm for slope and curvature: to begin with, and the smallest one."""
_RIDGE = 1e-9

Profile = Callable[[Float[np.ndarray, " m"]], tuple[float, Float[np.ndarray, " n"]]]
"""Returns the evidence of the logarithms of lags, up to a constant, and all unknowns."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
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
    lags = [effect.lags for effect in effects if isinstance(effect, TemperatureEffect)]
    own = [sensor for each in lags for sensor, lag in each.items() if lag == "fit"]
    return tuple(dict.fromkeys(own))


def find_lags(
    design: Design,
    data: JointData,
    fit: Estimate,
    pseudo: Float[np.ndarray, " r"],
    sensors: Sequence[str],
    near: Mapping[str, float] | None = None,
) -> dict[str, FoundLag]:
    """Return the lags with the best evidence, smoothness and weights of readings as they are.

    Args:
        design: Columns; the present lags do not matter.
        data: All rows: a lag remembers those that are not fitted.
        fit: A fit with any lags.
        pseudo: Its pseudo-readings about `Estimate.centre`, 0 where one is not believed.
        sensors: Whose lag to find.
        near: Lags that are about right, so that no others are tried; 0 = none showed.

    Raises:
        FitError: If there is no clock.
    """
    rest = _Rest(design, data, fit, pseudo)
    low, high = _bounds(design.axis, data)
    lags = {sensor: (near or {}).get(sensor, 0.0) for sensor in sensors}
    for sensor, known in list(lags.items()):
        # One after the other roughly; then all together.
        grid = np.log([known]) if known > 0.0 else np.linspace(low, high, _GRID)
        trials = [{**lags, sensor: float(lag)} for lag in np.exp(grid)]
        costs = [rest.profile(trial)[0] for trial in trials]
        best = int(np.argmin(costs))
        if rest.profile({**lags, sensor: 0.0})[0] - costs[best] > _WORTH:
            lags = trials[best]
        else:
            lags[sensor] = 0.0
    shown = [sensor for sensor, lag in lags.items() if lag > 0.0]
    result = {sensor: FoundLag(0.0, 0.0, np.zeros(design.size)) for sensor in lags}
    if not shown:
        return result

    def at(logs: Float[np.ndarray, " m"]) -> tuple[float, Float[np.ndarray, " n"]]:
        trial = dict(zip(shown, np.exp(logs).tolist(), strict=True))
        return rest.profile({**lags, **trial})

    best_logs = np.asarray(minimize(
        lambda logs: at(logs)[0], np.log([lags[sensor] for sensor in shown]),
        method="L-BFGS-B", jac="3-point", bounds=[(low, high)] * len(shown),
        options={"ftol": 1e-12, "gtol": 1e-4},
    ).x)  # fmt: skip
    spread, slopes = _at_best(at, best_logs)
    for k, sensor in enumerate(shown):
        lag = float(np.exp(best_logs[k]))
        result[sensor] = FoundLag(lag, lag * float(spread[k]), slopes[k] / lag)
    return result


def _at_best(
    at: Profile, logs: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " m"], list[Float[np.ndarray, " n"]]]:
    """Return the deviations of the logarithms, and the slopes of the unknowns over them."""
    unit, count = np.eye(len(logs)), len(logs)
    width = np.full(count, _STEP)
    curvature = np.zeros((count, count))
    for _ in range(3):
        # Two deviations: wider ones would see how lopsided the evidence is.
        for i in range(count):
            for j in range(i + 1):
                ends = [
                    a
                    * b
                    * at(logs + a * width[i] * unit[i] + b * width[j] * unit[j])[0]
                    for a in (1, -1)
                    for b in (1, -1)
                ]
                curvature[i, j] = curvature[j, i] = sum(ends) / (
                    4 * width[i] * width[j]
                )
        last = width
        width = np.sqrt(2.0 / np.maximum(np.abs(np.diag(curvature)), 1e-12))
        width = np.clip(width, _LEAST, _STEP)
    # Minus twice the log-likelihood: the covariance is two over its curvature.
    covariance = 2.0 * np.linalg.inv(curvature + 1e-12 * unit)
    slopes = [
        (at(logs + step)[1] - at(logs - step)[1]) / (2.0 * wide)
        for step, wide in zip(np.diag(last), last, strict=True)
    ]
    return np.sqrt(np.abs(np.diag(covariance))), slopes


def _bounds(axis: str, data: JointData) -> tuple[float, float]:
    """Return the logarithms of the shortest and the longest lag that a clock could show."""
    if data.time is None:
        msg = f"axis {axis}: a lag needs the time of every reading, found none."
        raise FitError(msg)
    clock = np.unique(data.time[np.isfinite(data.time)])
    if len(clock) < 3:
        msg = "all readings have the same time, expected a clock that runs."
        raise FitError(msg)
    span = float(clock[-1] - clock[0])
    gap = float(np.median(np.diff(clock)))
    return float(np.log(max(gap, 1e-4 * span))), float(np.log(span))


@final
@dataclasses.dataclass(frozen=True, eq=False)
class _Rest:
    """One axis about a fit with any lags, everything but its temperatures eliminated.

    The factor of the fit has the temperatures in it. Where they are held, the others solve as
    with them, less what the temperatures did.
    """

    design: Design
    data: JointData
    fit: Estimate
    pseudo: Float[np.ndarray, " r"]

    @cached_property
    def heated(self) -> list[tuple[int, TemperatureEffect]]:
        """The temperatures and their numbers."""
        effects = enumerate(self.design.effects)
        return [(k, each) for k, each in effects if isinstance(each, TemperatureEffect)]

    @cached_property
    def own(self) -> Int[np.ndarray, " k"]:
        """Unknowns of the temperatures."""
        return np.concatenate([self.design.places_of(k) for k, _ in self.heated])

    @cached_property
    def response(self) -> Float[np.ndarray, "n k"]:
        """Inverse of the fit's matrix in the columns of the temperatures."""
        return self.factor.solve(np.eye(self.design.size)[:, self.own])

    @property
    def factor(self) -> ArrowFactor:
        """Of the fit."""
        return self.fit.posterior.factor

    def solve(self, right: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return the solution with the temperatures held at zero."""
        found = self.factor.solve(right)
        inner = self.response[self.own]
        found = found - self.response @ np.linalg.solve(inner, found[self.own])
        found[self.own] = 0.0
        return np.asarray(found)

    def beside(self, rows: Float[np.ndarray, "r *k"]) -> Float[np.ndarray, "n *k"]:
        """Return the right-hand side of the others for readings, or columns of them."""
        found = np.asarray(self.design.columns.T @ rows)
        found[self.own] = 0.0
        return found

    @cached_property
    def target(self) -> Float[np.ndarray, " r"]:
        """Pseudo-readings; 0 where one is not believed."""
        whole = self.pseudo + self.design.columns @ self.fit.centre
        return np.where(self.pseudo != 0.0, whole, 0.0)

    @cached_property
    def base(self) -> tuple[Float[np.ndarray, " n"], float]:
        """The others without any temperature, and the square that they leave."""
        right = self.beside(self.target)
        values = self.solve(right)
        return values, float(self.target @ self.target) - float(right @ values)

    def profile(
        self, lags: Mapping[str, float]
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return the evidence of trial lags, up to a constant, and all unknowns."""
        base, square = self.base
        blocks = [each.lagging(lags).block(self.data) for _, each in self.heated]
        columns = np.hstack(
            [each.columns[self.design.rows].toarray() for each in blocks]
        )
        columns = columns * (self.target != 0.0)[:, None]
        beside = self.beside(columns)
        through = self.solve(beside)
        schur = columns.T @ columns - beside.T @ through
        right = columns.T @ self.target - beside.T @ base
        scale = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-300))
        scaled = schur / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
        values = np.linalg.solve(scaled, right / scale) / scale
        square = max(square - float(right @ values), 1e-300)
        _, logdet = np.linalg.slogdet(scaled * np.outer(scale, scale))
        theta = base - through @ values
        theta[self.own] = values
        free = self.fit.posterior.problem.degrees
        return free * float(np.log(square)) + float(logdet), theta

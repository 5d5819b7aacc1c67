"""The fit of one compensated axis: its stack, the lags of its sensors, what was believed."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from ...core import Estimate, FitError, Problem, Readings, estimate, memory
from .._table import floor_of
from ._data import JointData
from ._design import Design
from ._effect import AbstractEffect
from ._lag import FoundLag, find_lags, sensors_to_fit
from ._prepare import Ground, Prepared, alike, ground_of, judged
from ._temperature import TemperatureEffect

Smoothness = str | float | Mapping[str, Mapping[str, float]]
"""``"auto"``, a number, or weights by name of the table."""

_LAG_ROUNDS, _LAG_ENDED = 6, 0.1
"""Rounds of lags and everything else; they end where no lag moves by that share of its sd."""
_LEAST = 1e-7
"""Weight relative to the density of second differences that were given none."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class AxisFit:
    """A fitted axis.

    Attributes:
        ready: What was known before.
        estimate: Of its stack.
        error: Readings that were fitted in mm or °.
        lags: By sensor.
        settled: Whether everything converged.
    """

    ready: Prepared
    estimate: Estimate
    error: Float[np.ndarray, " r"]
    lags: Mapping[str, FoundLag]
    settled: bool

    @property
    def design(self) -> Design:
        """Columns."""
        return self.ready.design

    @cached_property
    def theta(self) -> Float[np.ndarray, " n"]:
        """Values under the rules."""
        return self.ready.rules.project(self.estimate.values)

    @cached_property
    def _pseudo(self) -> tuple[Float[np.ndarray, " r"], Bool[np.ndarray, " r"]]:
        return pseudo_readings(self.design, self.estimate, self.error)

    @property
    def pseudo(self) -> Float[np.ndarray, " r"]:
        """Pseudo-readings of the last pass about the estimate before it."""
        return self._pseudo[0]

    @property
    def active(self) -> Bool[np.ndarray, " r"]:
        """Readings that are believed at all."""
        return self._pseudo[1]


def pseudo_readings(
    design: Design, found: Estimate, error: Float[np.ndarray, " r"]
) -> tuple[Float[np.ndarray, " r"], Bool[np.ndarray, " r"]]:
    """Return the pseudo-readings of a fit about `Estimate.centre`, and which are believed."""
    left = error - design.columns @ found.centre
    ratio = left / found.loss.scale
    pseudo = found.loss.share(ratio) * left / found.posterior.problem.gain
    return np.asarray(pseudo), ~found.loss.wild(ratio)


def fit_axis(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    *,
    loss: str,
    smoothness: Smoothness,
    drift: int,
    use: Bool[np.ndarray, " t"] | None,
    like: Prepared | None = None,
) -> AxisFit:
    """Fit all effects of one axis.

    Args:
        axis: Compensated axis.
        effects: Its effects, nodes placed.
        data: Readings.
        loss: As for `fit_joint`; so are the following.
        smoothness: By evidence, or given.
        drift: Pieces of the drift of each run.
        use: Rows to fit.
        like: An earlier fit of the same effects, whose rules hold here too.

    Raises:
        FitError: If the readings do not determine them or an option is unknown.
    """
    sensors = sensors_to_fit(effects)
    ground = ground_of(axis, effects, data, drift, use, measured=True)
    ready = None if like is None else alike(like, ground)
    error, found = _fitted(ground, data, loss, smoothness, None)
    lags: dict[str, FoundLag] = {}
    settled = True
    for turn in range(_LAG_ROUNDS if sensors else 0):
        before = {sensor: lag.value for sensor, lag in lags.items()}
        pseudo = pseudo_readings(ground.design, found, error)[0]
        lags = find_lags(ground.design, data, found, pseudo, sensors, before)
        if before and _close(before, lags):
            break
        own = lagging(effects, lags)
        ground = ground_of(axis, own, data, drift, use, measured=True)
        error, found = _fitted(ground, data, loss, smoothness, found)
        settled = turn + 1 < _LAG_ROUNDS
    if ready is None or ready.sums is not ground.sums:
        ready = judged(ground, data, drift, ready)
    return AxisFit(ready, found, error, lags, settled and found.converged)


def lagging(
    effects: Sequence[AbstractEffect], lags: Mapping[str, FoundLag]
) -> list[AbstractEffect]:
    """Return effects with the lags that were found."""
    return [
        effect.lagging({s: lags[s].value for s in effect.sensor_names if s in lags})
        if isinstance(effect, TemperatureEffect)
        else effect
        for effect in effects
    ]


def _close(before: Mapping[str, float], now: Mapping[str, FoundLag]) -> bool:
    return all(
        abs(found.value - before[sensor]) <= _LAG_ENDED * found.deviation
        for sensor, found in now.items()
    )


def _fitted(
    ground: Ground,
    data: JointData,
    loss: str,
    smoothness: Smoothness,
    near: Estimate | None,
) -> tuple[Float[np.ndarray, " r"], Estimate]:
    """Return the readings of an axis and the fit of its stack for given lags."""
    design = ground.design
    error = np.asarray(data.error[design.axis], float)[design.rows]
    if len(error) - ground.pinned.free < 1:
        msg = (
            f"axis {design.axis}: {len(error)} readings leave nothing to judge the "
            f"noise by; expected more than {ground.pinned.free}."
        )
        raise FitError(msg)
    start = np.zeros(design.size)
    start[design.datum] = float(np.median(error))
    pins = ground.pinned.pins
    return error, estimate(
        design.stack,
        memory(design.stack, Readings(error, {}), design.dense),
        loss=loss,
        weights=None if smoothness == "auto" else _weights(design, smoothness),
        floor=floor_of(error),
        start=start,
        pins=pins if pins.any() else None,
        near=near,
    )


def _weights(
    design: Design, smoothness: Smoothness
) -> Callable[[Problem], Float[np.ndarray, " k"]]:
    """Return the weights that were asked for, given the sums."""
    if isinstance(smoothness, str):
        msg = f"smoothness: found {smoothness!r}, expected 'auto', a number or weights."
        raise FitError(msg)
    if isinstance(smoothness, (int, float)) and not 0 <= smoothness < np.inf:
        msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0."
        raise FitError(msg)

    def weights(problem: Problem) -> Float[np.ndarray, " k"]:
        if isinstance(smoothness, (int, float)):
            wanted = np.where(problem.optional, 0.0, float(smoothness))
        else:
            wanted = np.array(
                [
                    float((smoothness.get(part.name) or {}).get(name, 0.0))
                    for part in design.named
                    for name in part.prior_names
                ]
            )
        least = np.where(problem.optional, 0.0, _LEAST * problem.density)
        return np.maximum(wanted, least)

    return weights


def weights_by_name(fit: AxisFit) -> dict[str, dict[str, float]]:
    """Return the smoothness of each table, and of the drift, by name."""
    result, first = {}, 0
    for part in fit.design.named:
        names = part.prior_names
        own = fit.estimate.posterior.weights[first : first + len(names)]
        result[part.name] = dict(zip(names, own.tolist(), strict=True))
        first += len(names)
    return result

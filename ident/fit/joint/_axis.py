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
from ._design import Design, design_of
from ._effect import AbstractEffect
from ._gauge import Unheld
from ._identified import Identified, identified
from ._lag import FoundLag, find_lags, sensors_to_fit
from ._temperature import TemperatureEffect

Smoothness = str | float | Mapping[str, Mapping[str, float]]
"""``"auto"``, a number, or weights by name of the table."""

_LAG_ROUNDS, _LAG_ENDED = 6, 0.1
"""Rounds of lags and everything else; they end where no lag moves by that share of its sd."""
_LEAST = 1e-7
"""Weight relative to the density of second differences that were given none."""


@dataclasses.dataclass(frozen=True)
class Options:
    """How to fit; see `fit_joint`."""

    loss: str
    smoothness: Smoothness
    drift: int


@final
@dataclasses.dataclass(frozen=True, eq=False)
class AxisFit:
    """A fitted axis.

    Attributes:
        known: What its rows tell, whatever was measured in them.
        estimate: Of its stack.
        error: Readings that were fitted in mm or °.
        lags: By sensor.
        converged: Whether everything did.
    """

    known: Identified
    estimate: Estimate
    error: Float[np.ndarray, " r"]
    lags: Mapping[str, FoundLag]
    converged: bool

    @property
    def design(self) -> Design:
        """Columns."""
        return self.known.design

    @cached_property
    def theta(self) -> Float[np.ndarray, " n"]:
        """Values under the rules."""
        return self.known.rules.project(self.estimate.values)

    @cached_property
    def pseudo(self) -> Float[np.ndarray, " r"]:
        """Pseudo-readings of the last pass about the estimate before it, see `_pseudo`."""
        return _pseudo(self.design, self.estimate, self.error)

    @cached_property
    def active(self) -> Bool[np.ndarray, " r"]:
        """Readings that are believed at all."""
        left = self.error - self.design.columns @ self.estimate.centre
        return np.asarray(~self.estimate.loss.wild(left / self.estimate.loss.scale))

    def smoothness(self) -> dict[str, dict[str, float]]:
        """Return the weights of each table, and of the drift, by name."""
        weights = iter(self.estimate.posterior.weights.tolist())
        return {
            part.name: {name: next(weights) for name in part.weights}
            for part in self.design.named
        }


def _pseudo(
    design: Design, found: Estimate, error: Float[np.ndarray, " r"]
) -> Float[np.ndarray, " r"]:
    """Return the pseudo-readings about `Estimate.centre`, 0 where one is not believed."""
    left = error - design.columns @ found.centre
    share = found.loss.share(left / found.loss.scale)
    return np.asarray(share * left / found.posterior.problem.gain)


def fit_axis(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    options: Options,
    use: Bool[np.ndarray, " t"] | None,
    like: Identified | None = None,
) -> AxisFit:
    """Fit all effects of one axis.

    Args:
        axis: Compensated axis.
        effects: Its effects, nodes placed.
        data: Readings.
        options: How to fit.
        use: Rows to fit; None = all.
        like: What more rows told of the same effects: holds here too.

    Raises:
        FitError: If the readings do not determine them or an option is unknown.
    """
    sensors = sensors_to_fit(effects)
    lags: dict[str, FoundLag] = {}
    found: Estimate | None = None
    converged = True
    for turn in range(_LAG_ROUNDS + 1):
        own = [_lagging(effect, lags) for effect in effects]
        design = design_of(axis, own, data, options.drift, use)
        unheld = Unheld.of(design)
        error = np.asarray(data.error[axis], float)[design.rows]
        found = _estimated(design, unheld, error, options, found)
        if not sensors:
            break
        if turn == _LAG_ROUNDS:
            converged = False
            break
        before = {sensor: lags[sensor].value if lags else 0.0 for sensor in sensors}
        pseudo, first = _pseudo(design, found, error), not lags
        lags = find_lags(design, data, found, pseudo, before)
        moved = [abs(lag.value - before[sensor]) for sensor, lag in lags.items()]
        ends = [_LAG_ENDED * lag.deviation for lag in lags.values()]
        if not first and all(np.array(moved) <= np.array(ends)):
            break
    if like is not None and _same_unknowns(like.design, design):
        known = dataclasses.replace(like, design=design, unheld=unheld)
    else:
        known = identified(design, unheld, data, options.drift)
    return AxisFit(known, found, error, lags, converged and found.converged)


def _lagging(effect: AbstractEffect, lags: Mapping[str, FoundLag]) -> AbstractEffect:
    if not lags or not isinstance(effect, TemperatureEffect):
        return effect
    return effect.lagging({sensor: lag.value for sensor, lag in lags.items()})


def _same_unknowns(one: Design, other: Design) -> bool:
    return one.course.runs == other.course.runs and one.size == other.size


def _estimated(
    design: Design,
    unheld: Unheld,
    error: Float[np.ndarray, " r"],
    options: Options,
    near: Estimate | None,
) -> Estimate:
    """Return the fit of the stack for given lags."""
    if len(error) - unheld.free < 1:
        msg = (
            f"axis {design.axis}: {len(error)} readings leave nothing to judge the "
            f"noise by; expected more than {unheld.free}."
        )
        raise FitError(msg)
    start = np.zeros(design.size)
    start[design.datum] = float(np.median(error))
    auto = options.smoothness == "auto"
    return estimate(
        design.stack,
        memory(design.stack, Readings(error, {}), design.dense),
        loss=options.loss,
        weights=None if auto else _weights(design, options.smoothness),
        floor=floor_of(error),
        start=start,
        pins=unheld.pins if unheld.pins.any() else None,
        near=near,
    )


def _weights(
    design: Design, smoothness: Smoothness
) -> Callable[[Problem], Float[np.ndarray, " k"]]:
    """Return the weights that were asked for, given the sums."""
    single = isinstance(smoothness, int | float)
    if isinstance(smoothness, str) or (single and not 0 <= smoothness < np.inf):
        msg = (
            f"smoothness: found {smoothness!r}, expected 'auto', a number >= 0 or "
            "weights by name."
        )
        raise FitError(msg)

    def weights(problem: Problem) -> Float[np.ndarray, " k"]:
        least = np.where(problem.optional, 0.0, _LEAST * problem.density)
        if isinstance(smoothness, int | float):
            wanted = np.where(problem.optional, 0.0, float(smoothness))
        else:
            wanted = np.array(
                [
                    float((smoothness.get(part.name) or {}).get(name, 0.0))
                    for part in design.named
                    for name in part.weights
                ]
            )
        return np.maximum(wanted, least)

    return weights

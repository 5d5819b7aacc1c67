"""The fit of one compensated axis: passes, smoothness, lags, and what is reported of it."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from .._errors import FitError
from .._estimate import ROUGHLY, SAME
from ._alone import logs_alone
from ._choice import best_of, choose_weights, scanned_starts
from ._data import JointData
from ._effect import AbstractEffect
from ._lag import FoundLag, find_lags, sensors_to_fit
from ._passes import Stand, robust_passes
from ._prepare import Prepared, prepare
from ._problem import Solution, solve_joint
from ._temperature import TemperatureEffect

_ROUNDS = 6
"""Rounds of smoothness and passes at most."""
_LIGHT = 1e-2
"""Weight of second differences, relative to the density, to begin with."""
_LAG_ROUNDS, _LAG_SETTLED = 6, 0.1
"""Rounds of lags and everything else; they end where no lag moves by that share of its sd."""

Smoothness = str | float | Mapping[str, Mapping[str, float]]


@dataclasses.dataclass(frozen=True)
class AxisFit:
    """A fitted axis.

    Attributes:
        ready: What was known before.
        stand: Where the iterations ended.
        theta: Values under the rules.
        lags: By sensor.
        settled: Whether everything settled.
    """

    ready: Prepared
    stand: Stand
    theta: Float[np.ndarray, " n"]
    lags: Mapping[str, FoundLag]
    settled: bool


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
    ready = prepare(axis, effects, data, drift, use, measured=True, like=like)
    stand = _begin(ready, data, loss, smoothness)
    sensors = sensors_to_fit(ready.design)
    lags: dict[str, FoundLag] = {}
    settled = True
    for turn in range(_LAG_ROUNDS if sensors else 0):
        before = {sensor: found.value for sensor, found in lags.items()}
        lags = find_lags(ready.design, data, stand, sensors)
        values = {sensor: found.value for sensor, found in lags.items()}
        if turn and _close(before, lags):
            break
        moved = [
            effect.lagging({s: values[s] for s in effect.sensor_names if s in values})
            if isinstance(effect, TemperatureEffect)
            else effect
            for effect in ready.design.effects
        ]
        ready = prepare(axis, moved, data, drift, use, measured=True)
        known = stand if turn else None
        stand = _begin(ready, data, loss, smoothness, known)
        settled = turn + 1 < _LAG_ROUNDS
    theta = ready.rules.project(stand.solution.theta)
    return AxisFit(ready, stand, theta, lags, settled and stand.settled)


def _close(before: Mapping[str, float], now: Mapping[str, FoundLag]) -> bool:
    return all(
        abs(found.value - before[sensor]) <= _LAG_SETTLED * found.deviation
        for sensor, found in now.items()
    )


def _begin(
    ready: Prepared,
    data: JointData,
    loss: str,
    smoothness: Smoothness,
    known: Stand | None = None,
) -> Stand:
    """Return the fit for given lags; ``known`` is one for lags nearby."""
    design = ready.design
    error = np.asarray(data.error[design.axis], float)[design.rows]
    theta = np.zeros(design.size)
    theta[design.datum] = float(np.median(error))
    if ready.sums.count - ready.pinned.free < 1:
        msg = (
            f"axis {design.axis}: {ready.sums.count} readings leave nothing to judge the "
            f"noise by; expected more than {ready.pinned.free}."
        )
        raise FitError(msg)
    parts = (ready.weights, ready.pinned, error, loss)
    if not isinstance(smoothness, str):
        logs = _fixed(ready, smoothness)
        return robust_passes(ready.sums, *parts, logs, theta, near=False)
    if smoothness != "auto":
        msg = f"smoothness: found {smoothness!r}, expected 'auto', a number or weights."
        raise FitError(msg)
    logs = ready.weights.start(_LIGHT)
    if not ready.weights.parts:
        return robust_passes(ready.sums, *parts, logs, theta, near=False)
    if known is None:
        stand = robust_passes(
            ready.sums, *parts, logs, theta, near=False, tolerance=ROUGHLY
        )
    else:
        sums = ready.sums.changed(known.active)
        logs, theta = known.solution.logs, known.solution.theta
        stand = robust_passes(sums, *parts, logs, theta, near=True, tolerance=ROUGHLY)
    logs = stand.solution.logs if known is None else known.solution.logs
    for turn in range(_ROUNDS):
        problem = stand.solution.problem
        if turn or known is not None:
            found = choose_weights(problem, logs)
        elif ready.design.banded:
            found = choose_weights(problem, _start_large(ready, stand.solution))
        else:
            found = best_of(problem, scanned_starts(problem))
        if found is None:
            msg = f"axis {design.axis}: no smoothness gives a fit, the readings are degenerate."
            raise FitError(msg)
        logs = found.logs
        stand = robust_passes(problem.sums, *parts, logs, found.theta, near=True)
        if loss == "gauss" or _same(found, stand.solution):
            return stand
    return dataclasses.replace(stand, settled=False)


def _start_large(ready: Prepared, solution: Solution) -> Float[np.ndarray, " k"]:
    """Return where to begin with many unknowns: twice each table alone.

    The first time the others are still rough and leave much of their noise to each table.
    """
    logs = solution.logs
    for _ in range(2):
        placed = ready.rules.project(solution.theta)
        logs = logs_alone(dataclasses.replace(solution, theta=placed))
        again = solve_joint(solution.problem, logs)
        if again is None:
            break
        solution = again
    return logs


def _same(one: Solution, other: Solution) -> bool:
    """Tell whether two solutions predict alike, so that no new smoothness is asked for."""
    sums = other.problem.sums
    shift = float(np.std(sums.design.columns @ (other.theta - one.theta)))
    spread = np.sqrt(other.variance * min(1.0, sums.design.size / max(sums.count, 1)))
    return shift <= SAME * float(spread)


def _fixed(
    ready: Prepared, smoothness: float | Mapping[str, Mapping[str, float]]
) -> Float[np.ndarray, " k"]:
    if isinstance(smoothness, (int, float)):
        if not 0 <= smoothness < np.inf:
            msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0."
            raise FitError(msg)
        return ready.weights.fixed(float(smoothness))
    return ready.weights.fixed(
        [smoothness.get(table.name) for table in ready.weights.tables]
    )

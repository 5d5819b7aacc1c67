"""The fit of one compensated axis: passes, smoothness, lags, and what is reported of it."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ._data import JointData
from ._effect import AbstractEffect
from ._lag import FoundLag, find_lags, sensors_to_fit
from ._passes import Stand
from ._prepare import Prepared, alike, ground_of, judged
from ._scout import lagging, scouted
from ._settle import Known, Smoothness, nearly, settled_on

_LAG_ROUNDS, _LAG_SETTLED = 6, 0.1
"""Rounds of lags and everything else; they end where no lag moves by that share of its sd."""


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
    sensors = sensors_to_fit(effects)
    scout = None
    if smoothness == "auto":
        scout = scouted(axis, effects, data, drift, use, loss, sensors)
    lags: dict[str, FoundLag] = dict(scout.lags) if scout else {}
    own = lagging(effects, lags)
    ground = ground_of(axis, own, data, drift, use, measured=True)
    ready = None if like is None else alike(like, ground)
    if ready is None and scout is None:
        ready = judged(ground, data, drift)
    rules = ready.rules if ready else None
    known = None if scout is None else scout.carried(ground)
    if known is not None and sensors:
        # The lags of all rows, before their smoothness is looked for.
        stand = nearly(ground, data, loss, known)
        values = {sensor: found.value for sensor, found in lags.items()}
        found = find_lags(ground.design, data, stand, sensors, values)
        known = Known.of(stand)
        if not _close(values, found):
            lags = found
            own = lagging(effects, lags)
            ground = ground_of(axis, own, data, drift, use, measured=True)
    stand = settled_on(ground, data, loss, smoothness, known, rules)
    settled = True
    for turn in range(_LAG_ROUNDS if sensors else 0):
        before = {sensor: found.value for sensor, found in lags.items()}
        lags = find_lags(ground.design, data, stand, sensors, before)
        if before and _close(before, lags):
            break
        own = lagging(effects, lags)
        ground = ground_of(axis, own, data, drift, use, measured=True)
        stand = settled_on(ground, data, loss, smoothness, Known.of(stand))
        settled = turn + 1 < _LAG_ROUNDS
    if ready is None or ready.sums is not ground.sums:
        ready = judged(ground, data, drift, ready)
    theta = ready.rules.project(stand.solution.theta)
    return AxisFit(ready, stand, theta, lags, settled and stand.settled)


def _close(before: Mapping[str, float], now: Mapping[str, FoundLag]) -> bool:
    return all(
        abs(found.value - before[sensor]) <= _LAG_SETTLED * found.deviation
        for sensor, found in now.items()
    )

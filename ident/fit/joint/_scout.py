"""A small fit of the same: where lags and smoothness are looked for before the large one.

A plane of ten thousand nodes is smooth, and half a million readings say the same as some
ten thousand of them: fewer nodes and fewer readings know lags and smoothness to within their
own deviation, at a hundredth of the cost. What they find is where the whole fit begins; it
moves on from there by its own evidence.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Int

from ._data import JointData
from ._effect import AbstractEffect
from ._lag import FoundLag, find_lags
from ._passes import Stand
from ._prepare import Ground, all_rules, freedoms, ground_of
from ._settle import Known, roughly, settled_on
from ._tables import PlaneEffect
from ._temperature import TemperatureEffect

_NODES = 32
"""Nodes of a coarse plane along each master, at most."""
_ROWS = 24_000
"""Readings of a small fit, at least."""
_ROUNDS, _SETTLED = 4, 0.3
"""Rounds of lags at most; they end where none moves by that share of its deviation."""


@dataclasses.dataclass(frozen=True)
class Scout:
    """What a small fit found.

    Attributes:
        ground: Its numbers.
        stand: Where it ended.
        lags: By sensor.
    """

    ground: Ground
    stand: Stand
    lags: Mapping[str, FoundLag]

    def carried(self, ground: Ground) -> Known:
        """Return where the whole fit begins."""
        small, whole = self.ground.design, ground.design
        found = {part.name: part.places for part in small.components}
        values = self.stand.solution.theta
        theta = np.zeros(whole.size)
        for part in whole.components:
            own = found[part.name]
            if len(own) == len(part.places):
                theta[part.places] = values[own]
                continue
            coarse, fine = (each.effects[part.effect] for each in (small, whole))
            assert isinstance(coarse, PlaneEffect)
            assert isinstance(fine, PlaneEffect)
            second, first = (
                m.ravel() for m in np.meshgrid(*fine.nodes[::-1], indexing="ij")
            )
            places = dict(zip(fine.masters, (first, second), strict=True))
            theta[part.places] = coarse.block(JointData(places)).columns @ values[own]
        weights = self.ground.weights
        named = dict(
            zip(
                (table.name for table in weights.tables),
                weights.named(self.stand.solution.logs),
                strict=True,
            )
        )
        for coarse, fine in zip(small.effects, whole.effects, strict=True):
            if isinstance(coarse, PlaneEffect) and isinstance(fine, PlaneEffect):
                named[fine.name] = _finer(named[fine.name], coarse, fine)
        logs = ground.weights.fixed(
            [named[table.name] for table in ground.weights.tables]
        )
        known = Known.of(self.stand)
        return Known(logs, theta, None, known.used, None)


def scouted(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    drift: int,
    use: Bool[np.ndarray, " t"] | None,
    loss: str,
    sensors: tuple[str, ...],
) -> Scout | None:
    """Return what a small fit finds; None where the whole one is small and has no lags.

    Args:
        axis: Compensated axis.
        effects: Its effects, nodes placed.
        data: Readings.
        drift: Pieces of the drift of each run.
        use: Rows to fit.
        loss: As for `fit_joint`.
        sensors: Whose lag to find.

    Raises:
        FitError: If the readings do not determine them.
    """
    coarse = [_coarser(effect) for effect in effects]
    fewer = any(one is not other for one, other in zip(coarse, effects, strict=True))
    if not (sensors or fewer):
        return None
    some = _thinned(axis, coarse, data, use)

    def at(lags: Mapping[str, FoundLag]) -> Ground:
        return ground_of(axis, lagging(coarse, lags), data, drift, some, measured=True)

    lags: dict[str, FoundLag] = {}
    ground = at(lags)
    if sensors:
        lags = find_lags(ground.design, data, roughly(ground, data, loss), sensors)
        ground = at(lags)
    rules = None
    if ground.design.banded:
        rules = all_rules(ground, freedoms(ground, data, drift))
    stand = settled_on(ground, data, loss, "auto", None, rules)
    for _ in range(_ROUNDS if sensors else 0):
        before = lags
        near = {sensor: found.value for sensor, found in lags.items()}
        lags = find_lags(ground.design, data, stand, sensors, near)
        if all(
            abs(found.value - before[sensor].value) <= _SETTLED * found.deviation
            for sensor, found in lags.items()
        ):
            break
        ground = at(lags)
        stand = settled_on(ground, data, loss, "auto", Known.of(stand))
    return Scout(ground, stand, lags)


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


def _coarser(effect: AbstractEffect) -> AbstractEffect:
    if not isinstance(effect, PlaneEffect):
        return effect
    if max(len(nodes) for nodes in effect.nodes) <= _NODES:
        return effect
    first, second = (nodes[_spread(len(nodes))] for nodes in effect.nodes)
    return dataclasses.replace(effect, nodes=(first, second))


def _spread(count: int) -> Int[np.ndarray, " n"]:
    return np.rint(np.linspace(0, count - 1, min(count, _NODES))).astype(np.int64)


def _finer(
    weights: Mapping[str, float], coarse: PlaneEffect, fine: PlaneEffect
) -> dict[str, float]:
    """Return the weights with which finer nodes are as smooth.

    The penalties are sums over nodes of what differences make of a surface: of second ones
    the cube of the distance along them counts, of fourth ones its seventh power, over the
    distance across.
    """
    ratio = [
        float(np.mean(np.diff(one)) / np.mean(np.diff(other)))
        for one, other in zip(coarse.nodes, fine.nodes, strict=True)
    ]
    result = {}
    for axis, (along, across) in enumerate((ratio, ratio[::-1]), 1):
        for order, power in ((2, 3), (4, 7)):
            name = f"order {order}, axis {axis}"
            result[name] = weights.get(name, 0.0) * along**power / across
    return result


def _thinned(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    use: Bool[np.ndarray, " t"] | None,
) -> Bool[np.ndarray, " t"] | None:
    """Return some of the rows, any of them: their order may follow the machine."""
    keep = np.isfinite(data.column("error", axis, "the fit"))
    if use is not None:
        keep = keep & use
    rows = np.flatnonzero(keep)
    wanted = max(_ROWS, 20 * sum(effect.size for effect in effects))
    if len(rows) < 2 * wanted:
        return use
    some = np.zeros(len(keep), bool)
    some[np.random.default_rng(0).choice(rows, wanted, replace=False)] = True
    return some

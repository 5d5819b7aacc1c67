"""Data in which everything varies by itself: what cannot be told there never can."""

import numpy as np
from jaxtyping import Float

from ._crosstalk import CrosstalkEffect
from ._data import JointData
from ._delay import DelayEffect
from ._design import Design
from ._tables import CrossEffect, LeadscrewEffect, PlaneEffect
from ._temperature import TemperatureEffect

_ROWS_PER_VALUE = 8
_MORE = 500
"""Rows beyond those."""
_MOVED = 0.1
"""Share of its tables over which an axis must have moved for its range to count."""


def everything_varies(design: Design, data: JointData, values: int) -> JointData:
    """Return rows at random places, directions, accelerations, temperatures and runs.

    The axes move where they moved in the data: what is alike there may be exchanged there.

    Args:
        design: Of the actual data.
        data: The actual data, all rows.
        values: Number of unknowns that the rows are to tell apart.
    """
    rng = np.random.default_rng(0)
    count = _ROWS_PER_VALUE * values + _MORE

    def between(low: float, high: float) -> Float[np.ndarray, " t"]:
        return np.asarray(rng.uniform(low, high, count))

    places = {axis: between(*ends) for axis, ends in _ranges(design, data).items()}
    warm: dict[str, Float[np.ndarray, " t"]] = {}
    fast: dict[str, float] = {}
    for effect in design.effects:
        if isinstance(effect, TemperatureEffect):
            for law, nodes in effect.nodes.items():
                half = 0.5 * max(float(np.ptp(nodes)), 1.0)
                middle = 0.5 * float(nodes[0] + nodes[-1])
                sensor = effect.sensors[law]
                warm.setdefault(sensor, between(middle - half, middle + half))
        if isinstance(effect, CrosstalkEffect):
            top = 1.2 * max(effect.acceleration, -effect.deceleration)
            fast[effect.master] = max(fast.get(effect.master, 0.0), top)
        if isinstance(effect, DelayEffect):
            fast.setdefault(effect.axis, 1.0)
    labels = np.array(sorted({run for run, _ in design.knots}), np.int64)
    return JointData(
        position=places,
        direction={axis: rng.choice([-1.0, 1.0], count) for axis in places},
        velocity={axis: between(-1.0, 1.0) for axis in fast},
        acceleration={axis: between(-top, top) for axis, top in fast.items()},
        temperature=warm,
        time=between(0.0, 1.0),
        run=rng.choice(labels, count) if len(labels) else None,
    )


def _ranges(design: Design, data: JointData) -> dict[str, tuple[float, float]]:
    """Return from where to where each axis goes: as measured, or all of its tables."""
    seen: dict[str, list[float]] = {}
    for effect in design.effects:
        if isinstance(effect, LeadscrewEffect | CrossEffect):
            own = [(effect.masters[0], effect.nodes)]
        elif isinstance(effect, PlaneEffect):
            own = list(zip(effect.masters, effect.nodes, strict=True))
        elif isinstance(effect, CrosstalkEffect):
            own = list(zip(effect.adaptation, effect.points.T, strict=True))
        else:
            own = []
            seen.setdefault(effect.axis, [])
        for axis, nodes in own:
            seen.setdefault(axis, []).extend((float(nodes.min()), float(nodes.max())))
    result = {}
    for axis, ends in seen.items():
        # An axis without a table may stand anywhere; beyond a table its edge is held.
        low, high = (min(ends), max(ends)) if ends else (-1.0, 1.0)
        if axis in data.position:
            place = data.position[axis][design.rows]
            place = place[np.isfinite(place)]
            if len(place) and np.ptp(place) > _MOVED * (high - low):
                low, high = float(place.min()), float(place.max())
        result[axis] = low, high
    return result

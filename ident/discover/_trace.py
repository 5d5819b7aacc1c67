"""The rows of a recording in which a drive moves."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ._observed import Observed

_MOST = 20_000
_SLOW = 2e-3
"""Share of the fastest speed below which friction is not kinetic."""
_BLOCKS = 40
_FEW = 200


@dataclasses.dataclass(frozen=True)
class Trace:
    """A recording of a moving drive."""

    current: Float[np.ndarray, " t"]
    velocity: Float[np.ndarray, " t"]
    acceleration: Float[np.ndarray, " t"]
    position: Float[np.ndarray, " t"]
    temperature: Mapping[str, Float[np.ndarray, " t"]]
    block: Int[np.ndarray, " t"]
    unit: str

    @property
    def way(self) -> Float[np.ndarray, " t"]:
        """Direction of motion, ±1."""
        return np.asarray(np.sign(self.velocity))

    @property
    def fast(self) -> float:
        """Fastest speed."""
        return float(np.max(np.abs(self.velocity)))


def trace_of(observed: Observed, axis: str) -> Trace | str:
    """Return the rows in which a drive moves, or why there are none."""
    for channel in ("velocity", "acceleration", "position"):
        if axis not in getattr(observed, channel):
            return f"no {channel} of {axis} was recorded, nor time to derive it from"
    current, velocity = observed.current[axis], observed.velocity[axis]
    hard, place = observed.acceleration[axis], observed.position[axis]
    known = np.isfinite(current + velocity + hard + place)
    if not known.any():
        return f"current and motion of {axis} were never recorded together"
    fast = float(np.max(np.abs(velocity[known])))
    rows = np.flatnonzero(known & (np.abs(velocity) > _SLOW * fast))
    if len(rows) < _FEW:
        return f"{axis} moves in {len(rows)} readings of its current only"
    order = rows[np.lexsort((observed.clock[rows], observed.source[rows]))]
    stroke = np.cumsum(np.diff(np.sign(velocity[order]), prepend=0.0) != 0)
    if len(order) > _MOST:
        pick = np.sort(np.random.default_rng(0).permutation(len(order))[:_MOST])
        order, stroke = order[pick], stroke[pick]
    stroke = np.unique(stroke, return_inverse=True)[1].reshape(-1)
    count = int(stroke.max()) + 1
    block = stroke * min(_BLOCKS, count) // count
    if count < 8:
        block = np.arange(len(order)) * _BLOCKS // len(order)
    return Trace(
        current[order], velocity[order], hard[order], place[order],
        {
            name: values[order]
            for name, values in observed.temperature.items()
            if np.isfinite(values[order]).all() and np.ptp(values[order]) > 0
        },
        block.astype(np.int64), "",
    )  # fmt: skip

"""How far, how steep and how fast the offsets of a model become in the workspace."""

import dataclasses
import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float
from scipy.stats import qmc

from ._trace import OffsetLaw

_MANY, _FEW = 1 << 15, 1 << 12
"""Positions per round: of the offsets, and of what takes many times as long."""
_ROUNDS = 12
"""Each looks closer around the best: in the end within 1e-4 of the workspace."""
_BEST = 16
_SEED = 0

_Figures = Callable[[Float[Array, "t a"]], Float[Array, "t a"]]


@dataclasses.dataclass(frozen=True)
class Extremes:
    """The largest figures per axis that a search in the workspace has met.

    Attributes:
        offset: In mm or °; infinite where it is no number, and all else with it.
        slope: Change of the offset per change of all positions by 1, without unit.
        acceleration: That the offsets add, in mm/s² or °/s².
    """

    offset: Float[np.ndarray, " a"]
    slope: Float[np.ndarray, " a"]
    acceleration: Float[np.ndarray, " a"]


def extremes(
    law: OffsetLaw,
    workspace: Float[np.ndarray, "a 2"],
    *,
    feed: float,
    acceleration: float,
    cycle_time: float,
) -> Extremes:
    """Return the largest offsets, slopes and accelerations in a workspace.

    Args:
        law: OffsetLaw of all axes.
        workspace: Lowest and highest position per axis, in mm or °.
        feed: In mm/s, of each axis alone and of all together.
        acceleration: Of the axes, in mm/s²: through the slope it becomes one of the offsets.
        cycle_time: In s: over two cycles a kink at a node becomes an acceleration.
    """
    step = feed * cycle_time
    axes = workspace.shape[0]
    turning = workspace[:, 1] > workspace[:, 0]
    together = itertools.product((1.0, -1.0), repeat=min(axes, 3) - 1)
    ways = np.array(
        [*np.eye(axes), *(np.resize([1.0, *signs], axes) for signs in together)]
    )

    def curvature(place: Float[Array, "t a"]) -> Float[Array, "t a"]:
        def along(way: Float[Array, " a"]) -> Float[Array, "t a"]:
            rows = [place - way[None], place, place + way[None]]
            before, now, after = jnp.split(law(jnp.concatenate(rows)), 3)
            return jnp.abs(before - 2.0 * now + after)

        each: Array = lax.map(along, step * jnp.asarray(ways * turning))
        return each.max(axis=0) / cycle_time**2

    def slope(place: Float[Array, "t a"]) -> Float[Array, "t a"]:
        def along(unit: Float[Array, " a"]) -> Float[Array, "t a"]:
            every = jnp.broadcast_to(unit[None], place.shape)
            return jnp.abs(jax.jvp(law, (place,), (every,))[1])

        each: Array = lax.map(along, jnp.eye(axes))
        return each.sum(axis=0)

    offset = _largest(lambda place: jnp.abs(law(place)), workspace, _MANY)
    if not np.isfinite(offset).all():
        return Extremes(offset, offset, offset)
    steepest = _largest(slope, workspace, _FEW)
    bent = _largest(curvature, workspace, _FEW)
    return Extremes(offset, steepest, bent + acceleration * steepest)


def _largest(
    figures: _Figures, workspace: Float[np.ndarray, "a 2"], samples: int
) -> Float[np.ndarray, " a"]:
    """Return the largest value of each figure: sampled evenly, then close to the best."""
    low, width = workspace[:, 0], np.ptp(workspace, axis=1)
    axes = workspace.shape[0]
    compiled = jax.jit(figures)
    rng = np.random.default_rng(_SEED)
    share = qmc.Sobol(axes, rng=_SEED).random(samples)
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=min(axes, 10))))
    share[: len(corners), : corners.shape[1]] = corners
    best = np.zeros((axes, _BEST, axes))
    found = np.full((axes, _BEST), -np.inf)
    for number in range(_ROUNDS):
        values = np.asarray(compiled(jnp.asarray(low + share * width))).T
        # NaN is the worst of all: it is found, not passed over.
        values = np.where(np.isnan(values), np.inf, values)
        both = np.concatenate([found, values], axis=1)
        pool = np.concatenate([best, np.broadcast_to(share, (axes, *share.shape))], 1)
        order = np.argsort(-both, axis=1, kind="stable")[:, :_BEST]
        found = np.take_along_axis(both, order, axis=1)
        best = np.take_along_axis(pool, order[:, :, None], axis=1)
        rows = best.reshape(-1, axes)[np.arange(samples) % (axes * _BEST)]
        noise = rng.normal(scale=0.05 * 0.5**number, size=rows.shape)
        share = np.clip(rows + noise, 0.0, 1.0)
    return found[:, 0]

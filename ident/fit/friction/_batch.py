r"""Stribeck laws of thousands of axes at once: reduce the data first, polish on all of it.

A plain `vmap` of a Levenberg-Marquardt solver runs as long as its slowest lane. Here the law
$\mathrm{sign}(v)\,(c + d\,e^{-(v/v_s)^2}) + b\,v$ is odd, so it is fitted to $|v|$ and
$\mathrm{sign}(v)\,y$; its three linear parameters are eliminated (variable projection), which
leaves one search in $\ln v_s$. A grid on thinned data finds the valley, Gauss-Newton passes
over all data its bottom. On a grid whose $v_s$ shrinks by $\sqrt 2$ the next exponential is
the square of the last, so the whole grid needs a single one.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from ...core._threads import cores

LANES = 25
"""Axes that pass through the caches of a processor together."""
WORTH_A_CORE = 200
"""Axes from which on another core is worth its start."""
COARSE_LANES = 200
"""The same for the grid, whose thinned data are much smaller."""
GRID = 16
"""Points of the grid, from the highest speed down by √2 each: 2 ½ decades."""
THIN = 256
"""Samples that the grid looks at, about."""
SETTLED = 1e-8
"""Gain that the next step promises, relative to the cost, below which an axis is done."""
MAX_PASSES = 12
_STEP = 0.35
"""Longest step in ln v_s: one point of the grid."""
_FLAT = 1e-12
"""Share of its own length that must be left of a column beside the others."""
_TINY = 1e-300
_SEEN = 25.0
"""Gain of the drop in noise variances below which it could be noise (5 σ, v_s searched)."""


class StribeckBatch(NamedTuple):
    """Laws of many axes; the shape of the decay is 2 throughout.

    Attributes:
        coulomb: Level at high speed, less the viscous part, in units of the current.
        breakaway: Level at rest.
        stribeck_velocity: Speed in mm/s at which the drop has fallen to 1/e.
        viscous: Slope in current units per mm/s.
        cost: Half the sum of squared residuals.
        passes: Passes over all data that the axis took.
        settled: Whether the last pass promised no further gain.
        determined: Whether the data show a drop at all, and below which speed: where not,
            ``breakaway`` and ``stribeck_velocity`` are not numbers to rely on.
    """

    coulomb: Float[Array, " n"]
    breakaway: Float[Array, " n"]
    stribeck_velocity: Float[Array, " n"]
    viscous: Float[Array, " n"]
    cost: Float[Array, " n"]
    passes: Int[Array, " n"]
    settled: Bool[Array, " n"]
    determined: Bool[Array, " n"]


class _Line(NamedTuple):
    """Sums of the two fixed columns 1 and |v| with themselves and the current."""

    number: Array
    speed: Array
    square: Array
    level: Array
    slope: Array
    """Least-squares line through the samples."""
    rest: Array
    """Sum of squares that the line leaves."""


class _Pass(NamedTuple):
    """What one pass over the data says at one v_s."""

    cost: Array
    drop: Array
    level: Array
    slope: Array
    """Line through the decays, which the drop takes away from the line of the current."""
    step: Array
    gain: Array


def fit_stribeck_batch(
    velocity: Float[Array, "n t"],
    current: Float[Array, "n t"],
    *,
    lanes: int = LANES,
    max_passes: int = MAX_PASSES,
) -> StribeckBatch:
    """Fit a Stribeck law to each of many axes by least squares.

    Args:
        velocity: In mm/s; samples at rest (0) are left out of their axis.
        current: In drive units, inertia, gravity and offset already taken off.
        lanes: Axes worked on together.
        max_passes: Passes over all data at most.

    Returns:
        One law per axis. An axis that fails says so in its own entry; it stops no other.
    """
    count = velocity.shape[0]
    if count == 0 or velocity.shape[1] == 0:
        msg = f"fit_stribeck_batch needs axes and samples, got shape {velocity.shape}."
        raise ValueError(msg)
    shares = min(cores(), count // WORTH_A_CORE)
    if shares < 2 or isinstance(velocity, Tracer):
        return StribeckBatch(*_in_lanes(velocity, current, lanes, max_passes))
    # The lanes of one call keep one core busy; whole lanes per core leave every sum as it is.
    size = lanes * -(-count // (shares * lanes))
    cuts = [slice(first, first + size) for first in range(0, count, size)]
    with ThreadPoolExecutor(len(cuts)) as pool:
        found = list(
            pool.map(
                lambda cut: _in_lanes(velocity[cut], current[cut], lanes, max_passes),
                cuts,
            )
        )
    return StribeckBatch(
        *(jnp.concatenate(parts) for parts in zip(*found, strict=True))
    )


@partial(jax.jit, static_argnames=("lanes", "max_passes"))
def _in_lanes(
    velocity: Float[Array, "n t"],
    current: Float[Array, "n t"],
    lanes: int,
    max_passes: int,
) -> StribeckBatch:
    count = velocity.shape[0]
    thin = max(1, velocity.shape[1] // THIN)
    start = lax.map(
        lambda row: _coarse(row[0], row[1]),
        (velocity[:, ::thin], current[:, ::thin]),
        batch_size=min(COARSE_LANES, count),
    )
    found = lax.map(
        lambda row: _polish(row[0], row[1], row[2], max_passes),
        (velocity, current, start),
        batch_size=min(lanes, count),
    )
    return StribeckBatch(*found)


def _line(speed: Array, moving: Array, level: Array) -> _Line:
    zero = jnp.zeros((), speed.dtype)
    bare = _Line(moving.sum(), speed.sum(), speed @ speed, zero, zero, zero)
    a, b = _through(bare, level.sum(), speed @ level)
    rest = level - a * moving - b * speed
    return bare._replace(level=a, slope=b, rest=rest @ rest)


def _through(line: _Line, total: Array, moment: Array) -> tuple[Array, Array]:
    """Level and slope of the least-squares line through a column, from its sums."""
    det = line.number * line.square - line.speed**2
    det = jnp.maximum(det, _TINY)
    return (
        (line.square * total - line.speed * moment) / det,
        (line.number * moment - line.speed * total) / det,
    )


def _across(line: _Line, x: Array, sx: Array, y: Array, sy: Array) -> Array:
    """Inner product of two columns within the span of the line, from their sums."""
    level, slope = _through(line, x, sx)
    return level * y + slope * sy


def _coarse(velocity: Array, current: Array) -> Array:
    """Return ln v_s at the bottom of a grid over thinned data."""
    speed, way = jnp.abs(velocity), jnp.sign(velocity)
    level = way * current
    line = _line(speed, way * way, level)
    rest = level - line.level * way * way - line.slope * speed
    top = jnp.maximum(jnp.max(speed), _TINY)

    def point(decay: Array, _: None) -> tuple[Array, Array]:
        total, moment, own = decay.sum(), speed @ decay, decay @ decay
        left = own - _across(line, total, moment, total, moment)
        taken = (decay @ rest) ** 2
        gain = jnp.where(left > _FLAT * own, taken / jnp.maximum(left, 1e-300), 0.0)
        return decay * decay, gain

    # Samples at rest would count as 1 in every column of decays.
    first = jnp.exp(-((speed / top) ** 2)) * way * way
    _, gains = lax.scan(point, first, None, length=GRID)
    best = jnp.clip(jnp.argmax(gains), 1, GRID - 2)
    low, mid, high = gains[best - 1], gains[best], gains[best + 1]
    bend = low - 2 * mid + high
    shift = jnp.where(bend < 0, 0.5 * (low - high) / jnp.where(bend < 0, bend, 1.0), 0)
    place = best.astype(shift.dtype) + jnp.clip(shift, -1.0, 1.0)
    return jnp.log(top) - 0.5 * jnp.log(2.0) * place


def _pass(line: _Line, speed: Array, moving: Array, rest: Array, place: Array) -> _Pass:
    """Sum over all samples at one v_s: cost, drop, Gauss-Newton step and its gain."""
    power = (speed * jnp.exp(-place)) ** 2
    decay = jnp.exp(-power) * moving
    slope = 2 * power * decay
    # Without the barrier every sum below computes the exponentials anew.
    decay, slope = lax.optimization_barrier((decay, slope))  # type: ignore[no-untyped-call]
    e, ew, ee, er = decay.sum(), decay @ speed, decay @ decay, decay @ rest
    g, gw, gg, gr = slope.sum(), slope @ speed, slope @ slope, slope @ rest
    ge = slope @ decay
    own = ee - _across(line, e, ew, e, ew)
    seen = own > _FLAT * ee
    own = jnp.where(seen, own, 1.0)
    drop = jnp.where(seen, er / own, 0.0)
    cross = ge - _across(line, g, gw, e, ew)
    free = gg - _across(line, g, gw, g, gw) - cross**2 / own
    push = gr - cross * drop
    usable = seen & (free > _FLAT * gg) & (drop != 0.0)
    free = jnp.where(usable, free, 1.0)
    safe = jnp.where(usable, drop, 1.0)
    step = jnp.where(usable, push / free / safe, 0.0)
    gain = jnp.where(usable, push**2 / free, 0.0)
    level, tilt = _through(line, e, ew)
    return _Pass(line.rest - drop * er, drop, level, tilt, step, gain)


class _Search(NamedTuple):
    """Where the search in ln v_s stands: the best place so far and the next to look at."""

    best: Array
    at_best: _Pass
    trial: Array
    passes: Array
    done: Array


def _polish(
    velocity: Array, current: Array, start: Array, max_passes: int
) -> tuple[Array, ...]:
    """Return the fields of `StribeckBatch` for one axis."""
    speed, way = jnp.abs(velocity), jnp.sign(velocity)
    moving, level = way * way, way * current
    line = _line(speed, moving, level)
    rest = level - line.level * moving - line.slope * speed

    def look(search: _Search) -> _Search:
        now = _pass(line, speed, moving, rest, search.trial)
        better = now.cost <= search.at_best.cost
        best = jnp.where(better, search.trial, search.best)
        at_best = jax.tree.map(
            lambda new, old: jnp.where(better, new, old), now, search.at_best
        )
        onward = best + jnp.clip(now.step, -_STEP, _STEP)
        # Overshot: back to half way, as often as it takes.
        trial = jnp.where(better, onward, 0.5 * (search.trial + best))
        settled = better & (now.gain <= SETTLED * jnp.maximum(now.cost, 1e-300))
        stuck = jnp.abs(trial - best) < 1e-7
        return _Search(best, at_best, trial, search.passes + 1, settled | stuck)

    def going(search: _Search) -> Array:
        return ~search.done & (search.passes < max_passes)

    far = _Pass(*(jnp.full((), jnp.inf, speed.dtype) for _ in _Pass._fields))
    search = lax.while_loop(
        going,
        look,
        _Search(start, far, start, jnp.zeros((), jnp.int64), jnp.zeros((), bool)),
    )
    place, drop = search.best, search.at_best.drop
    coulomb = line.level - drop * search.at_best.level
    cost = search.at_best.cost
    freedom = jnp.maximum(line.number - 4, 1)
    shown = (line.rest - cost) * freedom > _SEEN * jnp.maximum(cost, 0.0)
    slowest = jnp.min(jnp.where(moving > 0, speed, jnp.inf))
    within = (jnp.exp(place) > slowest) & (jnp.exp(place) < jnp.max(speed))
    return (
        coulomb,
        coulomb + drop,
        jnp.exp(place),
        line.slope - drop * search.at_best.slope,
        0.5 * cost,
        search.passes,
        search.done & jnp.isfinite(cost),
        shown & within & (drop > 0),
    )

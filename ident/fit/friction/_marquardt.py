"""Levenberg-Marquardt on the simulated axis, compiled whole: one simulation per step."""

import dataclasses
from functools import partial
from typing import NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Bool, Float, Int

from ._axis import Drive, simulate
from ._shooting import AbstractSolver, Shooting, Shot

WINDOWS = 64
"""Windows that every compilation has room for."""
_DAMPING = 1e-4
_SHRINK, _GROW = 0.2, 4.0
_LARGEST = 1e4
"""Damping at which no step helps any more."""


class _Data(NamedTuple):
    """A `Shooting` as arrays."""

    low: Float[Array, " p"]
    high: Float[Array, " p"]
    constant: Float[Array, " 9"]
    mixing: Float[Array, "9 p"]
    drive: Drive
    target: Float[Array, " t"]
    compared: Bool[Array, " t"]
    belief: Float[Array, "p p"]
    centre: Float[Array, " p"]


class _Point(NamedTuple):
    """Parameters and starts of the windows (position, velocity)."""

    values: Float[Array, " p"]
    starts: Float[Array, "w 2"]


class _Look(NamedTuple):
    """What a simulation at a point gives: cost and normal equations, by windows."""

    cost: Float[Array, ""]
    matrix: Float[Array, "p p"]
    push: Float[Array, " p"]
    cross: Float[Array, "w p 2"]
    local: Float[Array, "w 2 2"]
    local_push: Float[Array, "w 2"]
    residual: Float[Array, " t"]
    slopes: Float[Array, "t p"]
    start_slopes: Float[Array, " t"]


class _State(NamedTuple):
    best: _Point
    look: _Look
    trial: _Point
    damping: Float[Array, ""]
    first_cost: Float[Array, ""]
    passes: Int[Array, ""]
    done: Bool[Array, ""]


def _residual(point: _Point, data: _Data) -> tuple[Array, Array, Array]:
    """Return measured − simulated position and its slopes, of parameters and starts."""
    run = simulate(
        data.constant + data.mixing @ point.values,
        data.mixing,
        point.starts[:, 1],
        data.drive,
    )
    use = jnp.where(data.compared, 1.0, 0.0)
    residual = use * (data.target - run.travel - point.starts[:, 0][data.drive.window])
    slopes = use[:, None] * run.slopes
    local = jnp.stack([use, slopes[:, -1]], axis=1)
    return residual, slopes[:, :-1], local


def _look(point: _Point, data: _Data, free: bool) -> _Look:
    residual, slopes, local = _residual(point, data)
    start_slopes = local[:, 1]
    windows = point.starts.shape[0]
    if not free:
        local = jnp.zeros_like(local)
    add = partial(
        jax.ops.segment_sum,
        segment_ids=data.drive.window,
        num_segments=windows,
        indices_are_sorted=True,
    )
    # A window that begins sticking does not feel the velocity it began with.
    eye = jnp.eye(2)[None] * (1e-9 if free else 1.0)
    off = point.values - data.centre
    pull = data.belief @ off
    return _Look(
        0.5 * (residual @ residual + off @ pull),
        slopes.T @ slopes + data.belief,
        slopes.T @ residual - pull,
        add(slopes[:, :, None] * local[:, None, :]),
        add(local[:, :, None] * local[:, None, :]) + eye,
        add(local * residual[:, None]),
        residual,
        slopes,
        start_slopes,
    )


def _inverse(matrix: Float[Array, "w 2 2"]) -> Float[Array, "w 2 2"]:
    """Return the inverse of each 2 × 2 matrix, written out: a solver takes long to compile."""
    a, b, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    rows = jnp.stack([jnp.stack([d, -b], axis=1), jnp.stack([-b, a], axis=1)], axis=1)
    return rows / (a * d - b * b)[:, None, None]


def _step(point: _Point, look: _Look, damping: Array, data: _Data) -> _Point:
    """Return the damped Gauss-Newton step, starts of windows eliminated, within bounds."""
    local = look.local * (1.0 + damping * jnp.eye(2))[None]
    inverse = _inverse(local)
    solved = jnp.einsum("wij,wpj->wip", inverse, look.cross)
    begun = jnp.einsum("wij,wj->wi", inverse, look.local_push)
    matrix = look.matrix - jnp.einsum("wpi,wiq->pq", look.cross, solved)
    push = look.push - jnp.einsum("wpi,wi->p", look.cross, begun)
    own = jnp.diag(look.matrix)
    # Scaled by what is left of each column beside the starts of the windows: scaled by all
    # of it, the damping would hold back what the starts can nearly stand in for.
    left = jnp.maximum(jnp.diag(matrix), 1e-12 * own)
    scale = jnp.sqrt(jnp.where(own > 0, left, 1.0))
    held = ((point.values <= data.low) & (push < 0)) | (
        (point.values >= data.high) & (push > 0)
    )
    held = held | (own <= 0)
    keep = jnp.where(held, 0.0, 1.0)
    scaled = matrix * (keep / scale)[None] * (keep / scale)[:, None]
    scaled = scaled + jnp.diag(damping * keep + (1.0 - keep))
    move = cho_solve(cho_factor(scaled), keep * push / scale) / scale
    values = jnp.clip(point.values + move, data.low, data.high)
    follow = begun - jnp.einsum("wip,p->wi", solved, values - point.values)
    return _Point(values, point.starts + follow)


@partial(jax.jit, static_argnames=("free",))
def _solve(
    start: _Point, data: _Data, tolerance: Array, max_passes: Array, *, free: bool
) -> _State:
    windows, count = start.starts.shape[0], start.values.shape[0]
    nothing = _Look(
        jnp.asarray(jnp.inf),
        jnp.eye(count),
        jnp.zeros(count),
        jnp.zeros((windows, count, 2)),
        jnp.broadcast_to(jnp.eye(2), (windows, 2, 2)),
        jnp.zeros((windows, 2)),
        jnp.zeros_like(data.target),
        jnp.zeros((len(data.target), count)),
        jnp.zeros_like(data.target),
    )

    def body(state: _State) -> _State:
        look = _look(state.trial, data, free)
        better = look.cost < state.look.cost
        gained = (state.look.cost - look.cost) / look.cost
        best, look = jax.tree.map(
            lambda new, old: jnp.where(better, new, old),
            (state.trial, look),
            (state.best, state.look),
        )
        damping = state.damping * jnp.where(better, _SHRINK, _GROW)
        damping = jnp.maximum(damping, 1e-12)
        trial = _step(best, look, damping, data)
        settled = better & (gained < tolerance)
        return _State(
            best,
            look,
            trial,
            damping,
            jnp.where(state.passes == 0, look.cost, state.first_cost),
            state.passes + 1,
            settled | (damping > _LARGEST),
        )

    zero = jnp.zeros((), jnp.int64)
    first = _State(
        start,
        nothing,
        start,
        jnp.asarray(_DAMPING),
        jnp.asarray(jnp.inf),
        zero,
        jnp.zeros((), bool),
    )
    return lax.while_loop(
        lambda state: ~state.done & (state.passes < max_passes), body, first
    )


@final
@dataclasses.dataclass(frozen=True)
class Marquardt(AbstractSolver):
    """Damped Gauss-Newton steps, limits kept by projection.

    Attributes:
        tolerance: Relative gain of a step below which the search ends: the valley is flat
            and kinked, so less is no better on another recording.
        max_passes: Simulations at most.
    """

    tolerance: float = 1e-6
    max_passes: int = 80

    @property
    def words(self) -> str:
        """Name for reports."""
        return "Levenberg-Marquardt"

    def solve(self, shooting: Shooting) -> Shot:
        """See `AbstractSolver`."""
        data = _Data(
            jnp.asarray(shooting.low),
            jnp.asarray(shooting.high),
            jnp.asarray(shooting.constant),
            jnp.asarray(shooting.mixing),
            Drive(
                jnp.asarray(shooting.force),
                jnp.asarray(shooting.window),
                jnp.asarray(shooting.first),
                jnp.asarray(shooting.step),
            ),
            jnp.asarray(shooting.target),
            jnp.asarray(shooting.compared),
            jnp.asarray(shooting.belief),
            jnp.asarray(shooting.centre),
        )
        # Filled up, so that few and many windows share one compilation.
        count = shooting.windows
        starts = np.zeros((max(count, WINDOWS), 2))
        starts[:count, 0], starts[:count, 1] = shooting.position, shooting.velocity
        state = _solve(
            _Point(jnp.asarray(shooting.start), jnp.asarray(starts)),
            data,
            jnp.asarray(self.tolerance),
            jnp.asarray(self.max_passes),
            free=shooting.free_start,
        )
        return Shot(
            np.asarray(state.best.values),
            np.asarray(state.best.starts[:count, 0]),
            np.asarray(state.best.starts[:count, 1]),
            float(state.look.cost),
            float(state.first_cost),
            np.asarray(state.look.residual),
            np.asarray(state.look.slopes),
            np.asarray(state.look.start_slopes),
            int(state.passes),
            bool(state.done) and bool(jnp.isfinite(state.look.cost)),
        )

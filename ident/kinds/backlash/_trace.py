"""Backlash from the reversals of a trace in motion."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...core import FitError, Regression, one_blas_thread, regress
from ._types import (
    SURE,
    BacklashFit,
    Dependence,
    Reversal,
    dependence_of,
    polynomials,
    refuse_undetermined,
)

_LEAST = 3
"""Reversals that show how they scatter, at least."""
_ROWS = 4
"""Rows on each side of a reversal that it takes at least."""
_SPEEDS = 0.05
"""Relative spread of the speeds that tells a delay from a backlash."""
_NINE_TENTHS = 0.9
_BINS = 20
_NAMES = ("backlash", "delay between the instruments")


@one_blas_thread()
def fit_backlash_trace(
    time: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    *,
    reach: float,
    skip: float | None = None,
    loss: str = "student",
) -> BacklashFit:
    r"""Fit the backlash to the reversals of a trace.

    Around each reversal the same positions are passed twice; the step between the two passes
    is minus the width. Each reversal gives one width, and these are the readings of the fit:
    their scatter, not that of the samples, gives the standard deviation. A delay between the
    instruments adds error in proportion to the speed; reversals of different speed tell it
    from the backlash.

    Args:
        time: In s, ascending.
        position: Of the axis's own encoder (or command at low speed) in mm or °.
        error: External reference − encoder in mm or °.
        reach: Travel on both sides of a reversal that is used, in mm or °; half of it is the
            smallest way back that is a reversal.
        skip: Travel after a reversal that is left out, in which the play is taken up; None =
            a fifth of the reach.
        loss: As for `fit_backlash`.

    Raises:
        FitError: If there are fewer than three reversals with readings on both sides.
    """
    if not reach > 0:
        msg = f"reach: found {reach!r}, expected a travel above 0."
        raise FitError(msg)
    rows = np.flatnonzero(
        np.isfinite(position) & np.isfinite(error) & np.isfinite(time)
    )
    time, position, error = time[rows], position[rows], error[rows]
    if len(time) < 2 or not (np.diff(time) > 0).all():
        msg = "time must ascend to derive the speed."
        raise FitError(msg)
    speeds = np.gradient(position, time)
    skip = 0.2 * reach if skip is None else skip
    steps = {
        turn: step
        for turn in _turns(position, 0.5 * reach, reach)
        if (step := _step(turn, position, error, speeds, skip)) is not None
    }
    if len(steps) < _LEAST:
        msg = (
            f"found {len(steps)} reversals with readings within {reach:g} on both sides, "
            f"expected at least {_LEAST}."
        )
        raise FitError(msg)
    width, variance, speed = np.array(list(steps.values())).T
    turns = list(steps)
    where = np.array([position[turn.turn] for turn in turns])
    clock = np.array([time[turn.turn] for turn in turns])
    fast = float(np.median(np.abs(speed)))
    delayed = len(width) > 4 and float(np.ptp(speed)) > _SPEEDS * max(fast, 1e-300)
    columns = np.column_stack([np.ones(len(width)), *[speed] * delayed])
    found = _pooled(columns, width, variance, clock, loss)
    seen, delay = error, None
    if delayed:
        # Scatter within a reversal counts what the delay leaves, not the delay itself.
        seen = error - found.coefficients[1] * speeds
        again = [_step(turn, position, seen, speeds, skip) for turn in turns]
        variance = np.array([step[1] for step in again if step is not None])
        found = _pooled(columns, width, variance, clock, loss)
        seen = error - found.coefficients[1] * speeds
        # The error of a reference that is late is −delay · speed.
        delay = (-float(found.coefficients[1]), float(found.standard_deviation[1]))
    refuse_undetermined(found, "reversals")
    best, deviation = float(found.coefficients[0]), float(found.standard_deviation[0])
    good = [
        turn.direction for turn, odd in zip(turns, found.wild, strict=True) if not odd
    ]
    return BacklashFit(
        width=best,
        standard_deviation=deviation,
        noise=found.noise,
        independent=float(found.independent[0]),
        support=(good.count(1), good.count(-1)),
        residual=found.residual,
        wild=found.wild,
        dependence=_dependence(columns[:, 1:], width, variance, where, clock, loss),
        delay=delay,
        delay_gain=None if delayed or not fast > 0 else fast,
        reversals=tuple(
            Reversal(
                int(rows[turn.turn]), float(position[turn.turn]), turn.direction,
                step[0], float(np.sqrt(step[1])), bool(odd),
            )
            for (turn, step), odd in zip(steps.items(), found.wild, strict=True)
        ),
        take_up=_take_up(turns, position, seen, best, reach)
        if abs(best) > SURE * deviation
        else None,
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Turn:
    """One turning point with the stretch around it that runs in one direction each.

    Attributes:
        start: First row of the stretch before.
        turn: Row of the turning point, which belongs to neither direction.
        stop: Row after the stretch behind.
        direction: Of the motion after it, ±1.
    """

    start: int
    turn: int
    stop: int
    direction: int


def _turns(
    position: Float[np.ndarray, " t"], swing: float, reach: float
) -> tuple[_Turn, ...]:
    """Return the turning points of a motion, jitter left out.

    Args:
        position: In mm or °.
        swing: Smallest way back that is a reversal, in mm or °.
        reach: Travel on both sides that is kept, in mm or °.
    """
    turns: list[int] = []
    way, extreme = 0, 0
    for row in range(1, len(position)):
        step = position[row] - position[extreme]
        if way == 0:
            if abs(position[row] - position[0]) > swing:
                way, extreme = (1 if position[row] > position[0] else -1), row
        elif step * way >= 0:
            extreme = row
        elif -step * way > swing:
            turns.append(extreme)
            way, extreme = -way, row
    result = []
    for number, turn in enumerate(turns):
        before = turns[number - 1] if number else 0
        after = turns[number + 1] if number + 1 < len(turns) else len(position) - 1
        left = np.flatnonzero(np.abs(position[before:turn] - position[turn]) > reach)
        behind = np.abs(position[turn : after + 1] - position[turn])
        right = np.flatnonzero(behind > reach)
        start = before + int(left[-1]) + 1 if len(left) else before
        stop = turn + int(right[0]) if len(right) else after + 1
        way = 1 if position[stop - 1] > position[turn] else -1
        result.append(_Turn(start, turn, stop, way))
    return tuple(result)


def _step(
    turn: _Turn,
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    velocity: Float[np.ndarray, " t"],
    skip: float,
) -> tuple[float, float, float] | None:
    """Return width, its variance and the width per second of delay, of one reversal."""
    rows = np.arange(turn.start, turn.stop)
    away = np.abs(position[rows] - position[turn.turn])
    # Both sides over the same positions, where the play has been taken up.
    after = rows > turn.turn
    far = min(float(away[side].max(initial=0.0)) for side in (after, ~after))
    rows = rows[(away >= skip) & (away <= far) & (rows != turn.turn)]
    after = rows > turn.turn
    if after.sum() < _ROWS or (~after).sum() < _ROWS:
        return None
    way = np.where(after, turn.direction, -turn.direction)
    place = position[rows] - position[rows].mean()
    scale = max(float(np.abs(place).max()), 1e-300)
    design = np.column_stack([-0.5 * way, np.ones(len(rows)), place / scale])
    solved, *_ = np.linalg.lstsq(
        design, np.column_stack([error[rows], velocity[rows]]), rcond=None
    )
    left = error[rows] - design @ solved[:, 0]
    free = max(len(rows) - 3, 1)
    inverse = np.linalg.inv(design.T @ design)
    variance = float(left @ left) / free * float(inverse[0, 0])
    return float(solved[0, 0]), max(variance, 1e-18), float(solved[0, 1])


def _pooled(
    columns: Float[np.ndarray, "r k"],
    width: Float[np.ndarray, " r"],
    variance: Float[np.ndarray, " r"],
    clock: Float[np.ndarray, " r"],
    loss: str,
) -> Regression:
    """Return what is common to all reversals; none outvotes the others by far."""
    middle = float(np.median(variance))
    weight = middle / np.maximum(variance, 0.1 * middle)
    return regress(columns, width, time=clock, weight=weight, loss=loss, names=_NAMES)


def _dependence(
    beside: Float[np.ndarray, "r k"],
    width: Float[np.ndarray, " r"],
    variance: Float[np.ndarray, " r"],
    where: Float[np.ndarray, " r"],
    clock: Float[np.ndarray, " r"],
    loss: str,
) -> Dependence | None:
    """Return how the widths change along the axis; None where the turns are at few places."""
    span = float(np.ptp(where))
    places = len(np.unique(np.round(where / max(span, 1e-12), 2)))
    order = min(2, places - 1)
    if order < 1 or len(width) < order + 5:
        return None
    columns = np.hstack([polynomials(where, order), beside])
    try:
        found = _pooled(columns, width, variance, clock, loss)
    except FitError:
        return None
    return dependence_of(found, order, len(width))


def _take_up(
    turns: list[_Turn],
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    width: float,
    reach: float,
) -> float | None:
    """Return the travel after which nine tenths of the step have come."""
    travel, share = [], []
    for turn in turns:
        before = slice(turn.start, turn.turn + 1)
        near = np.abs(position[before] - position[turn.turn]) <= 0.5 * reach
        level = float(np.median(error[before][near]))
        after = slice(turn.turn, turn.stop)
        travel.append(np.abs(position[after] - position[turn.turn]))
        share.append(-turn.direction * (error[after] - level) / width)
    where, done = np.concatenate(travel), np.concatenate(share)
    edges = np.linspace(0.0, reach, _BINS + 1)
    index = np.digitize(where, edges) - 1
    for number in range(_BINS):
        inside = index == number
        if inside.sum() >= _LEAST and np.median(done[inside]) >= _NINE_TENTHS:
            return float(edges[number + 1])
    return None

"""Backlash from the reversals of a trace in motion."""

import numpy as np
from jaxtyping import Float

from ....models import Leadscrew
from ...core._errors import FitError
from ...core._regression import Regression, regress
from ._bidirectional import sentence
from ._dependence import dependence_of, dependence_warning, polynomials
from ._spread import carried_by, carried_warning
from ._turns import Turn, find_turns
from ._types import SURE, BacklashFit, Dependence, Reversal

_LEAST = 3
"""Reversals without which nothing can be said of their scatter."""
_ROWS = 4
"""Rows on each side of a reversal that it takes at least."""
_SPEEDS = 0.05
"""Relative spread of the speeds that tells a delay from a backlash."""
_NINE_TENTHS = 0.9
_BINS = 20


def fit_backlash_trace(
    time: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    *,
    reach: float,
    skip: float | None = None,
    swing: float | None = None,
    velocity: Float[np.ndarray, " t"] | None = None,
    table: Leadscrew | None = None,
    table_active: bool = False,
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
        reach: Travel on both sides of a reversal that is used, in mm or °.
        skip: Travel after a reversal that is left out, in which the play is taken up; None =
            a fifth of the reach.
        swing: Smallest way back that is a reversal; None = half the reach.
        velocity: In mm/s or °/s; None = derived from time and position.
        table: As for `fit_backlash`.
        table_active: As for `fit_backlash`.
        loss: As for `fit_backlash`.

    Raises:
        FitError: If there are fewer than three reversals with readings on both sides.
    """
    if not reach > 0:
        msg = f"reach: found {reach!r}, expected a travel above 0."
        raise FitError(msg)
    known = np.isfinite(position) & np.isfinite(error) & np.isfinite(time)
    rows = np.flatnonzero(known)
    time, position, error = time[rows], position[rows], error[rows]
    speeds = _speeds(time, position) if velocity is None else velocity[rows]
    skip = 0.2 * reach if skip is None else skip
    turns = find_turns(position, 0.5 * reach if swing is None else swing, reach)
    steps = [_step(turn, position, error, speeds, skip) for turn in turns]
    kept = [(t, s) for t, s in zip(turns, steps, strict=True) if s is not None]
    if len(kept) < _LEAST:
        msg = (
            f"found {len(kept)} reversals with readings within {reach:g} on both sides, "
            f"expected at least {_LEAST}."
        )
        raise FitError(msg)
    values = np.array([s for _, s in kept])
    width, variance, speed = values.T
    where = np.array([position[t.turn] for t, _ in kept])
    clock = np.array([time[t.turn] for t, _ in kept])
    found, delayed, warnings = _pooled(width, variance, speed, clock, loss)
    if delayed:
        # Scatter within a reversal counts what the delay leaves, not the delay itself.
        left = error - found.coefficients[1] * speeds
        again = [_step(turn, position, left, speeds, skip) for turn, _ in kept]
        variance = np.array([step[1] for step in again if step is not None])
        found, delayed, warnings = _pooled(width, variance, speed, clock, loss)
    dependence = _dependence(width, variance, speed, where, clock, delayed, loss)
    if dependence is not None and dependence.significant:
        warnings.append(dependence_warning(dependence))
    best = float(found.coefficients[0])
    if table is not None:
        twice = carried_warning(best, carried_by(table, where), table_active)
        warnings += [] if twice is None else [twice]
    reversals = tuple(
        Reversal(
            int(rows[t.start]), int(rows[t.stop - 1]) + 1, int(rows[t.turn]),
            float(position[t.turn]), t.direction, float(s[0]), float(np.sqrt(s[1])),
            bool(wild),
        )
        for (t, s), wild in zip(kept, found.wild, strict=True)
    )  # fmt: skip
    good = [each for each in reversals if not each.wild]
    delay, seen = None, error
    if delayed:
        seen = error - found.coefficients[1] * speeds
        # The error of a reference that is late is −delay · speed.
        delay = (-float(found.coefficients[1]), float(found.standard_deviation[1]))
    return BacklashFit(
        width=best,
        standard_deviation=float(found.standard_deviation[0]),
        names=("backlash", "delay between the instruments")[: 1 + delayed],
        covariance=found.covariance,
        noise=found.noise,
        independent=float(found.independent[0]),
        support=(
            sum(each.direction > 0 for each in good),
            sum(each.direction < 0 for each in good),
        ),
        dependence=dependence,
        delay=delay,
        reversals=reversals,
        take_up=_take_up([t for t, _ in kept], position, seen, best, reach)
        if abs(best) > SURE * found.standard_deviation[0]
        else None,
        residual=found.residual,
        wild=found.wild,
        warnings=tuple(warnings),
        message=sentence(best, found, int(found.wild.sum()), "reversals"),
    )


def _speeds(
    time: Float[np.ndarray, " t"], position: Float[np.ndarray, " t"]
) -> Float[np.ndarray, " t"]:
    if len(time) < 2 or not (np.diff(time) > 0).all():
        msg = "time must ascend to derive the speed."
        raise FitError(msg)
    return np.asarray(np.gradient(position, time))


def _step(
    turn: Turn,
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    velocity: Float[np.ndarray, " t"],
    skip: float,
) -> tuple[float, float, float] | None:
    """Return width, its variance and the width per second of delay, of one reversal."""
    rows = np.arange(turn.start, turn.stop)
    away = position[rows] - position[turn.turn]
    after = rows > turn.turn
    # Both sides over the same positions, where the play has been taken up.
    rows = rows[(np.abs(away) >= skip) & (rows != turn.turn)]
    after = rows > turn.turn
    if after.sum() < _ROWS or (~after).sum() < _ROWS:
        return None
    far = min(
        float(np.abs(position[rows[side]] - position[turn.turn]).max())
        for side in (after, ~after)
    )
    rows = rows[np.abs(position[rows] - position[turn.turn]) <= far]
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
    width: Float[np.ndarray, " r"],
    variance: Float[np.ndarray, " r"],
    speed: Float[np.ndarray, " r"],
    clock: Float[np.ndarray, " r"],
    loss: str,
) -> tuple[Regression, bool, list[str]]:
    """Return the width common to all reversals, and whether the delay was fitted beside it."""
    fast = float(np.median(np.abs(speed)))
    delayed = len(width) > 4 and float(np.ptp(speed)) > _SPEEDS * max(fast, 1e-300)
    columns = [np.ones(len(width))]
    if delayed:
        columns.append(speed)
    warnings = []
    if not delayed and fast > 0:
        warnings.append(
            "All reversals run at one speed: a delay of 0.1 ms between the instruments would "
            f"count as {0.1 * fast:.2g} µm of backlash, and nothing here tells them apart."
        )
    weight = np.median(variance) / np.maximum(variance, 0.1 * np.median(variance))
    found = regress(
        np.column_stack(columns), width, time=clock, weight=weight, loss=loss,
        names=("backlash", "delay between the instruments"),
    )  # fmt: skip
    return found, delayed, warnings


def _dependence(
    width: Float[np.ndarray, " r"],
    variance: Float[np.ndarray, " r"],
    speed: Float[np.ndarray, " r"],
    where: Float[np.ndarray, " r"],
    clock: Float[np.ndarray, " r"],
    delayed: bool,
    loss: str,
) -> Dependence | None:
    """Return how the widths change along the axis; None where the turns are at few places."""
    span = float(np.ptp(where))
    places = len(np.unique(np.round(where / max(span, 1e-12), 2)))
    order = min(2, places - 1)
    if order < 1 or len(width) < order + 5:
        return None
    columns = polynomials(where, order)
    if delayed:
        columns = np.column_stack([columns, speed])
    weight = np.median(variance) / np.maximum(variance, 0.1 * np.median(variance))
    try:
        found = regress(columns, width, time=clock, weight=weight, loss=loss)
    except FitError:
        return None
    return dependence_of(found, 0, order, len(width))


def _take_up(
    turns: list[Turn],
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

"""Backlash from the reversals of a trace in motion."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...core import FitError, one_blas_thread, regress
from .effect import BacklashFit, Sides, dependence_along

_LEAST = 3
"""Reversals that show how they scatter, at least."""
_ROWS = 4
"""Rows on each side of a reversal that it takes at least."""
_SPEEDS = 0.05
"""Relative spread of the speeds that tells a delay from a backlash."""
_SKIP = 0.2
"""Share of the reach behind a reversal in which the play is taken up: left out."""
_HIGHEST = 2
"""Order of the polynomial along the axis."""
_NAMES = ("backlash", "delay between the instruments")


@dataclasses.dataclass(frozen=True)
class _Reversal:
    """One reversal cut out of a trace: rows around a turning point, within reach of it.

    Attributes:
        turn: Row of the turning point, which belongs to neither direction.
        position: Of the turning point in mm or °.
        direction: Of the motion after it, ±1.
        width: Backlash that this reversal shows by itself, in mm or °.
        speed: What it would show of a delay of −1 s, in mm/s or °/s.
        left: What its rows show besides, of the error and of the speed.
        variance: Of the width, relative to that of a row.
    """

    turn: int
    position: float
    direction: int
    width: float
    speed: float
    left: Float[np.ndarray, "r 2"]
    variance: float


@one_blas_thread()
def fit_backlash_trace(
    time: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    *,
    reach: float,
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
        reach: Travel on both sides of a reversal that is used but for the first fifth, in which
            the play is taken up, in mm or °; half of it is the smallest way back that is a
            reversal.
        loss: As for `fit_backlash`.

    Raises:
        FitError: If there are fewer than three reversals with readings on both sides.
    """
    if not reach > 0:
        msg = f"reach: found {reach!r}, expected a travel above 0."
        raise FitError(msg)
    rows = np.isfinite(position) & np.isfinite(error) & np.isfinite(time)
    time, position, error = time[rows], position[rows], error[rows]
    if len(time) < 2 or not (np.diff(time) > 0).all():
        msg = "time must ascend to derive the speed."
        raise FitError(msg)
    speeds = np.gradient(position, time)
    turns = _reversals(position, np.column_stack([error, speeds]), reach)
    if len(turns) < _LEAST:
        msg = (
            f"found {len(turns)} reversals with readings within {reach:g} on both sides, "
            f"expected at least {_LEAST}."
        )
        raise FitError(msg)
    width, speed, where, way = np.array(
        [(turn.width, turn.speed, turn.position, turn.direction) for turn in turns]
    ).T
    clock = time[[turn.turn for turn in turns]]
    fast = float(np.median(np.abs(speed)))
    delayed = len(width) > 4 and float(np.ptp(speed)) > _SPEEDS * max(fast, 1e-300)
    columns = np.column_stack([np.ones(len(width)), *[speed] * delayed])
    fitted = functools.partial(
        regress, time=clock, loss=loss, names=_NAMES, weight=_weights(turns, 0.0)
    )
    found, delay = fitted(columns, width), None
    if delayed:
        # Scatter within a reversal counts what the delay leaves, not the delay itself.
        weight = _weights(turns, float(found.coefficients[1]))
        fitted = functools.partial(fitted, weight=weight)
        found = fitted(columns, width)
        # The error of a reference that is late is −delay · speed.
        delay = -float(found.coefficients[1]), float(found.standard_deviation[1])
    places = len(np.unique(np.round(where / max(float(np.ptp(where)), 1e-12), 2)))
    order = min(_HIGHEST, places - 1)
    # Each reversal gives one width: half of it to either side.
    side, twice = np.tile([1, -1], len(turns)), np.repeat(width, 2)
    before, wild = -0.5 * side * twice, np.repeat(found.wild, 2)
    sides = Sides(np.repeat(where, 2), side, before, wild)
    return dataclasses.replace(
        BacklashFit.of(found, way, sides, "reversals"),
        dependence=dependence_along(where, columns, width, order, fitted),
        delay=delay,
        delay_gain=None if delayed or not fast > 0 else fast,
    )


def _reversals(
    position: Float[np.ndarray, " t"],
    seen: Float[np.ndarray, "t 2"],
    reach: float,
) -> list[_Reversal]:
    """Return the reversals of a motion with rows enough on both sides, jitter left out.

    Args:
        position: In mm or °.
        seen: Error and speed of each row.
        reach: Travel on both sides that is kept, in mm or °.
    """
    from scipy.signal import find_peaks  # takes long to load

    swing = 0.5 * reach
    ends = [find_peaks(side, prominence=swing)[0] for side in (position, -position)]
    turns = np.sort(np.concatenate(ends)).tolist()
    bounds = [0, *turns, len(position) - 1]
    found = []
    for before, turn, after in zip(bounds, turns, bounds[2:], strict=False):
        far = np.abs(position[before : after + 1] - position[turn]) > reach
        far = np.flatnonzero(far) + before
        start = max([before, *(far[far < turn][-1:] + 1)])
        stop = min([after + 1, *far[far > turn][:1]])
        direction = 1 if position[stop - 1] > position[turn] else -1
        # Both sides over the same positions, where the play has been taken up.
        rows = np.delete(np.arange(start, stop), turn - start)
        away, later = np.abs(position[rows] - position[turn]), rows > turn
        most = min(away[side].max(initial=0.0) for side in (later, ~later))
        rows = rows[(away >= _SKIP * reach) & (away <= most)]
        later = rows > turn
        if min(int(later.sum()), int((~later).sum())) < _ROWS:
            continue
        way = np.where(later, direction, -direction)
        place = position[rows] - position[rows].mean()
        scale = max(float(np.abs(place).max()), 1e-300)
        design = np.column_stack([-0.5 * way, np.ones(len(rows)), place / scale])
        solved = np.linalg.lstsq(design, seen[rows], rcond=None)[0]
        found.append(
            _Reversal(
                turn, float(position[turn]), direction,
                float(solved[0, 0]), float(solved[0, 1]), seen[rows] - design @ solved,
                float(np.linalg.inv(design.T @ design)[0, 0]),
            )
        )  # fmt: skip
    return found


def _weights(turns: Sequence[_Reversal], per_speed: float) -> Float[np.ndarray, " r"]:
    """Return the weights of the widths; none outvotes the others by far.

    Args:
        turns: Each reversal.
        per_speed: Error in s per speed, which the scatter within a reversal is about.
    """
    left = [turn.left @ (1.0, -per_speed) for turn in turns]
    scatter = np.array([each @ each / max(len(each) - 3, 1) for each in left])
    variance = np.maximum(scatter * [turn.variance for turn in turns], 1e-18)
    middle = float(np.median(variance))
    return np.asarray(middle / np.maximum(variance, 0.1 * middle))

"""Logs of several instruments on one clock: the offset between them, fitted."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ...core import FitError, one_blas_thread, regress_curve

_GRID = 81
_OVERLAP = 0.5
"""Share of the shorter log that must lie in the other one for an offset to be tried."""
_FLAT = 0.98
"""Cost of the best offset, in those of the worst, that tells one from the other."""
_LEAST = 8
_ALIKE = (
    "the signals are equally alike at all offsets tried: they do not tell the offset "
    "between the clocks."
)


@dataclasses.dataclass(frozen=True)
class ClockOffset:
    """Where the clock of a log stands against another.

    Attributes:
        offset: In s: instant on the first clock = instant on the log's clock + offset.
        standard_deviation: In s.
        explained: Share of the scatter of the first signal that the log explains, 0 to 1.
    """

    offset: float
    standard_deviation: float
    explained: float


@one_blas_thread()
def clock_offset(
    time: Float[np.ndarray, " t"],
    signal: Float[np.ndarray, " t"],
    log_time: Float[np.ndarray, " l"],
    log_signal: Float[np.ndarray, " l"],
    *,
    search: float,
    position: Float[np.ndarray, " t"] | None = None,
) -> ClockOffset:
    r"""Return the offset between two clocks from what both instruments saw.

    The signal is taken as a line in the log's signal (the same temperature measured twice; an
    error that follows a temperature), with positions as a line whose slope and offset both
    follow it. The sum over the offset is searched on a grid, then refined by `regress_curve`.

    Args:
        time: Of the first log in s.
        signal: What it measured.
        log_time: Of the other log in s, ascending.
        log_signal: What that measured.
        search: Largest offset that is tried, in s.
        position: Of the axis in mm where the signal is an error at several positions.

    Raises:
        FitError: If the logs do not overlap, or the signals do not tell the offset.
    """
    known = np.isfinite(log_signal)
    log_time, log_signal = log_time[known], log_signal[known]
    rows = np.isfinite(signal) & np.isfinite(time)
    time, signal = time[rows], signal[rows]
    away = None if position is None else position[rows] - float(np.mean(position[rows]))
    span = min(float(np.ptp(time)), float(np.ptp(log_time)))

    def inside(offset: float) -> Bool[np.ndarray, " t"]:
        there = time - offset
        return np.asarray((there >= log_time[0]) & (there <= log_time[-1]))

    def columns(
        offset: float, keep: Bool[np.ndarray, " t"]
    ) -> Float[np.ndarray, "k c"]:
        other = np.interp(time[keep] - offset, log_time, log_signal)
        parts = [np.ones(int(keep.sum())), other - log_signal.mean()]
        if away is not None:
            parts += [away[keep], away[keep] * parts[1]]
        return np.column_stack(parts)

    def cost(offset: float) -> float:
        keep = inside(offset)
        if keep.sum() < _LEAST or np.ptp(time[keep]) < _OVERLAP * span:
            return np.inf
        design = columns(offset, keep)
        value = np.linalg.lstsq(design, signal[keep], rcond=None)[0]
        size = np.abs(signal[keep] - design @ value)
        return float(np.minimum(size, 5.0 * np.median(size) + 1e-300).mean())

    grid = np.linspace(-search, search, _GRID)
    costs = np.array([cost(offset) for offset in grid])
    if not np.isfinite(costs).any():
        msg = (
            f"the logs overlap nowhere within ±{search:g} s, expected common time or a "
            "wider search."
        )
        raise FitError(msg)
    start = float(grid[np.argmin(costs)])
    if not costs.min() < _FLAT * float(costs[np.isfinite(costs)].max()):
        raise FitError(_ALIKE)
    step = float(grid[1] - grid[0])
    # A slope over less than the distance of the readings would be one of the log's noise.
    width = 0.5 * max(float(np.median(np.diff(np.unique(time)))), 0.2 * step)
    # The same readings for all offsets that are near.
    reach = 1.5 * step
    keep = inside(start - reach - width) & inside(start + reach + width)
    try:
        (offset,), found = regress_curve(
            lambda shapes: columns(float(shapes[0]), keep),
            signal[keep],
            np.array([start]),
            width=np.array([width]),
            bounds=(np.array([start - reach]), np.array([start + reach])),
            time=time[keep],
        )
    except FitError as error:
        raise FitError(_ALIKE) from error
    deviation = float(found.standard_deviation[-1])
    spread = float(np.var(signal[keep]))
    explained = 1.0 - float(np.var(found.residual[~found.wild])) / max(spread, 1e-300)
    if abs(offset) > search:
        msg = f"the best offset lies beyond ±{search:g} s: widen the search."
        raise FitError(msg)
    if not deviation < search:
        msg = (
            f"the offset between the clocks is uncertain by {deviation:.3g} s, expected "
            "signals that change sharply enough to tell it."
        )
        raise FitError(msg)
    return ClockOffset(float(offset), deviation, explained)

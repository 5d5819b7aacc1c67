"""Logs of several instruments on one clock: the offset between them, fitted."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...core._errors import FitError
from ...core._regression import regress
from ._types import SensorLog

_GRID = 81
_PASSES = 20
_OVERLAP = 0.5
"""Share of the shorter log that must lie in the other one for an offset to be tried."""
_FLAT = 0.98
"""Cost of the best offset, in those of the worst, that tells one from the other."""
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
        message: One sentence for the report.
    """

    offset: float
    standard_deviation: float
    explained: float
    message: str


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
    follow it. The sum of squares over the offset is searched, then refined by Gauss–Newton.

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

    def inside(offset: float) -> np.ndarray:
        there = time - offset
        return np.asarray((there >= log_time[0]) & (there <= log_time[-1]))

    def columns(offset: float, keep: np.ndarray) -> np.ndarray:
        other = np.interp(time[keep] - offset, log_time, log_signal)
        parts = [np.ones(int(keep.sum())), other - log_signal.mean()]
        if away is not None:
            parts += [away[keep], away[keep] * parts[1]]
        return np.column_stack(parts)

    def cost(offset: float) -> float:
        keep = inside(offset)
        if keep.sum() < 8 or np.ptp(time[keep]) < _OVERLAP * span:
            return np.inf
        design = columns(offset, keep)
        left = (
            signal[keep] - design @ np.linalg.lstsq(design, signal[keep], rcond=None)[0]
        )
        size = np.abs(left)
        return float(np.minimum(size, 5.0 * np.median(size) + 1e-300).mean())

    grid = np.linspace(-search, search, _GRID)
    costs = np.array([cost(offset) for offset in grid])
    if not np.isfinite(costs).any():
        msg = (
            f"the logs overlap nowhere within ±{search:g} s, expected common time or a "
            "wider search."
        )
        raise FitError(msg)
    offset = float(grid[np.argmin(costs)])
    worst = float(costs[np.isfinite(costs)].max())
    if not costs.min() < _FLAT * worst:
        raise FitError(_ALIKE)
    step = float(grid[1] - grid[0])
    # A slope over less than the distance of the readings would be one of the log's noise.
    delta = 0.5 * max(float(np.median(np.diff(np.unique(time)))), 0.2 * step)
    keep = inside(offset)
    found = regress(columns(offset, keep), signal[keep], quick=True)
    deviation = np.inf
    for _ in range(_PASSES):
        keep = inside(offset)
        design = columns(offset, keep)
        value = regress(design, signal[keep], quick=True).coefficients
        near = keep & inside(offset + delta) & inside(offset - delta)
        slope = np.zeros(len(time))
        slope[near] = (
            columns(offset + delta, near) - columns(offset - delta, near)
        ) @ (value / (2.0 * delta))
        both = np.column_stack([design, slope[keep]])
        try:
            found = regress(both, signal[keep], time=time[keep])
        except FitError as error:
            raise FitError(_ALIKE) from error
        move = float(np.clip(found.coefficients[-1], -step, step))
        deviation = float(found.standard_deviation[-1])
        offset += move
        step *= 0.7
        if abs(move) < 0.01 * deviation:
            break
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
    message = (
        f"The clocks differ by {offset:.4g} s ± {deviation:.2g} s; put on one clock the log "
        f"explains {100 * max(explained, 0.0):.0f} % of the scatter."
    )
    return ClockOffset(offset, deviation, explained, message)


def join_logs(logs: Sequence[tuple[SensorLog, float]]) -> SensorLog:
    """Return the sensors of several logs side by side on the first clock.

    Args:
        logs: Each log with its offset in s (`ClockOffset.offset`; 0 for the first clock).
            Instants are those of the densest log; outside a log its sensors are NaN.

    Raises:
        FitError: If there is none.
    """
    if not logs:
        msg = "no logs to join, expected one at least."
        raise FitError(msg)
    clock, shift = max(logs, key=lambda each: len(each[0].time))
    time = clock.time + shift
    columns = []
    for log, offset in logs:
        for values in log.temperature.T:
            known = np.isfinite(values)
            columns.append(
                np.interp(
                    time, log.time[known] + offset, values[known],
                    left=np.nan, right=np.nan,
                )
            )  # fmt: skip
    return SensorLog(time, np.column_stack(columns))

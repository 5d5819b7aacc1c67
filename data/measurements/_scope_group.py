"""Samples of one group of channels of a TwinCAT Scope text export."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from ._errors import CellError, LineError, MeasurementError
from ._table import BadCell, first_bad

_TICKS_PER_MS = 10_000


@dataclasses.dataclass(frozen=True)
class GroupSamples:
    """Samples of one group.

    Attributes:
        time: In ms since the start of the export.
        values: Per channel; NaN where the cell is no finite number.
        bad: Per channel, the first such cell.
        lines: Line of the file per sample.
        repeated: Samples that were written again to fill lines, and left out.
    """

    time: Float[np.ndarray, " t"]
    values: tuple[Float[np.ndarray, " t"], ...]
    bad: tuple[BadCell | None, ...]
    lines: Int[np.ndarray, " t"]
    repeated: int


@dataclasses.dataclass(frozen=True)
class Piece:
    """Lines of one width: value and blankness per column, line per row."""

    values: list[np.ndarray]
    blank: list[Bool[np.ndarray, " t"]]
    lines: Int[np.ndarray, " t"]


def join_group(
    path: Path,
    pieces: Sequence[Piece],
    keys: Sequence[str],
    columns: range,
    start: int | None,
) -> GroupSamples:
    """Return the samples of one group from all lines that have it.

    Args:
        path: The file.
        pieces: Runs of lines that have the group.
        keys: Names of all columns of the file, for messages.
        columns: Those of the group; the first holds its times.
        start: Start of the export in ticks where the times are ticks, else None.

    Raises:
        CellError: If a cell is empty beside or above others that are not.
        LineError: If a time runs back.
        MeasurementError: If there is no sample.
    """
    first, width = columns.start, len(columns)
    blank = [np.concatenate([part.blank[k] for part in pieces]) for k in columns]
    lines = np.concatenate([part.lines for part in pieces])
    present = ~np.logical_and.reduce(blank)
    count = int(present.sum())
    partly = np.logical_or.reduce(blank) & present
    if not present[:count].all() or partly.any():
        missing = np.flatnonzero(~present[:count])
        row = min([*missing[:1].tolist(), *np.flatnonzero(partly)[:1].tolist()])
        k = next(k for k in range(width) if blank[k][row])
        expected = "a number, as a later line of the group has one"
        if partly[row]:
            expected = "a number, as the other cells of the group hold"
        name = keys[first + k]
        raise CellError(str(path), int(lines[row]), name, "", expected)
    if not count:
        reason = f"found no samples of '{keys[first + 1]}', expected some"
        raise MeasurementError(str(path), reason)
    lines = lines[:count]
    values = [np.concatenate([part.values[k] for part in pieces]) for k in columns]
    time = _time(path, values[0][:count], lines, keys[first], start)
    cells = [np.asarray(v[:count], dtype=np.float64) for v in values[1:]]
    keep = _rising(path, time, cells, lines, keys[first + 1])
    repeated = count - int(keep.sum())
    kept = [cell[keep] for cell in cells]
    bad = tuple(first_bad(values, lines[keep]) for values in kept)
    clean = tuple(np.where(np.isfinite(values), values, np.nan) for values in kept)
    return GroupSamples(time[keep], clean, bad, lines[keep], repeated)


def _time(
    path: Path,
    column: np.ndarray,
    lines: Int[np.ndarray, " t"],
    name: str,
    start: int | None,
) -> Float[np.ndarray, " t"]:
    """Return the times of a group in ms since the start of the export."""
    if start is not None:
        return (column.astype(np.int64) - start) / _TICKS_PER_MS
    time = np.asarray(column, dtype=np.float64)
    invalid = np.flatnonzero(~np.isfinite(time))
    if invalid.size:
        found, line = f"{time[invalid[0]]}", int(lines[invalid[0]])
        raise CellError(str(path), line, name, found, "a time in ms")
    return time


def _rising(
    path: Path,
    time: Float[np.ndarray, " t"],
    values: Sequence[Float[np.ndarray, " t"]],
    lines: Int[np.ndarray, " t"],
    name: str,
) -> Bool[np.ndarray, " t"]:
    """Return which samples are new: Scope can repeat those of slow groups.

    Raises:
        LineError: If a time runs back, or stands still with other values.
    """
    step = np.diff(time)
    new = np.concatenate([[True], step != 0.0])
    equal = np.ones(step.size, dtype=bool)
    if (step == 0.0).any():
        for value in values:
            equal &= (value[1:] == value[:-1]) | ~np.isfinite(value[1:])
    invalid = np.flatnonzero((step < 0.0) | ((step == 0.0) & ~equal))
    if invalid.size:
        at = int(invalid[0]) + 1
        found = f"time {time[at]:.10g} ms of '{name}' after {time[at - 1]:.10g} ms"
        raise LineError(str(path), int(lines[at]), found, "times that rise")
    return new

"""Samples that a recorder dropped here and there, filled in from those beside them.

Each gap else ends a stretch that is looked at by itself, and dozens per second leave none.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..signals import SignalError, read_clock
from ._errors import CellError
from ._measurement import Measurement, RoleValues

_LEAST = 100
"""Samples of a recording of which some may be missing."""


def filled_in(
    measured: Measurement, most: int
) -> tuple[Measurement, Float[np.ndarray, " t"]]:
    """Return a recording with the samples that are missing, up to ``most`` in a row.

    Besides the row of the recording that each row was, those filled in between whole ones. Stamps
    that repeat as often are too coarse to tell: nothing is filled in.
    """
    time, places = measured.get("time"), [np.arange(measured.rows, dtype=float)]
    if time is None or len(time) < _LEAST:
        return measured, places[0]
    try:
        values = {role: np.asarray(measured.values[role]) for role in measured.values}
        clock = read_clock(np.asarray(time, dtype=float))
    except (CellError, SignalError):
        return measured, places[0]
    kinds = [jump.kind for jump in clock.jumps]
    coarse = 2 * kinds.count("repeat") > kinds.count("gap")
    for jump in () if coarse else clock.jumps:
        missed = round(jump.step / clock.sample_time) - 1
        if jump.kind == "gap" and missed <= most:
            places.append(jump.row - 1 + np.arange(1, missed + 1) / (missed + 1))
    if len(places) == 1:
        return measured, places[0]
    rows = np.sort(np.concatenate(places))
    whole = dataclasses.replace(
        measured,
        values=RoleValues({k: taken_at(column, rows) for k, column in values.items()}),
        rows=len(rows),
        lines=taken_at(measured.lines, rows),
    )
    return whole, rows


def taken_at(column: np.ndarray, rows: Float[np.ndarray, " n"]) -> np.ndarray:
    """Return a column at rows, between whole ones by a line, or the nearest of whole numbers."""
    if np.issubdtype(column.dtype, np.floating):
        return np.asarray(np.interp(rows, np.arange(len(column)), column))
    return np.asarray(column[np.round(rows).astype(np.int64)])

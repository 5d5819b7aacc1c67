"""Channels of several sample times at common instants, without inventing samples."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from ._errors import MeasurementError
from ._roles import ColumnSpec, Role, role as named_role
from ._table import Column, Table

_FOLLOWS = ("temperature",)
"""Kinds that change slowly: they are read at the instants of the others."""
_HELD = ("run", "direction")
"""Kinds that have no values in between."""
_GAP = 3.0
"""Sample times without a sample from which on nothing is read in between."""


def on_one_clock(
    table: Table, mapping: Mapping[str, ColumnSpec]
) -> tuple[Table, dict[str, ColumnSpec]]:
    """Return the columns that are used at common instants, and the mapping with `time`.

    The instants are those at which the slowest of the channels that are used has a
    sample (temperatures and runs aside): a faster channel is read there, linearly
    between its two samples nearest to the instant where it has none. So no value is
    made for a slow channel between its samples. Instants outside the range of any
    channel, or within a gap of one, are left out. Tables of one clock are returned as
    they are.

    Raises:
        MeasurementError: If the channels have no common instants.
    """
    if all(column.present is None for column in table.columns):
        if any(column.sample_time is not None for column in table.columns):
            return table, _with_time(table, mapping)
        return table, dict(mapping)
    mapping = _with_time(table, mapping)
    source = str(table.path)
    used: dict[str, tuple[Role, Column]] = {}
    for text, spec in mapping.items():
        column = table.column(spec.column)
        if column.role != "time":
            used[column.name] = (named_role(text, source), column)
    time = next(c.values for c in table.columns if c.role == "time")
    leading = [
        column for role, column in used.values() if role.kind not in (*_FOLLOWS, *_HELD)
    ] or [column for _, column in used.values()]
    if not leading:
        return table, mapping
    slowest = min(leading, key=lambda column: column.samples)
    chosen = _present(slowest, table.rows)
    interpolated = [
        column.name
        for _, column in used.values()
        if not _present(column, table.rows)[chosen].all()
    ]
    for _, column in used.values():
        chosen = chosen & _covered(column, time)
    if not chosen.any():
        names = ", ".join(f"'{name}'" for name in used)
        reason = f"found channels {names} without a common instant, expected some"
        raise MeasurementError(source, reason)
    columns = [
        dataclasses.replace(
            column,
            values=_read(used[column.name][0], column, time, chosen)
            if column.name in used
            else column.values[chosen],
            present=None
            if column.name in used or column.present is None
            else column.present[chosen],
        )
        for column in table.columns
        if column.text is None
    ]
    remarks = list(table.remarks)
    if int(chosen.sum()) < table.rows:
        remark = (
            f"Channels of several sample times are taken at the {int(chosen.sum())}"
        )
        remark += f" instants of '{slowest.name}'"
        if interpolated:
            remark += f"; read between two samples there: {', '.join(interpolated)}"
        remarks.append(remark + ".")
    aligned = dataclasses.replace(
        table,
        columns=tuple(columns),
        rows=int(chosen.sum()),
        lines=table.lines[chosen],
        remarks=tuple(remarks),
    )
    return aligned, mapping


def _with_time(
    table: Table, mapping: Mapping[str, ColumnSpec]
) -> dict[str, ColumnSpec]:
    """Return the mapping with the clock of the file, unless it names another."""
    clock = next((c for c in table.columns if c.role == "time"), None)
    if clock is None or "time" in mapping:
        return dict(mapping)
    return {**mapping, "time": ColumnSpec(clock.name)}


def _present(column: Column, rows: int) -> Bool[np.ndarray, " t"]:
    return np.ones(rows, dtype=bool) if column.present is None else column.present


def _covered(column: Column, time: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
    """Return the instants between two samples of a channel that are no gap apart."""
    instants = time[_present(column, time.size)]
    if instants.size == 1:
        only: Bool[np.ndarray, " t"] = time == instants[0]
        return only
    after = np.clip(np.searchsorted(instants, time), 1, instants.size - 1)
    usual = float(np.median(np.diff(instants)))
    exact = (time == instants[after]) | (time == instants[after - 1])
    within = (time > instants[0]) & (time < instants[-1])
    close = instants[after] - instants[after - 1] <= _GAP * usual
    covered: Bool[np.ndarray, " t"] = exact | (within & close)
    return covered


def _read(
    role: Role,
    column: Column,
    time: Float[np.ndarray, " t"],
    chosen: Bool[np.ndarray, " t"],
) -> Float[np.ndarray, " _"]:
    """Return a channel at the chosen instants; a bad cell spoils only its neighbours."""
    present = _present(column, time.size)
    result: Float[np.ndarray, " _"]
    instants, values = time[present], column.values[present]
    if present[chosen].all():
        result = column.values[chosen]
    elif role.kind in _HELD:
        result = values[np.searchsorted(instants, time[chosen], side="right") - 1]
    else:
        result = np.interp(time[chosen], instants, values)
    return result

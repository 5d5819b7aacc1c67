"""A log of a controller: its motion, and what it reported that it added."""

import dataclasses
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from ._dropped import filled_in, taken_at
from ._errors import CellError, MeasurementError
from ._log_names import COMPENSATIONS, LogName, log_name, plain_axis
from ._measurement import Measurement, measurement
from ._read import read_table
from ._roles import KINDS, ColumnSpec, find_role
from ._table import Column, Table
from ._units import UNITS, find_unit

_LENGTHS = ("length", "angle", "increments")
_JITTER = 0.25
"""Share of a cycle by which time stamps may miss their place: they are rounded."""
_FILLED = 20
"""Cycles missed in a row that are filled in at most."""


@dataclasses.dataclass(frozen=True)
class LoggedOffset:
    """One column of reported offsets.

    Attributes:
        axis: ``A3`` or a name; None where the column does not say.
        compensation: Or ``offset`` for the sum.
        column: As the file names it.
        values: In mm or °; friction in the unit of the file.
        filtered: Filters over cycles have acted on it.
        step: Worth of its last digit in mm or °; 0 where it is not counted in steps.
        acts: Whether the compensation was on, per row, where another column says so.
    """

    axis: str | None
    compensation: str
    column: str
    values: Float[np.ndarray, " t"]
    filtered: bool
    step: float
    acts: Bool[np.ndarray, " t"] | None = None


@dataclasses.dataclass(frozen=True)
class ControllerLog:
    """A log: one row per cycle, or independent rows where there is no time.

    Attributes:
        source: The file.
        motion: Positions, velocities … by role, in mm, °, s, °C.
        offsets: What the controller reported.
        cycle: Time step in s; None without time.
        ignored: Columns that mean nothing here.
        dropped: Cycles that are missing and were filled in from those beside them.
    """

    source: Path
    motion: Measurement
    offsets: tuple[LoggedOffset, ...]
    cycle: float | None
    ignored: tuple[str, ...]
    dropped: int = 0


def read_log(
    path: Path,
    increment: float | None = None,
    cycle: float | None = None,
    names: Collection[str] = COMPENSATIONS,
    turns: Mapping[str, float] | None = None,
) -> ControllerLog:
    """Return what a log holds; columns are recognised by their names.

    Args:
        path: CSV or Parquet.
        increment: mm or ° per encoder increment, for columns in increments.
        cycle: Cycle time in s that the log must have; None takes what it has.
        names: Compensations that columns such as ``A3.cross`` may name.
        turns: mm or ° of a turn, of axes that go round, by their name in the log.

    Raises:
        OSError: If the file cannot be read.
        MeasurementError: If it holds no position, a cell is no finite number, time does
            not run in even steps or not in those that are expected, or increments are
            of unknown worth.
    """
    table = read_table(path)
    roles: dict[str, ColumnSpec] = {}
    offsets: list[LoggedOffset] = []
    ignored: list[str] = []
    states: dict[tuple[str | None, str], Column] = {}
    named: dict[tuple[str | None, str, bool], str] = {}
    for column in table.columns:
        name = log_name(column.name, names)
        if name is not None and name.is_state:
            if column.text is None and column.bad is None:
                states[name.axis, name.compensation] = column
            else:
                ignored.append(column.name)
            continue
        if name is not None:
            key = (name.axis, name.compensation, name.filtered)
            if key in named:
                reason = (
                    f"found '{named[key]}' and '{column.name}', expected one of them"
                )
                raise MeasurementError(str(path), reason)
            named[key] = column.name
            offsets.append(_offset(table, column, name, increment))
            continue
        role = _role(column.role or column.name)
        if role is None:
            ignored.append(column.name)
        elif role in roles:
            reason = f"found '{roles[role].column}' and '{column.name}' for {role}"
            raise MeasurementError(str(path), f"{reason}, expected one")
        else:
            roles[role] = ColumnSpec(column.header or column.name)
    for at, offset in enumerate(offsets):
        state = states.pop((offset.axis, offset.compensation), None)
        if state is not None:
            acts = table.numbers(state) != 0.0
            offsets[at] = dataclasses.replace(offset, acts=acts)
    ignored += [column.name for column in states.values()]
    if not any(role.endswith(".position") for role in roles):
        names = ", ".join(column.name for column in table.columns[:12])
        reason = f"found columns {names}, expected a position such as A1.position"
        raise MeasurementError(str(path), reason)
    axes = {role.partition(".")[0] for role in roles}
    increments = {} if increment is None else dict.fromkeys(axes, increment)
    motion = measurement(table, roles, increments=increments, turns=turns)
    for role in roles:
        motion.require(role)  # raises at a cell that is no number
    motion, rows = filled_in(motion, _FILLED)
    dropped = motion.rows - table.rows
    for at, offset in enumerate(offsets if dropped else ()):
        acts = None if offset.acts is None else taken_at(offset.acts, rows)
        values = taken_at(offset.values, rows)
        offsets[at] = dataclasses.replace(offset, values=values, acts=acts)
    step = _cycle(motion, cycle)
    return ControllerLog(path, motion, tuple(offsets), step, tuple(ignored), dropped)


def _role(text: str) -> str | None:
    head, dot, tail = text.partition(".")
    if dot and tail in KINDS:
        text = f"{plain_axis(head)}.{tail}"
    return text if find_role(text) is not None and text != "run" else None


def _offset(
    table: Table, column: Column, name: LogName, increment: float | None
) -> LoggedOffset:
    values = table.numbers(column)
    unit = find_unit(column.unit) if column.unit else None
    if name.compensation == "friction":
        return LoggedOffset(
            name.axis, "friction", column.name, values, name.filtered, 0.0
        )
    if unit is None:
        unit = UNITS["inc" if name.increments else "mm"]
    if unit.dimension not in _LENGTHS:
        reason = f"column '{column.name}': found unit '{unit.name}', expected a length"
        raise MeasurementError(str(table.path), f"{reason}, an angle or increments")
    step = 0.0
    if unit.name == "inc":
        if increment is None:
            reason = (
                f"column '{column.name}': found encoder increments, expected their"
                " worth in mm or ° (--increment)"
            )
            raise MeasurementError(str(table.path), reason)
        step = increment
    return LoggedOffset(
        name.axis,
        name.compensation,
        column.name,
        unit.to_library(values, increment),
        name.filtered,
        step,
    )


def _cycle(motion: Measurement, cycle: float | None) -> float | None:
    """Return the time step, which must be the same all along.

    Raises:
        MeasurementError: Naming the first row that does not fit.
    """
    time = motion.get("time")
    if time is None or len(time) < 2:
        return None
    steps = np.diff(time)
    step = float(np.median(steps))
    expected = step if step > 0 else 0.0
    irregular = np.flatnonzero(~(np.abs(steps - expected) <= _JITTER * expected))
    if irregular.size:
        at = int(irregular[0])
        raise CellError(
            str(motion.source),
            int(motion.lines[at + 1]),
            "time",
            f"{time[at + 1]:.9g}",
            f"{time[at] + expected:.9g}, a cycle of {1e3 * expected:.6g} ms after the"
            " row before. Record every cycle, or give the rows before that line, or those"
            " from it on, as a file of their own",
        )
    # Stamps are rounded; their mean distance is not.
    step = float((time[-1] - time[0]) / len(steps))
    if cycle is not None and abs(step - cycle) > 1e-3 * cycle:
        reason = (
            f"found a cycle time of {1e3 * step:.6g} ms, expected {1e3 * cycle:.6g} ms"
        )
        raise MeasurementError(str(motion.source), reason)
    return step

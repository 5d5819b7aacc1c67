"""A measurement: columns that have got a meaning and the library's units."""

import dataclasses
import html
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from ..html import table_html
from ._align import on_one_clock
from ._convert import as_direction, as_run, library_unit, runs_against, unit_of
from ._dates import MOST_SECONDS, may_be_ms, seconds_of_dates
from ._errors import MeasurementError, MissingRole
from ._roles import ColumnSpec as ColumnSpec, Role, find_role, role as named_role
from ._table import MESH_FORMATS, SCOPE_FORMAT, Column, Skipped, Table, TextForm
from ._turns import passed_end, unwound
from ._units import Unit, find_unit
from ._wide import unfolded
from ._words import (
    is_axis_column,
    is_leg,
    kinds_in,
    says_correction,
    says_origin,
    words_in,
)


class RoleValues:
    """Values by role, like a dictionary; a column with a bad cell raises when used.

    So NaN in a column that nobody asks for does not stop a job. (Not a `Mapping`: type
    checkers at run time look at an item of those, and that may raise here.)
    """

    def __init__(
        self,
        good: Mapping[str, np.ndarray],
        bad: Mapping[str, MeasurementError] | None = None,
        gaps: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        self._good, self._bad = dict(good), dict(bad or {})
        self._gaps = dict(gaps or {})

    def __getitem__(self, role: str) -> np.ndarray:
        if role in self._bad:
            raise self._bad[role]
        return self._good[role]

    def __contains__(self, role: object) -> bool:
        return role in self._good or role in self._bad

    def __iter__(self) -> Iterator[str]:
        yield from self._good
        yield from self._bad

    def __len__(self) -> int:
        return len(self._good) + len(self._bad)

    def keys(self) -> tuple[str, ...]:
        """Return all roles, those with a bad cell too."""
        return tuple(self)

    @property
    def unusable(self) -> tuple[str, ...]:
        """Roles that raise when they are used."""
        return tuple(self._bad)

    def replaced(self, role: str, values: np.ndarray) -> "RoleValues":
        """Return them with other values of a role; what cannot be used stays so."""
        return RoleValues({**self._good, role: values}, self._bad, self._gaps)

    def with_gaps(self) -> "RoleValues":
        """Return the values with NaN where a cell of a number column holds none."""
        bad = {
            role: error for role, error in self._bad.items() if role not in self._gaps
        }
        return RoleValues({**self._good, **self._gaps}, bad)


@dataclasses.dataclass(frozen=True)
class Measurement:
    """One measurement in mm, °, s, °C; one value per row and role.

    Attributes:
        name: Of the measurement in the job, or of the file.
        source: The file, for messages.
        values: By role (``X.position``, ``run``, …), each of shape ``(t,)``.
        units: Library unit by role (``mm``, ``deg``, ``s`` …; ``""`` for run and
            direction).
        rows: Number of rows.
        lines: Line of the file per row.
        remarks: What was taken for granted, one sentence each.
        late: Of axes in motion, what one standard deviation of their instrument's delay
            makes of the error, per row in mm or °.
        format: Of the file, in words; see `Table`.
        form: How a text table was found to be written: separator, decimal mark, lines
            of header and units; None for all others.
        skipped: Lines of the file that are not in the rows.
    """

    name: str
    source: Path
    values: RoleValues
    units: Mapping[str, str]
    rows: int
    lines: Int[np.ndarray, " t"]
    remarks: tuple[str, ...] = ()
    late: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    format: str = ""
    form: TextForm | None = None
    skipped: tuple[Skipped, ...] = ()

    def _repr_html_(self) -> str:
        """Return the roles with their units and ranges, for a notebook."""
        seen, rows = self.values.with_gaps(), []
        for role in seen:
            bad = role in seen.unusable
            values = np.zeros(0) if bad else np.asarray(seen[role], float)
            valid = values[np.isfinite(values)]
            ends = (
                [f"{valid.min():.6g}", f"{valid.max():.6g}"] if valid.size else ["", ""]
            )
            rows.append([role, self.units.get(role, ""), *ends])
        parts = [f"<p><b>{html.escape(self.name)}</b>: {self.rows} rows</p>"]
        parts.append(table_html(("role", "unit", "least", "most"), rows))
        parts += [f"<p>{html.escape(remark)}</p>" for remark in self.remarks]
        return "".join(parts)

    def get(self, role: str) -> np.ndarray | None:
        """Return the values of a role, or None where the measurement does not have it.

        Raises:
            CellError: If the column holds a cell that cannot be used.
        """
        return self.values[role] if role in self.values else None

    def require(self, role: str, why: str = "") -> np.ndarray:
        """Return the values of a role.

        Args:
            role: Such as ``X.error``.
            why: End of the sentence "expected 'X.error' …", such as "for the leadscrew
                fit".

        Raises:
            MissingRole: If the measurement does not have it.
            CellError: If the column holds a cell that cannot be used.
        """
        if role not in self.values:
            raise MissingRole(str(self.source), role, why, tuple(self.values))
        return self.values[role]

    def with_gaps(self) -> "Measurement":
        """Return the measurement with NaN for missed readings, instead of an error."""
        return dataclasses.replace(self, values=self.values.with_gaps())

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that have any role, in order of appearance."""
        found = (find_role(role) for role in self.values)
        return tuple(dict.fromkeys(role.axis for role in found if role and role.axis))


def measurement(
    table: Table,
    columns: Mapping[str, ColumnSpec] | None = None,
    *,
    axis: str | None = None,
    masters: Sequence[str] = (),
    increments: Mapping[str, float] | None = None,
    rotary: Sequence[str] | None = None,
    turns: Mapping[str, float] | None = None,
    ends: Mapping[str, tuple[float, float]] | None = None,
    name: str | None = None,
) -> Measurement:
    """Give columns a meaning and convert them to mm, °, s and °C.

    Args:
        table: As read. Channels of several sample times are brought to the instants of
            the slowest one that is used; remarks say how.
        columns: Column per role. Left out, empty or values alone: beside them the roles
            that the file names itself.
        axis: Axis of a file that names roles without an axis (ISO 230-2 run table,
            laser table), or axis whose error a mesh shows (Z where left out).
        masters: Axes that x and y of a mesh stand for; left out: as the file says.
        increments: mm or ° per encoder increment by axis, for the unit ``inc``.
        rotary: Axes whose positions are angles, all others being lengths. Left out:
            as `turning_axes`.
        turns: mm or ° of a turn, of axes that go round: what a display shows within one turn
            goes on beyond it.
        ends: First and last position of axes that have two ends: what stays within a turn of
            them does not go round.
        name: Of the measurement; the file's name where left out.

    Raises:
        RoleError: If a role is unknown; names the nearest.
        ColumnError: If a column does not exist; names the nearest.
        UnitError: If a unit is unknown, does not fit the role, contradicts the file, or
            mixes lengths and angles on one axis; names the accepted ones and the
            nearest.
        MeasurementError: If there is nothing that could be used.
    """
    source = str(table.path)
    _of_one_kind(table)
    mapping = dict(columns or {})
    if all(spec.value is not None for spec in mapping.values()):
        # What a file does not hold takes nothing from the roles that it names.
        mapping = own_roles(table, axis, masters) | mapping
    if not mapping:
        names = ", ".join(column.header or column.name for column in table.columns[:12])
        reason = (
            f"found columns {names} without a role, expected the job to say in columns:"
            f" {advice(table)}"
        )
        if table.form is not None and table.form.titles and not table.form.header:
            line = table.form.titles[-1]
            reason += f" (line {line}, right above the rows, does not name so many)"
        raise MeasurementError(source, reason)
    differs = axis is not None and table.axis is not None and axis != table.axis
    table, mapping = unfolded(*_counted(table, mapping))
    table, mapping = on_one_clock(table, mapping)
    good: dict[str, np.ndarray] = {}
    bad: dict[str, MeasurementError] = {}
    gaps: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    remarks = list(table.remarks)
    if differs and not columns:
        remarks.append(f"The file is of axis {table.axis}, and is taken for {axis}.")
    stated = list(_stated_units(table, mapping))
    angular = turning_axes(table, mapping) if rotary is None else set(rotary)
    inches = {
        axis: text for axis, text, unit in stated if unit.name in ("in", "thou", "uin")
    }
    for text, spec in mapping.items():
        role = named_role(text, source)
        if spec.value is not None:
            good[text], units[text] = _constant(table, role, spec, role.axis in angular)
            continue
        column = table.column(spec.column)
        if not role.dimensions:
            units[text] = ""
            try:
                if role.kind == "run":
                    good[text] = as_run(table, column)
                else:
                    _refuse_origin(source, role, column, spec)
                    good[text] = spec.factor * as_direction(
                        table, column, spec.positive
                    )
            except MeasurementError as error:
                bad[text] = error
            continue
        angle = role.axis in angular
        if role.kind == "time" and column.text is not None:
            units[text] = "s"
            try:
                good[text] = seconds_of_dates(table, column)
            except MeasurementError as error:
                bad[text] = error
            continue
        unit = unit_of(table, role, column, spec.unit, angle=angle)
        scale = None
        if unit.dimension.startswith("increments"):
            scale = (increments or {}).get(role.axis or "")
            if scale is None:
                reason = (
                    f"{role}: found unit 'inc' and no increment of axis {role.axis}"
                )
                reason += ", expected mm or ° per increment"
                raise MeasurementError(source, reason)
        units[text] = library_unit(unit, angle=angle)
        turned = role.kind == "error" and spec.sign is None
        if turned and says_correction(column.name):
            reason = (
                f"column '{column.name}': found a name of corrections, or of targets less what"
                f" was reached, for {role}, which is the reached less the target: state sign = -1"
                " of the column (columns), or sign = 1 if it holds errors all the same"
            )
            raise MeasurementError(source, reason)
        told = column.role in ("position", "error", "actual")
        told |= role.kind == "temperature" and column.role is None
        told |= table.format == SCOPE_FORMAT and role.kind not in ("time", "current")
        if column.unit is None and spec.unit is None and told:
            if role.axis in inches and unit.dimension == "length":
                reason = (
                    f"column '{column.name}': found no unit, and inches for '{inches[role.axis]}',"
                    " expected its unit: state it (in, thou, mm, um) in columns"
                )
                raise MeasurementError(source, reason)
            remarks.append(
                f"Column '{column.name}' states no unit: it is taken in {unit.name}."
            )
        if role.kind == "time" and column.unit is None and spec.unit is None:
            finite = column.values[np.isfinite(column.values)]
            largest = float(np.abs(finite).max(initial=0.0))
            if largest > MOST_SECONDS:
                reason = (
                    f"column '{column.name}': found a time of {largest:.3g} without a unit,"
                    " expected s: state its unit (s, ms, us, ns) in columns"
                )
                raise MeasurementError(source, reason)
            places = [
                table.column(other.column)
                for name, other in mapping.items()
                if name.endswith((".position", ".actual")) and other.column
            ]
            warmed = any(name.startswith("temperature.") for name in mapping)
            if (doubt := may_be_ms(column, places)) or warmed:
                words = f"Column '{column.name}' states no unit: it is taken in s"
                remarks.append(f"{words}, not in ms." if doubt else f"{words}.")
        if column.doubtful_unit and spec.unit is None and unit.name == column.unit:
            remarks.append(
                f"Column '{column.name}' is taken in {unit.name} from its name."
            )
        try:
            values = spec.factor * unit.to_library(table.numbers(column), scale)
        except MeasurementError as error:
            bad[text] = error
            if column.bad is not None:
                gaps[text] = spec.factor * unit.to_library(column.values, scale)
        else:
            good[text] = values
    for text, values in good.items():
        own = text.partition(".")[0]
        if units[text] != "deg" or own in (turns or {}):
            continue
        low, high = (ends or {}).get(own, (-np.inf, np.inf))
        inside = np.isnan(values) | ((values >= low) & (values <= high))
        if high - low <= 360.0 and inside.all():
            continue
        if (seen := passed_end(values)) is not None:
            reason = (
                f"{text}: found {seen[0]:.4g}° and then {seen[1]:.4g}° in motion, expected the"
                f" job to say that {own} goes round: modulo = [0.0, 360.0] of its axis"
                " (axcomp iso230: --modulo 0:360), or limits, where it has two ends"
            )
            raise MeasurementError(source, reason)
    for found in (good, gaps):
        found |= unwound(found, turns or {})
    remarks += _turned_legs(table, mapping, good)
    return Measurement(
        name=name or table.path.name,
        source=table.path,
        values=RoleValues(good, bad, gaps),
        units=units,
        rows=table.rows,
        lines=table.lines,
        remarks=tuple(remarks),
        format=table.format,
        form=table.form,
        skipped=table.skipped,
    )


def _of_one_kind(table: Table) -> None:
    """Refuse rows of several axes, or with compensations off and on, below each other.

    Raises:
        MeasurementError: If a column says that there are.
    """
    for column in table.columns:
        on_or_off = column.text is not None and says_correction(column.name)
        if on_or_off or is_axis_column(column.name):
            cells = column.text or [f"{value:g}" for value in column.values]
            names = sorted({cell.strip() for cell in cells} - {"", "nan"})
            if len(names) > 1:
                expected = (
                    "with the same compensations on" if on_or_off else "of one axis"
                )
                reason = (
                    f"column '{column.name}': found readings of {', '.join(names[:6])} below"
                    f" each other, expected readings {expected}: write a file of each, or"
                    " choose lines with rows"
                )
                raise MeasurementError(str(table.path), reason)


def _refuse_origin(source: str, role: Role, column: Column, spec: ColumnSpec) -> None:
    """Refuse a column of where an axis came from as directions of its motion.

    Raises:
        MeasurementError: If it is one, and nobody stated its sign.
    """
    if spec.sign is None and spec.positive is None and says_origin(column.name):
        reason = (
            f"column '{column.name}': found a name of where {role.axis} came from, for {role},"
            " which is where it goes: state sign = -1 of the column (columns), or sign = 1 if"
            " + is motion in + all the same"
        )
        raise MeasurementError(source, reason)


def _turned_legs(
    table: Table, mapping: Mapping[str, ColumnSpec], good: dict[str, np.ndarray]
) -> list[str]:
    """Turn directions that are named as the way there and back, where there is towards −.

    Returns:
        What was turned, in sentences.
    """
    remarks = []
    for text, spec in mapping.items():
        role = find_role(text)
        place = good.get(text.replace("direction", "position"))
        if (
            role is None
            or role.kind != "direction"
            or text not in good
            or place is None
        ):
            continue
        cells = table.column(spec.column).text if spec.column else None
        if spec.positive is not None or not cells or not all(map(is_leg, {*cells})):
            continue
        run = good.get("run", np.zeros(len(place), np.int64))
        wrong = runs_against(place, good[text], run, good.get("time"))
        plus, minus = (cells[int(np.argmax(k * good[text]))].strip() for k in (1, -1))
        if len(wrong) == len(np.unique(run)):
            good[text] = -good[text]
            remarks.append(
                f"'{minus}' is motion in + direction: so the positions follow each other."
            )
        elif all(_rises(place, run, good[text] == side) for side in (1, -1)):
            remarks.append(
                f"'{plus}' is taken for motion in + direction: the rows stand in the order of"
                " the positions, and not of the measurement. Where it is motion in −, state"
                f' positive = "{minus}" of the column.'
            )
    return remarks


def _rises(place: np.ndarray, run: np.ndarray, rows: np.ndarray) -> bool:
    """Whether the positions of some rows never go down from row to row within a run."""
    steps = np.diff(place[rows])[np.diff(run[rows]) == 0]
    return bool(np.all(steps >= 0.0) and np.any(steps > 0.0))


def advice(table: Table) -> str:
    """Return what a job may say in ``columns`` of a file without roles, as written there."""
    columns = table.advice
    if not columns:
        first, last = table.columns[0], table.columns[-1]
        for column in table.columns:
            if "error" in kinds_in(words_in([column.name])) or says_correction(
                column.name
            ):
                last = column
        sign = -1 if says_correction(last.name) else None
        columns = {
            "position": ColumnSpec(first.header or first.name),
            "error": ColumnSpec(last.header or last.name, sign=sign),
        }
    texts = (f'"<axis>.{kind}" = {spec.words()}' for kind, spec in columns.items())
    return f"{', '.join(texts)}{'' if table.advice else ' or others'}"


def _counted(
    table: Table, mapping: Mapping[str, ColumnSpec]
) -> tuple[Table, dict[str, ColumnSpec]]:
    """Return the table with a column for each role that is counted row by row."""
    result = dict(mapping)
    for text, spec in mapping.items():
        if spec.value is None or not spec.interval:
            continue
        values = spec.value + spec.interval * np.arange(table.rows)
        name = f"{text} by rows"
        remark = (
            f"{text} is counted: {values[0]:g} in line {table.lines[0]} to"
            f" {values[-1]:g} in line {table.lines[-1]}."
        )
        table = dataclasses.replace(
            table,
            columns=(*table.columns, Column(name, None, None, values, header=name)),
            remarks=(*table.remarks, remark),
        )
        result[text] = ColumnSpec(name, spec.unit, sign=spec.sign)
    return table, result


def _constant(
    table: Table, role: Role, spec: ColumnSpec, angle: bool
) -> tuple[np.ndarray, str]:
    """Return a value that a role has in all rows, and its unit."""
    assert spec.value is not None
    values = np.full(table.rows, spec.value)
    column = Column(f"{spec.value:g}", None, None, values)
    if role.kind in ("run", "direction"):
        convert = as_run if role.kind == "run" else as_direction
        return convert(table, column), ""
    unit = unit_of(table, role, column, spec.unit, angle=angle)
    return unit.to_library(values), library_unit(unit, angle=angle)


def _stated_units(
    table: Table, mapping: Mapping[str, ColumnSpec]
) -> Iterator[tuple[str, str, Unit]]:
    """Yield axis, role and unit where the job, or else the file, states the unit."""
    for text, spec in mapping.items():
        axis = named_role(text, str(table.path)).axis
        stated = table.column(spec.column).unit if spec.column else None
        unit = find_unit(spec.unit or stated or "")
        if axis and unit is not None:
            yield axis, text, unit


def turning_axes(table: Table, mapping: Mapping[str, ColumnSpec]) -> set[str]:
    """Return the axes whose positions are angles, as far as units say.

    The speed of a motor makes no angle of a position in mm.
    """
    stated = {(axis, unit.dimension) for axis, _, unit in _stated_units(table, mapping)}
    turning = {axis for axis, dimension in stated if dimension.startswith("angular")}
    turning -= {axis for axis, dimension in stated if dimension == "length"}
    return turning | {axis for axis, dimension in stated if dimension == "angle"}


def own_roles(
    table: Table, axis: str | None, masters: Sequence[str]
) -> dict[str, ColumnSpec]:
    """Return the mapping that the file itself implies; see `measurement`.

    Raises:
        MeasurementError: If it cannot tell what is meant.
    """
    mesh = table.format in MESH_FORMATS
    result: dict[str, ColumnSpec] = {}
    names = iter(masters)
    for column in table.columns:
        if column.role is None:
            continue
        text = column.role
        role = find_role(text)
        if role is None:  # a kind without an axis
            axis = axis or table.axis
            if axis is None:
                reason = (
                    f"found '{column.name}' without an axis, expected the axis it is of"
                )
                raise MeasurementError(str(table.path), reason)
            text = f"{axis}.{text}"
        elif mesh and role.kind == "error" and axis is not None:
            text = f"{axis}.error"
        elif mesh and role.kind == "position":
            text = f"{next(names, role.axis)}.position"
        spec = ColumnSpec(
            column.header or column.name, run=column.run, direction=column.direction
        )
        if column.run is not None:
            parts = result[text].parts if text in result else ()
            result[text] = ColumnSpec("", parts=(*parts, spec))
            continue
        if text in result:
            reason = (
                f"found columns '{result[text].column}' and '{column.name}' for {text}"
            )
            raise MeasurementError(str(table.path), f"{reason}, expected one")
        result[text] = spec
    return result

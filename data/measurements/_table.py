"""A measurement file as read: columns, rows and what was left out, in its own units."""

import dataclasses
import difflib
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from ._errors import CellError, ColumnError, MeasurementError
from ._roles import ColumnSpec

MESH_FORMATS = ("Klipper bed mesh", "RepRapFirmware height map")
LASER_FORMAT = "laser table"
SCOPE_FORMAT = "TwinCAT Scope"


@dataclasses.dataclass(frozen=True)
class Lines:
    """What a job says of the lines of a text table, each counted from 1.

    Attributes:
        skip: Lines that are left out.
        header: Lines with the names of the columns; empty: there are none; None: as
            the file shows it.
        rows: First and last line of the rows; None: as the file shows it.
    """

    skip: tuple[int, ...] = ()
    header: tuple[int, ...] | None = None
    rows: tuple[int, int] | None = None

    @staticmethod
    def of(
        skip: int | Sequence[int] = 0,
        header: int | Sequence[int] | None = None,
        rows: tuple[int, int] | None = None,
    ) -> "Lines | None":
        """Return what the keys of a job say; None where they say nothing.

        Args:
            skip: So many lines at the top, or which.
            header: Which lines; an empty sequence: none.
            rows: First and last.
        """
        omitted = tuple(range(1, skip + 1)) if isinstance(skip, int) else tuple(skip)
        if not omitted and header is None and rows is None:
            return None
        names = (header,) if isinstance(header, int) else header
        return Lines(omitted, None if names is None else tuple(names), rows)

    def keep(self, text: str) -> str:
        """Return a text with the lines blank that are left out; the others keep their place."""
        if not self.skip and self.rows is None and not self.header:
            return text
        lines = text.split("\n")
        last = self.rows[1] if self.rows else len(lines)
        names = self.header or ()
        top = min(names, default=1)
        return "\n".join(
            line
            if number in names or (number not in self.skip and top <= number <= last)
            else ""
            for number, line in enumerate(lines, start=1)
        )


@dataclasses.dataclass(frozen=True)
class TextForm:
    """How a text table was found to be written.

    Attributes:
        encoding: As Python names it.
        separator: Between cells; a blank stands for any run of blanks and tabs.
        decimal: Decimal mark.
        thousands: Mark between groups of digits, or ``""``.
        titles: Lines above the header that are neither names nor rows.
        header: Lines with the names of the columns.
        units: Line with their units, or None.
        first: Line of the first row.
    """

    encoding: str
    separator: str
    decimal: str
    thousands: str
    titles: tuple[int, ...]
    header: tuple[int, ...]
    units: int | None
    first: int


@dataclasses.dataclass(frozen=True)
class Skipped:
    """A line or cell that was left out of the rows, and why."""

    line: int
    reason: str


@dataclasses.dataclass(frozen=True)
class BadCell:
    """First cell of a number column that is no finite number."""

    line: int
    found: str


def first_bad(
    values: Float[np.ndarray, " t"],
    lines: Sequence[int] | Int[np.ndarray, " t"],
    cells: Sequence[str] | None = None,
) -> BadCell | None:
    """Return the first value that is no finite number; None: there is none.

    Args:
        values: Of a column.
        lines: Line of each.
        cells: What stands there; left out: the value.
    """
    invalid = np.flatnonzero(~np.isfinite(values))
    if not invalid.size:
        return None
    at = int(invalid[0])
    return BadCell(int(lines[at]), f"{values[at]}" if cells is None else cells[at])


@dataclasses.dataclass(frozen=True)
class Column:
    """One column in the unit of the file.

    Attributes:
        name: As the file names it, without a bracketed unit; its number where the file
            has no header.
        role: What it means where the file says so (``X.position``; ``position`` alone
            where the file does not say of which axis), else None.
        unit: Unit that the file states, in the library's spelling, or None; as it
            stands where the library does not know it (TwinCAT Scope).
        values: One number per row; NaN where the cell holds none. All NaN for text.
        text: The cells of a text column, else None.
        bad: First cell that is not a finite number, or None.
        header: Header text as it stands.
        doubtful_unit: The unit was read off a one-letter ending (``x_m``), which may
            mean something else.
        present: Rows at which the channel has a sample, where the file holds channels
            of several sample times; None: all.
        sample_time: In s, where the file states it, or None.
        run: Run that all readings of the column are of, in a table of one column per
            run; else None.
        direction: Direction ±1 that they are of, or None.
    """

    name: str
    role: str | None
    unit: str | None
    values: Float[np.ndarray, " t"]
    text: tuple[str, ...] | None = None
    bad: BadCell | None = None
    header: str = ""
    doubtful_unit: bool = False
    present: Bool[np.ndarray, " t"] | None = None
    sample_time: float | None = None
    run: int | None = None
    direction: int | None = None

    @property
    def kind(self) -> str:
        """Kind of its role, such as ``"error"``; empty without a role."""
        return (self.role or "").rpartition(".")[2]

    @property
    def samples(self) -> int:
        """Number of rows that hold a sample of this column."""
        return self.values.size if self.present is None else int(self.present.sum())

    def cell(self, row: int) -> float | str | None:
        """Return the sample in a row of its own; None where it is no finite number."""
        if self.text is not None:
            return self.text[row]
        values = self.values if self.present is None else self.values[self.present]
        value = float(values[row])
        return value if math.isfinite(value) else None

    def take(
        self, keep: Bool[np.ndarray, " t"], lines: Int[np.ndarray, " t"]
    ) -> "Column":
        """Return the column at some rows, of which each has a line."""
        values, text, bad = self.values[keep], self.text, None
        present = None if self.present is None else self.present[keep]
        if text is None:
            sampled = slice(None) if present is None else present
            bad = first_bad(values[sampled], lines[keep][sampled])
        else:
            text = tuple(itertools.compress(text, keep))
        return dataclasses.replace(
            self, values=values, text=text, bad=bad, present=present
        )


@dataclasses.dataclass(frozen=True)
class Table:
    """What a measurement file holds.

    Attributes:
        path: The file.
        format: In words: ``CSV``, ``Parquet``, ``laser table``, ``ISO 230-2 run
            table``, ``Klipper bed mesh``, ``RepRapFirmware height map``, ``TwinCAT
            Scope``, ``MATLAB``.
        columns: In file order.
        rows: Number of rows.
        lines: Line of the file per row (row number for Parquet and MATLAB).
        skipped: Everything that is not in the rows.
        remarks: What the reader took for granted, one sentence each.
        advice: Column by kind of role that a job may state where the file has no roles.
        counts_rows: `lines` are row numbers (Parquet, MATLAB).
        scalars: Single numbers that stand beside the columns, by name (MATLAB).
        missing: Number of readings that the file announces and lacks (run table).
        form: How a text table is written; None for all others.
        axis: Axis that the file says it is of, or None.
        across: Its errors are those of an axis across the one that moved: straightness.
        titles: What the lines above the header of a text table say, comments too, by line.
    """

    path: Path
    format: str
    columns: tuple[Column, ...]
    rows: int
    lines: Int[np.ndarray, " t"]
    skipped: tuple[Skipped, ...] = ()
    remarks: tuple[str, ...] = ()
    advice: Mapping[str, ColumnSpec] = dataclasses.field(default_factory=dict)
    counts_rows: bool = False
    scalars: tuple[tuple[str, float], ...] = ()
    missing: int = 0
    form: TextForm | None = None
    axis: str | None = None
    across: bool = False
    titles: Mapping[int, str] = dataclasses.field(default_factory=dict)

    def run_of(self, column: Column) -> int | None:
        """Return the run that all readings of a column are of, unless another column says it."""
        told = any(each.kind == "run" for each in self.columns)
        return None if told else column.run

    def column(self, name: str) -> Column:
        """Return a column by name or header text; by number where there is no header.

        Raises:
            ColumnError: If there is none, or several of that name.
        """
        label = name.strip()
        for form in (str.strip, str.casefold):
            hits = [
                column
                for column in self.columns
                if form(label) in (form(column.name), form(column.header))
            ]
            if len(hits) == 1:
                return hits[0]
            if hits:
                break
        names = [column.name for column in self.columns]
        label = hits[0].name if hits else label
        close = difflib.get_close_matches(label, names, n=1, cutoff=0.4)
        raise ColumnError(
            str(self.path), label, names, close[0] if close and not hits else None
        )

    def cell_error(
        self, column: Column, cell: BadCell, expected: str, *, damaged: bool = False
    ) -> CellError:
        """Return the error that a cell of this table is, ready to raise.

        A line or a row that is damaged can be left out by a key of the job.
        """
        numbered = self.form is not None or self.counts_rows
        key = f"skip = [{cell.line}]" if damaged and numbered else ""
        return CellError(
            str(self.path),
            cell.line,
            column.name,
            cell.found,
            expected,
            self.counts_rows,
            key,
        )

    def numbers(self, column: Column) -> Float[np.ndarray, " t"]:
        """Return the values of a column, which must all be finite numbers.

        Raises:
            CellError: Naming the first cell that is none.
            MeasurementError: If the column has samples at some of the rows only.
        """
        if column.present is not None and column.samples < self.rows:
            reason = (
                f"found {column.samples} samples of '{column.name}' at {self.rows} "
                "instants, expected one each: `measurement` brings channels together"
            )
            raise MeasurementError(str(self.path), reason)
        if column.text is not None:
            first = BadCell(int(self.lines[0]), column.text[0])
            turns = "°" in first.found
            raise self.cell_error(
                column, first, "decimal degrees" if turns else "a number"
            )
        if column.bad is not None:
            raise self.cell_error(column, column.bad, "a finite number", damaged=True)
        return column.values


def number_columns(
    body: Float[np.ndarray, "t k"], names: Iterable[tuple[str, str, str | None]]
) -> tuple[Column, ...]:
    """Return columns of numbers by name, role and unit, the first ones of an array."""
    return tuple(
        Column(name, role, unit, np.ascontiguousarray(body[:, at]), header=name)
        for at, (name, role, unit) in enumerate(names)
    )

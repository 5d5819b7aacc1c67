"""What can be wrong with a measurement, each with the place and what was expected."""

from collections.abc import Sequence
from pathlib import Path

from ..errors import AxcompError, SourceError


class MeasurementError(SourceError, ValueError):
    """A measurement file or its use is wrong: where, and why."""


def damaged(path: Path, kind: str, error: Exception) -> MeasurementError:
    """Return the error that a file is which a library cannot read, ready to raise."""
    words = (str(error).splitlines() or ["unreadable"])[0][:80]
    reason = f"found damaged {kind} data ({words}), expected a whole file"
    return MeasurementError(str(path), reason)


class CellError(MeasurementError):
    """One cell does not hold what its column needs.

    Attributes:
        source: File.
        line: Line of a text file (1-based), or row of a Parquet file where `rows` is
            true.
        column: Name of the column, or its number.
        found: Text of the cell.
        expected: What should stand there.
        key: As of `LineError`.
    """

    def __init__(
        self,
        source: str,
        line: int,
        column: str,
        found: str,
        expected: str,
        rows: bool = False,
        key: str = "",
    ) -> None:
        AxcompError.__init__(self, source, line, column, found, expected, rows, key)
        self.source, self.line, self.column = source, line, column
        self.found, self.expected, self.rows, self.key = found, expected, rows, key
        reason = f"column '{column}': found {_quoted(found)}, expected {expected}"
        self.reason = reason + _hint(key)

    def __str__(self) -> str:
        if self.rows:
            return f"{self.source}: row {self.line}, {self.reason}"
        return f"{self.source}:{self.line}: {self.reason}"


class LineError(MeasurementError):
    """One line of a text file does not follow the file's own pattern.

    Attributes:
        source: File.
        line: Its number (1-based).
        found: What stands there.
        expected: What should.
        key: Key of the measurement in a job that helps, such as ``skip = [7]``.
    """

    def __init__(
        self, source: str, line: int, found: str, expected: str, key: str = ""
    ) -> None:
        AxcompError.__init__(self, source, line, found, expected, key)
        self.source, self.line, self.found = source, line, found
        self.expected, self.key = expected, key
        self.reason = f"found {found}, expected {expected}{_hint(key)}"

    def __str__(self) -> str:
        return f"{self.source}:{self.line}: {self.reason}"


class ColumnError(MeasurementError):
    """A column that was asked for is not there, or its name stands for several."""

    def __init__(
        self, source: str, column: str, names: Sequence[str], nearest: str | None
    ) -> None:
        AxcompError.__init__(self, source, column, tuple(names), nearest)
        self.source, self.column = source, column
        self.names, self.nearest = tuple(names), nearest
        hint = f" (nearest: '{nearest}')" if nearest else ""
        count = sum(name == column for name in names)
        found = f"{count} columns named" if count > 1 else "no column"
        if count > 1:
            hint = " (or the job says header = [], with columns by number)"
        self.reason = (
            f"found {found} '{column}', expected one of {_listed(names)}{hint}"
        )


class UnitError(MeasurementError):
    """A unit is unknown, or is not one of the units that a role can have."""

    def __init__(
        self, source: str, what: str, found: str, accepted: Sequence[str], nearest: str
    ) -> None:
        AxcompError.__init__(self, source, what, found, tuple(accepted), nearest)
        self.source, self.what, self.found = source, what, found
        self.accepted, self.nearest = tuple(accepted), nearest
        self.reason = f"{what}: found unit '{found}', expected {_listed(accepted)} "
        if nearest:
            self.reason += f"(nearest: {nearest})"
        else:
            self.reason += "(convert the column, or state its unit in the job)"


class RoleError(MeasurementError):
    """A role is not one that the library knows."""

    def __init__(self, source: str, role: str, nearest: str, expected: str) -> None:
        AxcompError.__init__(self, source, role, nearest, expected)
        self.source, self.role = source, role
        self.nearest, self.expected = nearest, expected
        self.reason = f"found role '{role}', expected {expected} (nearest: '{nearest}')"


class MissingRole(MeasurementError):
    """A measurement lacks a role that is needed."""

    def __init__(
        self, source: str, role: str, why: str, present: Sequence[str]
    ) -> None:
        AxcompError.__init__(self, source, role, why, tuple(present))
        self.source, self.role, self.why = source, role, why
        self.present = tuple(present)
        holds = _listed(present) if present else "nothing"
        self.reason = f"found {holds}, expected '{role}' {why}".rstrip()


class DirectionUnknown(MeasurementError):
    """From which side the targets were approached cannot be told from the data."""


def _hint(key: str) -> str:
    return f" (or the job says {key})" if key else ""


def _listed(names: Sequence[str], limit: int = 12) -> str:
    text = ", ".join(names[:limit])
    return text if len(names) <= limit else f"{text}, … ({len(names)} in all)"


def _quoted(text: str) -> str:
    return "an empty cell" if text.strip() == "" else f"'{text.strip()[:60]}'"

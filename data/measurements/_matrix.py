r"""Surfaces as a spreadsheet holds them: one axis along the top, the other down the side.

The cell in the corner names both axes: ``Y\X``, or ``Y [mm] \ X [mm]``.
"""

import dataclasses
import re
from pathlib import Path

import numpy as np

from ._dialect import Dialect
from ._errors import CellError, LineError
from ._header import unit_in, unit_of_title
from ._mesh import surface
from ._table import Skipped, Table

_AXIS = r"(?P<{0}>[A-Za-z])\s*(?:[\[(](?P<{0}_unit>[^\])]+)[\])])?"
_CORNER = re.compile(
    rf'^"?\s*{_AXIS.format("down")}\s*[\\/]\s*{_AXIS.format("along")}\s*"?(?P<mark>[;,\t])'
    r'(?=\s*"?[-+.\d])',  # "t/s;x/mm" are columns with their units
    re.MULTILINE,
)
_EMPTY = re.compile("")
_AXES = "XYZ"
_LOOK = 60
"""Lines that tell whether a text is a surface."""
_TITLES = 20
"""Lines above a surface at most."""
_LARGER = 5.0
"""Ratio of places to what was measured there from which on both are told apart."""
_FEWEST = 3
"""Numbers along the top from which on a line without names is taken for one."""


def is_matrix(head: str) -> bool:
    """Whether a line begins with a cell that names two axes, or the first with none."""
    named = ("/" in head or "\\" in head) and _CORNER.search(head) is not None
    return named or _unnamed_corner(head) is not None


def _unnamed_corner(head: str) -> str | None:
    """Return the first cell of a surface of which nobody says along which axes it lies.

    The cell is empty, 0 or a word, and ascending numbers stand behind it and below it. Where it
    is 0, these also are of another size than all other numbers, and where it is a word, they do
    not count runs: it may be a plain table.
    """
    mark = next((sign for sign in ";\t," if sign in head), "")
    lines = head.split("\n", _TITLES + _LOOK)[: _TITLES + _LOOK]
    wide = (n for n, line in enumerate(lines[:_TITLES]) if line.count(mark) >= _FEWEST)
    if not mark or (first := next(wide, None)) is None:
        return None
    top, *below = lines[first:]
    rows = [line.split(mark) for line in (top, *below[:_LOOK]) if line.strip()]
    corner, *heads = (_plain_number(cell) for cell in rows[0])
    along = [value for value in heads if value is not None]
    if not len(heads) == len(along) >= _FEWEST or along != sorted(set(along)):
        return None
    if not rows[0][0].strip(' "'):
        return ""
    numbers = [[_plain_number(cell) for cell in row] for row in rows[1:]]
    sides = [row[0] for row in numbers if row[0] is not None]
    if corner is None and len(sides) == len(numbers) >= _FEWEST:
        rising = sides == sorted(set(sides)) and not (_counts(along) or _counts(sides))
        return rows[0][0].strip(' "') if rising else None
    full = [row for row in numbers if None not in row and len(row) == len(rows[0])]
    if corner != 0.0 or len(full) < _FEWEST or len(full) < len(numbers) - 1:
        return None
    body = np.array(full, dtype=np.float64)
    jumps = np.abs(np.array(along) - np.median(body[:, 1:], axis=0))
    rises = bool(np.all(np.diff(body[:, 0]) > 0.0))
    larger = jumps.sum() > _LARGER * np.ptp(body[:, 1:], axis=0).sum()
    return rows[0][0].strip() if rises and larger else None


def _counts(values: list[float]) -> bool:
    return bool(np.all(np.diff(values) == 1.0))


def _plain_number(cell: str) -> float | None:
    return (
        Dialect(";", ".").number(cell.strip(' "\r').replace(",", "."))
        if cell.strip()
        else None
    )


def read_matrix(path: Path, text: str) -> Table:
    """Return one row per cell that holds a value: two positions and the error.

    An error between two of X, Y and Z is one of the third. Its unit is taken from the titles;
    positions without one are in mm. Empty cells are listed as skipped.

    Raises:
        CellError: If a cell is no number.
        LineError: If the corner names no axes, a line has more or fewer cells than the first
            or the position of another, or there is none below it.
    """
    corner = _CORNER.search(text)
    if corner is None:
        cell = _unnamed_corner(text)
        found = "ascending numbers along the top beside an empty cell"
        if cell:
            found = f"ascending numbers along the top and down the side beside '{cell}'"
        expected = "both axes in that cell, the one down the side first: Y\\X"
        advice = "header = [] where it is no surface" if cell == "0" else ""
        tops = enumerate(text.split("\n"), 1)
        at = next(n for n, line in tops if max(map(line.count, ";\t,")) >= _FEWEST)
        raise LineError(str(path), at, found, expected, advice)
    lines = text.split("\n")
    top = text.count("\n", 0, corner.start())
    # Y/X is written like a fraction, Y below the line; X/Y by some with X across.
    if "/" in corner[0] and corner["down"].upper() < corner["along"].upper():
        found = f"'{corner[0][:-1].strip()}', where a slash is read either way"
        expected = "a backslash behind the axis down the side: Y\\X"
        raise LineError(str(path), top + 1, found, expected)
    body = [(n, line) for n, line in enumerate(lines[top:], top + 1) if line.strip()]
    commas = corner["mark"] != "," and any("," in line for _, line in body)
    dialect = Dialect(corner["mark"], "," if commas else ".")
    names = (corner["along"].upper(), corner["down"].upper())
    (first, line), *below = body
    heads = dialect.split(line)[1:]
    while heads and not heads[-1]:
        heads.pop()
    along = [_number(path, dialect, first, names[0], cell) for cell in heads]
    sides: dict[float, int] = {}
    points = []
    for number, line in below:
        head, *cells = dialect.split(line)
        if not any((head, *cells)):
            continue
        while len(cells) > len(along) and not cells[-1]:
            cells.pop()
        side = _number(path, dialect, number, names[1], head)
        if side in sides:
            found = f"{names[1]} {side:g} a second time"
            expected = f"every position once (line {sides[side]})"
            raise LineError(str(path), number, found, expected)
        sides[side] = number
        points.append((number, [cell.replace(",", ".") for cell in cells]))
    if not points:
        found, expected = f"'{corner[0].strip()}' and no value", "rows of values below"
        raise LineError(str(path), first, found, expected)
    third = [axis for axis in _AXES if axis not in names]
    role = f"{third[0]}.error" if len(third) == 1 else "error"
    units = [_unit(corner["along_unit"]) or "mm", _unit(corner["down_unit"]) or "mm"]
    remark = (
        f"Positions of {names[0]} stand along the top in {units[0]}, of {names[1]} down"
        f" the side in {units[1]}; the values are taken as {role}."
    )
    axes = (np.array(along), np.array(list(sides)))
    form = "matrix of a surface"
    table = surface(path, form, names, axes, points, [remark], _EMPTY)
    stated = next(filter(None, map(unit_of_title, lines[:top])), None)
    column_units = [*units, stated]
    titles = (
        Skipped(n, "title") for n, line in enumerate(lines[:top], 1) if line.strip()
    )
    return dataclasses.replace(
        table,
        columns=tuple(
            dataclasses.replace(column, unit=unit, role=kind)
            for column, unit, kind in zip(
                table.columns,
                column_units,
                (*(f"{name}.position" for name in names), role),
                strict=True,
            )
        ),
        skipped=(*titles, *table.skipped),
    )


def _number(path: Path, dialect: Dialect, line: int, name: str, cell: str) -> float:
    value = dialect.number(cell)
    if value is None or not np.isfinite(value):
        raise CellError(str(path), line, name, cell, "a finite number")
    return value


def _unit(text: str | None) -> str | None:
    return None if text is None else unit_in(text)

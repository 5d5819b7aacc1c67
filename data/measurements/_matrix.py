r"""Surfaces as a spreadsheet holds them: one axis along the top, the other down the side.

The cell in the corner names both axes: ``Y\X``, or ``Y [mm] \ X [mm]``.
"""

import dataclasses
import re
from pathlib import Path

import numpy as np

from ._dialect import Dialect
from ._errors import CellError, LineError
from ._header import parse_name, unit_in
from ._mesh import surface
from ._table import Skipped, Table

_AXIS = r"(?P<{0}>[A-Za-z])\s*(?:[\[(](?P<{0}_unit>[^\])]+)[\])])?"
_CORNER = re.compile(
    rf'^"?\s*{_AXIS.format("down")}\s*[\\/]\s*{_AXIS.format("along")}\s*"?(?P<mark>[;,\t])',
    re.MULTILINE,
)
_IN = re.compile(r"\bin\s+(\S+)|[\[(]([^\])]+)[\])]")
_EMPTY = re.compile("")
_AXES = "XYZ"
_FEWEST = 3
"""Numbers along the top from which on a line without names is taken for one."""


def is_matrix(head: str) -> bool:
    """Whether a line begins with a cell that names two axes, or the first with none."""
    return _CORNER.search(head) is not None or _is_unnamed(head.partition("\n")[0])


def _is_unnamed(line: str) -> bool:
    """Whether a line holds an empty cell and ascending numbers: nobody says of which axis."""
    mark = line.lstrip(' "')[:1]
    if mark not in (";", ",", "\t"):
        return False
    cells = line.rstrip("\r\n").split(mark)[1:]
    dialect = Dialect(mark, ".")
    read = [dialect.number(cell.replace(",", ".")) for cell in cells]
    along = [value for value in read if value is not None]
    return len(along) == len(cells) >= _FEWEST and along == sorted(set(along))


def read_matrix(path: Path, text: str, encoding: str) -> Table:
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
        found = "ascending numbers along the top beside an empty cell"
        expected = "both axes in that cell, the one down the side first: Y\\X"
        raise LineError(str(path), 1, found, expected)
    lines = text.split("\n")
    top = text.count("\n", 0, corner.start())
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
    read = surface(path, form, names, axes, points, [remark], _EMPTY)
    every = [*units, _unit_of_titles(lines[:top])]
    titles = (
        Skipped(n, "title") for n, line in enumerate(lines[:top], 1) if line.strip()
    )
    return dataclasses.replace(
        read,
        columns=tuple(
            dataclasses.replace(column, unit=unit, role=own)
            for column, unit, own in zip(
                read.columns,
                every,
                (*(f"{name}.position" for name in names), role),
                strict=True,
            )
        ),
        skipped=(*titles, *read.skipped),
    )


def _number(path: Path, dialect: Dialect, line: int, name: str, cell: str) -> float:
    value = dialect.number(cell)
    if value is None or not np.isfinite(value):
        raise CellError(str(path), line, name, cell, "a finite number")
    return value


def _unit(text: str | None) -> str | None:
    return None if text is None else unit_in(text)


def _unit_of_titles(titles: list[str]) -> str | None:
    """Return the unit that the titles name: ``deviation in µm``, ``dz [µm]``."""
    for title in titles:
        stated = parse_name(title.strip(' ";,\t')).unit
        found = [stated, *(_unit(a or b) for a, b in _IN.findall(title))]
        if unit := next(filter(None, found), None):
            return unit
    return None

r"""Surfaces as a spreadsheet holds them: one axis along the top, the other down the side.

The cell in the corner names both axes: ``Y\X``, or ``Y [mm] \ X [mm]``.
"""

import re
from pathlib import Path

import numpy as np

from ._dialect import Dialect
from ._errors import CellError, LineError
from ._header import parse_name, unit_in
from ._table import Column, Skipped, Table

_AXIS = r"(?P<{0}>[A-Za-z])\s*(?:[\[(](?P<{0}_unit>[^\])]+)[\])])?"
_CORNER = re.compile(
    rf'^"?\s*{_AXIS.format("down")}\s*[\\/]\s*{_AXIS.format("along")}\s*"?(?P<mark>[;,\t])',
    re.MULTILINE,
)
_IN = re.compile(r"\bin\s+(\S+)|[\[(]([^\])]+)[\])]")
_AXES = "XYZ"


def is_matrix(head: str) -> bool:
    """Whether a line begins with a cell that names two axes."""
    return _CORNER.search(head) is not None


def read_matrix(path: Path, text: str, encoding: str) -> Table:
    """Return one row per cell that holds a value: two positions and the error.

    An error between two of X, Y and Z is one of the third. Its unit is taken from the titles;
    positions without one are in mm. Empty cells are listed as skipped.

    Raises:
        CellError: If a cell is no number.
        LineError: If a line has more or fewer cells than the first or the position of another,
            or there is none below it.
    """
    corner = _CORNER.search(text)
    assert corner is not None  # of `is_matrix`
    top = text.count("\n", 0, corner.start())
    lines = text.split("\n")
    body = [line for line in lines[top:] if line.strip()]
    decimal = "," if corner["mark"] != "," and "," in "".join(body) else "."
    dialect = Dialect(corner["mark"], decimal)
    names = [corner["along"].upper(), corner["down"].upper()]
    along: list[float] = []
    rows: list[tuple[float, float, float, int]] = []
    sides: dict[float, int] = {}
    skipped = [
        Skipped(n, "title") for n, line in enumerate(lines[:top], 1) if line.strip()
    ]
    for number, line in enumerate(lines[top:], top + 1):
        first, *cells = dialect.split(line)
        if not any((first, *cells)):
            continue
        if not along:
            while cells and not cells[-1]:
                cells.pop()
            along = [_number(path, dialect, number, names[0], cell) for cell in cells]
            continue
        if any(cells[len(along) :]) or len(cells) < len(along):
            found = f"{len(cells)} cells ('{line.strip()[:40]}')"
            expected = f"{len(along)} as many as positions of {names[0]} in the first"
            raise LineError(str(path), number, found, expected)
        side = _number(path, dialect, number, names[1], first)
        if side in sides:
            found = f"{names[1]} {side:g} a second time"
            expected = f"every position once (line {sides[side]})"
            raise LineError(str(path), number, found, expected)
        sides[side] = number
        for place, cell in zip(along, cells, strict=False):
            at = f"{names[0]} {place:g}, {names[1]} {side:g}"
            if cell:
                value = _number(path, dialect, number, f"error at {at}", cell)
                rows.append((place, side, value, number))
            else:
                skipped.append(Skipped(number, f"not probed: {at}"))
    if not rows:
        found, expected = f"'{corner[0].strip()}' and no value", "rows of values below"
        raise LineError(str(path), top + 1, found, expected)
    third = [axis for axis in _AXES if axis not in names]
    role = f"{third[0]}.error" if len(third) == 1 else "error"
    values = np.array(rows)
    units = [_unit(corner["along_unit"]) or "mm", _unit(corner["down_unit"]) or "mm"]
    named = [*zip(names, units, strict=True), (role, _unit_of_titles(lines[:top]))]
    roles = [*(f"{name}.position" for name in names), role]
    return Table(
        path=path,
        format="matrix of a surface",
        columns=tuple(
            Column(name, role, unit, values[:, k].copy(), header=name)
            for k, ((name, unit), role) in enumerate(zip(named, roles, strict=True))
        ),
        rows=len(rows),
        lines=values[:, 3].astype(np.int64),
        skipped=tuple(skipped),
        remarks=(
            f"Positions of {names[0]} stand along the top in {units[0]}, of {names[1]} down"
            f" the side in {units[1]}; the values are taken as {role}.",
        ),
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

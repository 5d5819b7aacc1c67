"""The neighbouring formats as text: CSV, LinuxCNC, bed mesh, height map.

Signs. A CSV holds the entries as the list has them. LinuxCNC's file holds where the joint
really was (``COMP_FILE_TYPE = 0``: nominal, forward, reverse) or what is to be added
(type 1: nominal − actual; ``usrmotLoadComp`` in LinuxCNC's ``src/emc/motion/usrmotintf.cc``);
a leadscrew entry is actual − nominal. Meshes hold heights: the error as it stands, whose
negative is the offset that a plane holds.
"""

import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...data.measurements import MESH_FORMATS, Table, find_unit, read_table
from ..kinds import kind
from ._convert import MASTERS, ExchangedTable
from ._errors import ExchangeError

FORMATS = ("list", "csv", "linuxcnc", "bed-mesh", "height-map")
_ENDINGS = {
    ".lis": "list",
    ".csv": "csv",
    ".comp": "linuxcnc",
    ".dat": "linuxcnc",
    ".cfg": "bed-mesh",
}
_MOST = 256
"""Points that LinuxCNC takes (EMCMOT_COMP_SIZE)."""
_HEAD = re.compile(
    r"#\s*(?P<name>\w+) of axis (?P<axis>\d+)(?: over (?P<masters>[\d, ]+))?"
    r"(?P<modulo>, modulo)?"
)
_UNEVEN = 1e-3


def format_of(path: Path) -> str:
    """Return the format that the ending of a name stands for.

    Raises:
        ExchangeError: If it stands for none.
    """
    found = _ENDINGS.get(path.suffix.casefold())
    if found is None:
        endings = ", ".join(f"{end} ({name})" for end, name in _ENDINGS.items())
        expected = f"one of {endings}, or --to {'|'.join(FORMATS)}"
        raise ExchangeError(str(path), f"the ending {path.suffix!r}", expected)
    return found


def text_of(table: ExchangedTable, form: str, *, trim: bool = False) -> str:
    """Return a table in one of the formats; lengths in mm (or °), to 0.1 µm.

    Args:
        table: The table.
        form: ``csv``, ``linuxcnc``, ``bed-mesh`` or ``height-map``.
        trim: LinuxCNC's ``COMP_FILE_TYPE = 1`` instead of 0.

    Raises:
        ExchangeError: If the format cannot hold it.
    """
    if form == "csv":
        return _csv(table)
    if form == "linuxcnc":
        return _linuxcnc(table, trim)
    if MASTERS.get(table.compensation) != 2:
        raise ExchangeError(form, f"a {table.compensation} table", "a plane")
    steps = [np.diff(each) for each in table.nodes]
    if any(each.size and np.ptp(each) > _UNEVEN for each in steps):
        raise ExchangeError(form, "nodes at uneven distances", "evenly spaced ones")
    return _bed_mesh(table) if form == "bed-mesh" else _height_map(table)


def table_of_file(path: Path, *, trim: bool = False) -> ExchangedTable:
    """Return the table of a file, recognised by its content: no list.

    Args:
        path: A CSV, a LinuxCNC file, a bed mesh or a height map.
        trim: LinuxCNC's ``COMP_FILE_TYPE = 1`` instead of 0.

    Raises:
        ExchangeError: If it holds no table.
        MeasurementError: If it cannot be read.
    """
    if _ENDINGS.get(path.suffix.casefold()) == "linuxcnc":
        return _of_triplets(path, trim)
    table = read_table(path)
    if table.format in MESH_FORMATS:
        return _of_mesh(table)
    return _of_csv(table)


def _number(value: float) -> str:
    return f"{round(value, 4) + 0.0:.4f}"


def _csv(table: ExchangedTable) -> str:
    head = f"# {table.compensation} of axis {table.axis}"
    if table.masters:
        head += f" over {', '.join(map(str, table.masters))}"
    head += ", modulo" * table.modulo
    names, entries = ["position"], list(table.entries)
    if len(table.nodes) == 2:
        names, entries = ["master 1", "master 2"], [table.entries.ravel()]
    known = kind(table.compensation).entries.columns if table.compensation else ()
    names += (known or ("correction",))[: len(entries)]
    columns = [*(place.ravel() for place in np.meshgrid(*table.nodes)), *entries]
    return _lines(
        head,
        ",".join(f"{name} [mm]" for name in names),
        *(",".join(map(_number, row)) for row in zip(*columns, strict=True)),
    )


def _of_csv(table: Table) -> ExchangedTable:
    """Return the table of a CSV: positions first, then entries."""
    with table.path.open(encoding="utf-8", errors="replace") as file:
        head = _HEAD.match(file.readline())
    columns = [_lengths(table, k) for k in range(len(table.columns))]
    if len(columns) not in (2, 3):
        raise ExchangeError(
            where=str(table.path),
            found=f"{len(columns)} columns",
            expected="positions, then one or two of entries",
        )
    name = head["name"] if head else ""
    axis = int(head["axis"]) if head else None
    over = head["masters"] if head else None
    masters = tuple(map(int, over.split(", "))) if over else ()
    on_grid = not name and table.columns[1].name.startswith("master")
    if on_grid or MASTERS.get(name) == 2:
        return dataclasses.replace(_of_grid(table, columns), axis=axis, masters=masters)
    modulo = bool(head and head["modulo"])
    rows = np.stack(columns[1:])
    return ExchangedTable(name, axis, masters, (columns[0],), rows, modulo)


def _lengths(table: Table, number: int) -> Float[np.ndarray, " t"]:
    """Return a column in mm (or °); without a unit it counts as that."""
    column = table.columns[number]
    unit = find_unit(column.unit or "mm")
    if unit is None or unit.dimension not in ("length", "angle"):
        raise ExchangeError(
            where=f"{table.path}: {column.name}",
            found=f"unit {column.unit}",
            expected="a length or an angle",
        )
    return unit.to_library(table.numbers(column))


def _linuxcnc(table: ExchangedTable, trim: bool) -> str:
    if MASTERS.get(table.compensation) != 0 or table.modulo:
        found = f"a {table.compensation} table" + " that goes round" * table.modulo
        expected = "a leadscrew table of a linear axis"
        raise ExchangeError(where="linuxcnc", found=found, expected=expected)
    (nodes,) = table.nodes
    if len(nodes) > _MOST:
        found, expected = f"{len(nodes)} points", f"at most {_MOST}"
        raise ExchangeError(where="linuxcnc", found=found, expected=expected)
    values = [-each if trim else nodes + each for each in table.entries]
    columns = [nodes, values[0], values[-1]]
    return _lines(*(" ".join(map(_number, row)) for row in zip(*columns, strict=True)))


def _of_triplets(path: Path, trim: bool) -> ExchangedTable:
    rows: list[list[float]] = []
    for number, line in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        try:
            row = [float(cell) for cell in line.split()]
        except ValueError:
            row = [math.nan]
        if len(row) not in (0, 3):
            # LinuxCNC itself stops reading here without a word.
            raise ExchangeError(
                where=f"{path}:{number}",
                found=repr(line.strip()),
                expected="three numbers: nominal, forward, reverse",
            )
        rows += [row] if row else []
    nodes, *values = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    if len(nodes) < 2 or np.any(np.diff(nodes) <= 0):
        found = (
            f"{len(nodes)} points" if len(nodes) < 2 else "points that do not ascend"
        )
        raise ExchangeError(str(path), found, "two or more, ascending")
    entries = np.stack([-each if trim else each - nodes for each in values])
    if np.allclose(entries[0], entries[1], 0.0, 1e-9):
        entries = entries[:1]
    return ExchangedTable("leadscrew", None, (), (nodes,), entries)


def _of_mesh(table: Table) -> ExchangedTable:
    found = _of_grid(table, [_lengths(table, k) for k in range(3)])
    return dataclasses.replace(found, entries=-found.entries)


def _of_grid(
    table: Table, columns: Sequence[Float[np.ndarray, " t"]]
) -> ExchangedTable:
    """Return a plane of the places of both masters and the values there."""
    first, i = np.unique(columns[0], return_inverse=True)
    second, j = np.unique(columns[1], return_inverse=True)
    values = np.full((len(second), len(first)), np.nan)
    values[j, i] = columns[2]
    holes = int(np.isnan(values).sum())
    if holes:
        found = f"{holes} of {values.size} places without a value"
        expected = f"a full grid; a fit fills it: axcomp new {table.path.name}"
        raise ExchangeError(str(table.path), found, expected)
    return ExchangedTable("plane", None, (), (first, second), values)


def _lines(*lines: str) -> str:
    return "\n".join([*lines, ""])


def _heights(table: ExchangedTable) -> list[str]:
    return [", ".join(_number(-value) for value in row) for row in table.entries]


def _bed_mesh(table: ExchangedTable) -> str:
    x, y = table.nodes
    lines = ["[bed_mesh default]", "version = 1", "points ="]
    lines += [f"\t  {row}" for row in _heights(table)]
    lines += [f"x_count = {len(x)}", f"y_count = {len(y)}"]
    lines += ["mesh_x_pps = 0", "mesh_y_pps = 0", "algo = direct", "tension = 0.2"]
    lines += [f"min_x = {_number(x[0])}", f"max_x = {_number(x[-1])}"]
    lines += [f"min_y = {_number(y[0])}", f"max_y = {_number(y[-1])}"]
    # As Klipper's SAVE_CONFIG writes it.
    return _lines(*(f"#*# {line}" for line in lines))


def _height_map(table: ExchangedTable) -> str:
    (x, y), z = table.nodes, -table.entries
    spacing = [
        float(np.mean(np.diff(each))) if len(each) > 1 else 1.0 for each in (x, y)
    ]
    ends = [x[0], x[-1], y[0], y[-1], -1.0, *spacing]
    return _lines(
        "RepRapFirmware height map file v2 generated by axcomp,"
        f" min error {z.min():.3f}, max error {z.max():.3f},"
        f" mean {z.mean():.3f}, deviation {z.std():.3f}",
        "axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1",
        f"X,Y,{','.join(map(_number, ends))},{len(x)},{len(y)}",
        *_heights(table),
    )

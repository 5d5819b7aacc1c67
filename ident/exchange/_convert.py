"""Tables between lists and neighbouring formats: CSV, LinuxCNC, bed mesh, height map.

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
from typing import Any, final

import numpy as np
from jaxtyping import Float

from ...data.lists import ListFile, new_list
from ...data.measurements import (
    MESH_FORMATS,
    WORDS,
    Table,
    direction_of,
    find_unit,
    pieces,
    read_table,
    says_correction,
    words_in,
)
from ...models import EquidistantNodes, Setpoints
from ..kinds import kind
from ._axis_models import AxisModels, load_model
from ._nodes import refuse_unordered
from ._units import LIST_UNITS, ExchangeError, expect

MASTERS = {"leadscrew": 0, "cross": 1, "plane": 2}
"""Compensations that are tables over positions, and how many masters each has."""
HEIGHTS = (
    "Heights of a mesh count as errors, + where the axis stands too high; entries of a plane are"
    " their negative. What the machine's own probe reads on a flat reference is the negative of"
    " the error: a plane of such a mesh comes from a job (axcomp new)."
)
"""What is said where a mesh is read or written."""
_GRID = 1e-3
"""mm or ° by which nodes may be off an even grid of whole list units."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class ExchangedTable:
    """A table as every format can say it; lengths in mm (or °).

    Attributes:
        compensation: ``leadscrew``, ``cross``, ``plane``; empty: the format does not say.
        axis: Number of the compensated axis, or None where the format does not say.
        masters: Numbers of the masters, master 1 first; empty where it does not say.
        nodes: Positions per master (leadscrew: of the axis itself).
        entries: As in the list: errors of a leadscrew, shape ``(1, n)`` or ``(2, n)`` by
            direction, offsets of a cross table ``(1, n)``, of a plane ``(j, i)``.
        modulo: A leadscrew table whose first and last node are the same place.
        holds: ``errors`` or ``offsets``, where the names of the columns say so.
        remarks: What was taken for granted, one sentence each.
    """

    compensation: str
    axis: int | None
    masters: tuple[int, ...]
    nodes: tuple[Float[np.ndarray, " _"], ...]
    entries: Float[np.ndarray, "k n"]
    modulo: bool = False
    holds: str = ""
    remarks: tuple[str, ...] = ()

    def stated(
        self, compensation: str | None, axis: int | None, masters: Sequence[int]
    ) -> "ExchangedTable":
        """Return the table with what the user states of it, unless the format says else."""
        given = {"compensation": compensation, "axis": axis, "masters": tuple(masters)}
        changes: dict[str, Any] = {k: value for k, value in given.items() if value}
        for key, value in changes.items():
            held = getattr(self, key)
            expect(not held or held == value, key, held, f"{value}, as stated")
        stated = dataclasses.replace(self, **changes)
        own = stated.compensation != "leadscrew" and stated.axis in stated.masters
        found = f"axis {stated.axis}, which the table compensates"
        expect(not own, "master", found, "another axis")
        return stated


def table_in(
    listing: ListFile, compensation: str | None = None, increment: float | None = None
) -> ExchangedTable:
    """Return the table that a compensation list holds, or one of several.

    Args:
        listing: The list.
        compensation: Which table.
        increment: mm or ° per increment, for a list with ``unit 0``.

    Raises:
        ExchangeError: If there is none, or several and none is named.
    """
    axis_models = load_model(listing, increment=increment)
    wanted = MASTERS if compensation is None else (compensation,)
    names = [name for name in MASTERS if name in axis_models and name in wanted]
    description = f"tables {', '.join(names)}" if names else "no such table"
    expected = f"one to convert: --compensation {'|'.join(MASTERS)}"
    expect(len(names) == 1, listing.source, description, expected)
    model = axis_models[names[0]]
    nodes = tuple(np.asarray(master.positions) for master in model.ways)
    rows = np.stack([np.asarray(values) for values in model.tables])
    record = kind(names[0])
    # A new list for both directions has the last one anyway.
    homing = () if len(rows) > 1 else (f"{record.prefix}.set_pos_without_comp",)
    keys = (record.cycles or ("",))[0], record.manual or "", *homing
    lost = [key for key in keys if listing.integer(key) or listing.boolean(key)]
    remark = f"No part of the table, and left out: {', '.join(lost)}."
    return ExchangedTable(
        compensation=names[0],
        axis=axis_models.axis,
        masters=axis_models.masters.get(names[0], ()),
        nodes=nodes,
        entries=rows[0] if len(nodes) == 2 else rows,
        modulo=bool(getattr(model, "modulo", None)),
        remarks=(remark,) if lost else (),
    )


def list_with(table: ExchangedTable) -> tuple[ListFile, dict[str, int]]:
    """Return a new list that holds a table, and the entries to set in the axis list.

    Raises:
        ExchangeError: If axis, masters or compensation are not known, or a list cannot
            hold the nodes.
    """
    name, count = table.compensation, len(table.masters)
    expect(name in MASTERS, "compensation", repr(name), " or ".join(MASTERS))
    expected_axis = "--axis: the one that is compensated (kopf.achs_nr)"
    expect(table.axis is not None, "axis", "no number", expected_axis)
    axis = table.axis or 0
    expected = f"{MASTERS[name]}: --master and the number of each axis"
    description = f"{count} masters of a {name} table"
    expect(count == MASTERS[name], "masters", description, expected)
    rows = [table.entries] if len(table.nodes) == 2 else table.entries
    own = count == 0  # the table of an axis over itself, with a column per direction
    holds = "errors" if own else "offsets"
    expected = f"{holds}, as the entries of a {name} are: the negative"
    found = f"{table.holds} by their name"
    expect(table.holds in ("", holds), "columns", found, expected)
    expected = f"one: a {name} has no directions"
    expect(own or len(rows) == 1, "columns", f"{len(rows)} of entries", expected)
    turning = {"modulo": True} if table.modulo else {}
    nodes = [_nodes(places) for places in table.nodes]
    model = kind(name).entries.models[0](*nodes, *rows, **turning)
    models = AxisModels(axis, {name: model}, {name: table.masters})
    entries, machine = models.to_entries()
    comment = (f"Compensation list of axis {axis}, converted by axcomp",)
    listing = new_list({"kopf.achs_nr": axis} | entries, comment=comment)
    return listing, {key: int(value) for key, value in machine.items()}


def _nodes(positions: Float[np.ndarray, " n"]) -> EquidistantNodes | Setpoints:
    """Return nodes at whole list units: evenly spaced where the positions are."""
    size = len(positions)
    if size > 1:
        grid = positions[0], (positions[-1] - positions[0]) / (size - 1)
        start, interval = np.round(np.array(grid) * LIST_UNITS) / LIST_UNITS
        if np.allclose(positions, start + interval * np.arange(size), 0.0, _GRID):
            return EquidistantNodes(np.asarray(start), np.asarray(interval), size)
    places = np.round(positions * LIST_UNITS) / LIST_UNITS
    refuse_unordered(places, "nodes", "each 0.1 µm or more above the one before")
    return Setpoints(places)


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
    r"#\s*(?P<name>leadscrew|cross|plane|\w+(?= of axis \d))(?: of axis (?P<axis>\d+))?"
    r"(?: over (?P<masters>\d+(?:[,;] \d+)*))?(?P<modulo>[,;] modulo)?"
)
_UNEVEN = 1e-3


def format_of(path: Path) -> str:
    """Return the format that the ending of a name stands for.

    Raises:
        ExchangeError: If it stands for none.
    """
    form = _ENDINGS.get(path.suffix.casefold())
    if form is None:
        endings = ", ".join(f"{end} ({name})" for end, name in _ENDINGS.items())
        expected = f"one of {endings}, or --to {'|'.join(FORMATS)}"
        raise ExchangeError(str(path), f"the ending {path.suffix!r}", expected)
    return form


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
    description = f"a {table.compensation} table"
    expect(MASTERS.get(table.compensation) == 2, form, description, "a plane")
    steps = [np.diff(places) for places in table.nodes]
    even = not any(places.size and np.ptp(places) > _UNEVEN for places in steps)
    expect(even, form, "nodes at uneven distances", "evenly spaced ones")
    return _bed_mesh(table) if form == "bed-mesh" else _height_map(table)


def table_of_file(
    path: Path, compensation: str | None = None, *, trim: bool = False
) -> ExchangedTable:
    """Return the table of a file, recognised by its content: no list.

    Args:
        path: A CSV, a LinuxCNC file, a bed mesh or a height map.
        compensation: What the columns of a CSV stand for, where that is stated.
        trim: LinuxCNC's ``COMP_FILE_TYPE = 1`` instead of 0.

    Raises:
        ExchangeError: If it holds no table.
        MeasurementError: If it cannot be read.
    """
    if _ENDINGS.get(path.suffix.casefold()) == "linuxcnc":
        return _of_triplets(path, trim)
    table = read_table(path)
    if table.format in MESH_FORMATS:
        plane = _of_grid(table, [_lengths(table, k) for k in range(3)])
        # The last remark speaks of the columns of a job.
        remarks = (*table.remarks[:-1], HEIGHTS)
        return dataclasses.replace(plane, entries=-plane.entries, remarks=remarks)
    return _of_csv(table, compensation or "")


def _number(value: float) -> str:
    return f"{round(value, 4) + 0.0:.4f}"


def _csv(table: ExchangedTable) -> str:
    head = f"# {table.compensation}"
    head += "" if table.axis is None else f" of axis {table.axis}"
    if table.masters:
        head += f" over {', '.join(map(str, table.masters))}"
    head += ", modulo" * table.modulo
    names, entries = ["position"], list(table.entries)
    if len(table.nodes) == 2:
        names, entries = ["master 1", "master 2"], [table.entries.ravel()]
    labels = kind(table.compensation).entries.columns if table.compensation else ()
    names += (labels or ("correction",))[: len(entries)]
    columns = [*(place.ravel() for place in np.meshgrid(*table.nodes)), *entries]
    return _lines(
        head,
        ",".join(f"{name} [mm]" for name in names),
        *(",".join(map(_number, row)) for row in zip(*columns, strict=True)),
    )


_PLACES, _ENTRIES = ("position", "master 1", "master 2"), ("pos", "neg", "correction")
"""Names of columns as `text_of` writes them, in their order."""
_FOLLOWS = 0.02
"""Share of the travel within which entries of a table are positions themselves."""


def _held(names: Sequence[str]) -> str:
    """Return ``errors`` or ``offsets``, where the names of the entries say so."""
    words = words_in(names)
    if any(map(says_correction, names)) or "offset" in words:
        return "" if words & WORDS["error"] else "offsets"
    return "errors" if words & WORDS["error"] else ""


def _ways(names: Sequence[str]) -> list[str]:
    """Return names of entries, those that name a direction as ``pos`` and ``neg``."""
    ways = [{direction_of(piece) for piece in pieces(name)} - {None} for name in names]
    if {1} in ways and {-1} in ways and len(ways) == 2:
        return ["pos" if way == {1} else "neg" for way in ways]
    return [*names]


def _of_csv(table: Table, stated: str) -> ExchangedTable:
    """Return the table of a CSV: by the names that `text_of` writes, or positions first."""
    with table.path.open(encoding="utf-8-sig", errors="replace") as file:
        head = _HEAD.match(file.readline())
    where, expected = str(table.path), "positions, then one or two of entries"
    names = [column.name.casefold().strip() for column in table.columns]
    expect(len(names) in (2, 3), where, f"{len(names)} columns", expected)
    order = [*range(len(names))]
    holds = _held(names)
    if len(names) == 3 and not names[1].startswith("master"):
        names[1:] = _ways(names[1:])
    if not any(name in _PLACES for name in names):
        names[0] = "position"
    known = _PLACES + _ENTRIES
    order.sort(key=lambda k: known.index(names[k]) if names[k] in known else k + 9)
    values = [name for name in names if name not in _PLACES]
    listed = [name in _ENTRIES for name in values]
    # Not one by its name and another by its place.
    alike = all(listed) or not any(listed)
    expect(alike, where, f"the columns {', '.join(values)}", "pos, or pos and neg")
    lone = "neg" in names and "pos" not in names
    expect(not lone, where, "neg alone", "pos as well, or one column")
    columns = [_lengths(table, k) for k in order]
    name = head["name"] if head else ""
    axis = int(head["axis"]) if head and head["axis"] else None
    over = head["masters"] if head else None
    masters = tuple(map(int, re.findall(r"\d+", over or "")))
    on_grid = not name and names[order[1]].startswith("master")
    if on_grid or MASTERS.get(name or stated) == 2:
        found = f"{len(columns)} columns"
        expect(len(columns) == 3, where, found, "two masters, entries")
        grid = _of_grid(table, columns)
        first, second = (table.columns[k].name for k in order[:2])
        taken = f"Column {first!r} is taken for master 1, {second!r} for master 2."
        remarks = () if names[order[0]].startswith("master") else (taken,)
        return dataclasses.replace(
            grid, axis=axis, masters=masters, holds=holds, remarks=remarks
        )
    if (name or stated) == "leadscrew":
        units = [find_unit(column.unit) for column in table.columns if column.unit]
        dimensions = sorted({unit.dimension for unit in units if unit})
        found, expected = " and ".join(dimensions), "lengths alone, or angles alone"
        expect(len(dimensions) < 2, f"{where}: units", found, expected)
    modulo = bool(head and head["modulo"])
    ascending = np.argsort(columns[0], kind="stable")
    places, *rows = (column[ascending] for column in columns)
    near = _FOLLOWS * float(np.ptp(places))
    follows = any(np.abs(row - places).max() < near for row in rows)
    expected = "errors or offsets; a file of LinuxCNC ends in .comp"
    expect(not follows, where, "entries that follow the positions", expected)
    ways = [names[k] for k in order[1:]]
    told = len(ways) == 1 or ways == ["pos", "neg"]
    expect(told, where, f"the columns {' and '.join(ways)}", "their names: pos and neg")
    for again in places[1:][np.diff(places) == 0]:
        raise ExchangeError(where, f"the position {again:g} twice", "each once")
    return ExchangedTable(name, axis, masters, (places,), np.stack(rows), modulo, holds)


def _lengths(table: Table, number: int) -> Float[np.ndarray, " t"]:
    """Return a column in mm (or °); without a unit it counts as that."""
    column = table.columns[number]
    unit = find_unit(column.unit or "mm")
    if unit is None or unit.dimension not in ("length", "angle"):
        where, found = f"{table.path}: {column.name}", f"unit {column.unit}"
        raise ExchangeError(where, found, "a length or an angle")
    return unit.to_library(table.numbers(column))


def _linuxcnc(table: ExchangedTable, trim: bool) -> str:
    suits = MASTERS.get(table.compensation) == 0 and not table.modulo
    description = f"a {table.compensation} table" + " that goes round" * table.modulo
    expect(suits, "linuxcnc", description, "a leadscrew table of a linear axis")
    (nodes,) = table.nodes
    description = f"{len(nodes)} points"
    expect(len(nodes) <= _MOST, "linuxcnc", description, f"at most {_MOST}")
    values = [-errors if trim else nodes + errors for errors in table.entries]
    columns = [nodes, values[0], values[-1]]
    return _lines(*(" ".join(map(_number, row)) for row in zip(*columns, strict=True)))


def _of_triplets(path: Path, trim: bool) -> ExchangedTable:
    rows: list[list[float]] = []
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    for number, line in enumerate(lines, 1):
        try:
            row = [float(cell) for cell in line.split()]
        except ValueError:
            row = [math.nan]
        # LinuxCNC itself stops reading here without a word.
        place, expected = f"{path}:{number}", "three numbers: nominal, forward, reverse"
        expect(len(row) in (0, 3), place, repr(line.strip()), expected)
        rows += [row] if row else []
    nodes, *values = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    description = (
        f"{len(nodes)} points" if len(nodes) < 2 else "points that do not ascend"
    )
    ascend = len(nodes) > 1 and bool(np.all(np.diff(nodes) > 0))
    expect(ascend, str(path), description, "two or more, ascending")
    size, off = np.abs(values).max(), np.abs(np.array(values) - nodes).max()
    found = "values near 0, which are no positions"
    expected = "forward and reverse positions; of trims (COMP_FILE_TYPE = 1): --trim"
    expect(trim or size >= off, str(path), found, expected)
    found = "values near the positions, which are no trims"
    expected = "trims; of forward and reverse positions leave --trim out"
    expect(not trim or off >= size, str(path), found, expected)
    entries = np.stack([-column if trim else column - nodes for column in values])
    if np.allclose(entries[0], entries[1], 0.0, 1e-9):
        entries = entries[:1]
    return ExchangedTable("leadscrew", None, (), (nodes,), entries)


def _of_grid(
    table: Table, columns: Sequence[Float[np.ndarray, " t"]]
) -> ExchangedTable:
    """Return a plane of the places of both masters and the values there."""
    first, i = np.unique(columns[0], return_inverse=True)
    second, j = np.unique(columns[1], return_inverse=True)
    values = np.full((len(second), len(first)), np.nan)
    values[j, i] = columns[2]
    _, count = np.unique(np.stack([i, j]), axis=1, return_counts=True)
    twice = int((count > 1).sum())
    expect(not twice, str(table.path), f"{twice} places twice", "a value for each")
    holes = int(np.isnan(values).sum())
    description = f"{holes} of {values.size} places without a value"
    expected = f"a full grid; a fit fills it: axcomp new {table.path.name}"
    expect(not holes, str(table.path), description, expected)
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
        float(np.mean(np.diff(places))) if len(places) > 1 else 1.0 for places in (x, y)
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

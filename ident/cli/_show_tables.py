"""What ``axcomp show`` prints of a list: parameters, tables, signs."""

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ...data.lists import ListFile, OffsetCurve, offset_curves, registry
from ..kinds import Kind, kind, kinds

MOST_ROWS = 24
MOST_COLUMNS = 9
"""Rows and columns of a table that are printed; of more, evenly spaced ones."""

_KINDS = {
    "compensation": "compensation list",
    "axis": "axis list",
    "startup": "start-up list",
    "unknown": "list of unknown kind",
}


def list_views(
    file: ListFile, plane_index: str = "ji", *, verified: bool = False
) -> Iterator[RenderableType]:
    """Return what to print of a list, from its head to its tables.

    Args:
        file: The list.
        plane_index: How the indices of a plane are read, as `offset_curves`.
        verified: Whether a measurement has shown that; else it is said that it is assumed.
    """
    yield Text(_headline(file), style="bold")
    if file.remarks:
        lines = sorted({remark.line for remark in file.remarks})
        yield Text(
            f"The text has oddities ({len(file.remarks)}, the first in line "
            f"{lines[0]}): see `axcomp check`.",
            style="yellow",
        )
    yield _parameters(file)
    curves = offset_curves(file, plane_index)
    order = f"plane_index = {plane_index}, {'verified' if verified else 'assumed'}"
    for compensation in dict.fromkeys(curve.compensation for curve in curves):
        alike = [curve for curve in curves if curve.compensation == compensation]
        yield Padding(_curve_view(alike, order), (1, 0, 0, 0))
    for each in sorted(kinds(), key=lambda one: one.prefix):
        for table in each.raw_tables:
            raw = _plain_table(file, each, table)
            if raw is not None:
                yield Padding(raw, (1, 0, 0, 0))


def _headline(file: ListFile) -> str:
    axis = file.integer("kopf.achs_nr")
    name = file.text("kopf.log_achs_name")
    parts = [f"{file.source}: {_KINDS[file.kind]}"]
    if axis is not None:
        parts.append(f"axis {axis}" + (f" ({name})" if name else ""))
    count = sum(len(rows.lines) for rows in file.columns.values())
    parts.append(f"{count} entries in {len(file.lines)} lines, {file.encoding}")
    return ", ".join(parts)


def _parameters(file: ListFile) -> Table:
    """Return the entries outside of tables, each with its unit and meaning."""
    table = _plain_columns()
    table.add_column("entry", no_wrap=True)
    table.add_column("value", justify="right", overflow="fold")
    table.add_column("", justify="right", no_wrap=True)
    table.add_column("meaning", style="dim", overflow="fold")
    known = registry().by_key
    for key, rows in file.columns.items():
        if "[]" in key and not key.startswith(("getriebe", "achs_kw")):
            continue
        row = known.get(key)
        meaning = "no manual names this entry" if row is None else row.text
        if row is not None and row.id:
            meaning = f"{meaning} ({row.id})"
        structure = key.rpartition(".")[0]
        metric = file.boolean(f"{structure}.unit") is True
        for indices, at in rows.last.items():
            name = key
            for index in indices:
                name = name.replace("[]", f"[{index}]", 1)
            unit = "" if row is None else row.unit[0]
            value = rows.integers[at]
            table.add_row(
                escape(name),
                escape(rows.texts[at]),
                _with_unit(value, unit, metric),
                escape(meaning),
            )
    return table


def _plain_columns(caption: str | None = None) -> Table:
    """Return an empty table without lines."""
    spaces = (0, 2, 0, 0)
    table = Table(box=None, pad_edge=False, padding=spaces, caption=caption)
    table.caption_justify = "left"
    return table


def _with_unit(value: int | None, unit: str, metric: bool) -> str:
    """Return the value of a length entry in mm or µm, or its unit as it is."""
    if value is None or not unit.startswith("0.1 µm"):
        return "" if unit == "----" else unit
    if "increments" in unit and not metric:
        return "increments"
    if abs(value) >= 10_000:
        return f"{value / 10_000:g} mm"
    return f"{value / 10:g} µm"


def _curve_view(curves: Sequence[OffsetCurve], order: str) -> Group:
    """Return the tables of one compensation under a sentence on their sign."""
    first = curves[0]
    values = [value for curve in curves for row in curve.offsets for value in row]
    unit = "µm" if first.metric else "increments"
    masters = " and ".join("?" if m is None else str(m) for m in first.masters)
    if masters:
        masters = f"{'axis' if len(first.masters) == 1 else 'axes'} {masters}"
    nodes = " x ".join(str(len(axis)) for axis in first.nodes)
    sentences = [f"{first.compensation.capitalize()} table, {nodes} nodes"]
    sentences[0] += f" over the position of {masters}." if masters else "."
    sentences.append(kind(first.compensation).adds)
    if values:
        ends = f"{_plain(min(values))} to {_plain(max(values))}"
        sentences.append(f"It adds from {ends} {unit}.")
    if not first.metric:
        sentences.append("The list counts in encoder increments.")
    missing = sum(curve.missing for curve in curves)
    if missing:
        sentences.append(f"Entries missing, which count as 0: {missing}.")
    if not first.ascending:
        sentences.append("Its positions do not ascend.")
    body = _plane_table(first, order) if len(first.nodes) == 2 else _line_table(curves)
    return Group(Text(" ".join(sentences)), body)


def _line_table(curves: Sequence[OffsetCurve]) -> Table:
    """Return a table over one axis: position, entries and what they add."""
    first = curves[0]
    heads = ["index", f"position/{'mm' if first.metric else 'inc'}"]
    for curve in curves:
        branch = "" if curve.branch == "both" else f" {curve.branch[:3]}"
        heads += [f"entry{branch}", f"adds{branch}/{'µm' if first.metric else 'inc'}"]
    rows = []
    for k, node in enumerate(first.nodes[0]):
        cells = [str(k), f"{node:g}"]
        for curve in curves:
            entry = curve.entries[0][k]
            cells.append("missing" if entry is None else str(entry))
            cells.append(_plain(curve.offsets[0][k]))
        rows.append(cells)
    return _grid(heads, rows)


def _grid(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    caption: str | None = None,
) -> Table:
    """Return a table of numbers; of many rows the first and last ones."""
    table = _plain_columns(caption)
    for head in heads:
        table.add_column(head, justify="right", vertical="bottom", overflow="fold")
    half = MOST_ROWS // 2
    cut = len(rows) > MOST_ROWS
    for row in rows[:half] if cut else rows:
        table.add_row(*row)
    if cut:
        table.add_row(*["..."] * len(heads), style="dim")
        for row in rows[-half:]:
            table.add_row(*row)
    return table


def _plane_table(curve: OffsetCurve, order: str) -> Table:
    """Return what a plane adds, over both masters; some of its rows and columns."""
    unit = "mm" if curve.metric else "inc"
    offsets = curve.offsets
    columns = _some(len(curve.nodes[0]), MOST_COLUMNS)
    rows = _some(len(curve.nodes[1]), MOST_ROWS)
    caption = f"adds/{'µm' if curve.metric else 'inc'}; "
    caption += f"to the right: axis {curve.masters[0]}, down: axis {curve.masters[1]}"
    caption += f" ({order})"
    for shown, nodes, what in zip(
        (columns, rows), curve.nodes, ("columns", "rows"), strict=True
    ):
        if len(shown) < len(nodes):
            caption += f"; {len(shown)} of {len(nodes)} {what} are shown"
    heads = [unit, *(f"{curve.nodes[0][i]:g}" for i in columns)]
    cells = []
    for j in rows:
        found = zip(curve.entries[j], offsets[j], strict=True)
        texts = ["-" if entry is None else _plain(offset) for entry, offset in found]
        cells.append([f"{curve.nodes[1][j]:g}", *(texts[i] for i in columns)])
    return _grid(heads, cells, caption)


def _plain(value: float) -> str:
    """Return the number without the sign that a negative zero has."""
    return f"{value + 0.0:g}"


def _some(count: int, most: int) -> list[int]:
    """Return all indices, or of many evenly spaced ones."""
    if count <= most:
        return list(range(count))
    return sorted({round(k * (count - 1) / (most - 1)) for k in range(most)})


def _plain_table(file: ListFile, one: Kind, table: str) -> Group | None:
    """Return a table with its entries as they stand, such as that of friction."""
    stem = f"{one.prefix}.{table}[]."
    keys = [key for key in file.columns if key.startswith(stem)]
    if not keys:
        return None
    known = registry().by_key
    heads = ["index"]
    for key in keys:
        row = known.get(key)
        unit = "" if row is None or row.unit[0] in ("", "----") else f"\n{row.unit[0]}"
        # The names are long and differ at their ends: they break where they may.
        name = key.removeprefix(stem).replace("_dir_", "\ndir_").replace("n_", "n\n")
        heads.append(escape(f"{name}{unit}"))
    columns = [file.columns[key] for key in keys]
    places = sorted({at for rows in columns for at in rows.last})
    lines = [
        [", ".join(map(str, place))]
        + [
            escape(rows.texts[rows.last[place]]) if place in rows.last else "-"
            for rows in columns
        ]
        for place in places
    ]
    size = "1 entry" if len(places) == 1 else f"{len(places)} entries"
    text = f"{one.name.capitalize()} table, {size}. {one.adds}"
    return Group(Text(text), _grid(heads, lines))

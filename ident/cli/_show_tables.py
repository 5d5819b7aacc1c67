"""What ``axcomp show`` prints of a list: parameters, tables, signs."""

from collections.abc import Collection, Iterable, Iterator, Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ...data.lists import (
    DEFAULT_RULES,
    SIGNS,
    CurveRules,
    ListFile,
    OffsetCurve,
    full_name,
    offset_curves,
    registry,
)
from ..kinds import Kind, kind, kinds
from ..report._scale import count
from ._console import table_of

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
    file: ListFile, rules: CurveRules = DEFAULT_RULES, verified: Collection[str] = ()
) -> Iterator[RenderableType]:
    """Return what to print of a list, from its head to its tables.

    Tables are read by rules as in `offset_curves`; those not verified are assumed.
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
    curves = offset_curves(file, rules)
    order = f"plane_index = {rules.get('plane_index', 'ji')}"
    order += ", verified" if "plane_index" in verified else ", assumed"
    for compensation in dict.fromkeys(curve.compensation for curve in curves):
        group = [curve for curve in curves if curve.compensation == compensation]
        yield Text(f"\n{_curve_words(group)}")
        plane = len(group[0].nodes) == 2
        yield _plane_table(group[0], order) if plane else _line_table(group)
    for each in sorted(kinds(), key=lambda each: each.prefix):
        for table in each.raw_tables:
            yield from _raw_table(file, each, table)


def _headline(file: ListFile) -> str:
    axis = file.integer("kopf.achs_nr")
    name = file.text("kopf.log_achs_name")
    parts = [f"{file.source}: {_KINDS[file.kind]}"]
    if axis is not None:
        parts.append(f"axis {axis}" + (f" ({name})" if name else ""))
    entries = sum(len(rows.lines) for rows in file.columns.values())
    parts.append(f"{entries} entries in {len(file.lines)} lines, {file.encoding}")
    return ", ".join(parts)


def _parameters(file: ListFile) -> Table:
    """Return the entries outside of tables, each with its unit and meaning."""
    lines: list[Sequence[str]] = []
    by_key = registry().by_key
    for key, rows in file.columns.items():
        if "[]" in key and not key.startswith(("getriebe", "achs_kw")):
            continue
        row = by_key.get(key)
        meaning = "no manual names this entry" if row is None else row.text
        if row is not None and row.id:
            meaning = f"{meaning} ({row.id})"
        structure = key.rpartition(".")[0]
        metric = file.boolean(f"{structure}.unit") is True
        for indices, at in rows.last.items():
            unit = "" if row is None else row.unit[0]
            converted = _with_unit(rows.integers[at], unit, metric)
            name = full_name(key, indices)
            lines.append((name, rows.texts[at], converted, meaning))
    heads = ("entry", "value", " ", "meaning")
    return table_of(heads, lines, numbers=heads[1:3], plain=True)


def _grid(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    caption: str = "",
    columns: int | None = None,
) -> Table:
    """Return a table of numbers; of many rows, and of more columns than ``columns``, some."""
    across = [0, *(1 + k for k in _thinned(len(heads) - 1, columns or len(heads)))]
    down, notes = _thinned(len(rows), MOST_ROWS), [caption] if caption else []
    for first, every, noun in (
        (len(across) - 1, len(heads) - 1, "columns"),
        (len(down), len(rows), "rows"),
    ):
        if first < every:
            notes.append(f"{first} of {every} {noun} are shown")
    return table_of(
        [heads[k] for k in across],
        ([rows[k][at] for at in across] for k in down),
        numbers=heads,
        caption="; ".join(notes) or None,
        plain=True,
    )


def _with_unit(value: int | None, unit: str, metric: bool) -> str:
    """Return the value of a length entry in mm or µm, or its unit as it is."""
    if value is None or not unit.startswith("0.1 µm"):
        return "" if unit == "----" else unit
    if "increments" in unit and not metric:
        return "increments"
    if abs(value) >= 10_000:
        return f"{value / 10_000:g} mm"
    return f"{value / 10:g} µm"


def _curve_words(curves: Sequence[OffsetCurve]) -> str:
    """Return what the tables of one compensation are, and their sign."""
    first = curves[0]
    values = [value for curve in curves for row in curve.offsets for value in row]
    masters = " and ".join("?" if m is None else str(m) for m in first.masters)
    if masters:
        axes = "axis" if len(first.masters) == 1 else "axes"
        masters = f" over the position of {axes} {masters}"
    nodes = " x ".join(str(len(axis)) for axis in first.nodes)
    name = first.compensation
    owner = "" if first.axis is None else f" of axis {first.axis}"
    sentences = [f"{name.capitalize()} table{owner}, {nodes} nodes{masters}."]
    if first.sign == SIGNS[name]:
        sentences.append(kind(name).adds)
    else:
        way = "the entry" if first.sign > 0 else "the negative of the entry"
        rule = f"By {name}_sign = {first.sign}"
        sentences.append(f"{rule} the controller adds {way} to the command position.")
    if values:
        # A list does not say whether its axis turns.
        unit = "µm (of a rotary axis 0.001°)" if first.metric else "increments"
        ends = f"{_plain(min(values))} to {_plain(max(values))}"
        sentences.append(f"It adds from {ends} {unit}.")
    if not first.metric:
        sentences.append("The list counts in encoder increments.")
    missing = sum(curve.missing for curve in curves)
    if missing:
        sentences.append(f"Entries missing, which count as 0: {missing}.")
    if not first.ascending:
        sentences.append("Its positions do not ascend.")
    return " ".join(sentences)


def _line_table(curves: Sequence[OffsetCurve]) -> Table:
    """Return a table over one axis: position, entries and what they add."""
    first = curves[0]
    heads = ["index", f"position/{'mm' if first.metric else 'inc'}"]
    places = [f"{node:g}" for node in first.nodes[0]]
    columns: list[Iterable[object]] = [range(len(places)), places]
    for curve in curves:
        branch = "" if curve.branch == "both" else f" {curve.branch[:3]}"
        heads += [f"entry{branch}", f"adds{branch}/{'µm' if first.metric else 'inc'}"]
        entries = ("missing" if entry is None else entry for entry in curve.entries[0])
        columns += [entries, map(_plain, curve.offsets[0])]
    return _grid(heads, [[*map(str, row)] for row in zip(*columns, strict=True)])


def _plane_table(curve: OffsetCurve, order: str) -> Table:
    """Return what a plane adds, over both masters."""
    across, down = curve.masters
    caption = (
        f"adds/{'µm' if curve.metric else 'inc'}; to the right: axis {across}, down:"
        f" axis {down} ({order})"
    )
    rows = []
    lines = zip(curve.nodes[1], curve.entries, curve.offsets, strict=True)
    for node, entries, offsets in lines:
        pairs = zip(entries, offsets, strict=True)
        cells = ("-" if entry is None else _plain(adds) for entry, adds in pairs)
        rows.append([f"{node:g}", *cells])
    heads = ["mm" if curve.metric else "inc", *(f"{x:g}" for x in curve.nodes[0])]
    return _grid(heads, rows, caption, MOST_COLUMNS)


def _plain(value: float) -> str:
    """Return the number without the sign that a negative zero has."""
    return f"{value + 0.0:g}"


def _thinned(count: int, limit: int) -> list[int]:
    """Return all indices, or of many evenly spaced ones."""
    if count <= limit:
        return list(range(count))
    return sorted({round(k * (count - 1) / (limit - 1)) for k in range(limit)})


def _raw_table(file: ListFile, kind_of: Kind, table: str) -> Iterator[RenderableType]:
    """Yield a table with its entries as they stand, such as that of friction."""
    stem = f"{kind_of.prefix}.{table}[]."
    columns = {key: rows for key, rows in file.columns.items() if key.startswith(stem)}
    heads = ["index"]
    for key in columns:
        row = registry().by_key.get(key)
        unit = "" if row is None or row.unit[0] in ("", "----") else f"\n{row.unit[0]}"
        # The names are long and differ at their ends: they break where they may.
        name = key.removeprefix(stem).replace("_dir_", "\ndir_").replace("n_", "n\n")
        heads.append(f"{name}{unit}")
    places = sorted({at for rows in columns.values() for at in rows.last})
    if not places:
        return
    size = count(len(places), "entry", "entries")
    yield Text(f"\n{kind_of.name.capitalize()} table, {size}. {kind_of.adds}")
    lines = []
    for place in places:
        at = ((rows.texts, rows.last.get(place)) for rows in columns.values())
        cells = ("-" if row is None else texts[row] for texts, row in at)
        lines.append([", ".join(map(str, place)), *cells])
    yield _grid(heads, lines)

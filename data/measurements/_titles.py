"""What the lines above a header say: axis, unit, direction, straightness."""

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np

from ._header import unit_of_title
from ._headings import heading
from ._roles import ColumnSpec
from ._run_layouts import straightness
from ._table import Column, Table
from ._units import find_unit
from ._words import LESS, WORDS, direction_of, kinds_in, words_in

_PAIR = re.compile(
    r"\W*(?P<key>[^:=;,\t|]+?)\s*[:=;,\t|]+\s*(?P<value>[^;,\t|]+?)[\s;,|]*"
)
_SEVERAL = re.compile(
    r"(?i)\W*(?:units|einheiten)\s*[:=]\s*(?P<value>[^\W\d_]+\W*[,;/]\W*\S.*)"
)
_UNIT_WORDS = frozenset(
    ("unit", "units", "einheit", "einheiten", "error unit", "messeinheit")
)
_AXIS = re.compile(
    r"(?i:\b(?:axis|\w*achse))\s*[:=;,\t ]+\s*(?P<axis>[A-Z]\d?)\b"
    r"|\b(?P<before>[XYZABCUVW]\d?)[- ](?i:axis|achse)\b"
)
_STRAIGHT = re.compile(r"(?i)straightness|geradheit")
_DEVIATES = re.compile(
    r"(?i:\b(?:in|of|\w*straightness|geradheit\w*|abweichung|error|deviation)"
    r"(?:\s+(?:direction|richtung))?)\s+(?P<axis>[XYZ])\b"
)
_MOVES = re.compile(
    r"(?i:\b(?:über|ueber|over|along|entlang|axis|achse|vs|against))\.?[\s:=;,]+"
    r"(?P<axis>[XYZ])\b|\b(?P<before>[XYZ])[- ](?i:axis|achse)\b"
)
_ISO = re.compile(r"\bE_?(?P<across>[XYZ])(?P<along>[XYZ])\b")
"""Straightness as ISO 230-1 writes it: EYX deviates in Y while X moves."""
_CORRECTIONS = re.compile(
    r"(?i)\b(?:\w*korrektur\w*|\w*kompensation\w*|corrections?|compensations?|trims?)\b"
)
"""Corrections, where the title has their unit."""
_OF_CORRECTIONS = re.compile(
    r"(?i)(?:\b\w*(?:korrektur|kompensations?)(?:werte?|tabelle|daten|liste)\b"
    r"|\b(?:correction|compensation|trim|offset)\W+(?:values?|table|data|list)\b)"
    r"(?!\s*[:=]\s*\S)"
    r"|^\W*(?:korrektur(?:en)?|kompensation(?:en)?|corrections?|compensations?|trims?)\W*$"
)
"""Titles of a table of corrections, and not of the one that was on: ``table: achskw1.lis``."""
_STATE = re.compile(
    r"(?i)\b(?:before|after|with|without|off|no|not|active|inactive|vor|nach|mit|ohne|aus"
    r"|keine?|aktiv|inaktiv|(?:on|an|ein)(?!\s+\w))\b"
)
"""Words of titles that say with which corrections something was measured."""
_INCHES = ("in", "thou", "uin")
_WORD = re.compile(r"[^\W\d_]")


def with_titles(table: Table, titles: Mapping[int, str]) -> Table:
    """Return the table with what the lines above its header say: axis, unit, direction."""
    table = _straight(table, " \n ".join(titles.values()))
    for line, text in titles.items():
        axis = axis_in_title(text)
        if axis is not None and table.axis is None and not table.across:
            remark = f"Line {line} says that the axis is {axis}."
            table = _noted(table, table.columns, remark, axis)
        elif axis is not None and table.axis not in (None, axis) and not table.across:
            if any(column.run is not None for column in table.columns):
                table = straightness(table, table.axis, axis, "titles and names")
        pair = _PAIR.fullmatch(text)
        key = pair["key"].strip().casefold() if pair is not None else ""
        several = _SEVERAL.fullmatch(text)  # "Units: inch, tenths"
        if pair is not None and key in _UNIT_WORDS:
            table = _in_unit(table, line, pair["value"])
        elif several is not None:
            table = _in_unit(table, line, several["value"])
        elif pair is not None and key in WORDS["direction"]:
            table = _in_direction(table, line, pair["value"])
        elif _WORD.search(text) and (title := heading(text)) and title.direction:
            table = _in_direction(table, line, "+" if title.direction > 0 else "-")
        elif (unit := unit_of_title(text)) is not None and (
            unit in _INCHES or "error" in kinds_in(words_in([text]))
        ):
            table = _in_unit(table, line, unit)
    for line, text in titles.items():
        said, unit = LESS.search(text), unit_of_title(text)
        if said is None and not _STATE.search(text):
            said = (_CORRECTIONS if unit else _OF_CORRECTIONS).search(text)
        if said is not None and not table.advice:
            table = _of_unknown_sign(table, line, said[0], unit)
    inches = [f"'{c.name}'" for c in table.columns if c.unit in _INCHES]
    if inches:
        note = f"In inches, of which one is 25.4 mm: {', '.join(inches[:6])}."
        table = _noted(table, table.columns, note)
    return table


def axis_in_title(text: str) -> str | None:
    """Return the axis that a title names: ``Achse: Y``, ``X axis``."""
    match = _AXIS.search(text)
    return None if match is None else match["axis"] or match["before"]


def _noted(
    table: Table, columns: Sequence[Column], remark: str, axis: str | None = None
) -> Table:
    return dataclasses.replace(
        table,
        columns=tuple(columns),
        remarks=(*table.remarks, remark),
        axis=axis or table.axis,
    )


def _in_unit(table: Table, line: int, text: str) -> Table:
    """Return the table with a unit for readings that state none.

    Positions are in inches where readings are; to a unit that nobody knows no default is
    taken either.
    """
    unit = find_unit(text)
    name = unit.name if unit else text
    units = {"error": name, "actual": name}
    if name in _INCHES:
        units["position"] = "in"
    columns, names = [], []
    for column in table.columns:
        stated = units.get(column.kind) if column.unit is None else None
        columns.append(dataclasses.replace(column, unit=stated or column.unit))
        names += [f"'{column.name}' in {stated}"] if stated else []
    if not names:
        return table
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    note = f"{', '.join(names[:4])}{more}, as line {line} says."
    return _noted(table, columns, note)


def _of_unknown_sign(table: Table, line: int, text: str, unit: str | None) -> Table:
    """Return the table with errors whose sign the job says, since a title calls them otherwise.

    Args:
        table: As read.
        line: Of the title.
        text: What it calls them.
        unit: That it states for readings that have none.
    """
    numbers = [column for column in table.columns if column.text is None]
    errors = [column for column in numbers if _kind_by_name(column) == "error"]
    if not errors and any(_kind_by_name(column) == "position" for column in numbers):
        errors = [column for column in numbers if not _kind_by_name(column)]
    runs = [column for column in errors if column.run is not None]
    others = [column for column in numbers if all(column is not e for e in errors)]
    others.sort(key=lambda column: _kind_by_name(column) != "position")
    if not others or not errors or (len(errors) > 1 and errors != runs):
        return table
    parts = tuple(
        ColumnSpec(
            column.header or column.name,
            column.unit or unit,
            sign=-1,
            run=column.run,
            direction=column.direction,
        )
        for column in errors
    )
    spec = ColumnSpec("", parts[0].unit, parts=parts) if runs else parts[0]
    place = ColumnSpec(others[0].header or others[0].name, others[0].unit)
    columns = [
        dataclasses.replace(column, role=None, run=None, direction=None)
        if any(column is each for each in (*errors, others[0]))
        else column
        for column in table.columns
    ]
    note = (
        f"Line {line} says '{text}': sign = -1 makes errors of what is the negative of"
        " them, and is left out where they are errors."
    )
    advice = {"position": place, "error": spec}
    return dataclasses.replace(_noted(table, columns, note), advice=advice)


def _in_direction(table: Table, line: int, text: str) -> Table:
    """Return the table with a direction for all rows, where it has none."""
    kinds = {column.kind for column in table.columns}
    side = direction_of(text)
    if side is None and "direction" not in kinds:
        remark = f"Line {line} says '{text}': no known direction."
        return _noted(table, table.columns, remark)
    stated = any(column.direction is not None for column in table.columns)
    if side is None or stated or "position" not in kinds or "direction" in kinds:
        return table
    values = np.full(table.rows, float(side))
    place = next(c.role or "" for c in table.columns if c.kind == "position")
    role = place.replace("position", "direction")
    column = Column("direction", role, None, values, header="direction")
    remark = f"Line {line} says '{text}': direction {side:+d} in all rows."
    return _noted(table, (*table.columns, column), remark)


def _straight(table: Table, titles: str) -> Table:
    """Return a table of straightness with the axes that move and deviate, as far as known.

    Its errors are across the motion: those of a laser table would be of the wrong axis.
    """
    across, along = _axes_of_straightness(titles)
    axes = {
        "position": along,
        "direction": along,
        "error": across,
        "actual": across,
    }
    names = " ".join(column.header for column in table.columns)
    kinds = [_kind_by_name(column) for column in table.columns]
    is_straightness = (across and along) or _STRAIGHT.search(f"{titles} {names}")
    has_both = kinds.count("position") == 1 and bool({"error", "actual"} & set(kinds))
    if not (is_straightness and has_both):
        return table
    table = dataclasses.replace(table, across=True)
    bare = [
        kind in axes and column.role in (None, kind)
        for column, kind in zip(table.columns, kinds, strict=True)
    ]
    if not any(bare):
        return table
    columns = [
        dataclasses.replace(column, role=f"{axes[kind]}.{kind}" if axes[kind] else None)
        if is_bare
        else column
        for column, kind, is_bare in zip(table.columns, kinds, bare, strict=True)
    ]
    if across and along:
        remark = (
            f"Straightness: the titles say that {along} moves and {across} deviates."
        )
    else:
        remark = (
            "Straightness: which axis moves and which deviates is not said; the job's"
            ' columns say it, such as "X.position" and "Y.error".'
        )
    return dataclasses.replace(_noted(table, columns, remark), format="CSV")


def _kind_by_name(column: Column) -> str:
    """Return the kind of role of a column, by its name where it has none."""
    if column.role is not None or column.text is not None:
        return column.kind
    return next(iter(kinds_in(words_in([column.name]))), "")


def _axes_of_straightness(titles: str) -> tuple[str | None, str | None]:
    """Return the axis that deviates and the one that moves, as titles say them."""
    if (iso := _ISO.search(titles)) and iso["across"] != iso["along"]:
        return iso["across"], iso["along"]
    moves = _MOVES.search(titles)
    along = (moves["axis"] or moves["before"]) if moves else None
    axes = [match["axis"] for match in _DEVIATES.finditer(titles)]
    return next((axis for axis in axes if axis != along), None), along

"""Captures of controllers in JSON: signals listed in a header, samples in pieces below."""

import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import MeasurementError
from ._table import Column, Skipped, Table
from ._vectors import Array, table_of_arrays

_CYCLE = "CYCLE"
_LIST = re.compile(rb"\s*\[\s*[{\[]")
_SAMPLES = re.compile(r"(?i)(.*data|samples|values|rows)")
_EXPECTED = (
    "a list of signals with names and lists of samples, or lists of numbers by name"
)


def is_capture(raw: bytes) -> bool:
    """Whether bytes begin like a JSON document."""
    return (
        raw.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{" or _LIST.match(raw) is not None
    )


def read_capture(path: Path, raw: bytes) -> Table:
    """Return the signals of a capture in JSON as columns; rows count from 1.

    Either a header with a list of signals (objects with a ``Name``) and pieces of lists
    of samples below, one cell per signal, as Sinumerik recorders write them; or lists of
    numbers by name; or a list of objects with the same names; these also under a key.

    Raises:
        MeasurementError: If the document is damaged or holds no such thing.
    """
    try:
        document = json.loads(raw)
    except (ValueError, RecursionError) as error:
        words = str(error).splitlines()[0][:80]
        reason = f"found damaged JSON ({words}), expected a whole document"
        raise MeasurementError(str(path), reason) from error
    signals = _signals(document)
    if signals:
        return _capture(path, document, signals)
    arrays = _arrays_in(document)
    if arrays:
        return table_of_arrays(path, "JSON", arrays, _EXPECTED)
    reason = f"found a JSON document without signals, expected {_EXPECTED}"
    raise MeasurementError(str(path), reason)


def _arrays_in(document: Any) -> list[Array]:
    """Return lists by name, or a list of objects; those of the first value that holds some."""
    objects = document if isinstance(document, list) else []
    if objects and all(isinstance(item, dict) for item in objects):
        keys = dict.fromkeys(key for item in document for key in item)
        return [_array(key, [item.get(key) for item in document]) for key in keys]
    if not isinstance(document, dict):
        return []
    arrays = [
        _array(name, values)
        for name, values in document.items()
        if isinstance(values, list)
    ]
    if any(array.values is not None for array in arrays):
        return arrays
    return next(filter(None, map(_arrays_in, document.values())), arrays)


def _signals(document: Any) -> list[dict[str, Any]]:
    """Return the longest list of objects with a name, found in the head of a document."""
    longest: list[dict[str, Any]] = []
    head = document.get("Header", document) if isinstance(document, dict) else {}
    for value in head.values() if isinstance(head, dict) else ():
        is_list = isinstance(value, list) and all(
            isinstance(item, dict) and "Name" in item for item in value
        )
        if is_list and len(value) > len(longest):
            longest = value
    return longest


def _capture(path: Path, document: Any, signals: Sequence[dict[str, Any]]) -> Table:
    names = [str(signal["Name"]) for signal in signals]
    rows: list[list[Any]] = []
    others: dict[str, int] = {}
    pieces = next(
        (v for k, v in document.items() if k != "Header" and isinstance(v, list)), []
    )
    for piece in pieces:
        for key, value in piece.items() if isinstance(piece, dict) else ():
            lists = isinstance(value, list) and all(isinstance(r, list) for r in value)
            if lists and _SAMPLES.fullmatch(key):
                for row in value:
                    if len(row) != len(names):
                        reason = f"found {len(row)} values in sample {len(rows) + 1}"
                        reason += f", expected {len(names)} as there are signals"
                        raise MeasurementError(str(path), reason)
                    rows.append(row)
            else:
                others[key] = others.get(key, 0) + 1
    if not rows:
        reason = f"found {len(names)} signals and no samples, expected some"
        raise MeasurementError(str(path), reason)
    arrays = [
        _array(name, values)
        for name, values in zip(names, zip(*rows, strict=True), strict=True)
    ]
    table = table_of_arrays(path, "JSON capture", arrays, _EXPECTED)
    axes = {
        str(signal["Name"]): str(signal["Axis"])
        for signal in signals
        if signal.get("Axis")
    }
    return _described(table, axes, others)


def _described(table: Table, axes: dict[str, str], others: dict[str, int]) -> Table:
    skipped = [
        Skipped(0, f"{count} entries '{key}', which are no samples")
        for key, count in others.items()
    ]
    remarks = []
    if axes:
        words: dict[str, str] = {}
        for name, axis in axes.items():
            number = name.rpartition("|")[2]
            words.setdefault(number if number != name else name, axis)
        listing = ", ".join(f"{number}: {axis}" for number, axis in words.items())
        remarks.append(f"Axes by the number in the signal's name: {listing[:200]}.")
    missed = _missed_cycles(table.columns)
    if missed:
        remarks.append(f"'{_CYCLE}' leaves out {missed} samples: the record has gaps.")
    return dataclasses.replace(
        table, skipped=(*table.skipped, *skipped), remarks=(*table.remarks, *remarks)
    )


def _missed_cycles(columns: Sequence[Column]) -> int:
    cycle = next((column for column in columns if column.name == _CYCLE), None)
    if cycle is None or cycle.values.size < 3:
        return 0
    steps = np.diff(cycle.values)
    usual = float(np.median(steps))
    return round(float(np.sum(steps[steps > usual] / usual - 1.0))) if usual > 0 else 0


def _array(name: str, values: Sequence[Any]) -> Array:
    cells = [np.nan if value is None else value for value in values]
    try:
        numbers = np.array(cells, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return Array(name, None, "not all of it numbers")
    return Array(name, numbers)

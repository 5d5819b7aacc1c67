"""Named arrays of a binary file as a table: vectors of one length are the columns."""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ._errors import MeasurementError
from ._header import parse_name, roles_of
from ._table import Column, Skipped, Table, first_bad
from ._units import find_unit


@dataclasses.dataclass(frozen=True)
class Array:
    """An array of a file by its name, or why it makes no columns.

    Attributes:
        name: As the file has it.
        values: Numbers of at most two dimensions; None where it holds none.
        other: What it is instead.
        unit: As the file states it beside the values, or None.
    """

    name: str
    values: np.ndarray | None
    other: str = ""
    unit: str | None = None


def table_of_arrays(
    path: Path,
    format_name: str,
    arrays: Sequence[Array],
    expected: str,
    remarks: Sequence[str] = (),
) -> Table:
    """Return vectors as columns; rows count from 1.

    Where vectors differ in length, those of the most frequent one are taken (of the
    longer one where two are equally frequent). A matrix that is longer than wide is one
    vector per column. Single numbers are `Table.scalars`; all else is listed as skipped.

    Raises:
        MeasurementError: If there is no vector.
    """
    vectors: dict[str, np.ndarray] = {}
    units: dict[str, str | None] = {}
    scalars: list[tuple[str, float]] = []
    skipped: list[Skipped] = []
    for array in arrays:
        name, value = array.name, array.values
        reason = array.other if value is None else _unfit(value)
        if value is None or reason:
            skipped.append(Skipped(0, f"variable '{name}': {reason}"))
        elif value.size == 1:
            scalars.append((name, float(value.reshape(-1)[0])))
        elif value.ndim == 2 and min(value.shape) > 1:
            for at in range(value.shape[1]):
                vectors[f"{name}(:,{at + 1})"] = _numbers(value[:, at])
                units[f"{name}(:,{at + 1})"] = array.unit
        else:
            vectors[name] = _numbers(value)
            units[name] = array.unit
    if not vectors:
        names = ", ".join(array.name for array in arrays) or "nothing"
        reason = f"found {names[:80]} and no vector of numbers, expected {expected}"
        raise MeasurementError(str(path), reason)
    counts = Counter(vector.size for vector in vectors.values())
    length = max(counts, key=lambda size: (counts[size], size))
    for name, vector in vectors.items():
        if vector.size != length:
            reason = (
                f"variable '{name}': {vector.size} values beside {length} of others"
            )
            skipped.append(Skipped(0, reason))
    chosen = {name: v for name, v in vectors.items() if v.size == length}
    columns = _columns(chosen, units)
    return Table(
        path=path,
        format=format_name,
        columns=columns,
        rows=length,
        lines=np.arange(1, length + 1, dtype=np.int64),
        skipped=tuple(skipped),
        remarks=tuple(remarks),
        counts_rows=True,
        scalars=tuple(scalars),
    )


def _columns(
    vectors: Mapping[str, np.ndarray], units: Mapping[str, str | None]
) -> tuple[Column, ...]:
    names = []
    for label in vectors:
        name, stated = parse_name(label), units[label]
        if stated:
            unit = find_unit(stated)
            text = unit.name if unit else stated
            name = dataclasses.replace(name, unit=text, doubtful=False)
        names.append(name)
    roles, _ = roles_of(names)
    return tuple(
        Column(
            name.name,
            role,
            name.unit,
            np.where(np.isfinite(values), values, np.nan),
            bad=first_bad(values, range(1, values.size + 1)),
            header=name.header,
            doubtful_unit=name.doubtful,
        )
        for name, role, values in zip(names, roles, vectors.values(), strict=True)
    )


def _unfit(values: np.ndarray) -> str:
    """Return why an array makes no columns; empty where it does."""
    if values.size == 0:
        return "empty"
    if values.ndim > 2:
        return f"{values.ndim} dimensions"
    if values.ndim == 2 and 1 < values.shape[0] < values.shape[1]:
        rows, columns = values.shape
        return f"a matrix of {rows} × {columns}, wider than long"
    return ""


def _numbers(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values.reshape(-1), dtype=np.float64)

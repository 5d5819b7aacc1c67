"""MATLAB files of versions 4 to 7.2: vectors of one length are the columns."""

from collections import Counter
from pathlib import Path

import numpy as np

from ._errors import MeasurementError
from ._header import parse_name, roles_of
from ._mat_elements import (
    DamagedMat,
    Variable,
    is_version_4,
    read_version_4,
    read_version_5,
)
from ._table import BadCell, Column, Skipped, Table

_EXPECTED = "a MATLAB file of version 4 to 7.2 with vectors of numbers"


def is_mat(raw: bytes) -> bool:
    """Whether the bytes begin like a MATLAB file of any version."""
    return raw.startswith((b"MATLAB 5.0", b"MATLAB 7.3")) or is_version_4(raw)


def read_mat(path: Path, raw: bytes) -> Table:
    """Return the vectors of a MATLAB file as columns; rows count from 1.

    Where vectors differ in length, those of the most frequent one are taken (of the
    longer one where two are equally frequent). Fields of structures are named
    ``structure.field``. Single numbers are `Table.scalars`; all else is listed as
    skipped.

    Raises:
        MeasurementError: If the file is damaged, of version 7.3, or holds no vector.
    """
    variables = _load(path, raw)
    vectors: dict[str, np.ndarray] = {}
    scalars: list[tuple[str, float]] = []
    skipped: list[Skipped] = []
    for name, value, reason in map(_judge, variables):
        if value is None:
            skipped.append(Skipped(0, f"variable '{name}': {reason}"))
        elif value.size == 1:
            scalars.append((name, float(value.reshape(-1)[0])))
        elif value.ndim == 2 and min(value.shape) > 1:
            for at in range(value.shape[1]):
                vectors[f"{name}(:,{at + 1})"] = _numbers(value[:, at])
        else:
            vectors[name] = _numbers(value)
    if not vectors:
        held = ", ".join(item.name for item in variables) or "nothing"
        reason = f"found {held[:80]} and no vector of numbers, expected {_EXPECTED}"
        raise MeasurementError(str(path), reason)
    counts = Counter(vector.size for vector in vectors.values())
    length = max(counts, key=lambda size: (counts[size], size))
    for name, vector in vectors.items():
        if vector.size != length:
            reason = (
                f"variable '{name}': {vector.size} values beside {length} of others"
            )
            skipped.append(Skipped(0, reason))
    taken = {name: v for name, v in vectors.items() if v.size == length}
    names = [parse_name(name) for name in taken]
    roles, _ = roles_of(names)
    return Table(
        path=path,
        format="MATLAB",
        columns=tuple(
            Column(
                name.name,
                role,
                name.unit,
                np.where(np.isfinite(values), values, np.nan),
                bad=_bad(values),
                header=name.header,
                doubtful_unit=name.doubtful,
            )
            for name, role, values in zip(names, roles, taken.values(), strict=True)
        ),
        rows=length,
        lines=np.arange(1, length + 1, dtype=np.int64),
        skipped=tuple(skipped),
        counts_rows=True,
        scalars=tuple(scalars),
    )


def _load(path: Path, raw: bytes) -> list[Variable]:
    if raw.startswith(b"MATLAB 7.3"):
        found = "found a MATLAB file of version 7.3 (HDF5)"
        advice = f"expected {_EXPECTED}: save it with the option '-v7'"
        raise MeasurementError(str(path), f"{found}, {advice}")
    try:
        if raw.startswith(b"MATLAB"):
            return list(read_version_5(raw))
        return list(read_version_4(raw))
    except DamagedMat as error:
        reason = f"found damaged MATLAB data ({error}), expected {_EXPECTED}"
        raise MeasurementError(str(path), reason) from error


def _judge(variable: Variable) -> tuple[str, np.ndarray | None, str]:
    """Return name and values of a variable, or why it makes no columns."""
    name, values = variable.name, variable.values
    if values is None:
        return name, None, variable.other
    if values.size == 0:
        return name, None, "empty"
    if values.ndim > 2:
        return name, None, f"{values.ndim} dimensions"
    rows, columns = values.shape
    if 1 < rows < columns:
        return name, None, f"a matrix of {rows} × {columns}, wider than long"
    return name, values, ""


def _numbers(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values.reshape(-1), dtype=np.float64)


def _bad(values: np.ndarray) -> BadCell | None:
    wrong = np.flatnonzero(~np.isfinite(values))
    if not wrong.size:
        return None
    return BadCell(int(wrong[0]) + 1, f"{values[wrong[0]]}")

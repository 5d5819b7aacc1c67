"""Read a measurement file of any known format, recognised by its content."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from ._csv import SHORT, read_csv
from ._layout import is_plain
from ._mat import is_mat, read_mat
from ._mesh import is_bed_mesh, is_height_map, read_bed_mesh, read_height_map
from ._parquet import read_parquet
from ._run_table import is_run_table, read_run_table
from ._scope import read_scope
from ._scope_block import is_scope
from ._table import Table
from ._text import text_and_words, unpacked

PlainRows: TypeAlias = Callable[[bytes, int, int], Float[np.ndarray, "k t"] | None]
"""Numbers of a text from an offset to its end in so many columns, None if not plain."""


def read_table(
    path: Path, *, profile: str | None = None, plain_rows: PlainRows | None = None
) -> Table:
    """Return what a measurement file holds, in the file's own units.

    CSV, TwinCAT Scope text exports, MATLAB files, Parquet, ISO 230-2 run tables,
    Klipper bed meshes and RepRapFirmware height maps are told apart by content, not by
    the ending of the name; text and MATLAB files may be packed with gzip.

    Args:
        path: The file.
        profile: Which profile of a Klipper file with several; see `Table.remarks`.
        plain_rows: What reads rows of plain numbers faster, to the same bits, where the
            caller has it.

    Raises:
        OSError: If the file cannot be read.
        MeasurementError: If it holds nothing usable; names the line and what was
            expected.
    """
    with path.open("rb") as file:
        magic = file.read(4)
        raw = b"" if magic == b"PAR1" else magic + file.read()
    if magic == b"PAR1":
        return read_parquet(path)
    raw = unpacked(raw, path)
    if plain_rows is not None and len(raw) > SHORT and not is_mat(raw):
        table = _plain_table(path, raw, plain_rows)
        if table is not None:
            return table
    return _any_table(path, raw, profile)


def _plain_table(path: Path, raw: bytes, plain_rows: PlainRows) -> Table | None:
    """Return a table of plain numbers below a header, None where it is not that.

    Such rows tell nothing of what the file is: its first three lines do.
    """
    header = raw.find(b"\n") + 1
    first = raw.find(b"\n", header) + 1
    head = raw[: raw.find(b"\n", first) + 1]
    if not is_plain(text_and_words(head, path)[0]):
        return None
    values = plain_rows(raw, header, raw.count(b",", header, first) + 1)
    table = None if values is None else _any_table(path, head, None)
    if values is None or table is None or table.lines.tolist() != [2, 3]:
        return None
    columns = (
        dataclasses.replace(column, values=own)
        for column, own in zip(table.columns, values, strict=True)
    )
    rows = values.shape[1]
    lines = np.arange(2, rows + 2)
    return dataclasses.replace(table, columns=tuple(columns), rows=rows, lines=lines)


def _any_table(path: Path, raw: bytes, profile: str | None) -> Table:
    """Return what a file holds, from its bytes."""
    if is_mat(raw):
        return read_mat(path, raw)
    text, words = text_and_words(raw, path)
    head = text[:200_000]
    if is_scope(head, words):
        return read_scope(path, text)
    if is_height_map(head):
        return read_height_map(path, text)
    if is_run_table(head, words):
        return read_run_table(path, text)
    if is_bed_mesh(text):
        return read_bed_mesh(path, text, profile)
    return read_csv(path, text)

"""Read a measurement file of any known format, recognised by its content."""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ._capture import is_capture, read_capture
from ._csv import number_column, read_cells, read_csv, table_of
from ._errors import MeasurementError
from ._hdf5 import is_hdf5, read_hdf5
from ._instruments import (
    is_addresses,
    is_centroid,
    is_renishaw,
    read_addresses,
    read_centroid,
    read_renishaw,
)
from ._layout import find_layout
from ._mat import is_mat, read_mat
from ._matrix import is_matrix, read_matrix
from ._mesh import is_bed_mesh, is_height_map, read_bed_mesh, read_height_map
from ._parquet import read_parquet
from ._run_table import is_run_table, read_run_table
from ._scope import read_scope
from ._scope_block import is_scope
from ._table import Lines, Skipped, Table
from ._tdms import read_tdms
from ._text import Text, decode, unpacked

_BULK = 1 << 22
"""Bytes from which on a file is not looked at as a whole."""
_HEAD = 1 << 17
"""Bytes that tell how it is laid out."""


def read_table(
    path: Path,
    *,
    profile: str | None = None,
    lines: Lines | None = None,
) -> Table:
    """Return what a measurement file holds, in the file's own units.

    Text tables of many kinds, matrices of a surface, TwinCAT Scope text exports,
    Renishaw, LinuxCNC and Centroid files, captures in JSON, MATLAB files, HDF5, TDMS,
    Parquet, ISO 230-2 run tables, Klipper bed meshes and RepRapFirmware height maps are
    told apart by content, not by the ending of the name; text and MATLAB files may be
    packed with gzip.

    Args:
        path: The file.
        profile: Which profile of a Klipper file with several; see `Table.remarks`.
        lines: What is known of the lines of a text table; of a file that counts its rows,
            which of them.

    Raises:
        OSError: If the file cannot be read.
        MeasurementError: If it holds nothing usable; names the line and what was
            expected. If a file without lines is told of them.
    """
    with path.open("rb") as file:
        magic = file.read(8)
    if magic.startswith(b"PAR1"):
        return _chosen(read_parquet(path), lines)
    if is_hdf5(magic):
        return _chosen(read_hdf5(path), lines)
    if magic.startswith(b"TDSm"):
        return _chosen(read_tdms(path), lines)
    if lines is None and path.stat().st_size >= _BULK:
        table = _bulk_table(path)
        if table is not None:
            return table
    raw = unpacked(path.read_bytes(), path)
    if is_mat(raw):
        return _chosen(read_mat(path, raw), lines)
    if is_capture(raw):
        return _chosen(read_capture(path, raw), lines)
    decoded = decode(raw, path)
    reader = special_reader(decoded, profile) if lines is None else None
    if reader is not None:
        return reader(path, decoded.text)
    return read_csv(path, decoded.text, encoding=decoded.encoding, lines=lines)


def _chosen(table: Table, lines: Lines | None) -> Table:
    """Return the rows that are asked for of a file that has no lines but counts its rows.

    Raises:
        MeasurementError: If nothing is left, or lines are named that it cannot have.
    """
    if lines is None:
        return table
    if not table.counts_rows or lines.header is not None:
        keys = (
            "header is a key" if table.counts_rows else "skip, header and rows are keys"
        )
        reason = f"found {table.format}, which has no lines: {keys} for text tables"
        raise MeasurementError(str(table.path), reason)
    first, last = lines.rows or (1, int(table.lines[-1]))
    keep = (table.lines >= first) & (table.lines <= last)
    keep &= ~np.isin(table.lines, lines.skip)
    if not keep.any():
        raise MeasurementError(
            str(table.path), "found no rows but those left out (skip, rows)"
        )
    left_out = [Skipped(int(row), "left out by the job") for row in table.lines[~keep]]
    return dataclasses.replace(
        table,
        columns=tuple(column.take(keep, table.lines) for column in table.columns),
        rows=int(keep.sum()),
        lines=table.lines[keep],
        skipped=(*table.skipped, *left_out),
    )


def _bulk_table(path: Path) -> Table | None:
    """Return a long table of plain numbers, None where it is not that.

    Its first lines tell what it is; the rest goes to pyarrow as it lies on the disk. One
    blank line, comment, word or missing number is enough for the careful way.
    """
    import pyarrow as pa

    with path.open("rb") as file:
        start = file.read(_HEAD)
        file.seek(-1, 2)
        ended = file.read() == b"\n"
    start = start[: start.rfind(b"\n") + 1]
    try:
        head = decode(unpacked(start, path), path)
        if head.encoding != "utf-8" or b"\r" in start.replace(b"\r\n", b""):
            return None
        layout = None if special_reader(head) else find_layout(path, head.text)
    except MeasurementError:
        return None
    if layout is None or len(layout.names) < 2 or not all(layout.numeric):
        return None
    if layout.dialect.separator == " " or layout.dialect.thousands or '"' in head.text:
        return None
    offset = 0
    for _ in range(layout.body_line - 1):
        offset = start.index(b"\n", offset) + 1
    with pa.memory_map(str(path)) as file:
        body = file.read_buffer()[offset:]
        cells = read_cells(body, layout, blank_lines=False, threads=True)
        if cells is None:
            return None
        values = [np.asarray(column.to_numpy()) for column in cells.columns]
    with np.errstate(all="ignore"):
        # Summing up finds any cell that is no number.
        if not all(np.isfinite(column.sum()) for column in values):
            return None
    columns = [
        number_column(name, array, None)
        for name, array in zip(layout.names, values, strict=True)
    ]
    rows = cells.num_rows
    lines = np.arange(layout.body_line, layout.body_line + rows)
    assert ended or rows  # a last line without its end is a row like the others
    return table_of(path, layout, columns, lines, (), head.encoding)


def special_reader(
    decoded: Text, profile: str | None = None
) -> Callable[[Path, str], Table] | None:
    """Return the reader of a text in a format of its own; None: it is a plain table.

    Args:
        decoded: The text, or its first part.
        profile: See `read_table`.
    """
    head = decoded.text[:200_000]
    if is_scope(head):
        return read_scope
    if is_height_map(head):
        return read_height_map
    if is_run_table(head):
        return read_run_table
    if is_bed_mesh(decoded.text):
        return functools.partial(read_bed_mesh, profile=profile)
    if is_renishaw(head):
        return read_renishaw
    if is_centroid(head):
        return read_centroid
    if is_matrix(head):
        return read_matrix
    if is_addresses(head):
        return functools.partial(read_addresses, encoding=decoded.encoding)
    return None

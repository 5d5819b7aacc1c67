"""Read a measurement file of any known format, recognised by its content."""

from pathlib import Path

from ._csv import read_csv
from ._mat import is_mat, read_mat
from ._mesh import is_bed_mesh, is_height_map, read_bed_mesh, read_height_map
from ._parquet import read_parquet
from ._run_table import is_run_table, read_run_table
from ._scope import read_scope
from ._scope_block import is_scope
from ._table import Table
from ._text import text_and_words, unpacked


def read_table(path: Path, *, profile: str | None = None) -> Table:
    """Return what a measurement file holds, in the file's own units.

    CSV, TwinCAT Scope text exports, MATLAB files, Parquet, ISO 230-2 run tables,
    Klipper bed meshes and RepRapFirmware height maps are told apart by content, not by
    the ending of the name; text and MATLAB files may be packed with gzip.

    Args:
        path: The file.
        profile: Which profile of a Klipper file with several; see `Table.remarks`.

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

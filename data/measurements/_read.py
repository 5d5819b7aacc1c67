"""Read a measurement file of any known format, recognised by its content."""

from pathlib import Path

from ._csv import read_csv
from ._errors import MeasurementError
from ._mesh import is_bed_mesh, is_height_map, read_bed_mesh, read_height_map
from ._parquet import read_parquet
from ._run_table import is_run_table, read_run_table
from ._table import Table
from ._text import decode, load_bytes


def read_table(path: Path, *, profile: str | None = None) -> Table:
    """Return what a measurement file holds, in the file's own units.

    CSV, Parquet, ISO 230-2 run tables, Klipper bed meshes and RepRapFirmware height
    maps are told apart by content, not by the ending of the name.

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
    if magic == b"PAR1":
        return read_parquet(path)
    text = decode(load_bytes(path), path)
    head = text[:200_000]
    if is_height_map(head):
        return read_height_map(path, text)
    if is_run_table(head):
        return read_run_table(path, text)
    if is_bed_mesh(text):
        return read_bed_mesh(path, text, profile)
    if head.startswith("Name") and "Starttime of export" in head:
        reason = "found a TwinCAT Scope text export, expected plain columns of numbers"
        raise MeasurementError(str(path), reason)
    return read_csv(path, text)

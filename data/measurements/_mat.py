"""MATLAB files of versions 5 to 7.2: vectors of one length are the columns."""

from pathlib import Path

from ._errors import MeasurementError
from ._mat_elements import DamagedMat, read_version_5
from ._table import Table
from ._vectors import table_of_arrays

_EXPECTED = "a MATLAB file with vectors of numbers"


def is_mat(raw: bytes) -> bool:
    """Whether the bytes begin like a MATLAB file of versions 5 to 7.2."""
    return raw.startswith(b"MATLAB 5.0")


def read_mat(path: Path, raw: bytes) -> Table:
    """Return the vectors of a MATLAB file as columns; see `table_of_arrays`.

    Fields of structures are named ``structure.field``.

    Raises:
        MeasurementError: If the file is damaged or holds no vector.
    """
    try:
        arrays = list(read_version_5(raw))
    except DamagedMat as error:
        reason = f"found damaged MATLAB data ({error}), expected {_EXPECTED}"
        raise MeasurementError(str(path), reason) from error
    return table_of_arrays(path, "MATLAB", arrays, _EXPECTED)

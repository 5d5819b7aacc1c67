"""HDF5 files and MATLAB files of version 7.3, which are such: data sets are the columns."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import MeasurementError, damaged
from ._table import Table
from ._vectors import Array, table_of_arrays
from ._words import AXIS

_EXPECTED = "data sets of numbers of one length"
_UNITS = ("unit", "units", "Unit", "Units")


def is_hdf5(magic: bytes) -> bool:
    """Whether the first eight bytes are those of HDF5, or of MATLAB 7.3."""
    return magic.startswith((b"\x89HDF\r\n\x1a\n", b"MATLAB 7"))


def read_hdf5(path: Path) -> Table:
    """Return the data sets of an HDF5 file as columns; see `table_of_arrays`.

    Data sets of several groups are named ``group.name``, fields of a compound likewise; units
    come from the attribute ``unit`` or ``units``. Matrices of MATLAB are transposed, as
    that program writes them.

    Raises:
        MeasurementError: If h5py is not installed, the file is damaged, or it holds no
            vector of numbers.
    """
    try:
        import h5py
    except ImportError:
        raise missing_library(path, "HDF5", "h5py") from None
    with path.open("rb") as file:
        matlab = file.read(6) == b"MATLAB"
    try:
        with h5py.File(path, "r") as file:
            arrays = [
                array
                for key in map(str, file)
                for array in _arrays(h5py, file[key], key, matlab)
            ]
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise damaged(path, "HDF5", error) from error
    groups = {
        array.name.rpartition(".")[0]
        for array in arrays
        if array.values is not None and array.values.size > 1
    }
    if (
        len(groups) == 1
        and re.fullmatch(AXIS, (group := groups.pop()).casefold()) is None
    ):
        # One group for all tells nothing, and is no axis: "laser.error".
        arrays = [
            dataclasses.replace(array, name=array.name.removeprefix(f"{group}."))
            for array in arrays
        ]
    name = "MATLAB 7.3" if matlab else "HDF5"
    return table_of_arrays(path, name, arrays, _EXPECTED)


def missing_library(path: Path, kind: str, library: str) -> MeasurementError:
    """Return the error that a library is not installed, ready to raise."""
    reason = f"found {kind}, which needs {library}: pip install 'axcomp[formats]'"
    return MeasurementError(str(path), reason)


def _arrays(h5py: Any, item: Any, name: str, matlab: bool) -> list[Array]:
    if name.startswith("#"):
        return []  # MATLAB keeps its references there
    if isinstance(item, h5py.Group):
        return [
            array
            for key in item
            for array in _arrays(h5py, item[key], f"{name}.{key}", matlab)
        ]
    if item.dtype.names:
        values = item[()]
        return [
            _array(f"{name}.{field}", np.asarray(values[field]), None)
            for field in item.dtype.names
        ]
    if item.dtype.kind not in "biuf":
        return [Array(name, None, f"{item.dtype}, which is no number")]
    kind = item.attrs.get("MATLAB_class", b"")
    if matlab and kind == b"char":
        return [Array(name, None, "text")]
    values = np.asarray(item[()])
    attribute = next((item.attrs[key] for key in _UNITS if key in item.attrs), None)
    unit = attribute.decode() if isinstance(attribute, bytes) else attribute
    return [_array(name, values.T if matlab else values, unit and str(unit))]


def _array(name: str, values: np.ndarray, unit: str | None) -> Array:
    if values.dtype.kind not in "biuf":
        return Array(name, None, f"{values.dtype}, which is no number")
    return Array(name, values.reshape(-1) if values.ndim == 0 else values, "", unit)

"""TDMS files of LabVIEW and DIAdem: channels are the columns."""

import logging
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import MeasurementError, damaged
from ._hdf5 import missing_library
from ._table import Table
from ._vectors import Array, table_of_arrays

_EXPECTED = "channels of numbers of one length"
_UNITS = ("unit_string", "NI_UnitDescription", "unit")


def read_tdms(path: Path) -> Table:
    """Return the channels of a TDMS file as columns; see `table_of_arrays`.

    Channels of several groups are named ``group.channel``. Where the file gives start
    and increment of a waveform, a column of the time in s stands before its channels.

    Raises:
        MeasurementError: If npTDMS is not installed, the file is damaged, or it holds no
            channel of numbers.
    """
    try:
        import nptdms
        from nptdms.log import log_manager
    except ImportError:
        raise missing_library(path, "TDMS", "npTDMS") from None
    log_manager.set_level(logging.ERROR)  # what it warns of is refused below, in a line
    arrays: list[Array] = []
    try:
        with nptdms.TdmsFile.open(path) as file:
            groups = [group for group in file.groups() if group.channels()]
            for group in groups:
                for channel in group.channels():
                    single = len(groups) == 1
                    name = channel.name if single else f"{group.name}.{channel.name}"
                    arrays += _arrays(channel, name, first=not arrays)
            cut = file.file_status.incomplete_final_segment
    except (OSError, ValueError, KeyError, IndexError, EOFError, struct.error) as error:
        raise damaged(path, "TDMS", error) from error
    if cut:
        reason = "found a TDMS file that was cut off, expected a whole file"
        raise MeasurementError(str(path), reason)
    return table_of_arrays(path, "TDMS", arrays, _EXPECTED)


def _arrays(channel: Any, name: str, *, first: bool) -> list[Array]:
    """Return a channel, before the first one its time where the file states that."""
    values = np.asarray(channel[:])
    if values.dtype.kind == "M":
        seconds = (values - values[:1]) / np.timedelta64(1, "s")
        return [Array("time" if first else name, seconds, "", "s")]
    if values.dtype.kind not in "biuf":
        return [Array(name, None, f"{values.dtype}, which is no number")]
    about = channel.properties
    unit = next((str(about[key]) for key in _UNITS if about.get(key)), None)
    step = float(about.get("wf_increment", 0.0))
    arrays = [Array(name, values, "", unit)]
    if first and step > 0.0:
        start = float(about.get("wf_start_offset", 0.0))
        time = start + step * np.arange(values.size)
        arrays.insert(0, Array("time", time, "", "s"))
    return arrays

"""The table of all results: one row per fit, one for a job that failed. Versioned.

Columns are only ever added; a change of meaning raises the version.
"""

import functools
from typing import Any

VERSION = 1
"""Stands in the metadata of the Parquet file as ``axcomp.schema``."""

_STAGES = ("before", "predicted", "from_file")
_FIGURES = ("rms", "max")
_ISO = ("A", "R", "B", "E", "M")

COLUMNS: dict[str, tuple[str, str]] = {
    "job": ("string", "name of the job in the batch"),
    "state": ("string", "`done`, or `failed`: no list was written, `reason` says why"),
    "reason": ("string", "why the job failed, else null"),
    "passed": (
        "bool",
        "the fit passed every check of its gate, and its files have no error",
    ),
    "verified": (
        "bool",
        "every convention used is verified; else the list lies in `unverified/`",
    ),
    "verdict": (
        "string",
        "`good`, `unproven`, `undetermined`, `rejected`; null where the job failed",
    ),
    "folder": (
        "string",
        "of the job's files, relative to that of the batch; null where failed",
    ),
    "title": ("string", "of the job"),
    "machine_id": ("string", "`machine.id`, or null"),
    "measured_at": ("date", "`machine.measured_at`, or null"),
    "fit": ("int", "number of the fit in the job, from 0"),
    "compensation": ("string", "`leadscrew`, `plane`, …"),
    "axis": ("string", "name of the compensated axis in the job"),
    "axis_number": ("int", "its logical number"),
    "unit": ("string", "unit of all errors: `mm`, `deg` or that of the current"),
    **{
        f"{stage}_{figure}": (
            "float",
            f"{figure} of the error {words}, wild readings aside",
        )
        for stage, words in zip(
            _STAGES,
            (
                "as measured",
                "predicted on data the fit did not see",
                "under the written file",
            ),
            strict=True,
        )
        for figure in _FIGURES
    },
    **{
        f"{stage}_{figure}": (
            "float",
            f"{figure} of ISO 230-2, {stage.replace('_', ' ')}",
        )
        for stage in _STAGES
        for figure in _ISO
    },
    "noise": ("float", "standard deviation of one reading"),
    "rounding": ("float", "largest effect of rounding to list units"),
    "table": ("floats", "entries of the written table, branch by branch, row by row"),
    "deviation": ("floats", "their standard deviations"),
    "support": ("ints", "readings that touch each node; 0 = not measured"),
    "gate_failed": ("strings", "names of the gate's checks that failed"),
    "warnings": ("strings", "remarks of level warning or error"),
    "files": ("strings", "written files, relative to `folder`"),
    "job_sha256": ("string", "hash of the job file"),
    "inputs_sha256": (
        "string",
        "hash of all files that the job reads: itself, measurements, existing lists",
    ),
    "wall_time": ("float", "seconds that the job took, those of its group included"),
}
"""Name, type and meaning of every column; lengths in mm, angles in °."""


@functools.cache
def arrow_schema() -> Any:
    """Return the schema for pyarrow."""
    import pyarrow as pa

    kinds = {
        "string": pa.string(),
        "bool": pa.bool_(),
        "int": pa.int64(),
        "float": pa.float64(),
        "date": pa.date32(),
        "floats": pa.list_(pa.float64()),
        "ints": pa.list_(pa.int64()),
        "strings": pa.list_(pa.string()),
    }
    fields = [
        pa.field(name, kinds[kind], metadata={"meaning": meaning})
        for name, (kind, meaning) in COLUMNS.items()
    ]
    return pa.schema(fields, metadata={"axcomp.schema": str(VERSION)})

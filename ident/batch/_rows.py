"""The table of all results: one row per fit, one for a job that failed. Versioned.

Columns are only ever added; a change of meaning raises the version.
"""

import datetime
import functools
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...data.toml import TomlError, read_toml

VERSION = 1
"""Stands in the metadata of the Parquet file as ``axcomp.schema``."""

_STAGES = {
    "before": "as measured",
    "predicted": "predicted on data the fit did not see",
    "from_file": "under the written file",
}
_SIZES = ("rms", "max")
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
        "every convention that turns its sign or owner is verified; else the list lies in"
        " `unverified/`",
    ),
    "verdict": (
        "string",
        "`good`, `unproven`, `undetermined`, `rejected`; null where the job failed",
    ),
    "reasons": ("strings", "codes of its reasons: `no_gain`, `assumed`, `gate`, …"),
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
        for stage, words in _STAGES.items()
        for figure in _SIZES
    },
    **{
        f"{stage}_{figure}": (
            "float",
            f"{figure} of ISO 230-2, {stage.replace('_', ' ')}",
        )
        for stage in _STAGES
        for figure in _ISO
    },
    "noise": (
        "float",
        "standard deviation of one reading; of a crosstalk that of its noisiest quadrant",
    ),
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


Row = dict[str, Any]
"""One row; the keys are those of `COLUMNS`, absent ones are null."""


def rows_of(
    name: str, folder: str, verified: bool, job_hash: str, result: Mapping[str, Any]
) -> list[Row]:
    """Return the rows of a job that ran, one per fit, of what its ``result.json`` holds.

    The folder of its files is relative to that of the batch; it is verified where every
    convention that it used is.
    """
    machine = result["machine"]
    common = {
        "job": name,
        "state": "done",
        "verified": verified,
        "folder": folder,
        "title": result["title"],
        "machine_id": machine.get("id"),
        "measured_at": machine.get("measured_at"),
        "job_sha256": job_hash,
        "inputs_sha256": hash_of_inputs(result["inputs"]),
        "wall_time": result["wall_time"],
    }
    remarks = list(result["remarks"])
    for group in result.get("groups", ()):
        remarks += group["remarks"]
    return [
        common | {"fit": k} | _fit_row(fit, remarks)
        for k, fit in enumerate(result["fits"])
    ]


def identity_in(path: Path) -> Row:
    """Return what a job file that cannot run says of machine, date, axis and compensation.

    Axis and compensation only where all of its fits have the same.
    """
    try:
        tree = read_toml(path)[1]
    except (TomlError, OSError):
        return {}
    machine, fits = tree.get("machine"), tree.get("fits")
    machine = machine if isinstance(machine, Mapping) else {}
    fits = fits if isinstance(fits, list) else []
    row: Row = {
        "title": tree.get("title"),
        "machine_id": machine.get("id"),
        "measured_at": machine.get("measured_at"),
    }
    for key in ("axis", "compensation"):
        values = {str(fit.get(key)) for fit in fits if isinstance(fit, Mapping)}
        row[key] = values.pop() if len(values) == 1 else None
    texts = ("title", "machine_id")
    return row | {key: None for key in texts if not isinstance(row.get(key), str)}


def hash_of_inputs(inputs: Mapping[str, str]) -> str:
    """Return one hash for the hashes of all files of a job, by name."""
    lines = (f"{name} {inputs[name]}\n" for name in sorted(inputs))
    text = "".join(lines)
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()


def _fit_row(fit: Mapping[str, Any], remarks: Sequence[Mapping[str, str]]) -> Row:
    """Return the columns of a fit; ``remarks`` are those of the job and its groups."""
    row: Row = {
        "compensation": fit["compensation"],
        "axis": fit["axis"],
        "axis_number": fit["axis_number"],
        "unit": fit["unit"],
        "noise": max(_flat(fit.get("noise")) or [None], key=_size),
        "rounding": fit.get("rounding"),
        "table": _flat(fit.get("parameters", {}).get("table")),
        "deviation": _flat(fit.get("standard_deviations", {}).get("table")),
        "support": _flat(fit.get("support")),
        "files": list(fit["files"]),
        "verdict": fit.get("verdict"),
        "reasons": [reason["code"] for reason in fit.get("reasons", ())],
    }
    for stage, figures in fit["error"].items():
        for figure in _SIZES:
            plain = figures.get(figure)
            row[f"{stage}_{figure}"] = figures.get(f"{figure}_without_wild", plain)
        for figure in _ISO:
            row[f"{stage}_{figure}"] = figures.get(figure)
    every = [*remarks, *fit["remarks"]]
    sound = all(entry["level"] != "error" for entry in every)
    row["gate_failed"] = [entry["name"] for entry in fit["gate"] if not entry["passed"]]
    row["passed"] = bool(fit["passed"]) and sound and fit.get("verdict") != "rejected"
    levels = ("warning", "error")
    row["warnings"] = [entry["message"] for entry in every if entry["level"] in levels]
    return {key: value for key, value in row.items() if key in COLUMNS}


def _size(noise: float | None) -> float:
    """Return what a noise counts; that of a quadrant without events is none."""
    return -1.0 if noise is None or noise != noise else noise


def _flat(table: Any) -> list[Any] | None:
    """Return all numbers of a table in a row; branches follow each other."""
    if table is None:
        return None
    parts = table.values() if isinstance(table, Mapping) else [table]
    rows = [np.ravel(part) for part in parts if part is not None]
    return [value for part in rows for value in part.tolist()]


def as_date(value: Any) -> datetime.date | None:
    """Return the day of a date or its text; None where it is neither."""
    if isinstance(value, datetime.date):
        return value
    try:
        return datetime.date.fromisoformat(str(value)[:10])
    except ValueError:
        return None

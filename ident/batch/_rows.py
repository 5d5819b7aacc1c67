"""Rows of the table of results, from what a job wrote or from why it failed."""

import datetime
import hashlib
import itertools
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ._schema import COLUMNS

Row = dict[str, Any]
"""One row; the keys are those of `COLUMNS`, absent ones are null."""


def rows_of(
    name: str, folder: str, verified: bool, job_hash: str, result: Mapping[str, Any]
) -> list[Row]:
    """Return the rows of a job that ran, one per fit.

    Args:
        name: Of the job.
        folder: Of its files, relative to that of the batch.
        verified: Whether every convention that it used is verified.
        job_hash: SHA-256 of the job file.
        result: Its ``result.json``, or the tree that is written there: of that, the
            numbers are still what NumPy has.
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
    general = [
        remark["message"]
        for remark in remarks
        if remark["level"] in ("warning", "error")
    ]
    whole = not any(remark["level"] == "error" for remark in remarks)
    return [
        common | _fit_row(k, fit, general, whole)
        for k, fit in enumerate(result["fits"])
    ]


def hash_of_inputs(inputs: Mapping[str, str]) -> str:
    """Return one hash for the hashes of all files of a job, by name."""
    lines = (f"{name} {inputs[name]}\n" for name in sorted(inputs))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def failed_row(name: str, reason: str, **known: Any) -> Row:
    """Return the row of a job that failed."""
    return {"job": name, "state": "failed", "reason": reason, "passed": False, **known}


def _fit_row(k: int, fit: Mapping[str, Any], general: list[str], whole: bool) -> Row:
    row: Row = {
        "fit": k,
        "compensation": fit["compensation"],
        "axis": fit["axis"],
        "axis_number": fit["axis_number"],
        "unit": fit["unit"],
        "noise": fit.get("noise"),
        "rounding": fit.get("rounding"),
        "table": _flat(fit.get("parameters", {}).get("table")),
        "deviation": _flat(fit.get("standard_deviations", {}).get("table")),
        "support": _flat(fit.get("support")),
        "files": list(fit["files"]),
        "verdict": fit.get("verdict"),
    }
    for stage, figures in fit["error"].items():
        for figure in ("rms", "max"):
            plain = figures.get(figure)
            row[f"{stage}_{figure}"] = figures.get(f"{figure}_without_wild", plain)
        for figure in ("A", "R", "B", "E", "M"):
            row[f"{stage}_{figure}"] = figures.get(figure)
    levels = {remark["level"] for remark in fit["remarks"]}
    row["gate_failed"] = [one["name"] for one in fit["gate"] if not one["passed"]]
    sound = whole and fit.get("verdict") != "rejected" and "error" not in levels
    row["passed"] = bool(fit["passed"]) and sound
    row["warnings"] = general + [
        remark["message"]
        for remark in fit["remarks"]
        if remark["level"] in ("warning", "error")
    ]
    return {key: value for key, value in row.items() if key in COLUMNS}


def _flat(table: Any) -> list[Any] | None:
    """Return all numbers of a table in a row; branches follow each other."""
    if table is None:
        return None
    if isinstance(table, int | float):
        return [table]
    if isinstance(table, np.ndarray):
        return list(table.ravel().tolist())
    if isinstance(table, Mapping):
        parts: Iterable[Any] = table.values()
    elif table and isinstance(table[0], list):
        parts = table
    else:
        return list(table)
    return list(itertools.chain.from_iterable(filter(None, map(_flat, parts))))


def as_date(value: Any) -> datetime.date | None:
    """Return the day of a date or its text; None where it is neither."""
    if isinstance(value, datetime.date):
        return value
    try:
        return datetime.date.fromisoformat(str(value)[:10])
    except ValueError:
        return None

"""``result.json``: what a job found, for machines (interface.md)."""

import datetime
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..proof import ErrorFigures
from ._result import FitResult, JobResult


def result_json(result: JobResult) -> str:
    """Return ``result.json`` as text; it holds no NaN and no infinity."""
    return json.dumps(plain(as_tree(result)), indent=1, allow_nan=False) + "\n"


def as_tree(result: JobResult) -> dict[str, Any]:
    """Return a job's result as nested dictionaries and lists."""
    return {
        "title": result.title,
        "machine": dict(result.machine),
        "passed": result.passed,
        "fits": [_fit(fit) for fit in result.fits],
        "remarks": [vars(remark) for remark in result.remarks],
        "load_sheet": [vars(step) for step in result.load_sheet],
        "files": [str(file) for file in result.files],
        "inputs": dict(result.inputs),
        "versions": dict(result.versions),
        "wall_time": result.wall_time,
        "job": dict(result.job),
    }


def _fit(fit: FitResult) -> dict[str, Any]:
    parameters: dict[str, Any] = {
        "table": _values(fit.table),
        "nodes": [list(nodes) for nodes in fit.nodes],
    }
    if fit.cycles is not None:
        parameters["n_backlash_cyc"] = fit.cycles
    return {
        "compensation": fit.compensation,
        "axis": fit.axis,
        "axis_number": fit.axis_number,
        "masters": list(fit.masters),
        "unit": fit.unit,
        "parameters": parameters,
        "standard_deviations": {"table": _values(fit.standard_deviation)},
        "support": _values(fit.support),
        "noise": fit.fit.noise,
        "smoothness": dict(fit.fit.smoothness),
        "loss": fit.fit.loss,
        "runs": [vars(run) for run in fit.fit.runs],
        "message": fit.fit.message,
        "rounding": fit.rounding,
        "error": {name: _figures(error) for name, error in fit.error.items()},
        "held_out": fit.held_out,
        "passed": fit.passed,
        "gate": [vars(check) for check in fit.gate],
        "findings": [dict(finding) for finding in fit.findings],
        "remarks": [vars(remark) for remark in fit.remarks],
        "conventions": [vars(convention) for convention in fit.conventions],
        "files": [str(file) for file in fit.files],
        "verified_by": fit.verified_by,
    }


def _values(branches: Mapping[str, np.ndarray]) -> Any:
    """Return a table as an array, or as ``{pos, neg}`` where it has named branches."""
    return branches[""] if "" in branches else dict(branches)


def _figures(error: ErrorFigures) -> dict[str, float]:
    return {
        "rms": error.rms,
        "max": error.max,
        "rms_without_wild": error.sound.rms,
        "max_without_wild": error.sound.max,
        **(error.iso230 or {}),
    }


def plain(value: Any) -> Any:
    """Return a value that JSON can hold; NaN and infinity become null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path | datetime.date):
        return str(value)
    return value

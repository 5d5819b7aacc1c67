"""``result.json``: what a job found, for machines (interface.md)."""

import datetime
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..proof import ErrorFigures
from ._result import AbstractResult, JobResult

_TEXT = json.JSONEncoder(allow_nan=False).encode
_DEPTH = 3
"""Down to the entries of a fit."""


def result_json(result: JobResult) -> str:
    """Return ``result.json`` as text; it holds no NaN and no infinity."""
    return _lines(plain(as_tree(result)), _DEPTH) + "\n"


def _lines(value: Any, depth: int) -> str:
    """Return JSON with an entry per line down to a depth; tables stay on one line."""
    if depth and value and isinstance(value, dict):
        parts = [f"{_TEXT(k)}: {_lines(v, depth - 1)}" for k, v in value.items()]
        return "{\n" + ",\n".join(parts) + "\n}"
    if depth and value and isinstance(value, list):
        return "[\n" + ",\n".join(_lines(v, depth - 1) for v in value) + "\n]"
    return _TEXT(value)


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


def _fit(fit: AbstractResult) -> dict[str, Any]:
    return {
        "compensation": fit.compensation,
        "axis": fit.axis,
        "axis_number": fit.axis_number,
        "unit": fit.unit,
        # Tables alone have a prior; the key is there for all.
        "smoothness": None,
        **fit.details(),
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
    if type(value) in (str, int, bool):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        numbers = value.dtype.kind == "f"
        whole = not numbers or bool(np.isfinite(value).all())
        return value.tolist() if whole else plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path | datetime.date):
        return str(value)
    return value

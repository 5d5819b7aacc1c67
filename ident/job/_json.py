"""``result.json``: what a job found, for machines (interface.md)."""

import dataclasses
import datetime
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ._job_result import JobResult
from ._result import AbstractResult

_DEPTH = 3
"""Down to the entries of a fit."""
_text = json.JSONEncoder(allow_nan=False).encode


def result_json(result: JobResult) -> str:
    """Return ``result.json`` as text; it holds no NaN and no infinity."""
    return tree_json(result.tree)


def tree_json(tree: Mapping[str, Any]) -> str:
    """Return the tree of ``result.json``, all of it `plain`, as text."""
    return _lines(dict(tree), _DEPTH) + "\n"


def _lines(value: Any, depth: int) -> str:
    """Return JSON with an entry per line down to a depth; tables stay on one line."""
    if depth and value and isinstance(value, dict):
        below = [f"{_text(key)}: {_lines(v, depth - 1)}" for key, v in value.items()]
        return "{\n" + ",\n".join(below) + "\n}"
    if depth and value and isinstance(value, list):
        return "[\n" + ",\n".join([_lines(v, depth - 1) for v in value]) + "\n]"
    return _text(value)


def as_tree(result: JobResult) -> dict[str, Any]:
    """Return a job's result as nested dictionaries and lists that JSON can hold."""
    tree = {
        "title": result.title,
        "machine": result.machine,
        "passed": result.passed,
        "verdict": str(result.verdict),
        "fits": [_fit(fit) for fit in result.fits],
        "whole": {one.axis: one.as_tree() for one in result.whole},
        "groups": [group.as_tree() for group in result.groups],
        "remarks": result.remarks,
        "load_sheet": result.load_sheet,
        "files": result.files,
        "second_measurement": result.second,
        "clocks": result.clocks,
        "inputs": result.inputs,
        "versions": result.versions,
        "wall_time": result.wall_time,
        "job": result.job,
    }
    return {key: plain(value) for key, value in tree.items()}


def _fit(fit: AbstractResult) -> dict[str, Any]:
    judged, again = fit.judgement, fit.again
    diagnosis = None if again is None else again.diagnosis
    return {
        "compensation": fit.compensation,
        "axis": fit.axis,
        "axis_number": fit.axis_number,
        "unit": fit.unit,
        "group": fit.group,
        # Tables alone have a prior; the key is there for all.
        "smoothness": None,
        **fit.details(),
        "error": {name: error.as_tree() for name, error in fit.error.items()},
        "held_out": fit.held_out,
        "passed": fit.passed,
        "verdict": str(judged.verdict),
        "reasons": [reason.as_tree() for reason in judged.reasons],
        "gate": fit.gate,
        "findings": fit.findings,
        "remarks": fit.remarks,
        "conventions": fit.conventions,
        "files": fit.files,
        "verified_by": again.source if again and fit.confirmed else None,
        "diagnosis": None if diagnosis is None else diagnosis.as_tree(),
    }


def plain(value: Any) -> Any:
    """Return a value that JSON can hold: NaN and infinity null, a record its fields."""
    if value is None or type(value) in (str, int, bool):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        whole = value.dtype.kind != "f" or bool(np.isfinite(value).all())
        return value.tolist() if whole else plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        return {name: plain(getattr(value, name)) for name in names}
    return str(value) if isinstance(value, Path | datetime.date) else value

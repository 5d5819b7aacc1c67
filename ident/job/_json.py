"""``result.json``: what a job found, for machines (interface.md)."""

import datetime
import json
import math
from collections.abc import Mapping
from json.encoder import encode_basestring_ascii
from pathlib import Path
from typing import Any

import numpy as np

from ._job_result import JobResult
from ._result import AbstractResult

_DEPTH = 3
"""Down to the entries of a fit."""
_PLAIN = (dict, list, int, float, type(None))
_NUMPY = (np.ndarray, np.generic)
_WORDS: Mapping[Any, str] = {None: "null", True: "true", False: "false"}


def _known(value: Any) -> Any:
    """Return a value in terms that JSON knows, what it holds left as it is."""
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, _NUMPY):
        return value.tolist()
    # Last but one, since to ask for a `Mapping` takes longest.
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Path | datetime.date):
        return str(value)
    msg = (
        f"found {type(value).__name__}, expected a number, a text, a list or a mapping"
    )
    raise TypeError(msg)


_TEXT = json.JSONEncoder(allow_nan=False, default=_known).encode


def result_json(result: JobResult) -> str:
    """Return ``result.json`` as text; it holds no NaN and no infinity."""
    return tree_json(result.tree)


def tree_json(tree: Mapping[str, Any]) -> str:
    """Return the tree of ``result.json`` as text."""
    try:
        return _lines(tree, _DEPTH) + "\n"
    except (TypeError, ValueError):
        # Something that JSON does not know, such as a NaN: look at every number then.
        return _lines(plain(tree), _DEPTH) + "\n"


def _lines(value: Any, depth: int) -> str:
    """Return JSON with an entry per line down to a depth; tables stay on one line."""
    # To set up the encoder takes longer than to encode what is no table.
    kind = type(value)
    if kind is str:
        return encode_basestring_ascii(value)
    if kind is int or (kind is float and math.isfinite(value)):
        return repr(value)
    if value is None or kind is bool:
        return _WORDS[value]
    if not depth:
        return _TEXT(value)
    value = _known(value)
    if value and isinstance(value, dict):
        below = [
            f"{encode_basestring_ascii(str(k))}: {_lines(v, depth - 1)}"
            for k, v in value.items()
        ]
        return "{\n" + ",\n".join(below) + "\n}"
    if value and isinstance(value, list):
        return "[\n" + ",\n".join([_lines(v, depth - 1) for v in value]) + "\n]"
    return _TEXT(value)


def as_tree(result: JobResult) -> dict[str, Any]:
    """Return a job's result as nested dictionaries and lists."""
    return {
        "title": result.title,
        "machine": dict(result.machine),
        "passed": result.passed,
        "verdict": str(result.verdict),
        "fits": [_fit(fit) for fit in result.fits],
        "whole": {one.axis: one.as_tree() for one in result.whole},
        "groups": [group.as_tree() for group in result.groups],
        "remarks": [vars(remark) for remark in result.remarks],
        "load_sheet": [vars(step) for step in result.load_sheet],
        "files": [str(file) for file in result.files],
        "second_measurement": result.second,
        "clocks": [vars(clock) for clock in result.clocks],
        "inputs": dict(result.inputs),
        "versions": dict(result.versions),
        "wall_time": result.wall_time,
        "job": dict(result.job),
    }


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
        "gate": [vars(check) for check in fit.gate],
        "findings": [dict(finding) for finding in fit.findings],
        "remarks": [vars(remark) for remark in fit.remarks],
        "conventions": [vars(convention) for convention in fit.conventions],
        "files": [str(file) for file in fit.files],
        "verified_by": dict(again.source) if again and fit.confirmed else None,
        "diagnosis": None if diagnosis is None else diagnosis.as_tree(),
    }


def plain(value: Any) -> Any:
    """Return a value that JSON can hold; NaN and infinity become null."""
    if value is None or type(value) in (str, int, bool):
        return value
    if type(value) is float:
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        numbers = value.dtype.kind == "f"
        whole = not numbers or bool(np.isfinite(value).all())
        return value.tolist() if whole else plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, Mapping):
        return plain(dict(value))
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path | datetime.date):
        return str(value)
    return value

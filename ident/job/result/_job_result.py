"""What a job found: the structure behind ``result.json`` (interface.md), report and exit status."""

import dataclasses
import datetime
import functools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...proof import GateCheck
from ...readings import ClockState
from ..write._output import RESULT
from ._result import AbstractResult, Remark, TableResult
from ._verdict import Verdict

if TYPE_CHECKING:
    from ..joint._proof import GroupResult


_SIZES = {
    "largest_offset": ("max_correction", 1.0),
    "slope": ("max_slope", 1e-3),
    "kink": ("max_kink", 1.0),
    "velocity": ("max_velocity", 1.0),
    "acceleration": ("max_acceleration", 1.0),
    "jump": ("max_jump", 1.0),
}
"""What result.json says of an axis: its line of the gate, and what makes it mm or mm/mm of that."""


@dataclasses.dataclass(frozen=True)
class WholeAxis:
    """All that will act on one axis, read from the files and judged together.

    Attributes:
        compensations: What acts on its position.
        sizes: Largest value by line of the gate, of the sum and of what the axis moves by itself;
            those that were not judged are left out.
        error: rms by measurement and fit in mm or °: ``before``, by this list ``alone``, by all
            ``together``; empty where one list acts alone, as its own figures stand.
        gate: Lines of the gate for the axis.
        remarks: What the user must know.
        switching: Largest step in one cycle where a fitted compensation comes or goes, in mm or °.
    """

    axis: str
    compensations: tuple[str, ...]
    sizes: Mapping[str, float]
    error: Mapping[str, Mapping[str, float]]
    gate: tuple[GateCheck, ...]
    remarks: tuple[Remark, ...]
    switching: Mapping[str, float]

    @property
    def failed(self) -> bool:
        """Whether its lists must not be loaded."""
        error = any(remark.level == "error" for remark in self.remarks)
        return error or not all(check.passed for check in self.gate)

    def as_tree(self) -> dict[str, Any]:
        """Return what result.json says of the axis; its remarks stand with its fits."""
        return {
            "axis": self.axis,
            "compensations": self.compensations,
            **{k: u * self.sizes.get(n, math.nan) for k, (n, u) in _SIZES.items()},
            "error": self.error,
            "gate": self.gate,
            "switching": self.switching,
        }


@dataclasses.dataclass(frozen=True)
class LoadStep:
    """One line of the load sheet: what to do, with which file or entry, and why."""

    action: str
    detail: str


@dataclasses.dataclass(frozen=True)
class JobResult:
    """Everything a job did.

    Attributes:
        machine: Its identity (id, measured_at) as given.
        fits: One entry per ``[[fits]]``, in order.
        inputs: SHA-256 by file name, relative to the job.
        versions: Of axcomp, Python and the numerical libraries.
        load_sheet: Which file goes where, reload or restart, activation, the way back.
        remarks: What concerns the job as a whole.
        wall_time: In s.
        job: The job as resolved (defaults filled in), for the record.
        clocks: How files of one measurement were put onto one clock.
        groups: Fits that were identified together.
        second: The second measurement, where there is one: ``file``, ``sha256``,
            ``date``, hashes of its ``inputs`` and of the ``lists`` that it is about.
        whole: All that will act on each axis, judged together.
        digests: SHA-256 of the written files by name, by which a later run knows its own.
        conventions: All rules of the controller that were reckoned with, by name.
    """

    title: str
    machine: Mapping[str, Any]
    fits: tuple[AbstractResult, ...]
    inputs: Mapping[str, str]
    versions: Mapping[str, str]
    remarks: tuple[Remark, ...]
    job: Mapping[str, Any]
    load_sheet: tuple[LoadStep, ...] = ()
    wall_time: float = 0.0
    clocks: tuple[ClockState, ...] = ()
    groups: tuple["GroupResult", ...] = ()
    second: Mapping[str, Any] | None = None
    whole: tuple[WholeAxis, ...] = ()
    digests: Mapping[str, str] = dataclasses.field(default_factory=dict)
    conventions: Mapping[str, int | str] = dataclasses.field(default_factory=dict)

    @functools.cached_property
    def tree(self) -> dict[str, Any]:
        """What ``result.json`` says, as nested dictionaries and lists that JSON can hold."""
        tree = {
            "title": self.title,
            "machine": self.machine,
            "passed": self.passed,
            "verdict": str(self.verdict),
            "fits": [_fit(fit) for fit in self.fits],
            "whole": {axis.axis: axis.as_tree() for axis in self.whole},
            "groups": [group.as_tree() for group in self.groups],
            "remarks": self.remarks,
            "load_sheet": self.load_sheet,
            "files": self.files,
            "digests": self.digests,
            "second_measurement": self.second,
            "clocks": self.clocks,
            "inputs": self.inputs,
            "versions": self.versions,
            "wall_time": self.wall_time,
            "job": self.job,
            "conventions": self.conventions,
        }
        return {key: plain(value) for key, value in tree.items()}

    @property
    def files(self) -> tuple[Path, ...]:
        """All files written, relative to the output folder."""
        return (*map(Path, self.digests), Path(RESULT))

    @property
    def tables(self) -> tuple[TableResult, ...]:
        """The fits that are tables, in order."""
        return tuple(fit for fit in self.fits if isinstance(fit, TableResult))

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of its fits."""
        order = list(Verdict)
        verdicts = [fit.judgement.verdict for fit in self.fits]
        return max(verdicts, key=order.index, default=Verdict.GOOD)

    @property
    def confirmed(self) -> bool:
        """Whether a second measurement, where there is one, shows something and confirms it."""
        states = [fit.confirmed for fit in self.fits if fit.again is not None]
        return all(states) and (self.second is None or bool(states))

    @property
    def passed(self) -> bool:
        """Whether every list passed its gate and nothing requested is missing."""
        # A list that failed its gate is rejected.
        if any(fit.judgement.verdict is Verdict.REJECTED for fit in self.fits):
            return False
        fits = (remark for fit in self.fits for remark in fit.remarks)
        groups = (remark for group in self.groups for remark in group.remarks)
        remarks = (*self.remarks, *fits, *groups)
        return all(remark.level != "error" for remark in remarks)


_DEPTH = 3
"""Down to the entries of a fit."""
_text = json.JSONEncoder(allow_nan=False).encode


def tree_json(tree: Mapping[str, Any]) -> str:
    """Return the tree of ``result.json``, all of it `plain`, as text without NaN."""
    return _lines(dict(tree), _DEPTH) + "\n"


def _lines(value: Any, depth: int) -> str:
    """Return JSON with an entry per line down to a depth; tables stay on one line."""
    if depth and value and isinstance(value, dict):
        below = [f"{_text(key)}: {_lines(v, depth - 1)}" for key, v in value.items()]
        return "{\n" + ",\n".join(below) + "\n}"
    if depth and value and isinstance(value, list):
        return "[\n" + ",\n".join([_lines(v, depth - 1) for v in value]) + "\n]"
    return _text(value)


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
        "conventions": fit.rules,
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

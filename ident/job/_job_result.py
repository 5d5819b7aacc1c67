"""What a job found: the structure behind result.json, report and exit status."""

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..proof import GateCheck
from ..readings import ClockState
from ._result import AbstractResult, Remark, TableResult
from ._verdict import Verdict

if TYPE_CHECKING:
    from .joint import GroupResult


@dataclasses.dataclass(frozen=True)
class WholeAxis:
    """All that will act on one axis, read from the files and judged together.

    NaN where it was not judged. Lengths in mm (or °).

    Attributes:
        axis: Name in the job.
        compensations: What acts on its position.
        largest_offset: Of the sum.
        slope: Of the sum, in mm per mm.
        kink: Change of the velocity at a node, in mm/s at the feed of the gate.
        velocity: That is added at this feed, in mm/s.
        acceleration: Likewise, in mm/s².
        jump: By which the axis moves by itself at most where all comes or goes.
        switching: Largest step in one cycle where a fitted compensation comes or goes.
        error: rms by measurement and fit: ``before``, by this list ``alone``, by all
            ``together``; empty where one list acts alone, as its own figures stand.
        gate: Lines of the gate for the axis.
        remarks: What the user must know.
    """

    axis: str
    compensations: tuple[str, ...]
    largest_offset: float
    slope: float
    kink: float
    velocity: float
    acceleration: float
    jump: float
    error: Mapping[str, Mapping[str, float]]
    gate: tuple[GateCheck, ...]
    remarks: tuple[Remark, ...]
    switching: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def as_tree(self) -> dict[str, Any]:
        """Return what result.json says of the axis; its remarks stand with its fits."""
        return {name: value for name, value in vars(self).items() if name != "remarks"}


@dataclasses.dataclass(frozen=True)
class LoadStep:
    """One line of the load sheet: what to do, with which file or entry, and why."""

    action: str
    detail: str


@dataclasses.dataclass(frozen=True)
class JobResult:
    """Everything a job did.

    Attributes:
        title: Of the job; ``machine`` its identity (id, measured_at) as given.
        fits: One entry per ``[[fits]]``, in order.
        inputs: SHA-256 by file name, relative to the job.
        versions: Of axcomp, Python and the numerical libraries.
        load_sheet: Which file goes where, reload or restart, activation, the way back.
        remarks: What concerns the job as a whole.
        files: All files written, relative to the output folder.
        wall_time: Seconds.
        job: The job as resolved (defaults filled in), for the record.
        clocks: How files of one measurement were put onto one clock.
        groups: Fits that were identified together.
        second: The second measurement, where there is one: ``file``, ``sha256``,
            ``date``, hashes of its ``inputs`` and of the ``lists`` that it is about.
        whole: All that will act on each axis, judged together.
    """

    title: str
    machine: Mapping[str, Any]
    fits: tuple[AbstractResult, ...]
    inputs: Mapping[str, str]
    versions: Mapping[str, str]
    load_sheet: tuple[LoadStep, ...]
    remarks: tuple[Remark, ...]
    files: tuple[Path, ...]
    wall_time: float
    job: Mapping[str, Any]
    clocks: tuple[ClockState, ...] = ()
    groups: tuple["GroupResult", ...] = ()
    second: Mapping[str, Any] | None = None
    whole: tuple[WholeAxis, ...] = ()

    @functools.cached_property
    def tree(self) -> dict[str, Any]:
        """What ``result.json`` says, as nested dictionaries and lists."""
        from ._json import as_tree

        return as_tree(self)

    @property
    def tables(self) -> tuple[TableResult, ...]:
        """The fits that are tables, in order."""
        return tuple(fit for fit in self.fits if isinstance(fit, TableResult))

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of its fits."""
        order = list(Verdict)
        found = [fit.judgement.verdict for fit in self.fits]
        return max(found, key=order.index, default=Verdict.GOOD)

    @property
    def confirmed(self) -> bool:
        """Whether a second measurement, where there is one, confirms all that it shows."""
        return all(fit.confirmed for fit in self.fits if fit.again is not None)

    @property
    def passed(self) -> bool:
        """Whether every list passed its gate and nothing requested is missing."""
        if any(f.judgement.verdict is Verdict.REJECTED for f in self.fits):
            return False
        return all(fit.passed for fit in self.fits) and not any(
            remark.level == "error"
            for remark in (
                *self.remarks,
                *(r for fit in self.fits for r in fit.remarks),
                *(r for group in self.groups for r in group.remarks),
            )
        )

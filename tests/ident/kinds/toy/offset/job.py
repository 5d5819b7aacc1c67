"""The offset of one axis: the median of its error, written, judged, read back."""

import dataclasses
from typing import Any, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from axcomp.data.lists import ListFile, Value
from axcomp.ident.exchange import Reading
from axcomp.ident.job._draft import (
    AbstractDraft,
    AxisLists,
    Leftovers,
    Planned,
    Written,
)
from axcomp.ident.job._gating import limits_of
from axcomp.ident.job.file._load import Job
from axcomp.ident.job.result._result import AbstractResult, Remark, staged
from axcomp.ident.proof import GateCheck, gate_check
from axcomp.ident.readings import Tables, Wanted, read_joined

from .entries import ENTRIES, Constant
from .keys import Spec


def plan(job: Job, tables: Tables, index: int, fit: Spec, lists: AxisLists) -> Planned:
    """Plan a fit."""

    def draft(left: Leftovers) -> AbstractDraft:
        wanted = Wanted((fit.axis,), "no", lengths=False)
        return OffsetDraft(index, fit, lists, read_joined(tables, fit, wanted).error)

    return draft


@final
@dataclasses.dataclass(frozen=True)
class OffsetDraft(AbstractDraft):
    """A fitted offset."""

    fit: Spec
    error: Float[np.ndarray, " t"]

    @property
    def value(self) -> float:
        return -float(np.median(self.error))

    @property
    def needs(self) -> str:
        return "Works from start-up on"

    def entries(self, job: Job) -> dict[str, Value]:
        model = Constant(jnp.asarray(self.value))
        return dict(ENTRIES.to_list(model, (), job.conventions))

    def jump(self, job: Job) -> float:
        return abs(self.value)

    def gate(self, job: Job, cycles: int | None) -> tuple[GateCheck, ...]:
        limit = limits_of(job).max_correction
        return (gate_check("max_correction", abs(self.value), limit, "mm", "anywhere"),)

    def prove(self, done: Written) -> AbstractResult:
        listing = done.compensation
        assert listing is not None
        value = self._read_back(done.job, listing)
        wild = np.zeros(len(self.error), dtype=bool)
        left = self.error + value
        return OffsetResult(
            **self.frame(done),
            error=staged(self.error, left, left, wild),
            remarks=(Remark.info("The same everywhere."), *done.files.remarks),
            files=done.names,
            value=value,
        )

    def _read_back(self, job: Job, listing: ListFile) -> float:
        number = job.spec.axes[self.axis].number
        return float(ENTRIES.model(listing, number, Reading(job.conventions)).value)


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class OffsetResult(AbstractResult):
    """The offset of an axis, as written, in mm."""

    value: float

    def details(self) -> dict[str, Any]:
        return {"parameters": {"offset": self.value}}

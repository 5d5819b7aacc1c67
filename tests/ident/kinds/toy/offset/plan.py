"""The offset of one axis: the median of its error, written, judged, read back."""

import dataclasses
from typing import TYPE_CHECKING, Any, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from axcomp.data.lists import ListFile, Value
from axcomp.ident.exchange import Reading
from axcomp.ident.job._draft import (
    AbstractDraft,
    AbstractPlan,
    Leftovers,
)
from axcomp.ident.job.joint._recording import read_group
from axcomp.ident.job.result._result import AbstractResult, Remark, staged
from axcomp.ident.proof import GateCheck, gate_check
from axcomp.ident.readings import Tables

from .entries import ENTRIES, Constant
from .keys import Spec

if TYPE_CHECKING:
    from axcomp.ident.job.write._lists import AxisFiles


def plan(tables: Tables, index: int, fit: Spec) -> "OffsetPlan":
    """Plan a fit."""
    return OffsetPlan(tables.job, index, fit)


@final
@dataclasses.dataclass(frozen=True)
class OffsetPlan(AbstractPlan):
    """A planned offset."""

    fit: Spec

    def fit_single(self, tables: Tables, left: Leftovers) -> AbstractDraft:
        error = read_group(tables, [self]).data.error[self.axis]
        return OffsetDraft(self.job, self.index, self.fit, error)


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

    def entries(self) -> dict[str, Value]:
        model = Constant(jnp.asarray(self.value))
        return dict(ENTRIES.to_list(model, target=self.target))

    @property
    def jump(self) -> float:
        return abs(self.value)

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        limit = self.job.spec.gate.max_correction
        return (gate_check("max_correction", abs(self.value), limit, "mm", "anywhere"),)

    def prove(self, done: "AxisFiles") -> AbstractResult:
        listing = done.compensation
        assert listing is not None
        value = self._read_back(listing)
        wild = np.zeros(len(self.error), dtype=bool)
        left = self.error + value
        return OffsetResult(
            **self.frame(done),
            error=staged(self.error, left, left, wild),
            remarks=(Remark.info("The same everywhere."), *done.remarks),
            value=value,
        )

    def _read_back(self, listing: ListFile) -> float:
        number = self.job.spec.axes[self.axis].number
        reading = Reading(self.job.conventions)
        return float(ENTRIES.model(listing, number, reading).value)


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class OffsetResult(AbstractResult):
    """The offset of an axis, as written, in mm."""

    value: float

    def details(self) -> dict[str, Any]:
        return {"parameters": {"offset": self.value}}

"""The keys of a leadscrew table in a job."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal

from .._keys import Fault, KeyPath, LineSpec

if TYPE_CHECKING:
    from ...exchange import AbstractTable
    from ...job.file._load import Job
    from ...job.file._schema import Axis, JobFile


class Spec(LineSpec, frozen=True):
    """A leadscrew table: error of the axis over its own position."""

    lacking = ("n_cycles",)

    compensation: Literal["leadscrew"]
    bilateral: bool = False
    """One table per direction; it contains the backlash. Example: `true`."""
    modulo: bool = False
    """Whether the points include the repeated end: first = last. Example: `true`."""

    @property
    def switches_off(self) -> tuple[str, ...]:
        return ("backlash",) if self.bilateral else ()

    @property
    def form(self) -> dict[str, bool]:
        return {"bilateral": self.bilateral}

    def turns(self, axes: "Mapping[str, Axis]") -> bool:
        return self.modulo

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        yield from super().faults(job, where)
        axis = job.axes.get(self.axis)
        linear = axis is not None and axis.kind == "linear" and not axis.modulo
        if self.modulo and linear:
            yield (
                (*where, "modulo"),
                f"found axis {self.axis} of type linear without modulo, expected a rotary"
                " axis or its modulo range",
            )

    def refuse(self, job: "Job", index: int, table: "AbstractTable") -> None:
        for name in self.sources:
            conflict = set(self.switches_off) & set(job.spec.measurements[name].active)
            if conflict:
                raise job.error(
                    ("measurements", name, "active"),
                    f"found {conflict.pop()} for a bilateral leadscrew fit, which switches"
                    " it off (both would compensate the reversal), expected a"
                    " measurement without it",
                )

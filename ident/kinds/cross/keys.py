"""The keys of a cross table in a job."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal

from .._keys import Fault, KeyPath, LineSpec, master_faults

if TYPE_CHECKING:
    from ...exchange import AbstractTable
    from ...job.file._load import Job
    from ...job.file._schema import Axis, JobFile


class Spec(LineSpec, frozen=True):
    """A cross table: error of the axis over the position of one master."""

    compensation: Literal["cross"]
    master: str
    """The axis over which the error is tabulated. Example: `"X"`."""

    @property
    def over(self) -> tuple[str, ...]:
        return (self.master,)

    def turns(self, axes: "Mapping[str, Axis]") -> bool:
        return axes[self.master].modulo is not None

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        yield from super().faults(job, where)
        yield from master_faults(job, self, (*where, "master"))

    def refuse(self, job: "Job", index: int, table: "AbstractTable") -> None:
        limits = job.spec.axes[self.master].limits or (math.inf, -math.inf)
        first, last = table.nodes[0].positions[[0, -1]]
        short = first > limits[0] + 1e-9 or last < limits[1] - 1e-9
        if short and not table.periodic:  # S-12
            raise job.error(
                ("fits", index),
                f"found nodes from {first:g} to {last:g}, expected them to reach the"
                f" software limits of {self.master}, {limits[0]:g} to {limits[1]:g}:"
                " what the controller does outside a cross table is not documented",
            )
        if job.conventions.cross_list == "master":
            raise job.error(
                ("fits", index),
                "found the convention cross_list = 'master', expected 'slave': cross"
                " tables are written into the list of the compensated axis",
            )

    def warnings(self, job: "Job") -> list[str]:
        master = job.spec.axes[self.master]
        if master.limits is not None or master.modulo is not None:
            return []
        return [
            f"No software limits of {self.master} are given: make sure that the nodes"
            " reach them, since what the controller does outside a cross table is not"
            " documented."
        ]

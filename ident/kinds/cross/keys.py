"""The keys of a cross table in a job."""

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
        self._refuse_short(job, index, table)
        if job.conventions.cross_list == "master":
            raise job.error(
                ("fits", index),
                "found the convention cross_list = 'master', expected 'slave': cross"
                " tables are written into the list of the compensated axis",
            )

    def _refuse_short(self, job: "Job", index: int, table: "AbstractTable") -> None:
        """Raise where the table ends inside its master's software limits (S-12)."""
        limits = job.spec.axes[self.master].limits
        if limits is None or table.periodic:
            return
        ends = table.nodes[0].positions[[0, -1]]
        if ends[0] > limits[0] + 1e-9 or ends[1] < limits[1] - 1e-9:
            raise job.error(
                ("fits", index),
                f"found nodes from {ends[0]:g} to {ends[1]:g}, expected them to reach"
                f" the software limits of {self.master}, {limits[0]:g} to"
                f" {limits[1]:g}: what the controller does outside a cross table is"
                " not documented",
            )

    def warnings(self, job: "Job") -> list[str]:
        if job.spec.axes[self.master].limits is not None:
            return []
        return [
            f"No software limits of {self.master} are given: make sure that the nodes"
            " reach them, since what the controller does outside a cross table is not"
            " documented."
        ]

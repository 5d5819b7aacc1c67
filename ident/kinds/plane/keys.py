"""The keys of a plane in a job."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from .._keys import Count, Fault, Grid, KeyPath, Positive, TableSpec, master_faults

if TYPE_CHECKING:
    from ...job.file._schema import JobFile

_Two = Field(min_length=2, max_length=2)


class Spec(TableSpec, frozen=True):
    """A plane: error of the axis over the positions of two masters."""

    compensation: Literal["plane"]
    masters: Annotated[list[str], _Two]
    """The two axes over which the error is tabulated. Example: `["X", "Y"]`."""
    start: Annotated[list[float], _Two] | None = None
    """First node over each master in mm or °. Example: `[-40.0, -70.0]`."""
    interval: Annotated[list[Positive], _Two] | None = None
    """Distance of the nodes. Example: `[10.0, 10.0]`."""
    points: Annotated[list[Count], _Two] | None = None
    """Number of nodes. Example: `[41, 41]`."""

    @property
    def over(self) -> tuple[str, ...]:
        return (self.masters[0], self.masters[1])

    @property
    def nodes(self) -> tuple[Grid | list[float], ...]:
        if self.start is None or self.interval is None or self.points is None:
            return ()
        return tuple(zip(self.start, self.interval, self.points, strict=True))

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        yield from super().faults(job, where)
        yield from master_faults(job, self, (*where, "masters"))
        for name in self.masters:
            if name in job.axes and job.axes[name].modulo is not None:
                yield (
                    (*where, "masters"),
                    f"found the modulo axis {name!r}, expected axes with two ends: over"
                    " an axis that goes round both edges of a plane must be equal"
                    " (S-20), and planes are fitted without that. A cross table over"
                    f" {name} goes round; a plane can, where {name} never passes its"
                    " transition and is stated without modulo",
                )

"""The keys of a backlash in a job: none of its own."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from .._keys import Fault, FitSpec, KeyPath

if TYPE_CHECKING:
    from ...job.file._schema import JobFile


class Spec(FitSpec, frozen=True):
    """Backlash; no keys of its own."""

    lacking = ("smoothness", "max_points", "n_cycles", "manual_activation")

    compensation: Literal["backlash"]

    @property
    def lengths(self) -> bool:
        return True

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        for k, other in enumerate(job.fits):
            if other.axis == self.axis and self.compensation in other.switches_off:
                yield (
                    (*where, "compensation"),
                    f"found backlash beside the bilateral {other.compensation} of"
                    f" fits[{k}], both of which compensate the reversal, expected one of"
                    " them",
                )

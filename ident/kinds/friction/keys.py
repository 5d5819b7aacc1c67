"""The keys of a friction fit in a job."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from .._keys import Fault, FitSpec, KeyPath, Positive, unkept

if TYPE_CHECKING:
    from ...job.file._schema import JobFile


class Spec(FitSpec, frozen=True):
    """Friction of a drive."""

    lacking = ("smoothness", "n_cycles", "manual_activation")

    compensation: Literal["friction"]
    table_entries: Annotated[int, Field(ge=3)] | None = None
    """Most knots of the list; left out: as many as it takes. Example: `8`."""
    inertia: Literal["fit"] | Positive | None = None
    """Current per acceleration where it is known; left out: fitted. Example:
    `"fit"`."""
    method: Literal["inverse", "output_error"] = "inverse"
    """Whether the current is explained (`inverse`), or the motion that it makes.
    Example: `"output_error"`."""
    solver: Literal["optimistix", "ipopt"] = "optimistix"
    """Solver of the output-error fit. Example: `"ipopt"`."""
    constraints: list[Literal["monotone", "non-negative"]] = Field(default_factory=list)
    """What the law must keep: over the speed it falls nowhere (`"monotone"`), or never
    below 0 (`"non-negative"`); with ipopt. Example: `["non-negative"]`."""
    reversal: bool = False
    """Whether lookahead, distance and delay at reversals are fitted. Example:
    `true`."""
    level: Annotated[float, Field(gt=0)] | None = None
    """Share of the friction that the list gives; left out: 0.15 until `friction_sign`
    is verified. Example: `0.5`."""
    rated_current: Positive | None = None
    """Rated current of the drive in A. Example: `12.0`."""
    rated_torque: Positive | None = None
    """Rated torque in N·m, where the recording holds a torque. Example: `8.5`."""
    torque_unit: Positive | None = None
    """Share of the rated value that one unit of the list is; left out: the law is
    reported, and no list is written. Example: `0.001`."""

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        if self.rated_current is not None and self.rated_torque is not None:
            expected = "expected the one that suits the recording"
            yield (*where, "rated_torque"), f"found beside rated_current, {expected}"
        for key in ("solver", "constraints"):
            if key in self.model_fields_set and self.method != "output_error":
                reason = f"found with method {self.method!r}, expected 'output_error'"
                yield (*where, key), reason
        yield from unkept(self.constraints, self.solver, where)

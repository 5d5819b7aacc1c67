"""The keys of a friction fit in a job."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from .._keys import Count, Fault, FitSpec, KeyPath, Positive

if TYPE_CHECKING:
    from ...job._schema import JobFile


class Spec(FitSpec, frozen=True):
    """Friction of a drive."""

    lacking = ("smoothness", "n_cycles", "manual_activation")

    compensation: Literal["friction"]
    table_entries: Count | None = None
    inertia: Literal["fit"] | Positive | None = None
    method: Literal["inverse", "output_error"] = "inverse"
    solver: Literal["optimistix", "ipopt"] = "optimistix"
    constraints: list[Literal["non-negative"]] = Field(default_factory=list)
    reversal: bool = False
    level: Annotated[float, Field(ge=0)] | None = None
    rated_current: Positive | None = None
    rated_torque: Positive | None = None
    torque_unit: Positive | None = None

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        if self.rated_current is not None and self.rated_torque is not None:
            reason = (
                "found beside rated_current, expected the one that suits the recording"
            )
            yield (*where, "rated_torque"), reason
        if self.method != "output_error":
            for key in ("solver", "constraints"):
                if key in self.model_fields_set:
                    reason = (
                        f"found with method {self.method!r}, expected 'output_error'"
                    )
                    yield (*where, key), reason
        if self.constraints and self.solver != "ipopt":
            reason = (
                f"found with solver {self.solver!r}, expected 'ipopt', which keeps them"
            )
            yield (*where, "constraints"), reason

"""The keys of a crosstalk in a job."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from .._keys import Fault, FitSpec, KeyPath, Positive, not_linear, unknown
from . import SAFE_TESTS

if TYPE_CHECKING:
    from ...job.file._schema import JobFile

_Place = Annotated[list[float], Field(min_length=1, max_length=2)]


class Spec(FitSpec, frozen=True):
    """Crosstalk between two axes."""

    lacking = ("smoothness",)

    compensation: Literal["crosstalk"]
    master: str
    """The axis whose acceleration bends this one. Example: `"X"`."""
    adaptation: str | list[str] | None = None
    """The axis, or two, over whose position the effect changes. Example: `["Z"]`."""
    mode: Literal[1, 2, 3, "auto"] = "auto"
    """How the controller goes between the tests. Example: `2`."""
    velocity_dependent: bool | None = None
    """Whether the direction of motion counts. Example: `true`."""
    acceleration: Positive | None = None
    """Acceleration of the tests in mm/s². Example: `5000.0`."""
    deceleration: Annotated[float, Field(lt=0)] | None = None
    """Deceleration of the tests in mm/s², negative. Example: `-5000.0`."""
    positions: list[_Place] | None = None
    """Places of the tests in mm, one list per place. Example: `[[0.0], [400.0]]`."""

    @property
    def adapts_to(self) -> tuple[str, ...]:
        """Axes on whose positions it may depend."""
        if isinstance(self.adaptation, str):
            return (self.adaptation,)
        return tuple(self.adaptation or ())

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        pairs = [("master", self.master)]
        pairs += [("adaptation", name) for name in self.adapts_to]
        for key, name in pairs:
            if name not in job.axes:
                yield (*where, key), unknown(name, job.axes, "an axis")
        if self.master == self.axis:
            found = f"found {self.axis!r}, the compensated axis itself"
            yield (*where, "master"), f"{found}, expected another"
        why = "the units of a crosstalk list are not defined for others"
        for key, name in (("axis", self.axis), *pairs):
            yield from not_linear(job, name, (*where, key), why)
        yield from self._tests(where)

    def _tests(self, where: KeyPath) -> Iterator[Fault]:
        """Yield what is wrong with the tests that are asked for."""
        names = list(self.adapts_to)
        if len(names) > 2 or len(set(names)) < len(names):
            yield (*where, "adaptation"), f"found {names}, expected one or two axes"
        if isinstance(self.mode, int) and self.mode - 1 > len(names):
            yield (
                (*where, "adaptation"),
                f"found {len(names)} axes for mode {self.mode}, expected {self.mode - 1}",
            )
        if self.max_points is not None and self.max_points > SAFE_TESTS:
            reason = f"found {self.max_points} tests, expected at most {SAFE_TESTS}"
            yield (*where, "max_points"), reason
        if self.positions is None:
            return
        widths = {len(place) for place in self.positions}
        if widths != {len(names)}:
            yield (
                (*where, "positions"),
                f"found {' and '.join(map(str, sorted(widths))) or 'no'} numbers per"
                f" test, expected {len(names)}, one per adaptation axis",
            )
        if len(self.positions) > SAFE_TESTS:
            reason = f"found {len(self.positions)}, expected at most {SAFE_TESTS} tests"
            yield (*where, "positions"), reason

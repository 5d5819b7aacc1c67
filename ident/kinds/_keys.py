"""The keys of a fit in a job: what those of all compensations have in common.

Each compensation has its own in the part ``keys`` of its folder: a class ``Spec``.
"""

import abc
import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from . import kind
from ._kind import Kind

if TYPE_CHECKING:
    from ..exchange import AbstractTable
    from ..job.file._load import Job
    from ..job.file._schema import Axis, JobFile

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=2)]
Grid = tuple[float, float, int]
"""Start, interval and number of nodes."""
KeyPath = tuple[str | int, ...]
"""Where a key stands: ``("fits", 0, "start")``."""
Fault = tuple[KeyPath, str]
"""A key and what is wrong with it."""


class JobPart(BaseModel, frozen=True):
    """A table of the job file: no other keys, no text for a number, no NaN."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class FitSpec(JobPart, frozen=True):
    """Keys that every fit has, and what a job asks of its specification.

    Attributes:
        lacking: Keys of those below that its list has no entry for.
        parts: Classes of its keys that are tables themselves.
    """

    lacking: ClassVar[tuple[str, ...]] = ()
    parts: ClassVar[Mapping[str, type[JobPart]]] = {}

    compensation: str
    """Which compensation. Example: `"leadscrew"`."""
    axis: str
    """The axis that is compensated. Example: `"X"`."""
    measurement: str | None = None
    """Name of the measurement. Example: `"laser"`."""
    measurements: Annotated[list[str], Field(min_length=1)] | None = None
    """Names, where there are several. Example: `["monday", "friday"]`."""
    smoothness: Literal["auto"] | Annotated[float, Field(ge=0)] = "auto"
    """Weight of the squared second differences per node distance, relative to 1/noise²;
    0: each node rests on its own readings; `"auto"`: by evidence. Example: `0.0`."""
    loss: Literal["student", "huber", "gauss"] = "student"
    """How readings far from the others count: `"gauss"` takes every one as it stands.
    Example: `"huber"`."""
    max_points: Annotated[int, Field(ge=1, le=2**32 - 2)] | None = None
    """Size of the table in the controller; left out: written only where the default is
    too small. Example: `200`."""
    n_cycles: Annotated[int, Field(ge=0, le=20)] | None = None
    """Cycles over which switching is spread; left out: chosen such that the gate holds.
    Example: `10`."""
    manual_activation: bool | None = None
    """Whether the compensation waits for `COMP ON` in the NC program. Example:
    `true`."""
    group: str | None = None
    """Fits of one name are identified together. Example: `"Z"`."""

    @property
    def kind(self) -> Kind:
        """The facts of its compensation."""
        return kind(self.compensation)

    @property
    def name(self) -> str:
        """Compensation and axis, for messages."""
        return f"{self.compensation} of {self.axis}"

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the measurements, joined for this fit."""
        if self.measurement is not None:
            return (self.measurement,)
        return tuple(self.measurements or ())

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose positions it acts, master 1 first."""
        return (self.axis,)

    @property
    def lengths(self) -> bool:
        """Whether its errors are lengths along its axis, which grow with the scale."""
        return self.kind.table and self.over == (self.axis,)

    @property
    def switches_off(self) -> tuple[str, ...]:
        """Compensations of its axis that are off beside it."""
        return ()

    @property
    def plc_files(self) -> tuple[str, ...]:
        """Names of the files that it may write for the PLC."""
        return ()

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        """Yield what is wrong beyond the types of its keys; `where` is the key of this fit."""
        yield from ()


def unkept(constraints: list[Any], solver: str, where: KeyPath) -> Iterator[Fault]:
    """Yield that the solver of a fit keeps no constraints; `where` is the key of the fit."""
    if constraints and solver != "ipopt":
        reason = f"found with solver {solver!r}, expected 'ipopt', which keeps them"
        yield (*where, "constraints"), reason


class TableSpec(FitSpec, frozen=True):
    """A table: values at nodes over one or two positions.

    Attributes:
        nodes_wanted: The keys that give its nodes, in words.
    """

    nodes_wanted: ClassVar[str] = "start, interval and points"

    solver: Literal["factor", "ipopt"] = "factor"
    """Solver: `"ipopt"` keeps constraints, the factor knows none. Example: `"ipopt"`."""
    constraints: list[Literal["monotone", "non-negative"]] = Field(default_factory=list)
    """What the entries of the list keep: along each master they turn back nowhere
    (`"monotone"`, per direction), none is below 0 (`"non-negative"`); with ipopt.
    Example: `["monotone"]`."""

    @property
    @abc.abstractmethod
    def nodes(self) -> tuple[Grid | list[float], ...]:
        """Nodes over each master, as grid or setpoints; empty: the job gives none."""

    @property
    def form(self) -> dict[str, bool]:
        """What its table has beside nodes and masters, as arguments of its class."""
        return {}

    def turns(self, axes: "Mapping[str, Axis]") -> bool:
        """Return whether its table goes round a modulo axis."""
        return False

    def refuse(self, job: "Job", index: int, table: "AbstractTable") -> None:
        """Raise where the table that it writes cannot stand on this machine.

        Raises:
            JobError: Naming the key.
        """

    def warnings(self, job: "Job") -> list[str]:
        """Return what the user must make sure of."""
        return []

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        yield from unkept(self.constraints, self.solver, where)
        if self.constraints and self.group is not None:
            reason = "found in a group, expected a fit of its own, which keeps them"
            yield (*where, "constraints"), reason
        grid = {key: getattr(self, key) for key in ("start", "interval", "points")}
        given = [key for key, value in grid.items() if value is not None]
        missing = [key for key in grid if key not in given]
        if getattr(self, "setpoints", None) is not None and given:
            reason = "found beside setpoints, expected one way to give the nodes"
            yield (*where, given[0]), reason
        if given and missing:
            yield (*where, missing[0]), f"found nothing, expected it beside {given[0]}"


class LineSpec(TableSpec, frozen=True):
    """Nodes along one position: single setpoints, or a grid."""

    nodes_wanted: ClassVar[str] = "setpoints, or start, interval and points"

    setpoints: Annotated[list[float], Field(min_length=2)] | None = None
    """Single nodes in mm or °, ascending; instead of a grid. Example: `[0.0, 25.0,
    100.0]`."""
    start: float | None = None
    """First node of a grid in mm or °. Example: `0.0`."""
    interval: Positive | None = None
    """Distance of its nodes. Example: `10.0`."""
    points: Count | None = None
    """Number of its nodes. Example: `81`."""

    @property
    def nodes(self) -> tuple[Grid | list[float], ...]:
        if self.setpoints is not None:
            return (self.setpoints,)
        if self.start is None or self.interval is None or self.points is None:
            return ()
        return ((self.start, self.interval, self.points),)


def master_faults(job: "JobFile", fit: FitSpec, where: KeyPath) -> Iterator[Fault]:
    """Yield what is wrong with the masters of a fit over other axes, at the key that names them."""
    for name in fit.over:
        if name not in job.axes:
            yield where, unknown(name, job.axes, "an axis")
        elif name == fit.axis:
            reason = f"found {name!r}, the compensated axis itself, expected another"
            yield where, reason
    if len(set(fit.over)) < len(fit.over):
        yield where, f"found {list(fit.over)}, expected two different axes"


def not_linear(job: "JobFile", name: str, where: KeyPath, why: str) -> Iterator[Fault]:
    """Yield that an axis is none of those that a compensation has units for."""
    axis = job.axes.get(name)
    if axis is not None and axis.kind != "linear":
        yield where, f"found the {axis.kind} axis {name}, expected a linear one: {why}"


def unknown(name: str, known: Iterable[str], what: str) -> str:
    """Return that a name is none of those that are known, and the nearest of them."""
    names = list(known)
    close = [other for other in names if other.casefold() == name.casefold()]
    close = close or difflib.get_close_matches(name, names, 1, cutoff=0.0)
    hint = f" (nearest: {close[0]!r})" if close else ""
    return f"found {name!r}, expected {what}: {', '.join(names) or 'none'}{hint}"

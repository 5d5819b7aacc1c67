"""What a joint fit is given: one row per reading, by axis and by sensor."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._errors import FitError

Columns = Mapping[str, np.ndarray]
"""Arrays of shape ``(t,)`` by the name of an axis or of a sensor."""

_TABLES = (
    "position",
    "error",
    "direction",
    "velocity",
    "acceleration",
    "temperature",
)


@dataclasses.dataclass(frozen=True)
class JointData:
    """Readings of one or several axes; NaN = not measured in this row.

    A name that is absent was not recorded at all.

    Attributes:
        position: Commanded, in mm or °, by axis.
        error: Actual − commanded (at rest) or actual − encoder (in motion) in mm or °, by
            compensated axis.
        direction: Of the last motion, ±1, by axis.
        velocity: In mm/s, by axis.
        acceleration: In mm/s², by axis.
        temperature: In °C, by sensor.
        time: In s; None where there is no clock.
        run: Number of the repeated run or separate set-up; None where there is one.
        runs: The same by axis, for axes on which other runs than these (or none) may have
            an offset of their own.
    """

    position: Columns = dataclasses.field(default_factory=dict)
    error: Columns = dataclasses.field(default_factory=dict)
    direction: Columns = dataclasses.field(default_factory=dict)
    velocity: Columns = dataclasses.field(default_factory=dict)
    acceleration: Columns = dataclasses.field(default_factory=dict)
    temperature: Columns = dataclasses.field(default_factory=dict)
    time: Float[np.ndarray, " t"] | None = None
    run: Int[np.ndarray, " t"] | None = None
    runs: Mapping[str, Int[np.ndarray, " t"] | None] = dataclasses.field(
        default_factory=dict
    )

    def run_of(self, axis: str) -> Int[np.ndarray, " t"] | None:
        """Return the runs that may have an offset of their own on an axis."""
        return self.runs.get(axis, self.run)

    def __post_init__(self) -> None:
        count = len(self)
        for table in _TABLES:
            for name, values in getattr(self, table).items():
                if np.shape(values) != (count,):
                    msg = (
                        f"{table} of {name}: found shape {np.shape(values)}, expected "
                        f"one number per row, ({count},)."
                    )
                    raise FitError(msg)
        for name in ("time", "run"):
            values = getattr(self, name)
            if values is not None and np.shape(values) != (count,):
                msg = (
                    f"{name}: found shape {np.shape(values)}, expected one number per "
                    f"row, ({count},)."
                )
                raise FitError(msg)

    def __len__(self) -> int:
        for table in _TABLES:
            for values in getattr(self, table).values():
                return len(values)
        for each in (self.time, self.run):
            if each is not None:
                return len(each)
        return 0

    def take(self, keep: Bool[np.ndarray, " t"] | Int[np.ndarray, " r"]) -> "JointData":
        """Return the readings that are kept (a mask, or row numbers).

        What remembers (the lag of a temperature) then knows only these rows: to leave rows out
        of a fit give `fit_joint` the whole recording and a mask.
        """
        tables = {
            table: {
                name: np.asarray(values)[keep]
                for name, values in getattr(self, table).items()
            }
            for table in _TABLES
        }
        return JointData(
            **tables,
            time=None if self.time is None else self.time[keep],
            run=None if self.run is None else self.run[keep],
            runs={
                axis: None if run is None else run[keep]
                for axis, run in self.runs.items()
            },
        )

    def column(self, table: str, name: str, wanted: str) -> Float[np.ndarray, " t"]:
        """Return one column.

        Args:
            table: Name of the attribute.
            name: Of the axis or sensor.
            wanted: What needs it, for the message.

        Raises:
            FitError: If it was not recorded.
        """
        found = getattr(self, table).get(name)
        if found is None:
            known = ", ".join(getattr(self, table)) or "none"
            msg = (
                f"{wanted}: needs the {table} of {name}, the data have that of {known}."
            )
            raise FitError(msg)
        return np.asarray(found, float)

"""A second measurement, with the new list active: all that may be called verified."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.errors import AxcompError
from ...data.measurements import Iso230, iso230
from ..proof import ErrorFigures, RunTable, error_figures


class SecondMeasurementError(AxcompError):
    """A second measurement cannot stand beside the first."""

    def __init__(self, name: str, found: str, expected: str) -> None:
        super().__init__(name, found, expected)
        self.name, self.found, self.expected = name, found, expected

    def __str__(self) -> str:
        return f"{self.name}: found {self.found}, expected {self.expected}"


@dataclasses.dataclass(frozen=True)
class SecondMeasurement:
    """Readings taken with the list of one fit active.

    Attributes:
        name: What the user calls it, as a rule the file.
        positions: Commanded positions in mm or °, shape ``(t, d)``, master 1 first.
        error: Error seen in mm or ° (the instrument's arbitrary offset or line removed
            as in the first measurement), shape ``(t,)``.
        direction: ±1 per reading, or None.
        run: Run per reading, or None.
        wild: Readings that are the instrument's fault, or None: rms and largest error
            are given without them as well, as for the first measurement.
    """

    name: str
    positions: Float[np.ndarray, "t d"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None = None
    run: Int[np.ndarray, " t"] | None = None
    wild: Bool[np.ndarray, " t"] | None = None

    def __post_init__(self) -> None:
        if self.error.size == 0 or not np.isfinite(self.error).all():
            found = f"{self.error.size} readings, {int(np.isfinite(self.error).sum())}"
            raise SecondMeasurementError(
                self.name, f"{found} of them numbers", "one number or more, and no gaps"
            )

    @property
    def sound(self) -> Bool[np.ndarray, " t"]:
        """Readings that are not wild."""
        everything = np.ones(len(self.error), dtype=bool)
        return everything if self.wild is None else np.asarray(~self.wild)

    @property
    def figures(self) -> ErrorFigures:
        """Rms and largest error, and ISO 230-2 for a run table, in mm or °."""
        runs = None
        if self.iso230 is not None and self.run is not None:
            assert self.direction is not None  # else there is no evaluation
            runs = RunTable(self.positions[:, 0], self.run, self.direction)
        return error_figures(self.error, runs, self.wild)

    @property
    def iso230(self) -> Iso230 | None:
        """Evaluation by ISO 230-2, or None where the readings are no run table."""
        if self.run is None or self.direction is None or self.positions.shape[1] != 1:
            return None
        return iso230(self.positions[:, 0], self.error, self.run, self.direction)

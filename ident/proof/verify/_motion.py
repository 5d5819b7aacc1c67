"""The motion of a log as the channels need it."""

import dataclasses
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...exchange import ExchangeError, Motion, direction_of_motion

MOST_CYCLES = 10
"""Cycles by which an offset is tried to be later or earlier."""

_HISTORY = 128
"""Cycles before a piece of a log that filters look back at."""


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class LogMotion(Motion):
    """Commanded motion of a log, one row per cycle or independent row.

    Attributes:
        cycle: Time step in s; None where the rows are independent.
        clock: Cycles by which what was reported was recorded later.
        drives: Position on the drive bus by axis, which contains the compensations.
        acting: Whether a compensation is on, per row, by axis and name, where the log says so.
        names: Of the axes, for sentences, where they have some.
    """

    cycle: float | None = None
    clock: float = 0.0
    drives: Mapping[int, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    acting: Mapping[tuple[int, str], Bool[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )

    names: Mapping[int, str] = dataclasses.field(default_factory=dict)

    def name(self, axis: int) -> str:
        """Return the name of an axis."""
        return self.names.get(axis, f"A{axis}")

    @property
    def edge_rows(self) -> int:
        """Rows at either end that are not judged: lags and filters reach beyond them."""
        return 0 if self.cycle is None else min(_HISTORY, self.rows // 8)

    @property
    def judged(self) -> slice:
        """The rows that are judged."""
        return slice(self.edge_rows, self.rows - self.edge_rows)

    @property
    def reach(self) -> int:
        """Cycles by which an offset may be late and still be judged."""
        return min(MOST_CYCLES, self.edge_rows)

    def has_actual(self, *axes: int) -> bool:
        """Return whether the log has the actual position of one of the axes."""
        return any(axis in self.actuals for axis in axes)

    def actual(self, axis: int, why: str) -> Float[np.ndarray, " t"]:
        """Return the actual position of an axis; one without is where it should be."""
        found = self.actuals.get(axis)
        return self.position(axis, why) if found is None else found

    def direction(
        self, axis: int, why: str, start: int, actual: bool = False
    ) -> Int[np.ndarray, " t"]:
        """Return the direction of motion of an axis, ±1 per row (S-21)."""
        if axis in self.directions:
            return self.directions[axis]
        place = self.actual(axis, why) if actual else self.position(axis, why)
        if self.cycle is None:
            return np.full(self.rows, start, dtype=np.int64)
        return direction_of_motion(self.unwrapped(axis, place), start)

    def required_rates(
        self, axis: int, why: str, actual: bool = False
    ) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return velocity and acceleration of an axis in mm/s and mm/s², or °.

        Raises:
            ExchangeError: If the log has neither them nor what they follow from.
        """
        velocity, acceleration = self.rates(axis, actual)
        if velocity is None or acceleration is None:
            raise ExchangeError(
                where=self.source,
                found=f"no velocity and acceleration of A{axis}, nor time",
                expected=f"A{axis}.position and time {why}",
            )
        return velocity, acceleration

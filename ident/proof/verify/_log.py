"""What a log holds: its motion, one column that is to be explained, and the drive's position."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.signals import estimate_delay
from ...exchange import ExchangeError, Motion, direction_of_motion
from ...exchange.controller._motion import Column, Columns

MOST_CYCLES = 10
"""Cycles by which an offset is tried to be later or earlier."""

_HISTORY = 128
"""Cycles before a piece of a log that filters look back at."""

RESOLUTION = 1e-4
"""mm or °: the unit of the lists, and the smallest difference that is spoken of."""

FLOOR = RESOLUTION / 10
"""Noise in mm that is taken for granted: the arithmetic of two programs differs."""

_REACH = 20
"""Cycles by which the drive bus may be late."""
_SURE = 3.0
"""Standard deviations from which on it is."""
_ENDS = 60
"""Rows at either end that the filter of the delay, and the delay, reach."""
_FEWEST = 3 * _ENDS
"""Rows from which on a log tells the delay."""

_COUNTED = 1.0
"""mm or ° of motion, or off zero, from which on a drive shows which way it counts."""
_ADDED = 0.1
"""mm or ° by which it may then differ from the command at standstill."""


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
    drives: Columns = dataclasses.field(default_factory=dict)
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

    def place(self, axis: int, why: str, actual: bool) -> Column:
        """Return where an axis is to be, or is; one without actual positions is there."""
        measured = self.actuals.get(axis) if actual else None
        return self.position(axis, why) if measured is None else measured

    def direction(
        self, axis: int, why: str, start: int, actual: bool
    ) -> Int[np.ndarray, " t"]:
        """Return the direction of motion of an axis, ±1 per row (S-21)."""
        if axis in self.directions:
            return self.directions[axis]
        place = self.unwrapped(axis, self.place(axis, why, actual))
        if self.cycle is None:
            return np.full(self.rows, start, dtype=np.int64)
        return direction_of_motion(place, start)

    def required_rates(
        self, axis: int, why: str, actual: bool = False
    ) -> tuple[Column, Column]:
        """Return its `rates`; a log without them and what they follow from is refused."""
        velocity, acceleration = self.rates(axis, actual)
        if velocity is None or acceleration is None:
            found = f"no velocity and acceleration of A{axis}, nor time"
            expected = f"A{axis}.position and time {why}"
            raise ExchangeError(self.source, found, expected)
        return velocity, acceleration


@final
@dataclasses.dataclass(frozen=True)
class Target:
    """Measured values without what is known of them, and how well columns explain them.

    Attributes:
        values: In mm or °, shape ``(t,)``, each times the root of its weight.
        basis: Orthonormal columns that may be added freely (zero of a drive or of an
            instrument, clock), likewise weighted.
        step: Worth of the last digit of a value in mm; 0 where it is not counted.
        root: Of the weights.
        band: Share by which what is added may be larger or smaller than a hypothesis says:
            machine and instrument drift.
    """

    values: Column
    basis: Float[np.ndarray, "t b"]
    step: float
    root: Column
    band: float = 0.0

    @classmethod
    def of(
        cls,
        values: Column,
        nuisance: Float[np.ndarray, "t b"] | None = None,
        step: float = 0.0,
        weight: Column | None = None,
    ) -> "Target":
        """Return a target; free columns may be anything, dependent ones too."""
        root = np.sqrt(np.ones(len(values)) if weight is None else weight)
        free = np.zeros((len(values), 0)) if nuisance is None else nuisance
        columns = root[:, None] * free
        scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        vectors, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
        basis = vectors[:, sizes > 1e-9 * sizes.max(initial=0.0)]
        return cls(values, basis, step, root).but(values)

    def but(self, values: Column) -> "Target":
        """Return the target with other values, what is free taken out of them."""
        return dataclasses.replace(self, values=self.free_of(values))

    def at(self, rows: np.ndarray) -> "Target":
        """Return the target at some rows."""
        part = Target.of(self.values[rows], self.basis[rows], self.step)
        return dataclasses.replace(part, root=self.root[rows], band=self.band)

    def free_of(self, values: Float[np.ndarray, "*h t"]) -> Float[np.ndarray, "*h t"]:
        """Return what of columns cannot be had from the free ones, weighted."""
        values = self.root * values
        return np.asarray(values - values @ self.basis @ self.basis.T)

    def residual(self, columns: Float[np.ndarray, "*h t"]) -> Float[np.ndarray, "*h t"]:
        """Return what columns leave of the values, in mm or °."""
        return np.asarray((self.values - self.free_of(columns)) / self.root)

    @functools.cached_property
    def power(self) -> float:
        """Sum of squares."""
        return float(self.values @ self.values)

    def fitted(
        self, columns: Float[np.ndarray, "h t"]
    ) -> tuple[
        Float[np.ndarray, " h"], Float[np.ndarray, " h"], Float[np.ndarray, " h"]
    ]:
        """Return the factors that fit columns best, what these leave, and their power.

        A column without any, or that the free ones make up, has factor 0 and power 0.
        """
        columns = self.root * columns
        power = np.einsum("ht,ht->h", columns, columns)
        power = power - np.square(columns @ self.basis).sum(axis=1)
        power = np.where(power > 1e-18 * columns.shape[1], power, 0.0)
        inner = columns @ self.values
        factors = np.where(power > 0.0, inner, 0.0) / np.where(power > 0.0, power, 1.0)
        return factors, self.power - factors * inner, power

    def residual_squares(
        self, columns: Float[np.ndarray, "h t"]
    ) -> Float[np.ndarray, " h"]:
        """Return the squares that columns leave, as they are or by factors in the band."""
        factors, squares, power = self.fitted(columns)
        factor = np.clip(factors, 1.0 - self.band, 1.0 + self.band)
        return np.asarray(squares + np.square(factor - factors) * power)

    def criterion(
        self, squares: Float[np.ndarray, " h"], samples: float
    ) -> Float[np.ndarray, " h"]:
        """Return −2 log likelihood of sums of squares left over in mm², noise estimated.

        `samples` is the number of independent rows.
        """
        floor = max(FLOOR**2, self.step**2 / 12.0)
        variance = np.maximum(squares, 0.0) / len(self.values) + floor
        return np.asarray(samples * np.log(variance))


def way_of_counting(position: Column, drive: Column) -> int:
    """Return 1 where a drive counts as its axis does, −1 where the other way, 0 if not shown.

    Shown by a motion of the axis, or where it stands, by the value itself.
    """
    if np.ptp(position) >= _COUNTED:
        slope = float(np.polyfit(position, drive, 1)[0])
        return int(np.sign(slope)) if 0.5 < abs(slope) < 2.0 else 0
    if np.min(np.abs(position)) >= _COUNTED:
        for way in (1, -1):
            if np.max(np.abs(way * drive - position)) < _ADDED:
                return way
    return 0


def drive_target(
    position: Column, drive: Column, listed: Sequence[Column], cyclic: bool
) -> tuple[Target, int, float]:
    """Return what the drive bus adds to the command, and by how many cycles it is late.

    The zero of the drive is free. Where the axis moves, its own motion tells how late
    the bus is: by whole cycles, which are taken out of the target, and by a part of one,
    which is still in what it adds. What the lists add goes with the velocity, too: it is
    no delay, by whatever factor it is there.

    Args:
        position: As commanded, in mm or °.
        drive: Position on the bus.
        listed: What each list adds.
        cyclic: The rows are cycles.
    """
    ones, rows = np.ones((len(position), 1)), np.arange(len(position))
    if not cyclic or len(rows) < _FEWEST:
        return Target.of(drive - position, ones), 0, 0.0
    velocity = np.gradient(position)
    shares = np.column_stack([ones, velocity, np.gradient(velocity)])
    design, interior = np.column_stack([shares, *listed]), slice(_ENDS, -_ENDS)
    lag, part, aligned = 0, 0.0, drive
    for _ in range(2):  # a delay of several cycles leaves something of it at first
        difference = (aligned - position)[interior]
        factors = np.linalg.lstsq(design[interior], difference, rcond=None)[0]
        without_lists = aligned - design[:, 3:] @ factors[3:]
        delay_fit = estimate_delay(position, without_lists, 1.0, longest=float(_REACH))
        significant = abs(delay_fit.seconds) > _SURE * delay_fit.standard_deviation
        delay = delay_fit.seconds if delay_fit.determined and significant else 0.0
        lag, part = lag + round(delay), delay - round(delay)
        aligned = drive[np.clip(rows + lag, 0, rows[-1])]
    if abs(part) < 0.02:
        return Target.of(aligned - position, ones), lag, 0.0
    difference = aligned - np.interp(rows - part, rows, position)
    return Target.of(difference, shares), lag, part

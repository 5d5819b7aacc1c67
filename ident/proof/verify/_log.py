"""What a log holds: its motion, and one column that is to be explained."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

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

    def actual(self, axis: int, why: str) -> Column:
        """Return the actual position of an axis; one without is where it should be."""
        measured = self.actuals.get(axis)
        return self.position(axis, why) if measured is None else measured

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
    ) -> tuple[Column, Column]:
        """Return velocity and acceleration of an axis in mm/s and mm/s², or °.

        Raises:
            ExchangeError: If the log has neither them nor what they follow from.
        """
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

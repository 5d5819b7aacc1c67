"""The linear equation behind an inverse fit: load = inertia · a + friction(v) + offset + loads.

Both sides go through one low-pass and are thinned to about a hundred rows per second: what is
filtered alike on both sides keeps a linear equation true, so the filter takes noise away
without a shift or a smear that one side would see and the other not (the "parallel filter" of
the robotics literature: Gautier, Janot and others).
"""

import dataclasses
import itertools
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.signal import firwin

from ._samples import DriveSamples
from ._structures import AbstractStructure, default_knots, range_of

_REACH = 10
"""Half the length of the filter in rows."""
_RATE = 100.0
"""Rows per s where nothing else is asked for."""


@dataclasses.dataclass(frozen=True)
class Known:
    """What need not be fitted.

    Attributes:
        gain: Load that one unit of current moves; parameters come in units of that load.
        inertia: In load units per mm/s², or None to fit it.
        offset: Constant load in load units, or None to fit it.
    """

    gain: float = 1.0
    inertia: float | None = None
    offset: float | None = None


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Lowpass:
    """A zero-phase FIR low-pass and every ``factor``-th sample of what it gives.

    Attributes:
        piece: Stretch of even time steps that each sample belongs to.
        factor: Samples per row; 1 filters nothing.
    """

    piece: Int[np.ndarray, " t"]
    factor: int

    @cached_property
    def _kernel(self) -> Float[np.ndarray, " k"]:
        taps = 2 * _REACH * self.factor + 1
        return np.asarray(firwin(taps, 1.0 / self.factor, window="hamming"))

    @cached_property
    def _runs(self) -> list[slice]:
        edges = np.flatnonzero(np.diff(self.piece, prepend=-1, append=-1)).tolist()
        runs = [slice(*ends) for ends in itertools.pairwise(edges)]
        return [run for run in runs if run.stop - run.start >= len(self._kernel)]

    @cached_property
    def centres(self) -> Int[np.ndarray, " s"]:
        """Sample of the recording that each row is centred on."""
        if self.factor == 1:
            return np.arange(len(self.piece))
        half = _REACH * self.factor
        found = [
            np.arange(run.start + half, run.stop - half, self.factor)
            for run in self._runs
        ]
        return np.concatenate([np.zeros(0, np.int64), *found])

    @property
    def reach(self) -> int:
        """Rows on each side that share samples with a row."""
        return 0 if self.factor == 1 else 2 * _REACH

    def __call__(self, columns: Float[np.ndarray, "t c"]) -> Float[np.ndarray, "s c"]:
        """Return the filtered, thinned columns; the kernel lies within one piece entirely."""
        if self.factor == 1:
            return columns
        if not columns.size:
            return np.asarray(columns[self.centres])
        found = [np.zeros((0, columns.shape[1]))]
        for run in self._runs:
            count = (run.stop - run.start - len(self._kernel)) // self.factor + 1
            found.append(self._run(columns[run], count))
        return np.concatenate(found)

    def _run(
        self, columns: Float[np.ndarray, "m c"], count: int
    ) -> Float[np.ndarray, "r c"]:
        """Return so many rows: products of pieces of column and kernel, added in place."""
        factor, parts = self.factor, 2 * _REACH + 1
        kernel = np.append(self._kernel, np.zeros(factor - 1)).reshape(parts, factor)
        whole = np.zeros((columns.shape[1], (count + parts - 1) * factor))
        used = min(len(columns), whole.shape[1])
        whole[:, :used] = columns[:used].T
        pieces = whole.reshape(columns.shape[1], -1, factor)
        products = np.moveaxis(kernel @ np.swapaxes(pieces, 1, 2), 1, 0)
        rows = np.zeros((columns.shape[1], count))
        for part, each in enumerate(products):
            rows += each[:, part : part + count]
        return rows.T


def default_factor(cycle: float) -> int:
    """Return the samples per row that leave about a hundred rows per second."""
    return max(1, round(1.0 / (_RATE * cycle)))


@dataclasses.dataclass(frozen=True, eq=False)
class Equation:
    """A recording as rows of a linear equation under one kind of law.

    Attributes:
        samples: What was recorded.
        structure: Kind of friction law.
        known: What need not be fitted.
        factor: Samples of the recording per row.
    """

    samples: DriveSamples
    structure: AbstractStructure
    known: Known
    factor: int

    def with_structure(self, structure: AbstractStructure) -> "Equation":
        """Return the same rows for another kind of law; what they share is kept."""
        other = dataclasses.replace(self, structure=structure)
        for name in (
            "lowpass",
            "load",
            "target",
            "usable",
            "piece",
            "speed",
            "speed_range",
            "_still",
        ):
            other.__dict__[name] = getattr(self, name)
        if structure.directional == self.structure.directional:
            other.__dict__["_beside"] = self._beside
        return other

    @cached_property
    def lowpass(self) -> Lowpass:
        """Filter of both sides."""
        return Lowpass(self.samples.piece, self.factor)

    @cached_property
    def load(self) -> Float[np.ndarray, " s"]:
        """The whole load, filtered: what a relative error refers to."""
        return self.lowpass(self.known.gain * self.samples.current[:, None])[:, 0]

    @cached_property
    def target(self) -> Float[np.ndarray, " s"]:
        """The load without its known parts, filtered."""
        known = np.zeros_like(self.samples.current)
        if self.known.inertia is not None and self.samples.acceleration is not None:
            known = self.known.inertia * self.samples.acceleration
        if self.known.offset is not None:
            known = known + self.known.offset
        return np.asarray(self.load - self.lowpass(known[:, None])[:, 0])

    @cached_property
    def usable(self) -> Bool[np.ndarray, " s"]:
        """Rows to fit: in motion and not saturated, for the most part of the filter."""
        good = self.samples.in_motion & ~self.samples.saturated
        return np.asarray(self.lowpass(good[:, None] * 1.0)[:, 0] > 0.5)

    @cached_property
    def piece(self) -> Int[np.ndarray, " s"]:
        """Piece of each row."""
        return np.asarray(self.samples.piece[self.lowpass.centres])

    @cached_property
    def speed(self) -> Float[np.ndarray, " t"]:
        """Speeds in motion in mm/s."""
        return np.asarray(np.abs(self.samples.velocity[self.samples.in_motion]))

    @cached_property
    def speed_range(self) -> tuple[float, float]:
        """Slowest and fastest speed in mm/s (`range_of`)."""
        return range_of(self.speed)

    def knots(self, count: int) -> tuple[float, ...]:
        """Return knots in mm/s where the samples in motion are (`default_knots`)."""
        return default_knots(self.speed, count)

    @property
    def fits_offset(self) -> bool:
        """Whether the offset has a column of its own.

        Per direction it has none: it could not be told from the difference of the levels.
        """
        return self.known.offset is None and not self.structure.directional

    @cached_property
    def fixed_names(self) -> tuple[str, ...]:
        """Names of the columns that do not belong to friction."""
        inertia = self.known.inertia is None and self.samples.acceleration is not None
        names = ("inertia",) * inertia + ("offset",) * self.fits_offset
        return names + tuple(self.samples.loads)

    @property
    def has_instrument(self) -> bool:
        """Whether a noise-free motion stands beside the measured one."""
        return self.samples.instrument_velocity is not None

    @cached_property
    def _beside(self) -> list[Float[np.ndarray, "s f"]]:
        """Columns that do not belong to friction, of the measured and noise-free motion."""
        samples, found = self.samples, []
        for acceleration in (samples.acceleration, samples.instrument_acceleration):
            columns = list(samples.loads.values())
            if self.fits_offset:
                columns.insert(0, np.ones(len(samples.time)))
            if "inertia" in self.fixed_names and acceleration is not None:
                columns.insert(0, acceleration)
            stacked = np.stack([*columns, samples.current], axis=1)[:, :-1]
            found.append(self.lowpass(stacked))
        return found

    def _velocity(self, instrument: bool) -> Float[np.ndarray, " t"]:
        fine = self.samples.instrument_velocity
        return fine if instrument and fine is not None else self.samples.velocity

    def design(
        self, shape: Float[np.ndarray, " h"], *, instrument: bool = False
    ) -> Float[np.ndarray, "s k"]:
        """Return all linear columns, those beside friction first.

        Args:
            shape: Logarithms of the law's non-linear parameters.
            instrument: Of the noise-free motion instead of the measured one.
        """
        kept = self._designs.get(instrument)
        if kept is not None and np.array_equal(kept[0], shape):
            return kept[1]
        own = self._friction(shape, instrument)
        found = np.concatenate([self._beside[instrument], own], axis=1)
        self._designs[instrument] = shape, found
        return found

    def _friction(
        self, shape: Float[np.ndarray, " h"], instrument: bool
    ) -> Float[np.ndarray, "s k"]:
        """Return the columns of friction; those that follow no shape are made once."""
        velocity, structure = self._velocity(instrument), self.structure
        if structure.shapes:
            return self.lowpass(structure.columns(velocity, shape))
        each_way = dataclasses.replace(structure, directional=True)
        key = each_way, instrument
        if key not in self._still:
            self._still[key] = self.lowpass(each_way.columns(velocity, shape))
        found, width = self._still[key], len(structure.factors)
        return found if structure.directional else found[:, :width] + found[:, width:]

    @cached_property
    def _still(
        self,
    ) -> dict[tuple[AbstractStructure, bool], Float[np.ndarray, "s k"]]:
        """Columns per direction of laws without a shape, for all laws of the recording."""
        return {}

    @cached_property
    def _designs(
        self,
    ) -> dict[bool, tuple[Float[np.ndarray, " h"], Float[np.ndarray, "s k"]]]:
        """The design that was asked for last, and its shape."""
        return {}

    def last_columns(self, shape: Float[np.ndarray, " h"]) -> Float[np.ndarray, "s w"]:
        """Return the last column of each direction, which alone follows the shape."""
        velocity = self.samples.velocity
        signs = self.structure.signs(velocity)
        last = self.structure.last(np.abs(velocity), shape[None])[0]
        return self.lowpass((signs * last).T)

    def tangents(
        self,
        shape: Float[np.ndarray, " h"],
        factors: Float[np.ndarray, " k"],
        *,
        instrument: bool = False,
    ) -> Float[np.ndarray, "s h"]:
        """Return the derivatives of the load by the logarithms of the shape."""
        own = factors[len(self.fixed_names) :]
        velocity = self._velocity(instrument)
        return self.lowpass(self.structure.tangents(velocity, shape, own))

    @cached_property
    def penalty(self) -> Float[np.ndarray, "b k"] | None:
        """What of all linear factors the smoothness prior keeps small, or None."""
        bends = self.structure.bends()
        if bends is None:
            return None
        fixed, (rows, width) = len(self.fixed_names), bends.shape
        ways = self.structure.ways
        found = np.zeros((ways * rows, fixed + ways * width))
        found[:, fixed:] = np.kron(np.eye(ways), bends)
        return found

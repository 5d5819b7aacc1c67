"""The linear equation behind an inverse fit: load = inertia · a + friction(v) + offset + loads.

Both sides go through one low-pass and are thinned to about a hundred rows per second: what is
filtered alike on both sides keeps a linear equation true (the "parallel filter" of the robotics
literature: Gautier, Janot and others).
"""

import dataclasses
import itertools
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.signals import decimate
from ._samples import DriveSamples, Trace, check_samples
from ._structures import SUFFIXES, AbstractStructure, KnotTable, Shape, default_knots

_REACH = 10
"""Half the length of the filter in rows."""
_MOSTLY = 0.7
"""Share of the filter in motion of a row that tells of friction."""
_RATE = 100.0
"""Rows per s where nothing else is asked for."""
_REST = 1e-3
"""Share of the slowest speed held that is as good as rest."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """A recording as filtered, thinned rows: what the equations of all laws share.

    The filter is a zero-phase FIR low-pass, of which every ``factor``-th sample is a row.

    Attributes:
        samples: What was recorded.
        inertia: In drive units per mm/s², or None to fit it.
        factor: Samples of the recording per row; 1 filters nothing.
    """

    samples: DriveSamples
    inertia: float | None
    factor: int

    @cached_property
    def noise_free(self) -> "Recording | None":
        """The same of the motion free of noise, where one stands beside the measured one."""
        samples = self.samples
        fine, push = samples.instrument_velocity, samples.instrument_acceleration
        if fine is None or push is None:
            return None
        samples = dataclasses.replace(samples, velocity=fine, acceleration=push)
        return dataclasses.replace(self, samples=samples)

    @cached_property
    def _runs(self) -> list[slice]:
        """Pieces that are longer than the filter."""
        edges = np.flatnonzero(np.diff(self.samples.piece, prepend=-1, append=-1))
        runs = [slice(*ends) for ends in itertools.pairwise(edges.tolist())]
        taps = 2 * _REACH * self.factor + 1
        return [run for run in runs if run.stop - run.start >= taps]

    @cached_property
    def centres(self) -> Int[np.ndarray, " s"]:
        """Sample of the recording that each row is centred on."""
        if self.factor == 1:
            return np.arange(len(self.samples.piece))
        half = _REACH * self.factor
        ends = ((run.start + half, run.stop - half) for run in self._runs)
        centres = [np.arange(*places, self.factor) for places in ends]
        return np.concatenate([np.zeros(0, np.int64), *centres])

    @property
    def reach(self) -> int:
        """Rows on each side that share samples with a row."""
        return 0 if self.factor == 1 else 2 * _REACH

    def filtered(self, columns: Float[np.ndarray, "t *c"]) -> Float[np.ndarray, "s *c"]:
        """Return the filtered, thinned columns; the kernel lies within one piece entirely."""
        if self.factor == 1:
            return columns
        runs = [decimate(columns[run], self.factor) for run in self._runs]
        inside = [rows[_REACH:-_REACH] for rows in runs]
        return np.concatenate([columns[:0], *inside])

    @cached_property
    def load(self) -> Float[np.ndarray, " s"]:
        """The current, filtered: what a relative error refers to."""
        return self.filtered(self.samples.current)

    @cached_property
    def load_size(self) -> float:
        """RMS of the load over the rows to fit."""
        return float(np.sqrt(np.mean(self.load[self.usable] ** 2)))

    @cached_property
    def target(self) -> Float[np.ndarray, " s"]:
        """The load without that of a known inertia, filtered."""
        if self.inertia is None:
            return self.load
        force = self.inertia * self.samples.acceleration
        return np.asarray(self.load - self.filtered(force))

    @cached_property
    def usable(self) -> Bool[np.ndarray, " s"]:
        """Rows to fit: in motion and not saturated, for the most part of the filter."""
        good = self.samples.in_motion & ~self.samples.saturated
        return np.asarray(self.filtered(good * 1.0) > _MOSTLY)

    @cached_property
    def piece(self) -> Int[np.ndarray, " s"]:
        """Piece of each row."""
        return np.asarray(self.samples.piece[self.centres])

    @cached_property
    def speed(self) -> Trace:
        """Speeds in motion in mm/s."""
        return np.asarray(np.abs(self.samples.velocity[self.samples.in_motion]))

    @cached_property
    def knots(self) -> tuple[float, ...]:
        """Knots of a free table in mm/s, at speeds that rows hold.

        What an axis passes within a row, as at a turn, would take up what no law explains: it has
        one knot beside rest, else knots above would share it with alternating signs.
        """
        velocity, rows = self.samples.velocity, self.centres[self.usable]
        if self.factor > 1:
            change = velocity[rows + self.factor] - velocity[rows - self.factor]
            rows = rows[2.0 * np.abs(velocity[rows]) > np.abs(change)]
        held = np.abs(velocity[rows])
        knots = default_knots(held if held.any() else self.speed)
        return (_REST * knots[0], *knots) if self.factor > 1 else knots

    @cached_property
    def beside(self) -> Float[np.ndarray, "s f"]:
        """Acceleration, a constant load, and further loads."""
        loads = np.ones(len(self.samples.time)), *self.samples.loads.values()
        return self.filtered(np.stack([self.samples.acceleration, *loads], axis=1))

    def by_direction(
        self, structure: AbstractStructure, profile: Float[np.ndarray, "t k"]
    ) -> Float[np.ndarray, "s w k"]:
        """Return columns over speed with the signs of each direction, filtered."""
        signs = structure.signs(self.samples.velocity).T
        return self.filtered(signs[:, :, None] * profile[:, None])


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Equation:
    """A recording as rows of a linear equation under one kind of law."""

    recording: Recording
    structure: AbstractStructure

    def under(self, structure: AbstractStructure) -> "Equation":
        """Return the same rows for another kind of law."""
        same = structure == self.structure
        return self if same else Equation(self.recording, structure)

    @cached_property
    def fixed_names(self) -> tuple[str, ...]:
        """Names of the columns that do not belong to friction.

        Per direction the offset has none: it could not be told from a difference of levels.
        """
        inertia = ("inertia",) * (self.recording.inertia is None)
        offset = ("offset",) * (not self.structure.directional)
        return (*inertia, *offset, *self.recording.samples.loads)

    @cached_property
    def bounds(self) -> Float[np.ndarray, "2 h"]:
        """The least and the largest logarithms of a shape that the data can tell apart."""
        return self.structure.bounds(self.recording.speed)

    @cached_property
    def _falling(self) -> dict[bytes, Float[np.ndarray, "s w c"]]:
        """What `falling` returned before: a search ends where it has been."""
        return {}

    def falling(self, shape: Shape) -> Float[np.ndarray, "s w c"]:
        """Return the column of each direction that follows the shape, and its derivatives."""
        key = shape.tobytes()
        if key not in self._falling:
            speed = np.abs(self.recording.samples.velocity)
            profile = self.structure.falling(speed, shape[None])[:, 0].T
            self._falling[key] = self.recording.by_direction(self.structure, profile)
        return self._falling[key]

    @property
    def beside(self) -> Float[np.ndarray, "s f"]:
        """Columns that do not belong to friction."""
        names = "inertia", "offset", *self.recording.samples.loads
        return self.recording.beside[:, [name in self.fixed_names for name in names]]

    @cached_property
    def steady(self) -> Float[np.ndarray, "s w k"]:
        """The columns of each direction that follow no shape."""
        profile = self.structure.steady(np.abs(self.recording.samples.velocity))
        return self.recording.by_direction(self.structure, profile)

    @cached_property
    def unbent(self) -> Float[np.ndarray, "s f"]:
        """All columns that follow no shape."""
        return np.hstack([self.beside, in_line(self.steady)])

    def columns(self, shape: Shape) -> Float[np.ndarray, "s k"]:
        """Return the columns of all linear factors."""
        last = self.falling(shape)[:, :, :1]
        both = np.concatenate([self.steady, last], axis=2)
        return np.hstack([self.beside, in_line(both)])

    def slopes(
        self, shape: Shape, factors: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, "s h"]:
        """Return the derivatives of the rows by the shape."""
        parts = factors[len(self.fixed_names) :].reshape(self.structure.ways, -1)
        return np.tensordot(self.falling(shape)[:, :, 1:], parts[:, -1], (1, 0))

    @cached_property
    def reading(
        self,
    ) -> tuple[tuple[str, ...], Float[np.ndarray, "r k"], Float[np.ndarray, "f k"]]:
        """Names of parameters as users read them, and the maps of linear factors as fitted.

        The one leads to these parameters, the other to the factors of the law.

        Per direction, seen in motion are level⁺ + offset and level⁻ − offset only: the offset
        is chosen so that the mean levels of both directions are equal.
        """
        structure, names = self.structure, self.fixed_names
        fixed = len(names)
        unit = np.eye(fixed + len(structure.names))
        beside, to_law = unit[:fixed], unit[fixed:]
        if isinstance(structure, KnotTable) and structure.held:
            count = len(structure.knots)
            to_law[::count] = to_law[1::count]
        words, sums = structure.reported
        if structure.directional:
            words = tuple(name + suffix for suffix in SUFFIXES for name in words)
            levels = structure.levels
            both = np.concatenate([levels, -levels])
            offset = 0.5 * both @ to_law / levels.sum()
            names, beside = (*names, "offset"), np.vstack([beside, offset])
            to_law = to_law - np.outer(both, offset)
        law = np.kron(np.eye(structure.ways), sums) @ to_law
        return (*names, *words), np.vstack([beside, law]), to_law

    @cached_property
    def penalty(self) -> Float[np.ndarray, "k k"]:
        """Precision of factors and shape under the smoothness prior at weight 1."""
        structure, fixed = self.structure, len(self.fixed_names)
        total = np.zeros((fixed + len(structure.names) + len(structure.shapes),) * 2)
        bends = structure.bends
        if bends is not None:
            total[fixed:, fixed:] = np.kron(np.eye(structure.ways), bends.T @ bends)
        return total


def in_line(columns: Float[np.ndarray, "s w k"]) -> Float[np.ndarray, "s c"]:
    """Return columns of each direction beside each other."""
    return columns.reshape(len(columns), columns.shape[1] * columns.shape[2])


def record(
    samples: DriveSamples, inertia: float | None, decimate: int | None
) -> Recording:
    """Return the rows of a checked recording, about 100 a second where nothing is stated.

    Args:
        samples: The recording.
        inertia: In drive units per mm/s², where it is known.
        decimate: Samples per row, at least 1.

    Raises:
        FitError: If the samples cannot be used at all.
    """
    check_samples(samples)
    factor = decimate or max(1, round(1.0 / (_RATE * samples.cycle)))
    return Recording(samples, inertia, factor)

"""The linear equation behind an inverse fit: which columns, filtered alike with the current."""

import copy
import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from ._lanes import Lanes, lanes_of
from ._lowpass import Decimation, decimation
from ._samples import DriveSamples, saturated
from ._structure import AbstractStructure
from ._tables import Spread, spread_of


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


_OF_THE_RECORDING = frozenset(
    "target load piece speed usable saturated said all_rows met limits scouted spread"
    " senses".split()
)
_OF_THE_LAW = frozenset({"places", "still", "still_instrument"})
_OF_THE_DIRECTIONS = frozenset({"beside", "_fixed_instrument"})
"""What is computed once, and for how long it holds."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """Load = inertia · a + friction(v) + offset + further loads, ready for least squares.

    Attributes:
        samples: What was recorded.
        structure: Kind of friction law.
        known: What need not be fitted.
        lowpass: Filter of both sides.
        sigma: Relative standard deviation of each row where they differ; such rows are taken
            to be independent of each other.
        least_noise: Standard deviation of a row of ``sigma`` 1 below which it is not believed.
    """

    samples: DriveSamples
    structure: AbstractStructure
    known: Known
    lowpass: Decimation
    sigma: Float[np.ndarray, " s"] | None = None
    least_noise: float = 0.0

    def _rows(self, columns: np.ndarray) -> np.ndarray:
        rows = self.lowpass(columns)
        return rows if self.sigma is None else rows / self.sigma[:, None]

    def _rows_of(self, stack: np.ndarray) -> np.ndarray:
        """Filter what runs along the last axis."""
        if not self.filtered:
            return stack
        flat = stack.reshape(-1, stack.shape[-1])
        return np.ascontiguousarray(self._rows(flat.T).T).reshape(*stack.shape[:-1], -1)

    def with_structure(self, structure: AbstractStructure) -> "Problem":
        """Return the same rows for another kind of law; what was computed is kept."""
        for name in _OF_THE_RECORDING - self.__dict__.keys():
            getattr(self, name)  # once for all laws
        other = copy.copy(self)
        kept = other.__dict__
        kept["structure"] = structure
        gone = _OF_THE_LAW
        if structure.directional != self.structure.directional:
            # The offset has no column of its own per direction.
            gone |= _OF_THE_DIRECTIONS
        for name in gone:
            kept.pop(name, None)
        return other

    @cached_property
    def target(self) -> Float[np.ndarray, " s"]:
        """The current in load units, known parts taken off, filtered."""
        load = self.known.gain * self.samples.current
        if self.known.inertia is not None and self.samples.acceleration is not None:
            load = load - self.known.inertia * self.samples.acceleration
        if self.known.offset is not None:
            load = load - self.known.offset
        return np.asarray(self._rows(load[:, None])[:, 0])

    @cached_property
    def load(self) -> Float[np.ndarray, " s"]:
        """The whole load, filtered: what a relative error refers to."""
        load = self.known.gain * self.samples.current
        return np.asarray(self._rows(load[:, None])[:, 0])

    @cached_property
    def usable(self) -> Bool[np.ndarray, " s"]:
        """Rows to fit: in motion and not saturated, for the most part of the filter."""
        good = self.samples.in_motion & ~self.saturated
        return np.asarray(self.lowpass.mostly(good))

    @cached_property
    def all_rows(self) -> Lanes:
        """A single fit, to all rows that may be used."""
        return lanes_of(self.usable)

    @cached_property
    def saturated(self) -> Bool[np.ndarray, " t"]:
        """Samples of the recording at the limit of the drive."""
        return saturated(self.samples.current)

    @cached_property
    def piece(self) -> Int[np.ndarray, " s"]:
        """Piece of each sample that is left after filtering."""
        if self.sigma is not None:
            return np.arange(len(self.lowpass.centres))
        return np.asarray(self.samples.piece[self.lowpass.centres])

    @cached_property
    def speed(self) -> Float[np.ndarray, " t"]:
        """Speeds in motion, in mm/s."""
        return np.asarray(np.abs(self.samples.velocity[self.samples.in_motion]))

    @cached_property
    def spread(self) -> Spread:
        """How the speeds in motion are spread."""
        return spread_of(self.speed)

    @cached_property
    def said(self) -> list[tuple[str, ...]]:
        """What was already found odd about the recording, in words."""
        return []

    @cached_property
    def scouted(self) -> dict[tuple[str, bool], Float[np.ndarray, " s"]]:
        """Weights of all rows that `scout` found, by loss and whether per direction."""
        return {}

    @property
    def fits_inertia(self) -> bool:
        """Whether the inertia is a parameter."""
        return self.known.inertia is None and self.samples.acceleration is not None

    @property
    def fits_offset(self) -> bool:
        """Whether the offset has a column of its own.

        Per direction it has none: it could not be told from the difference of the levels.
        """
        return self.known.offset is None and not self.structure.directional

    @property
    def fixed_names(self) -> tuple[str, ...]:
        """Names of the columns that do not belong to friction."""
        names = ("inertia",) * self.fits_inertia + ("offset",) * self.fits_offset
        return names + tuple(self.samples.loads)

    def _fixed(self, acceleration: np.ndarray | None) -> np.ndarray:
        columns = []
        if self.fits_inertia:
            assert acceleration is not None
            columns.append(acceleration)
        if self.fits_offset:
            columns.append(np.ones(len(self.samples.time)))
        columns += list(self.samples.loads.values())
        if not columns:
            return np.zeros((len(self.lowpass.centres), 0))
        return self._rows(np.stack(columns, axis=1))

    @cached_property
    def beside(self) -> Float[np.ndarray, "s f"]:
        """The columns that do not belong to friction, of the measured motion."""
        return self._fixed(self.samples.acceleration)

    @cached_property
    def _fixed_instrument(self) -> np.ndarray:
        return self._fixed(self.samples.instrument_acceleration)

    @property
    def has_instrument(self) -> bool:
        """Whether a noise-free motion stands beside the measured one."""
        return self.samples.instrument_velocity is not None

    @cached_property
    def still(self) -> Float[np.ndarray, "t k"]:
        """The linear columns that follow no shape, fixed ones first."""
        found = np.empty((len(self.target), self.still_width))
        self.put_still(found)
        return found

    @property
    def still_width(self) -> int:
        """How many columns follow no shape."""
        return len(self.fixed_names) + len(self.structure.names) - len(self.places[1])

    def put_still(self, into: Float[np.ndarray, "t k"]) -> None:
        """Write the linear columns that follow no shape, fixed ones first.

        Args:
            into: Where to.
        """
        fixed = len(self.fixed_names)
        into[:, :fixed] = self.beside
        signs = self.signs_of(False)
        profile = self.structure.still_profile(self.speed_of(False))
        if self.filtered:
            into[:, fixed:] = self._rows(self.structure.signed(signs, profile))
        else:
            self.structure.put_signed(signs, profile, into[:, fixed:])

    @property
    def bounds(self) -> tuple[Float[np.ndarray, " h"], Float[np.ndarray, " h"]]:
        """Least and largest logarithms of the shape."""
        key = self.structure.alike
        if key not in self.limits:
            self.limits[key] = key.bounds(self.speed)
        return self.limits[key]

    @cached_property
    def limits(
        self,
    ) -> dict[
        AbstractStructure, tuple[Float[np.ndarray, " h"], Float[np.ndarray, " h"]]
    ]:
        """Bounds of laws that were already asked for."""
        return {}

    def pairs(self) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 2"]]:
        """Return which factors of one direction each sample meets, and both columns."""
        # Laws for both directions alike and apart have the same ones.
        key = self.structure.alike
        if key not in self.met:
            self.met[key] = key.pairs(self.speed_of(False))
        return self.met[key]

    @property
    def signed_pair(self) -> Float[np.ndarray, "t 2"]:
        """Columns of the factors that each sample meets, with the sign of its velocity."""
        return np.asarray(np.sign(self.samples.velocity)[:, None] * self.pairs()[1])

    @cached_property
    def met(
        self,
    ) -> dict[
        AbstractStructure, tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 2"]]
    ]:
        """Pairs of laws that were already asked for."""
        return {}

    @cached_property
    def still_instrument(self) -> Float[np.ndarray, "t k"]:
        """The same of the noise-free motion."""
        own = self.structure.still_columns(self._velocity(True))
        return np.concatenate([self._fixed_instrument, self._rows(own)], axis=1)

    def shaped(
        self, shapes: Float[np.ndarray, "w h"], *, instrument: bool = False
    ) -> tuple[Float[np.ndarray, "d w t"], Float[np.ndarray, "h d w t"]]:
        """Return the columns that follow the shape, per direction, and their derivatives."""
        signs = self.signs_of(instrument)[:, None]
        of = np.zeros(len(shapes), np.int64)
        speed = self.speed_of(instrument)[None]
        values, slopes = self.structure.shaped_profiles(speed, of, shapes)
        return self._rows_of(signs * values), self._rows_of(signs * slopes[:, None])

    def speed_of(self, instrument: bool) -> Float[np.ndarray, " t"]:
        """Return the speed of all samples, in mm/s."""
        return np.asarray(np.abs(self._velocity(instrument)))

    def signs_of(self, instrument: bool) -> Float[np.ndarray, "d t"]:
        """Return what the columns of each direction carry as sign."""
        key = self.structure.directional, instrument
        if key not in self.senses:
            self.senses[key] = self.structure.signs(self._velocity(instrument))
        return self.senses[key]

    @cached_property
    def senses(self) -> dict[tuple[bool, bool], Float[np.ndarray, "d t"]]:
        """Signs, by whether per direction and of the noise-free motion."""
        return {}

    @property
    def filtered(self) -> bool:
        """Whether a row is anything else than a sample."""
        return self.lowpass.factor != 1 or self.sigma is not None

    @cached_property
    def places(self) -> tuple[list[int], list[int]]:
        """Places of the columns that follow no shape, and of those that do."""
        fixed = len(self.fixed_names)
        moving = [fixed + place for place in self.structure.shaped_places]
        every = range(fixed + len(self.structure.names))
        return [place for place in every if place not in moving], moving

    def friction(
        self,
        law: Int[np.ndarray, " t"],
        factors: Float[np.ndarray, "w k"],
        shapes: Float[np.ndarray, "w h"],
    ) -> Float[np.ndarray, " t"]:
        """Return the friction of each sample under one of some laws, in load units.

        Args:
            law: Which of them.
            factors: Of friction, law by law.
            shapes: Logarithms, law by law.
        """
        structure, speed = self.structure, self.speed_of(False)
        rows, width = np.arange(len(speed)), len(structure.factors)
        sign = np.sign(self.samples.velocity)
        first = width * (sign < 0) if structure.directional else 0 * rows
        cell, pair = self.pairs()
        own = pair[:, 0] * factors[law, first + cell]
        own += pair[:, 1] * factors[law, first + cell + 1]
        for place in structure.shaped:
            # Each sample for itself, under the one law that is asked of it.
            column = structure.shaped_values(speed[:, None], rows, shapes[law])
            own += column[:, 0] * factors[law, first + place]
        return np.asarray(sign * own)

    def design(self, shape: Float[np.ndarray, " s"]) -> Float[np.ndarray, "t k"]:
        """Return all linear columns, fixed ones first, of the measured motion."""
        own = self.structure.columns(self.samples.velocity, shape)
        return np.concatenate([self.beside, self._rows(own)], axis=1)

    def tangents(
        self, shape: Float[np.ndarray, " s"], factors: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, "t s"]:
        """Return the derivative of the load with respect to the logarithms of the shape."""
        own = factors[len(self.fixed_names) :]
        slopes = self.structure.column_slopes(self.samples.velocity, shape)
        if not slopes:
            return np.zeros((len(self.lowpass.centres), 0))
        return self._rows(np.stack([slope @ own for slope in slopes], axis=1))

    def _velocity(self, instrument: bool) -> np.ndarray:
        if instrument:
            assert self.samples.instrument_velocity is not None
            return self.samples.instrument_velocity
        return self.samples.velocity

    def penalty(self) -> Float[np.ndarray, "k k"] | None:
        """Return the smoothness prior over all linear factors."""
        one = self.structure.penalty()
        if one is None:
            return None
        fixed, width = len(self.fixed_names), len(one)
        size = fixed + self.structure.ways * width
        result = np.zeros((size, size))
        for way in range(self.structure.ways):
            at = slice(fixed + way * width, fixed + (way + 1) * width)
            result[at, at] = one
        return result


def make_problem(
    samples: DriveSamples, structure: AbstractStructure, known: Known, factor: int
) -> Problem:
    """Return the equation with its filter."""
    return Problem(samples, structure, known, decimation(samples.piece, factor))

"""The linear equation behind an inverse fit: load = inertia · a + friction(v) + offset + loads.

Both sides go through one low-pass and are thinned to about a hundred rows per second: what is
filtered alike on both sides keeps a linear equation true, so the filter takes noise away
without a shift or a smear that one side would see and the other not (the "parallel filter" of
the robotics literature: Gautier, Janot and others). The rows are weighed once, under a table
that can bend anywhere: what is wild under it is wild under any law.
"""

import dataclasses
import itertools
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import firwin

from ..core import (
    ColumnsEffect,
    FitError,
    NoPrior,
    Readings,
    Stack,
    estimate,
    least_scale,
    memory,
)
from ._samples import DriveSamples, check_samples
from ._structures import (
    KNOTS,
    WAYS,
    AbstractStructure,
    CoulombViscous,
    KnotTable,
    Stribeck,
    default_knots,
    range_of,
)

_REACH = 10
"""Half the length of the filter in rows."""
_TOGETHER = 8
"""Rows that are filtered at a time."""
_RATE = 100.0
"""Rows per s where nothing else is asked for."""
_WILD = 4.0
"""Error in scales beyond which a row says nothing of the law."""
_HELD = 1e-9
"""Precision that holds a column without rows, relative to that of all others."""
_RIDGE = 1e-12
"""Added to scaled normal matrices that are inverted as they stand."""


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
    def _kernel(self) -> Float[np.ndarray, "m l"]:
        """The filter for a few rows, as a matrix on the samples that they share."""
        taps = 2 * _REACH * self.factor + 1
        kernel = firwin(taps, 1.0 / self.factor, window="hamming")
        found = np.zeros((_TOGETHER, taps + (_TOGETHER - 1) * self.factor))
        for row, own in enumerate(found):
            own[row * self.factor :][:taps] = kernel
        return found

    @cached_property
    def _runs(self) -> list[slice]:
        edges = np.flatnonzero(np.diff(self.piece, prepend=-1, append=-1)).tolist()
        runs = [slice(*ends) for ends in itertools.pairwise(edges)]
        taps = 2 * _REACH * self.factor + 1
        return [run for run in runs if run.stop - run.start >= taps]

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
        found, kernel = [np.zeros((0, columns.shape[1]))], self._kernel
        length, step = kernel.shape[1], _TOGETHER * self.factor
        for run in self._runs:
            own = columns[run]
            count = len(range(0, len(own) - 2 * _REACH * self.factor, self.factor))
            blocks, rest = divmod(count, _TOGETHER)
            if blocks:
                seen = sliding_window_view(own, length, axis=0)[::step][:blocks]
                rows = kernel @ seen.transpose(0, 2, 1)
                found.append(rows.reshape(blocks * _TOGETHER, own.shape[1]))
            reach = length - (_TOGETHER - rest) * self.factor
            found.append(kernel[:rest, :reach] @ own[blocks * step :][:reach])
        return np.concatenate(found)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """A recording as filtered, thinned rows: what the equations of all laws share.

    Attributes:
        samples: What was recorded.
        known: What need not be fitted.
        factor: Samples of the recording per row.
    """

    samples: DriveSamples
    known: Known
    factor: int

    @cached_property
    def noise_free(self) -> "Recording | None":
        """The same of the motion free of noise, where one stands beside the measured one."""
        fine = self.samples.instrument_velocity
        if fine is None:
            return None
        samples = dataclasses.replace(
            self.samples,
            velocity=fine,
            acceleration=self.samples.instrument_acceleration,
        )
        return dataclasses.replace(self, samples=samples)

    @cached_property
    def lowpass(self) -> Lowpass:
        """Filter of both sides."""
        return Lowpass(self.samples.piece, self.factor)

    @cached_property
    def load(self) -> Float[np.ndarray, " s"]:
        """The whole load, filtered: what a relative error refers to."""
        return self.lowpass(self.known.gain * self.samples.current[:, None])[:, 0]

    @cached_property
    def load_size(self) -> float:
        """RMS of the load over the rows to fit."""
        return float(np.sqrt(np.mean(self.load[self.usable] ** 2)))

    @cached_property
    def target(self) -> Float[np.ndarray, " s"]:
        """The load without its known parts, filtered."""
        known = np.full_like(self.samples.current, self.known.offset or 0.0)
        if self.known.inertia is not None and self.samples.acceleration is not None:
            known += self.known.inertia * self.samples.acceleration
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
    def knots(self) -> tuple[float, ...]:
        """Knots of a free table in mm/s."""
        return default_knots(self.speed, KNOTS)

    @cached_property
    def speed_range(self) -> tuple[float, float]:
        """Slowest and fastest speed in mm/s (`range_of`)."""
        return range_of(self.speed)

    @cached_property
    def signs(self) -> Float[np.ndarray, "t 2"]:
        """Sign of the motion in each direction; 0 elsewhere."""
        return CoulombViscous(True).signs(self.samples.velocity).T

    @cached_property
    def beside(self) -> Float[np.ndarray, "s f"]:
        """Acceleration, a constant load, and further loads."""
        samples, even = self.samples, np.ones(len(self.samples.time))
        push = even if samples.acceleration is None else samples.acceleration
        return self.lowpass(np.stack([push, even, *samples.loads.values()], axis=1))

    @cached_property
    def _steady(self) -> dict[AbstractStructure, Float[np.ndarray, "s w k"]]:
        return {}

    def steady(self, structure: AbstractStructure) -> Float[np.ndarray, "s w k"]:
        """Return the columns of a law that follow no shape; what both directions show is kept."""
        both = dataclasses.replace(structure, directional=True)
        if both not in self._steady:
            profile = both.steady(np.abs(self.samples.velocity))
            self._steady[both] = self.of_each_way(both, profile)
        found = self._steady[both]
        return found if structure.directional else found[:, :1] + found[:, 1:]

    def of_each_way(
        self, structure: AbstractStructure, profile: Float[np.ndarray, "t k"]
    ) -> Float[np.ndarray, "s w k"]:
        """Return columns over speed with the signs of each direction, filtered."""
        signs = self.signs if structure.directional else self.signs.sum(1)[:, None]
        both = signs[:, :, None] * profile[:, None]
        shape = both.shape[1:]
        found = self.lowpass(both.reshape(len(both), shape[0] * shape[1]))
        return found.reshape(len(found), *shape)


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
        samples, known = self.recording.samples, self.recording.known
        inertia = known.inertia is None and samples.acceleration is not None
        offset = known.offset is None and not self.structure.directional
        names = ("inertia",) * inertia + ("offset",) * offset
        return names + tuple(samples.loads)

    @cached_property
    def bounds(self) -> Float[np.ndarray, "2 h"]:
        """The least and the largest logarithms of a shape that the data can tell apart."""
        return self.structure.bounds(self.recording.speed_range)

    @cached_property
    def _falling(self) -> dict[bytes, Float[np.ndarray, "s w c"]]:
        """What `falling` returned before: a search ends where it has been."""
        return {}

    def falling(self, shape: Float[np.ndarray, " h"]) -> Float[np.ndarray, "s w c"]:
        """Return the column of each direction that follows the shape, and its derivatives."""
        key = shape.tobytes()
        if key not in self._falling:
            speed = np.abs(self.recording.samples.velocity)
            profile = self.structure.falling(speed, shape[None])[:, 0].T
            self._falling[key] = self.recording.of_each_way(self.structure, profile)
        return self._falling[key]

    @property
    def beside(self) -> Float[np.ndarray, "s f"]:
        """Columns that do not belong to friction."""
        kept = [name in self.fixed_names for name in ("inertia", "offset")]
        further = [True] * len(self.recording.samples.loads)
        return self.recording.beside[:, [*kept, *further]]

    @cached_property
    def unbent(self) -> Float[np.ndarray, "s f"]:
        """All columns that follow no shape."""
        return np.hstack([self.beside, in_line(self.recording.steady(self.structure))])

    @cached_property
    def _shapeless(self) -> Float[np.ndarray, "s c"]:
        """What `rows` returns where no column follows a shape."""
        return np.hstack([self.unbent, self.recording.target[:, None]])

    def rows(self, shape: Float[np.ndarray, " h"]) -> Float[np.ndarray, "s c"]:
        """Return columns of all linear factors, slopes by the shape, and the target, per row.

        The slopes are those of the last column of each direction.
        """
        if not len(shape):
            return self._shapeless
        fixed, ways = len(self.fixed_names), self.structure.ways
        last = self.falling(shape)
        steady = np.split(self.unbent[:, fixed:], ways, axis=1)
        each = [(own, last[:, way, :1]) for way, own in enumerate(steady)]
        columns = [self.unbent[:, :fixed], *itertools.chain(*each)]
        target = self.recording.target[:, None]
        return np.hstack([*columns, in_line(last[:, :, 1:]), target])

    def tangent(self, factors: Float[np.ndarray, " k"]) -> Float[np.ndarray, "c p"]:
        """Return the map from `rows` but the target to derivatives by factors and shape."""
        shapes, ways = len(self.structure.shapes), self.structure.ways
        last = factors[len(self.fixed_names) :].reshape(ways, -1)[:, -1]
        by_shape = np.concatenate([each * np.eye(shapes) for each in last])
        found = np.eye(len(factors) + len(by_shape), len(factors) + shapes)
        found[len(factors) :, len(factors) :] = by_shape
        return found

    @cached_property
    def reading(
        self,
    ) -> tuple[tuple[str, ...], Float[np.ndarray, "r k"], Float[np.ndarray, "f k"]]:
        """How the linear factors as fitted are read.

        Names of parameters as users read them, the map to these, and that to the factors of
        the law. Per direction, seen in motion are level⁺ + offset and level⁻ − offset only:
        where the offset is not known, it is chosen so that the mean levels of both directions
        are equal.
        """
        structure, fixed = self.structure, len(self.fixed_names)
        known = self.recording.known
        unit = np.eye(fixed + len(structure.names))
        names, beside, to_law = self.fixed_names, unit[:fixed], unit[fixed:]
        words, sums = structure.reported
        if structure.directional:
            words = tuple(name + way for way in WAYS for name in words)
        if structure.directional and known.offset is None:
            one = structure.levels
            both = np.concatenate([one, -one])
            offset = 0.5 * both @ to_law / one.sum()
            names, beside = (*names, "offset"), np.vstack([beside, offset])
            to_law = to_law - np.outer(both, offset)
        law = np.kron(np.eye(structure.ways), sums) @ to_law
        return (*names, *words), np.vstack([beside, law]), to_law

    @cached_property
    def penalty(self) -> Float[np.ndarray, "k k"]:
        """Precision of all linear factors under the smoothness prior at weight 1."""
        structure, fixed = self.structure, len(self.fixed_names)
        found = np.zeros((fixed + len(structure.names),) * 2)
        bends = structure.bends
        if bends is not None:
            found[fixed:, fixed:] = np.kron(np.eye(structure.ways), bends.T @ bends)
        return found


def in_line(columns: Float[np.ndarray, "s w k"]) -> Float[np.ndarray, "s c"]:
    """Return columns of each direction beside each other."""
    return columns.reshape(len(columns), columns.shape[1] * columns.shape[2])


def record(
    samples: DriveSamples, known: Known | None, decimate: int | None
) -> Recording:
    """Return the rows of a checked recording; arguments as of `fit_inverse`.

    Raises:
        FitError: If the samples cannot be used at all.
    """
    check_samples(samples)
    known = Known() if known is None else known
    if known.gain == 0 or not np.isfinite(known.gain):
        msg = f"gain: found {known.gain!r}, expected a number other than 0."
        raise FitError(msg)
    usual = max(1, round(1.0 / (_RATE * samples.cycle)))
    factor = usual if decimate is None else decimate
    if factor < 1:
        msg = f"decimate: found {factor}, expected 1 or more."
        raise FitError(msg)
    return Recording(samples, known, factor)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Weights:
    """What the rows say before any law is asked.

    Attributes:
        share: How much each row counts, 0 to 1.
        limit: Largest error that says anything of a law.
        free: Equation of the free table.
        sums: Its XᵀW [X, target].
    """

    share: Float[np.ndarray, " s"]
    limit: float
    free: Equation
    sums: Float[np.ndarray, "k k1"]

    def start(self, equation: Equation) -> Float[np.ndarray, " h"]:
        """Return the start of a law's shape that leaves the least, as the free table sees it."""
        structure, free = equation.structure, self.free
        assert isinstance(structure, Stribeck)
        assert isinstance(free.structure, KnotTable)
        knots, fixed = np.asarray(free.structure.knots), len(free.fixed_names)
        velocity = np.concatenate([knots, -knots])
        # Factors of the free table, which has no offset, for each factor of the law.
        starts = structure.starts(equation.recording.speed_range)
        own = structure.columns(velocity, starts)
        if "offset" in equation.fixed_names:
            own = np.concatenate([own, np.ones_like(own[:, :, :1])], axis=2)
        laws = np.zeros((len(starts), len(self.sums), fixed + own.shape[2]))
        laws[:, :fixed, :fixed] = np.eye(fixed)
        laws[:, fixed:, fixed:] = np.sign(velocity)[:, None] * own
        sums = np.swapaxes(laws, 1, 2) @ self.sums
        factors = ridged(sums[:, :, :-1] @ laws, sums[:, :, -1])
        gains = np.einsum("nk,nk->n", sums[:, :, -1], factors)
        return np.asarray(starts[np.argmax(gains)])


def weigh(recording: Recording, loss: str) -> Weights:
    """Return the weights of the rows under a table per direction that can bend anywhere.

    Args:
        recording: The recording.
        loss: ``"trim"``, ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the loss is unknown.
    """
    free = Equation(recording, KnotTable(True, recording.knots))
    used = recording.usable
    right = free.rows(np.zeros(0))[used]
    rows, target = right[:, :-1], right[:, -1]
    every = rows.T @ right
    count, size = rows.shape

    def sums(share: np.ndarray) -> np.ndarray:
        less = np.flatnonzero(share < 1.0)
        return np.asarray(
            every - ((1.0 - share[less, None]) * rows[less]).T @ right[less]
        )

    own, limit, share = np.ones(count), np.inf, np.zeros(len(used))
    if loss != "gauss" and count > 2 * size:
        length = np.sqrt(np.maximum(every[:, :-1].diagonal(), 1e-300))
        design = rows / length
        stack = Stack((ColumnsEffect(NoPrior(size), size, _HELD),), banded=False)
        found = estimate(
            stack,
            memory(stack, Readings(target, {}, None), design),
            loss=loss,
            weights=lambda _: np.zeros(0),
            floor=least_scale(target),
        )
        ratio = (target - design @ found.centre) / found.loss.scale
        own, limit = found.loss.share(ratio), _WILD * found.loss.scale
    share[used] = own
    return Weights(share, limit, free, sums(own))


def ridged(
    matrix: Float[np.ndarray, "*w k k"], right: Float[np.ndarray, "*w k"]
) -> Float[np.ndarray, "*w k"]:
    """Return the solutions of normal equations; 0 where columns have no rows."""
    size = np.sqrt(np.maximum(matrix.diagonal(0, -2, -1), 0.0))
    size[size == 0.0] = 1.0
    scaled = matrix / (size[..., :, None] * size[..., None, :])
    scaled += _RIDGE * np.eye(matrix.shape[-1])
    return np.asarray(np.linalg.solve(scaled, (right / size)[..., None])[..., 0] / size)

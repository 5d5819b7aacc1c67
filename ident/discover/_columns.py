"""Columns of every term: products of functions that libraries of pysindy carry.

A factor is a channel of the recording, scaled to about 1, and functions of it. Their sizes are
a prior: a smooth error of 1 mm has coefficients of about 1. Beside the terms stand columns of
what is no compensation's task: the zero of each measurement, offsets of runs, a drift.
"""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ._terms import CHANNELS, Kind, Term
from ._view import AxisView, some_of

_DECAY = 1.5
"""A smooth error has less of fine structure: amplitudes fall as the 1.5th power."""
_EACH = 8
"""Rows per function, at least."""
_FULL = 0.99
"""Quantile of the accelerations that counts as a full one."""
_EARLY = 0.35
"""Share of the full acceleration at which a table may have its entry."""
_MEMORY = (0.002, 0.01, 0.05)
"""Shares of the travel over which an error may build up after a reversal."""
_KNEES = (0.01, 0.03, 0.08, 0.2)
"""Stribeck velocities, as shares of the fastest speed."""
_BEND = 0.3
"""Size of a curved part of a temperature law, beside its straight part."""
_REFERENCE = 20.0
"""°C at which a temperature law corrects nothing; the nearest measured one counts."""
_DRIFT = 20
"""Functions of time: a drift is slower than a 10th of the record."""
_PLACED = 0.9
"""Share of a drift that positions explain, from which on it cannot be told from them."""
_MOST_RUNS = 250
"""Runs of a measurement that have an offset each; a counter of readings is none of runs."""
_MOST = 5_000
"""Rows that show whether positions explain a drift."""

Function = Callable[[Float[np.ndarray, " t"]], Float[np.ndarray, " t"]]
Factor = tuple[Float[np.ndarray, " t"], list[Function]]
_ONE: Function = lambda values: np.ones_like(values)  # noqa: E731 (pysindy counts arguments)
_SAME: Function = lambda values: values  # noqa: E731
_STRAIGHT: Function = lambda u: np.sqrt(3.0) * (2.0 * u - 1.0)  # noqa: E731


def place_where(straight: float) -> float:
    """Return the place, 0 to 1 along the travel, where the straight function has a value."""
    return float(0.5 * (straight / np.sqrt(3.0) + 1.0))


def smooth(count: int, periodic: bool = False) -> list[Function]:
    """Return functions of a position from 0 to 1: a line and cosines, or waves of a turn.

    They are scaled as smooth errors are, large scale first, and the constant is left out.
    """
    if not periodic:
        return [_STRAIGHT, *(_wave(k, 0.5 * k, 0.0) for k in range(1, count))]
    return [_wave(1 + k // 2, 1 + k // 2, 0.25 * (k % 2)) for k in range(count)]


def _wave(order: int, turns: float, phase: float) -> Function:
    size = np.sqrt(2.0) / order**_DECAY
    return lambda u: size * np.cos(2.0 * np.pi * (turns * u - phase))


def _line(view: AxisView, term: Term, axis: str, limit: int) -> Factor:
    rows = len(view.data) // _EACH
    # Several factors share the rows.
    if term.kind in (Kind.SURFACE, Kind.OWN_LINE):
        rows = int(np.sqrt(rows))
    elif len(term.facts.factors) > 1:
        rows //= 4
    count = max(1, min(limit, view.places(axis) - 1, rows))
    return view.scaled(axis), smooth(count, view.goes_round(axis))


def _scaled(values: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    finite = values[np.isfinite(values)]
    size = float(np.sqrt(np.mean(finite**2))) if finite.size else 1.0
    return values / (size or 1.0)


def _time(view: AxisView) -> Float[np.ndarray, " t"]:
    clock = view.data.clock
    return np.asarray((clock - clock.mean()) / (float(np.std(clock)) or 1.0))


def _push(view: AxisView, term: Term, axis: str, limit: int) -> Factor:
    """Return laws over an acceleration, per sign: linear to a full or an early entry, then held."""
    values = view.data.acceleration[axis]
    finite = np.abs(values[np.isfinite(values)])
    busy = finite[finite > 0.05 * finite.max(initial=0.0)]
    full = float(np.quantile(busy, _FULL)) if busy.size else 1.0

    def law(sign: float, share: float) -> Function:
        return lambda hard: np.clip(sign * hard / share, 0.0, 1.0)

    shares = (1.0, _EARLY)[: limit // 2]
    return values / full, [law(sign, share) for sign in (1.0, -1.0) for share in shares]


def _decay(share: float, power: int) -> Function:
    return lambda distance: np.exp(-((distance / share) ** power))


def _heat(view: AxisView, term: Term, sensor: str, limit: int) -> Factor:
    """Return laws over the temperature of the structure behind a sensor.

    Laws of a coefficient are zero at the reference: what is there, is the leadscrew's.
    """
    heated = term.kind is Kind.HEAT_SLOPE
    data, body = view.data, view.data.temperature[sensor]
    if term.lag > 0.0 and data.time is not None:
        body = data.clocked(sensor, term.words).structure(term.lag)
    finite = body[np.isfinite(body)]
    mean, spread = float(finite.mean()), float(np.std(finite)) or 1.0
    zero = float(np.clip(_REFERENCE, finite.min(), finite.max())) if heated else mean
    middle = (mean - zero) / spread
    constant = middle**2 if heated else 1.0
    bent: Function = lambda warm: _BEND * ((warm - middle) ** 2 - constant)  # noqa: E731
    return (body - zero) / spread, [_SAME, bent][:limit]


_FACTORS: Mapping[str, Callable[[AxisView, Term, str, int], Factor]] = {
    "line": _line,
    "push": _push,
    "heat": _heat,
    "memory": lambda view, _, axis, most: (
        view.distance / np.ptp(view.span[axis]),
        [_decay(each, 1) for each in _MEMORY],
    ),
    "slow": lambda view, _, axis, most: (
        np.abs(view.data.velocity[axis]) / np.nanmax(np.abs(view.data.velocity[axis])),
        [_decay(each, 2) for each in _KNEES],
    ),
    "middle": lambda view, _, axis, most: (view.scaled(axis), [_STRAIGHT]),
    "time": lambda view, _, axis, most: (_time(view), [_SAME]),
    # A delay between instrument and encoder may change with time.
    "aging": lambda view, _, axis, most: (_time(view), [_ONE, _SAME]),
}
_SHAPES: Mapping[str, Function] = {
    "way": np.sign,
    "sign": np.sign,
    "speed": _scaled,
    "drag": lambda velocity: _scaled(velocity * np.abs(velocity)),
    "magnitude": lambda velocity: _scaled(np.abs(velocity)),
    "pull": _scaled,
}
"""Factors that are one function of a channel."""


def slow_functions(clock: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n k"]:
    """Return functions of time that a drift is made of; none for few readings."""
    if len(clock) < 2 * _DRIFT or not np.ptp(clock) > 0:
        return np.zeros((len(clock), 0))
    share = (clock - clock.min()) / np.ptp(clock)
    count = min(_DRIFT, len(clock) // 20)
    # Of a random walk, the amplitudes fall as the first power only.
    return np.stack(
        [max(k, 1) ** 0.5 * wave(share) for k, wave in enumerate(smooth(count))], axis=1
    )


def followed(
    courses: Float[np.ndarray, "t *c"], columns: Float[np.ndarray, "t k"]
) -> Float[np.ndarray, "*c"]:
    """Return the share of the square of courses that columns follow, means aside."""
    courses = courses - courses.mean(axis=0)
    columns = columns - columns.mean(axis=0)
    residual = courses - columns @ np.linalg.lstsq(columns, courses)[0]
    square = np.sum(courses**2, axis=0)
    share = 1.0 - np.sum(residual**2, axis=0) / np.where(square > 0, square, 1.0)
    return np.asarray(np.where(square > 0, share, 0.0))


@dataclasses.dataclass(frozen=True)
class Design:
    """Columns of terms and nuisance side by side.

    Attributes:
        terms: Candidates; what comes after them is nuisance.
        columns: Features.
        slices: Columns of each term, then those of each group of nuisance.
    """

    terms: tuple[Term, ...]
    columns: Float[np.ndarray, "t p"]
    slices: tuple[slice, ...]

    @classmethod
    def of(
        cls,
        terms: Sequence[Term],
        blocks: Sequence[Float[np.ndarray, "t _"]],
        nuisance: Sequence[Float[np.ndarray, "t _"]] = (),
    ) -> "Design":
        """Return the columns of terms and nuisance, one behind the other."""
        parts = [*blocks, *(part for part in nuisance if part.shape[1])]
        ends = np.cumsum([0, *(part.shape[1] for part in parts)]).tolist()
        slices = tuple(slice(start, end) for start, end in itertools.pairwise(ends))
        return cls(tuple(terms), np.concatenate(parts, axis=1), slices)


class Columns:
    """Features of terms of one axis, each computed once, and the weights of readings.

    Attributes:
        view: The readings.
        weight: How much each reading counts, as far as is known.
    """

    def __init__(self, view: AxisView) -> None:
        self.view = view
        self._blocks: dict[Term, np.ndarray] = {}
        self.weight = np.ones(len(view.error))

    def of(self, term: Term) -> Float[np.ndarray, "t k"]:
        """Return the features of a term, centred in each measurement; 0 where not known."""
        if term in self._blocks:
            return self._blocks[term]
        from pysindy import CustomLibrary, TensoredLibrary

        view, factors = self.view, list[Factor]()
        for name, owner, limit in term.facts.factors:
            subject = term.owners[owner]
            if name in _SHAPES:
                values = getattr(view.data, CHANNELS[name])[subject]
                factors.append((_SHAPES[name](values), [_SAME]))
            else:
                factors.append(_FACTORS[name](view, term, subject, limit))
        inputs = np.stack([channel for channel, _ in factors], axis=1)
        parts = [CustomLibrary(functions) for _, functions in factors]
        library = TensoredLibrary(parts, [[k] for k in range(len(parts))])
        features = library.fit(np.zeros((1, len(parts)))).transform(inputs)
        self._blocks[term] = view.centred(np.asarray(features))
        return self._blocks[term]

    def design(self, terms: Sequence[Term]) -> Design:
        """Return the columns of terms, zeros, runs and drifts."""
        blocks = [self.of(term) for term in terms]
        return Design.of(terms, blocks, (self.zeros, self.runs, self.drift))

    @cached_property
    def zeros(self) -> Float[np.ndarray, "t s"]:
        """One column per measurement: the zero of its instrument."""
        source = self.view.data.source
        return np.asarray(source[:, None] == np.unique(source), dtype=float)

    @cached_property
    def runs(self) -> Float[np.ndarray, "t r"]:
        """One column per run of a measurement of several; of too many none, they are noise."""
        columns = [np.zeros((len(self.view.data), 0))]
        for at in self.zeros.T:
            numbers, counts = np.unique(self.view.data.run[at > 0], return_counts=True)
            if 1 < len(numbers) <= min(_MOST_RUNS, counts.sum() // 2):
                columns.append((self.view.data.run[:, None] == numbers) * at[:, None])
        return self.view.centred(np.concatenate(columns, axis=1))

    @cached_property
    def drift(self) -> Float[np.ndarray, "t d"]:
        """Drifts of instruments, of measurements in which positions do not explain them."""
        kinds = (Kind.OWN, Kind.LINE, Kind.REVERSAL)
        places = [block for term, block in self._blocks.items() if term.kind in kinds]
        result = [np.zeros((len(self.view.data), 0))]
        for rows in self.view.sources if self.view.channel == "error" else ():
            functions = slow_functions(self.view.data.clock[rows])
            slow = np.zeros((len(self.view.data), functions.shape[1]))
            slow[rows] = functions
            slow = self.view.centred(slow)
            sample = rows[some_of(len(rows), _MOST)]
            if places and functions.shape[1]:
                placed = np.concatenate([block[sample] for block in places], axis=1)
                if np.any(followed(slow[sample, :2], placed) > _PLACED):
                    continue
            result.append(slow)
        return np.concatenate(result, axis=1)

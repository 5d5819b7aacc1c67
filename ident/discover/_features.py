"""Columns of every term: products of functions that libraries of pysindy carry.

A factor is a channel of the recording, scaled to about 1, and functions of it; the features
of a term are all products of the functions of its factors. Their sizes are a prior: a smooth
error of 1 mm has coefficients of about 1.
"""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float, Int

from ._data import Observed
from ._terms import Kind, Term
from ._view import AxisView

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
_BEND = 0.3
"""Size of a curved part of a temperature law, beside its straight part."""
_REFERENCE = 20.0
"""°C at which a temperature law corrects nothing; the nearest measured one counts."""
_DRIFT = 20
"""Functions of time: a drift is slower than a 10th of the record."""

Function = Callable[[Float[np.ndarray, " t"]], Float[np.ndarray, " t"]]
_ONE: Function = lambda values: np.ones_like(values)  # noqa: E731 (pysindy counts arguments)
_SAME: Function = lambda values: values  # noqa: E731
_STRAIGHT: Function = lambda u: np.sqrt(3.0) * (2.0 * u - 1.0)  # noqa: E731
Factor = tuple[Float[np.ndarray, " t"], list[Function]]


def columns_of(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    """Return the features of a term, centred in each measurement; 0 where not known."""
    from pysindy import CustomLibrary, TensoredLibrary

    factors = [
        (_CHANNELS[name](view.data, term.owner(whose)), [_SAME])
        if name in _CHANNELS
        else _FACTORS[name](view, term, term.owner(whose), most)
        for name, whose, most in term.facts.factors
    ]
    inputs = np.stack([channel for channel, _ in factors], axis=1)
    known = np.isfinite(inputs).all(axis=1)
    parts = [CustomLibrary(functions) for _, functions in factors]
    library = TensoredLibrary(parts, [[k] for k in range(len(parts))])
    library.fit(np.zeros((1, len(parts))))
    result = np.full((len(inputs), library.n_output_features_), np.nan)
    if known.any():
        result[known] = np.asarray(library.transform(inputs[known]))
    return view.centred(result)


def smooth(count: int, periodic: bool = False) -> list[Function]:
    """Return functions of a position scaled to 0 … 1, the constant left out.

    A straight line and cosines, or cosines and sines of a turn, scaled as smooth errors are:
    large scale first.

    Args:
        count: How many functions.
        periodic: 0 and 1 are the same place.
    """
    if not periodic:
        return [_STRAIGHT, *(_wave(k, 0.5 * k, 0.0) for k in range(1, count))]
    return [_wave(1 + k // 2, 1 + k // 2, 0.25 * (k % 2)) for k in range(count)]


def _wave(order: int, turns: float, late: float) -> Function:
    size = np.sqrt(2.0) / order**_DECAY
    return lambda u: size * np.cos(2.0 * np.pi * (turns * u - late))


def _line(view: AxisView, term: Term, axis: str, most: int) -> Factor:
    rows = len(view.data) // _EACH
    # Several factors share the rows.
    others = len(term.facts.factors) - 1
    if others:
        rows = int(np.sqrt(rows)) if term.kind in _SURFACES else rows // 4
    count = max(1, min(most, view.places(axis) - 1, rows))
    return view.scaled(axis), smooth(count, axis in view.modulo)


_SURFACES = (Kind.SURFACE, Kind.OWN_LINE)


def _scaled(values: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    finite = values[np.isfinite(values)]
    size = float(np.sqrt(np.mean(finite**2))) if finite.size else 1.0
    return values / (size or 1.0)


def _time(view: AxisView) -> Float[np.ndarray, " t"]:
    clock = view.data.clock
    return np.asarray((clock - clock.mean()) / (float(np.std(clock)) or 1.0))


def _push(view: AxisView, term: Term, axis: str, most: int) -> Factor:
    """Return laws over an acceleration: linear to a full or an early entry, then held.

    Accelerations of either sign have entries of their own.
    """
    values = view.data.acceleration[axis]
    finite = np.abs(values[np.isfinite(values)])
    busy = finite[finite > 0.05 * finite.max(initial=0.0)]
    full = float(np.quantile(busy, _FULL)) if busy.size else 1.0

    def law(sign: float, share: float) -> Function:
        return lambda hard: np.clip(sign * hard / share, 0.0, 1.0)

    shares = (1.0, _EARLY)[: most // 2]
    return values / full, [law(sign, share) for sign in (1.0, -1.0) for share in shares]


def _memory(view: AxisView, term: Term, axis: str, most: int) -> Factor:
    assert view.distance is not None  # the candidates have seen to it
    low, high = view.span[axis]

    def decay(share: float) -> Function:
        return lambda gone: np.exp(-gone / share)

    return view.distance / (high - low), [decay(share) for share in _MEMORY]


def _heat(view: AxisView, term: Term, sensor: str, most: int) -> Factor:
    body = lagged(view, sensor, term.lag)
    finite = body[np.isfinite(body)]
    warm = (body - finite.mean()) / (float(np.std(finite)) or 1.0)
    return warm, [_SAME, lambda warm: _BEND * (warm**2 - 1.0)][:most]


def _heated(view: AxisView, term: Term, sensor: str, most: int) -> Factor:
    """Return laws that are zero at the reference: what is there, is the leadscrew's."""
    body = lagged(view, sensor, term.lag)
    finite = body[np.isfinite(body)]
    spread = float(np.std(finite)) or 1.0
    zero = float(np.clip(_REFERENCE, finite.min(), finite.max()))
    middle = (float(finite.mean()) - zero) / spread
    bent: Function = lambda warm: _BEND * ((warm - middle) ** 2 - middle**2)  # noqa: E731
    return (body - zero) / spread, [_SAME, bent][:most]


def _slow(view: AxisView, term: Term, axis: str, most: int) -> Factor:
    velocity = view.data.velocity[axis]
    knee = term.lag * float(np.nanmax(np.abs(velocity)))
    return _scaled(np.sign(velocity) * np.exp(-((velocity / knee) ** 2))), [_SAME]


_FACTORS: Mapping[str, Callable[[AxisView, Term, str, int], Factor]] = {
    "line": _line,
    "push": _push,
    "memory": _memory,
    "heat": _heat,
    "heated": _heated,
    "slow": _slow,
    "middle": lambda view, _, axis, most: (view.scaled(axis), [_STRAIGHT]),
    "time": lambda view, _, axis, most: (_time(view), [_SAME]),
    # A delay between instrument and encoder may change with time.
    "aging": lambda view, _, axis, most: (_time(view), [_ONE, _SAME]),
}
_CHANNELS: Mapping[str, Callable[[Observed, str], Float[np.ndarray, " t"]]] = {
    "way": lambda data, axis: np.sign(data.direction[axis]),
    "sign": lambda data, axis: np.sign(data.velocity[axis]),
    "speed": lambda data, axis: _scaled(data.velocity[axis]),
    "drag": lambda data, axis: _scaled(
        data.velocity[axis] * np.abs(data.velocity[axis])
    ),
    "magnitude": lambda data, axis: _scaled(np.abs(data.velocity[axis])),
    "pull": lambda data, axis: _scaled(data.acceleration[axis]),
}
"""Factors that are a channel as it stands."""


def lagged(view: AxisView, sensor: str, lag: float) -> Float[np.ndarray, " t"]:
    """Return a temperature as a body of the given time constant in s follows it."""
    from scipy.signal import lfilter

    raw = view.data.temperature[sensor]
    if lag <= 0.0 or view.data.time is None:
        return raw
    result = np.full(len(raw), np.nan)
    for own in view.sources():
        rows = own[np.isfinite(raw[own])]
        if not rows.size:
            continue
        time = view.data.time[rows]
        grid = np.linspace(time[0], time[-1], max(2, min(1500, len(rows))))
        heat = np.interp(grid, time, raw[rows])
        share = -np.expm1(-(grid[1] - grid[0]) / lag) if grid[1] > grid[0] else 0.0
        gain, memory = [0.0, share], [1.0, share - 1.0]
        body = heat[0] + lfilter(gain, memory, heat - heat[0])
        result[rows] = np.interp(time, grid, body)
    return result


@dataclasses.dataclass(frozen=True)
class Nuisance:
    """What changes between and during measurements and is no compensation's task.

    Attributes:
        zeros: One column per measurement: the zero of its instrument.
        runs: One column per run of a measurement of several.
        drift: Slow functions of time in each measurement.
        owner: Number of the measurement of each of these.
    """

    zeros: Float[np.ndarray, "t s"]
    runs: Float[np.ndarray, "t r"]
    drift: Float[np.ndarray, "t d"]
    owner: Int[np.ndarray, " d"]


def nuisance_of(view: AxisView, drifting: bool = True) -> Nuisance:
    """Return the columns of zeros, offsets of runs and drifts."""
    data = view.data
    zeros: list[np.ndarray] = []
    runs: list[np.ndarray] = []
    drift: list[np.ndarray] = []
    owner: list[int] = []
    for number, rows in enumerate(view.sources()):
        own = np.zeros(len(data))
        own[rows] = 1.0
        zeros.append(own)
        numbers = np.unique(data.run[rows])
        if len(numbers) > 1:
            runs += [(data.run == each) * own for each in numbers]
        if not drifting:
            continue
        slow = slow_functions(data.clock[rows])
        columns = np.zeros((len(data), slow.shape[1]))
        columns[rows] = slow
        drift += list(columns.T)
        owner += [number] * slow.shape[1]
    empty = np.zeros((len(data), 0))
    return Nuisance(
        np.stack(zeros, axis=1),
        view.centred(np.stack(runs, axis=1)) if runs else empty,
        view.centred(np.stack(drift, axis=1)) if drift else empty,
        np.array(owner, dtype=np.int64),
    )


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

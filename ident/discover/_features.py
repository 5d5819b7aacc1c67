"""Columns of every term: normalised features of what was recorded."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float, Int

from ._basis import products, waves
from ._terms import Kind, Term
from ._view import AxisView

_LINE = 48
"""Functions along one position: down to a 24th of the travel."""
_REVERSAL = 24
_SURFACE = 10
_PAIR = 6
_ADAPT = 4
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


def columns_of(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    """Return the features of a term, centred in each measurement.

    Their sizes are a prior: a smooth error of 1 mm has coefficients of about 1.
    """
    return view.centred(_COLUMNS[term.kind](view, term))


def lagged(view: AxisView, sensor: str, lag: float) -> Float[np.ndarray, " t"]:
    """Return a temperature as a body of the given time constant in s follows it."""
    raw = view.data.temperature[sensor]
    if lag <= 0.0 or view.data.time is None:
        return raw
    result = np.full(len(raw), np.nan)
    for number in np.unique(view.data.source):
        rows = np.flatnonzero((view.data.source == number) & np.isfinite(raw))
        if not rows.size:
            continue
        time = view.data.time[rows]
        grid = np.linspace(time[0], time[-1], max(2, min(1500, len(rows))))
        heat = np.interp(grid, time, raw[rows])
        step = grid[1] - grid[0]
        share = -np.expm1(-step / lag) if step > 0 else 0.0
        body = np.empty_like(heat)
        body[0] = heat[0]
        for k in range(1, len(heat)):
            body[k] = body[k - 1] + share * (heat[k - 1] - body[k - 1])
        result[rows] = np.interp(time, grid, body)
    return result


def _count(view: AxisView, axis: str, most: int) -> int:
    rows = len(view.data) // _EACH
    return max(1, min(most, view.places(axis) - 1, rows))


def _line(view: AxisView, axis: str, most: int) -> Float[np.ndarray, "t k"]:
    count = _count(view, axis, most)
    return waves(view.scaled(axis), count, axis in view.modulo)


def _own(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    return _line(view, term.axis, _LINE)


def _other(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    return _line(view, term.masters[0], _LINE)


def _way(view: AxisView, axis: str) -> Float[np.ndarray, "t 1"]:
    return np.asarray(np.sign(view.data.direction[axis])[:, None])


def _reversal(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    return _way(view, term.axis)


def _own_reversal(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    most = max(1, min(_REVERSAL, len(view.data) // (4 * _EACH)))
    return np.asarray(_way(view, term.axis) * _line(view, term.axis, most))


def _surface(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    return _pair(view, term.masters[0], term.masters[1], _SURFACE)


def _pair(
    view: AxisView, first: str, second: str, most: int
) -> Float[np.ndarray, "t k"]:
    most = max(1, min(most, int(np.sqrt(len(view.data) // _EACH))))
    return products(_line(view, first, most), _line(view, second, most))


def _heat(view: AxisView, term: Term) -> Float[np.ndarray, "t 2"]:
    assert term.sensor is not None  # the library gives every such term one
    body = lagged(view, term.sensor, term.lag)
    finite = np.isfinite(body)
    spread = float(np.std(body[finite])) or 1.0
    warm = (body - float(np.mean(body[finite]))) / spread
    return np.stack([warm, _BEND * (warm**2 - 1.0)], axis=1)


def _middle(view: AxisView, axis: str) -> Float[np.ndarray, "t 1"]:
    return np.asarray(np.sqrt(3.0) * (2.0 * view.scaled(axis) - 1.0)[:, None])


def _heat_slope(view: AxisView, term: Term) -> Float[np.ndarray, "t 2"]:
    return np.asarray(_middle(view, term.axis) * _heat(view, term))


def _heat_line(view: AxisView, term: Term) -> Float[np.ndarray, "t 1"]:
    return np.asarray(_middle(view, term.masters[0]) * _heat(view, term)[:, :1])


def _growth(view: AxisView, term: Term) -> Float[np.ndarray, "t 1"]:
    clock = view.data.clock
    share = (clock - clock.mean()) / (float(np.std(clock)) or 1.0)
    return np.asarray(_middle(view, term.axis) * share[:, None])


def _drift(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    """Return the smoothest drifts: cubic in time, each measurement for itself."""
    clock, parts = view.data.clock, []
    for source in np.unique(view.data.source):
        own = view.data.source == source
        width = float(np.ptp(clock[own])) or 1.0
        share = 2.0 * (clock - clock[own].min()) / width - 1.0
        parts += [np.where(own, share**k, 0.0) for k in (1, 2, 3)]
    return np.stack(parts, axis=1)


def _push(values: Float[np.ndarray, " t"], shapes: int = 2) -> Float[np.ndarray, "t k"]:
    """Return laws over an acceleration: linear to a full or an early entry, then held.

    Accelerations of either sign have entries of their own.
    """
    finite = np.abs(values[np.isfinite(values)])
    busy = finite[finite > 0.05 * finite.max(initial=0.0)]
    full = float(np.quantile(busy, _FULL)) if busy.size else 1.0
    shares = (1.0, _EARLY)[:shapes]
    return np.stack(
        [
            np.clip(sign * values / (share * full), 0.0, 1.0)
            for sign in (1.0, -1.0)
            for share in shares
        ],
        axis=1,
    )


def _push_of(view: AxisView, term: Term) -> Float[np.ndarray, "t 4"]:
    return _push(view.data.acceleration[term.masters[0]])


def _push_way(view: AxisView, term: Term) -> Float[np.ndarray, "t 4"]:
    way = np.sign(view.data.velocity[term.masters[0]])[:, None]
    return np.asarray(way * _push_of(view, term))


def _push_place(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    hard = _push(view.data.acceleration[term.masters[0]], 1)
    return products(hard, _line(view, term.masters[1], _ADAPT))


def _push_places(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    hard = _push(view.data.acceleration[term.masters[0]], 1)
    first, second = (_line(view, axis, _ADAPT) for axis in term.masters[1:])
    return products(hard, products(first, second))


def _scaled(values: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 1"]:
    finite = values[np.isfinite(values)]
    size = float(np.sqrt(np.mean(finite**2))) if finite.size else 1.0
    return values[:, None] / (size or 1.0)


def _speed(view: AxisView, term: Term) -> Float[np.ndarray, "t 2"]:
    """Return a delay between instrument and encoder, and how it drifts."""
    fast = _scaled(view.data.velocity[term.axis])
    clock = view.data.clock
    share = (clock - clock.mean()) / (float(np.std(clock)) or 1.0)
    return np.concatenate([fast, fast * share[:, None]], axis=1)


def _speed_other(view: AxisView, term: Term) -> Float[np.ndarray, "t 1"]:
    return _scaled(view.data.velocity[term.masters[0]])


def _pull(view: AxisView, term: Term) -> Float[np.ndarray, "t 1"]:
    return _scaled(view.data.acceleration[term.axis])


def _reversal_other(view: AxisView, term: Term) -> Float[np.ndarray, "t 1"]:
    return _way(view, term.masters[0])


def _own_line(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    return _pair(view, term.axis, term.masters[0], _PAIR)


def _memory(view: AxisView, term: Term) -> Float[np.ndarray, "t k"]:
    assert view.distance is not None  # the library has seen to it
    low, high = view.span[term.axis]
    decays = [np.exp(-view.distance / (share * (high - low))) for share in _MEMORY]
    return np.asarray(_way(view, term.axis) * np.stack(decays, axis=1))


_COLUMNS: Mapping[Kind, Callable[[AxisView, Term], np.ndarray]] = {
    Kind.OWN: _own,
    Kind.REVERSAL: _reversal,
    Kind.OWN_REVERSAL: _own_reversal,
    Kind.LINE: _other,
    Kind.SURFACE: _surface,
    Kind.HEAT_OFFSET: _heat,
    Kind.HEAT_SLOPE: _heat_slope,
    Kind.PUSH: _push_of,
    Kind.PUSH_WAY: _push_way,
    Kind.PUSH_PLACE: _push_place,
    Kind.PUSH_PLACES: _push_places,
    Kind.SPEED: _speed,
    Kind.SPEED_OTHER: _speed_other,
    Kind.PULL: _pull,
    Kind.REVERSAL_OTHER: _reversal_other,
    Kind.OWN_LINE: _own_line,
    Kind.MEMORY: _memory,
    Kind.HEAT_LINE: _heat_line,
    Kind.GROWTH: _growth,
    Kind.DRIFT: _drift,
}


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


_DRIFT = 20
"""Functions of time: a drift is slower than a 10th of the record."""


def nuisance_of(view: AxisView) -> Nuisance:
    """Return the columns of offsets of runs and of drifts."""
    data = view.data
    runs: list[np.ndarray] = []
    drift: list[np.ndarray] = []
    owner: list[int] = []
    for source in np.unique(data.source):
        own = data.source == source
        numbers = np.unique(data.run[own])
        if len(numbers) > 1:
            runs += [((data.run == number) & own).astype(float) for number in numbers]
        clock = data.clock[own]
        if len(clock) < 2 * _DRIFT or not np.ptp(clock) > 0:
            continue
        share = (clock - clock.min()) / np.ptp(clock)
        count = min(_DRIFT, int(own.sum()) // 20)
        # Of a random walk, the amplitudes fall as the first power only.
        slow = waves(share, count, False) * np.maximum(np.arange(count), 1) ** 0.5
        column = np.zeros((len(data), count))
        column[own] = slow
        drift += list(column.T)
        owner += [int(source)] * count
    empty = np.zeros((len(data), 0))
    numbers = np.unique(data.source)
    return Nuisance(
        (data.source[:, None] == numbers).astype(float),
        view.centred(np.stack(runs, axis=1)) if runs else empty,
        view.centred(np.stack(drift, axis=1)) if drift else empty,
        np.array(owner, dtype=np.int64),
    )

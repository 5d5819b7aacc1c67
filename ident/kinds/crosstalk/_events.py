"""Acceleration events cut out of a log of master and slave, each reduced to one value."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import FitError, filled
from ...fit.joint import Crosstalk
from . import BRANCHES

_LEAST = 0.3
"""Share of the specified acceleration that an event reaches."""
QUIET = 0.02
"""Share of the specified acceleration up to which the master does not accelerate."""
_TURN = 0.1
"""Share of the impulse of an acceleration that a direction has at least where the master
turns in it; less is the edge of a filtered acceleration."""
_LEAST_SPEED = 1e-12
"""mm/s: tells a direction and nothing else."""
_ROWS = 4
"""Rows of an event at least."""
_BLIND = 1e6
"""Variance of an event, relative to one reading, from which on it says nothing."""
_DEARER = 4.0
"""Variance by impulses, in that of least squares, up to which impulses are preferred."""


@dataclasses.dataclass(frozen=True)
class CrosstalkReadings:
    """Motion of the master axis and the error of the slave axis, row by row in time.

    Attributes:
        time: In s, ascending.
        acceleration: Of the master in mm/s².
        velocity: Of the master in mm/s.
        error: Of the slave, actual − encoder (or commanded at rest) in mm; NaN = missed.
        positions: Of the axes on which it may depend (adaptation axes) in mm, shape
            ``(t, k)``; k = 0 where there are none.
    """

    time: Float[np.ndarray, " t"]
    acceleration: Float[np.ndarray, " t"]
    velocity: Float[np.ndarray, " t"]
    error: Float[np.ndarray, " t"]
    positions: Float[np.ndarray, "t k"]

    def take(self, rows: slice) -> "CrosstalkReadings":
        """Return some of the rows."""
        return CrosstalkReadings(*(column[rows] for column in vars(self).values()))

    def directed(self, form: Crosstalk) -> "CrosstalkReadings":
        """Return the log with one direction per acceleration, or two where it turns.

        A filter smears an acceleration over the standstill before and after, where the
        velocity has no direction: there the controller would take another entry.

        Args:
            form: Says what full acceleration is.
        """
        velocity = self.velocity.copy()
        full = np.where(self.acceleration < 0, -form.deceleration, form.acceleration)
        share = np.abs(self.acceleration) / full
        sign = np.where(share < QUIET, 0, np.sign(self.acceleration))
        for start, stop in _stretches(sign):
            rows = slice(start, stop)
            push, speed = share[rows], np.abs(velocity[rows])
            net = push * np.sign(velocity[rows])
            forward, back = float(net[net > 0].sum()), float(-net[net < 0].sum())
            if sign[start] == 0 or forward == back:
                continue
            turn, lead = stop - start, 1.0 if forward > back else -1.0
            if min(forward, back) >= _TURN * float(push.sum()):
                # The master turns: one direction before, the other one after.
                lead = -float(sign[start])
                turn = 1 + int(np.argmax(np.cumsum(net * lead)))
            way = np.where(np.arange(stop - start) < turn, lead, -lead)
            velocity[rows] = way * np.maximum(speed, _LEAST_SPEED)
        return dataclasses.replace(self, velocity=velocity)


@dataclasses.dataclass(frozen=True)
class Events:
    """Accelerations of the master cut out of a log, one row each.

    Attributes:
        start: First row of the log.
        stop: Row after the last.
        branch: Sign of the acceleration and direction, a row of `BRANCHES`.
        positions: Of the adaptation axes in mm, weighted like the readings of the event.
        peak: Largest acceleration in mm/s², with its sign.
        value: Error of the slave at the specified acceleration that the event shows, in mm.
        standard_deviation: Of that, from the scatter within the event.
        wild: Set aside because it contradicts the others.
    """

    start: Int[np.ndarray, " n"]
    stop: Int[np.ndarray, " n"]
    branch: Int[np.ndarray, " n"]
    positions: Float[np.ndarray, "n k"]
    peak: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    standard_deviation: Float[np.ndarray, " n"]
    wild: Bool[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.value)

    def take(self, rows: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> "Events":
        """Return some of the events."""
        return Events(*(column[rows] for column in vars(self).values()))


def joined_logs(parts: Sequence[CrosstalkReadings]) -> CrosstalkReadings:
    """Put logs one after the other, far enough apart that no event sees another log."""
    if len(parts) == 1:
        return parts[0]
    rows = np.arange(1, 2 + max(map(_longest, parts)))
    none, missing = np.zeros(len(rows)), np.full(len(rows), np.nan)
    found, start = [], 0.0
    for part in parts:
        step = float(np.median(np.diff(part.time)))
        time = start + part.time - part.time[0]
        between = time[-1] + step * rows
        places = np.repeat(part.positions[-1:], len(rows), axis=0)
        found.append(dataclasses.replace(part, time=time))
        found.append(CrosstalkReadings(between, none, none, missing, places))
        start = between[-1] + step
    columns = zip(*(vars(each).values() for each in found), strict=True)
    return CrosstalkReadings(*map(np.concatenate, columns))


def _longest(part: CrosstalkReadings) -> int:
    """Return the rows of the longest acceleration of one sign."""
    size = np.abs(part.acceleration)
    sign = np.sign(part.acceleration) * (size > QUIET * size.max(initial=0.0))
    return max((b - a for a, b in _stretches(sign) if sign[a]), default=0)


def specified(
    readings: CrosstalkReadings, acceleration: float | None, deceleration: float | None
) -> tuple[float, float]:
    """Return the accelerations that the entries stand for, in mm/s²: given, or as measured.

    Raises:
        FitError: If the master never accelerates so.
    """

    def reached(sign: float, word: str) -> float:
        values = sign * readings.acceleration
        top = float(values.max())
        if not top > 0:
            msg = f"the master shows no {word} at all, expected events of both signs."
            raise FitError(msg)
        # What the master reaches again and again; a list has integers.
        return sign * math.ceil(float(np.median(values[values > 0.5 * top])))

    return (
        reached(1.0, "acceleration") if acceleration is None else acceleration,
        reached(-1.0, "deceleration") if deceleration is None else deceleration,
    )


def cut_events(readings: CrosstalkReadings, form: Crosstalk) -> Events:
    r"""Return the acceleration events of a log, one value each.

    An event is a stretch of one sign and direction that reaches a share of the specified
    acceleration. Over it and as much of the log on both sides,
    $e = A\,\mathrm{share}(t) + b + c\,t$ (and other events nearby) is solved: what stands still
    or drifts beside the acceleration is no crosstalk. Its place is the mean of the positions
    with the weights of the readings.

    Args:
        readings: Log of master and slave.
        form: Specified accelerations, and how signs and directions are defined.

    Raises:
        FitError: If rows are not finite, time does not ascend or there is no event.
    """
    for name in ("time", "acceleration", "velocity", "positions"):
        bad = ~np.isfinite(getattr(readings, name).reshape(len(readings.time), -1))
        if bad.any():
            row = int(np.flatnonzero(bad.any(axis=1))[0])
            msg = f"reading {row + 1}: {name} is not finite, expected numbers."
            raise FitError(msg)
    back = np.flatnonzero(np.diff(readings.time) <= 0)
    if back.size:
        msg = (
            f"reading {back[0] + 2}: found time that does not ascend, expected a log in the"
            " order of time."
        )
        raise FitError(msg)
    share, label = shares_of(readings, form)
    found = []
    for start, stop in _stretches(label):
        if label[start] < 0 or share[start:stop].max() < _LEAST:
            continue
        rows, events, line = window_of(readings, label, share, start, stop)
        solved = _amplitude(share[rows], events, line, readings.error[rows])
        if solved is not None:
            found.append((start, stop, solved))
    if not found:
        msg = (
            f"no acceleration of the master reaches {100 * _LEAST:.0f} % of "
            f"{form.acceleration:g} mm/s² or {form.deceleration:g} mm/s² for {_ROWS} rows: "
            "nothing to fit."
        )
        raise FitError(msg)
    spans = [slice(start, stop) for start, stop, _ in found]
    weights = [share[rows] ** 2 for rows in spans]
    places = [
        weight @ readings.positions[rows] / weight.sum()
        for rows, weight in zip(spans, weights, strict=True)
    ]
    pushes = [readings.acceleration[rows] for rows in spans]
    first, last = np.array([ends for *ends, _ in found]).T
    value, deviation = np.array([solved for *_, solved in found]).T
    return Events(
        start=first,
        stop=last,
        branch=label[first],
        positions=np.array(places).reshape(len(found), -1),
        peak=np.array([push[np.argmax(np.abs(push))] for push in pushes]),
        value=value,
        standard_deviation=deviation,
        wild=np.zeros(len(found), dtype=bool),
    )


def shares_of(
    readings: CrosstalkReadings, form: Crosstalk
) -> tuple[Float[np.ndarray, " t"], Int[np.ndarray, " t"]]:
    """Return the share of the specified acceleration in each row, and its row of `BRANCHES`.

    That is −1 where the master does not accelerate.
    """
    directed = readings.directed(form)
    everywhere = dataclasses.replace(
        form, adaptation=(), positions=None, velocity_dependent=True
    )
    model = everywhere.to_model(np.zeros((4, 1)), 1.0)
    stencil = model.stencil(filled(directed.acceleration), filled(directed.velocity))
    count = len(readings.time)
    share = np.asarray(stencil.weights)[:count].sum(axis=1)
    branch = np.asarray(stencil.nodes)[:count, 0].astype(np.int64)
    return share, np.where(share < QUIET, -1, branch)


def _stretches(
    label: Float[np.ndarray, " t"] | Int[np.ndarray, " t"],
) -> list[tuple[int, int]]:
    """Return first row and row after the last of each stretch of equal labels."""
    edges = (np.flatnonzero(np.diff(label)) + 1).tolist()
    return list(zip([0, *edges], [*edges, len(label)], strict=True))


def window_of(
    readings: CrosstalkReadings,
    label: Int[np.ndarray, " t"],
    share: Float[np.ndarray, " t"],
    start: int,
    stop: int,
) -> tuple[Int[np.ndarray, " w"], Float[np.ndarray, "w e"], Float[np.ndarray, "w l"]]:
    """Return the rows of an event and of what lies beside it, and what they may show.

    That are the events in these rows, 1 or 0 for each and this one first, then level and
    drift. No rows where the event has too few; arguments as of `shares_of`.
    """
    length = stop - start
    rows = np.arange(max(start - length, 0), min(stop + length, len(share)))
    rows = rows[np.isfinite(readings.error[rows])]
    own = (rows >= start) & (rows < stop)
    if own.sum() < _ROWS:
        return rows[:0], np.zeros((0, 1)), np.zeros((0, 2))
    beside = [~own & (label[rows] == other) for other in range(len(BRANCHES))]
    events = np.stack([own, *(each for each in beside if each.sum() >= _ROWS)], axis=1)
    keep = events.any(axis=1) | (label[rows] < 0)
    rows, events = rows[keep], events[keep].astype(float)
    clock = readings.time[rows] - readings.time[rows].mean()
    clock /= max(float(np.abs(clock).max()), 1e-300)
    return rows, events, np.stack([np.ones(len(rows)), clock], axis=1)


def _amplitude(
    share: Float[np.ndarray, " w"],
    events: Float[np.ndarray, "w e"],
    line: Float[np.ndarray, "w l"],
    error: Float[np.ndarray, " w"],
) -> tuple[float, float] | None:
    """Return the size of the first event, and its deviation; None where it is open.

    Least squares make the factor too large where a filter has smeared the acceleration but not
    the error, and too small where the acceleration is noisy. What a filter keeps is the
    impulse: sums over each event, instead of products with its shares, are the instruments
    that hit the factor all the same (A. Wald, Ann. Math. Stat. 11, 1940). Where the master
    accelerates all the time they tell no level, and least squares have to do.

    Args:
        share: Of the specified acceleration, per row.
        events: Rows of each event.
        line: Level and drift.
        error: Of the slave in mm.
    """
    design = np.hstack([events * share[:, None], line])
    impulses = np.hstack([events, line])
    free = len(error) - design.shape[1]
    if free <= 0 or np.linalg.matrix_rank(design, 1.0 / _BLIND) < design.shape[1]:
        return None
    found = []
    for instruments in (design, impulses):
        matrix = instruments.T @ design
        if np.linalg.cond(matrix) > _BLIND**2:
            continue
        inverse = np.linalg.inv(matrix)
        left = error - design @ (inverse @ (instruments.T @ error))
        row = instruments @ inverse[0]
        found.append((float(row @ row), float(row @ error), float(left @ left) / free))
    if len(found) == 2 and found[1][0] <= _DEARER * found[0][0]:
        found = found[1:]
    if not found or found[0][0] > _BLIND:
        return None
    variance, value, square = found[0]
    return value, math.sqrt(max(square * variance, 1e-18))

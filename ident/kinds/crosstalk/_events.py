"""Acceleration events cut out of a log of master and slave, each reduced to one value."""

import dataclasses
import functools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import stdtrit

from .... import models
from ....data.signals import travel_direction
from ..._recording import JointData
from ...core import FitError, filled, regress
from ...fit.joint import Crosstalk
from . import BRANCHES

_LEAST = 0.3
"""Share of the specified acceleration that an event reaches."""
_QUIET = 0.02
"""Share of the specified acceleration up to which the master does not accelerate."""
_TURN = 0.1
"""Share of the impulse of an acceleration that a direction has at least where the master
turns in it; less is the edge of a filtered acceleration."""
_LOBE = 0.15
"""Share of the peak of an event up to which what follows it with the other sign is where a
filter rings."""
_SILENT = 0.002
"""Share of the peak of an event up to which nothing rings."""
_STILL = 0.01
"""mm within which an axis does not move during an event."""
_LEAST_SPEED = 1e-12
"""mm/s: tells a direction and nothing else."""
_ROWS = 4
"""Rows of an event at least."""
_BLIND = 1e6
"""Variance of an event, relative to one reading, from which on it says nothing."""
_LEVELLED = 8.0
"""Variance of an event, in that where the level is known, from which on the level is open.

Where accelerations go straight into others, the rows over which a filter of 22 Hz smears them
make 10 of it for those of 0.1 s, and more for longer ones; a tenth of the time at rest makes 5,
an acceleration like a sine 2.5. What shorter ones make of it, the gate sees (`from_file`).
"""
_DEARER = 16.0
"""Variance by impulses, in that of least squares, up to which impulses are preferred."""
_BLURRED = 4.0
"""Deviation, in the one at a fixed place, up to which an event is one whose size moves."""
_FARTHEST = 0.02
"""s: a delay beyond this is another event."""
_MOST_ROWS, _MOST_EVENTS = 25, 60
"""Rows of a delay, and about how many events are looked at for it."""
_FAR = 6.0
"""Residual, in the median one, up to which no reading of a window is suspected to be wild."""
_BY_PLACE = 0.3
"""Share of what changes in the error between accelerations that its slope over the master is."""
_STANDS, _BY_CHANCE = 0.01, 1e-8
"""Share of its highest speed below which the master stands, and the chance of a jump at its turns
by which noise shows one."""
_ONE_SPEED, _FADES = 0.95, 0.25
"""Share of what a direction changes that the speed does too, above which neither is told; and of a
jump that may fade before the next acceleration."""
_GAIN = 0.05
"""Relative fall of the residual's standard deviation below which there is no delay."""


def directed(data: JointData, form: Crosstalk) -> JointData:
    """Return a log with one direction per acceleration, or two where the master turns.

    A filter smears an acceleration over the standstill before and after, where the velocity has
    no direction: there the controller would take another entry. The form says what full
    acceleration is, and whose direction counts.
    """
    acceleration, velocity, *_ = form.columns_of(data)
    velocity = velocity.copy()
    full = np.where(acceleration < 0, -form.deceleration, form.acceleration)
    share = np.abs(acceleration) / full
    sign = np.where(share < _QUIET, 0, np.sign(acceleration))
    for start, stop in _stretches(sign, logs_of(data)):
        rows = slice(start, stop)
        shares, speed = share[rows], np.abs(velocity[rows])
        net = shares * np.sign(velocity[rows])
        forward, backward = float(net[net > 0].sum()), float(-net[net < 0].sum())
        if sign[start] == 0 or forward == backward:
            continue
        turn, lead = stop - start, 1.0 if forward > backward else -1.0
        if min(forward, backward) >= _TURN * float(shares.sum()):
            # The master turns: one direction before, the other one after.
            lead = -float(sign[start])
            turn = 1 + int(np.argmax(np.cumsum(net * lead)))
        direction = np.where(np.arange(stop - start) < turn, lead, -lead)
        velocity[rows] = direction * np.maximum(speed, _LEAST_SPEED)
    (_, mover) = form.inputs[1]
    return dataclasses.replace(data, velocity={**data.velocity, mover: velocity})


def added_by(
    model: models.AbstractCrosstalk, data: JointData, form: Crosstalk
) -> Float[np.ndarray, " t"]:
    """Return what a list of the axes of a form adds in each row of a log, in mm, unfiltered."""
    # Beside an event the direction is that of the event.
    pull, speed, *places = form.columns_of(directed(data, form))
    motion = pull, speed, np.reshape(places, (-1, len(pull))).T
    return np.asarray(model.offset(*motion))


def gone_by(data: JointData, form: Crosstalk) -> Float[np.ndarray, " t"]:
    """Return how far the master has gone in each row, in mm."""
    speed = np.nan_to_num(data.velocity[form.master])
    return np.cumsum(speed * np.gradient(data.clock_for(form.name)))


def logs_of(data: JointData) -> Int[np.ndarray, " t"]:
    """Return the number of the log that each row belongs to: no event sees another log."""
    zeros = np.zeros(len(data), dtype=np.int64)
    return zeros if data.clock_number is None else data.clock_number


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
        left_out: Readings of the event and beside it that were taken for wild.
        wild: Set aside because it contradicts the others.
    """

    start: Int[np.ndarray, " n"]
    stop: Int[np.ndarray, " n"]
    branch: Int[np.ndarray, " n"]
    positions: Float[np.ndarray, "n k"]
    peak: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    standard_deviation: Float[np.ndarray, " n"]
    left_out: Int[np.ndarray, " n"]
    wild: Bool[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.value)

    @functools.cached_property
    def own_noise(self) -> float:
        """Scatter of an event of weight 1 as the events tell themselves, in mm."""
        return float(np.median(self.standard_deviation))

    @functools.cached_property
    def weight(self) -> Float[np.ndarray, " n"]:
        """Relative weights, median 1: none is so sure of itself that it outvotes the others."""
        deviation = np.maximum(self.standard_deviation, 0.3 * self.own_noise)
        return np.asarray(np.square(self.own_noise / deviation))

    def take(self, rows: Bool[np.ndarray, " n"]) -> "Events":
        """Return some of the events."""
        names = (field.name for field in dataclasses.fields(self))
        return Events(*(getattr(self, name)[rows] for name in names))


def specified(
    measured: Float[np.ndarray, " t"],
    acceleration: float | None,
    deceleration: float | None,
) -> tuple[float, float]:
    """Return the accelerations that the entries stand for, in mm/s²: given, or as measured.

    Raises:
        FitError: If the master never accelerates so.
    """

    def reached(sign: float, words: str) -> float:
        values = sign * measured
        top = float(values.max(initial=0.0))
        if not top > 0:
            msg = (
                f"the master never {words} in these readings, expected accelerations of both"
                " signs."
            )
            raise FitError(msg)
        # What the master reaches again and again; a list has integers.
        return sign * math.ceil(float(np.median(values[values > 0.5 * top])))

    return (
        reached(1.0, "speeds up") if acceleration is None else acceleration,
        reached(-1.0, "slows down") if deceleration is None else deceleration,
    )


def cut_events(data: JointData, form: Crosstalk, over: Sequence[str] = ()) -> Events:
    r"""Return the acceleration events of a log, one value each.

    An event is a stretch of one sign and direction that reaches a share of the specified
    acceleration. Over it and as much of the log on both sides,
    $e = A\,\mathrm{share}(t) + b + c\,t$ (and other events nearby) is solved: what stands still
    or drifts beside the acceleration is no crosstalk. Its place is the mean of the positions
    with the weights of the readings.

    Args:
        data: Log of master and slave, in the order of time; a row without error was missed.
        form: Specified accelerations, and how signs and directions are defined.
        over: Axes whose positions make the place of an event.

    Raises:
        FitError: If rows are not finite, time does not ascend or there is no event.
    """
    time = data.clock_for(form.name)
    acceleration, velocity, *_ = form.columns_of(data)
    places = np.column_stack(
        [np.zeros((len(data), 0)), *(data.position[name] for name in over)]
    )
    motion = {"acceleration": acceleration, "velocity": velocity, "positions": places}
    for name, values in {"time": time, **motion}.items():
        invalid = ~np.isfinite(values.reshape(len(data), -1)).all(axis=1)
        for row in np.flatnonzero(invalid).tolist():
            msg = f"reading {row + 1}: {name} is not finite, expected numbers."
            raise FitError(msg)
    falling = (np.diff(time) <= 0) & (np.diff(logs_of(data)) == 0)
    for row in np.flatnonzero(falling).tolist():
        words = "found time that does not ascend, expected a log in the order of time"
        msg = f"reading {row + 2}: {words}."
        raise FitError(msg)
    cut, error, windows = [], data.error[form.axis], [*_windows(data, form)]
    for event in windows:
        if not event.has_level:
            continue
        rows, weight = slice(event.start, event.stop), event.share**2
        place, signal = weight @ places[rows] / weight.sum(), acceleration[rows]
        sound = _sound(event.design, error[event.rows])
        within = places[event.rows] - place
        shown = event.design[sound], error[event.rows][sound]
        size = _amplitude(*shown, within[sound, :0])
        # What changes with the place within an event is no drift, where that can be told.
        moves = np.ptp(within, axis=0) > _STILL
        if size is not None and moves.any():
            moved = _amplitude(*shown, within[sound][:, moves])
            if moved is not None and moved[1] <= _BLURRED * size[1]:
                size = moved
        if size is None:
            # Which events there are depends on the motion alone, not on what the slave did.
            sound = np.ones(len(sound), bool)
            size = _amplitude(event.design, error[event.rows], within[:, :0])
        if size is None:
            continue
        peak = signal[np.argmax(np.abs(signal))]
        edges, wild = (event.start, event.stop), int((~sound).sum())
        cut.append((*edges, event.branch, place, peak, *size, wild, False))
    if windows and not cut:
        raise FitError(without_level(len(windows), len(windows), form))
    if not cut:
        msg = (
            f"no acceleration of the master reaches {100 * _LEAST:.0f} % of "
            f"{form.acceleration:g} mm/s² or {form.deceleration:g} mm/s² for {_ROWS} rows: "
            "nothing to fit."
        )
        raise FitError(msg)
    return Events(*map(np.array, zip(*cut, strict=True)))


def without_level(count: int, total: int, form: Crosstalk) -> str:
    """Return words for so many accelerations of all that cannot be told from the level."""
    return (
        f"{count} of {total} accelerations of {form.master} go straight into others, or lack"
        f" readings of {form.axis} beside them: the error of {form.axis} that they cause cannot be"
        f" told from its level. Let {form.master} rest or cruise between any two accelerations, as"
        " long as each of them lasts."
    )


def count_cut(data: JointData, form: Crosstalk) -> int:
    """Return how many events a log has, with those that cannot be told from the level."""
    return sum(1 for _ in _windows(data, form))


@dataclasses.dataclass(frozen=True)
class _Window:
    """An event, and as much of its log on both sides.

    Attributes:
        start: First row of the event.
        stop: Row after the last.
        branch: Row of `BRANCHES`.
        share: Share of the specified acceleration in each of them.
        rows: Those of the window in which the slave was read.
        design: What they may show: an amplitude of each event in them, this one first, then
            level and drift.
    """

    start: int
    stop: int
    branch: int
    share: Float[np.ndarray, " e"]
    rows: Int[np.ndarray, " w"]
    design: Float[np.ndarray, "w c"]

    @property
    def has_level(self) -> bool:
        """Whether the amplitude of the event can be told from the level of the error.

        Where events go straight into others only their edges tell it. There a filter has
        smeared the acceleration and not the error, which makes the amplitude a third too small.
        """
        normal = self.design.T @ self.design
        if np.linalg.matrix_rank(self.design, 1.0 / _BLIND) < len(normal):
            return False
        return bool(np.linalg.inv(normal)[0, 0] * normal[0, 0] < _LEVELLED)


def _windows(data: JointData, form: Crosstalk) -> Iterator[_Window]:
    """Yield the events of a log that are strong and long enough."""
    share, label = _shares_of(data, form)
    log, time, error = logs_of(data), data.clock_for(form.name), data.error[form.axis]
    strong = [
        rows
        for rows in _stretches(label, log)
        if label[rows[0]] >= 0 and share[slice(*rows)].max() >= _LEAST
    ]
    lobes = _lobes(share, label, log, strong)
    acceleration = form.columns_of(data)[0]
    impulse, owner = share.copy(), label.copy()
    for (start, stop), around in zip(strong, lobes, strict=True):
        peak = start + int(np.argmax(share[start:stop]))
        impulse[around] = acceleration[around] * (share[peak] / acceleration[peak])
        owner[around] = label[start]
    for (start, stop), around in zip(strong, lobes, strict=True):
        length = stop - start
        rows = np.arange(max(start - length, 0), min(stop + length, len(share)))
        rows = rows[(log[rows] == log[start]) & np.isfinite(error[rows])]
        if ((rows >= start) & (rows < stop)).sum() < _ROWS:
            continue
        event = (rows >= around.start) & (rows < around.stop)
        others = [~event & (owner[rows] == branch) for branch in range(len(BRANCHES))]
        others = [other for other in others if other.sum() >= _ROWS]
        events = np.stack([event, *others], axis=1)
        keep = events.any(axis=1) | (owner[rows] < 0)
        rows, events = rows[keep], events[keep]
        clock = time[rows] - time[rows].mean()
        clock /= max(float(np.abs(clock).max()), 1e-300)
        design = np.column_stack(
            [events * impulse[rows, None], np.ones(len(rows)), clock]
        )
        shares = share[start:stop]
        yield _Window(start, stop, int(label[start]), shares, rows, design)


def _lobes(
    share: Float[np.ndarray, " t"],
    label: Int[np.ndarray, " t"],
    log: Int[np.ndarray, " t"],
    events: Sequence[tuple[int, int]],
) -> list[slice]:
    """Return the rows of each event with those around it in which a filter of it rings.

    A filter keeps the impulse only together with these: the event alone has too much of it.

    Args:
        share: Of the specified acceleration.
        label: Row of `BRANCHES`, −1 where the master does not accelerate.
        log: Number of the log.
        events: First row and row after the last, in their order.
    """
    starts, stops = np.transpose(_stretches(label, log))
    top = np.repeat(np.maximum.reduceat(share, starts), stops - starts) * (label >= 0)
    # An event reaches as far as half of its length, and half of the way to the next one.
    edges = np.array([0, *np.ravel(events), len(share)]).reshape(-1, 2)
    halves = (edges[:, 1] - edges[:, 0] + 1) // 2
    around = []
    spans = zip(events, halves[:-1], halves[1:], strict=True)
    for (start, stop), before, behind in spans:
        reach, peak = (stop - start) // 2, float(share[start:stop].max())
        # The nearest row first, while no stretch is too high.
        fore = np.arange(start - 1, start - 1 - min(reach, int(before)), -1)
        aft = np.arange(stop, stop + min(reach, int(behind)))
        rings = []
        for rows in (fore, aft):
            height = np.where(log[rows] == log[start], top[rows], np.inf) / peak
            free = np.logical_and.accumulate(height <= _LOBE)
            ringing = np.flatnonzero(free & (share[rows] / peak > _SILENT))
            rings.append(int(ringing[-1]) + 1 if ringing.size else 0)
        around.append(slice(start - rings[0], stop + rings[1]))
    return around


def _shares_of(
    data: JointData, form: Crosstalk
) -> tuple[Float[np.ndarray, " t"], Int[np.ndarray, " t"]]:
    """Return the share of the specified acceleration in each row, and its row of `BRANCHES`.

    That is −1 where the master does not accelerate.
    """
    # An event tells its size by all of its impulse. Held above the specified acceleration, a
    # filtered one would lose where it overshoots, and keep where it falls short.
    rules = dataclasses.replace(form.rules, crosstalk_above="line")
    everywhere = dataclasses.replace(
        form, adaptation=(), positions=None, velocity_dependent=True, conventions=rules
    )
    model = everywhere.to_model(np.zeros((4, 1)), 1.0)
    stencil = model.stencil(*map(filled, everywhere.columns_of(directed(data, form))))
    share = np.asarray(stencil.weights)[: len(data)].sum(axis=1)
    branch = np.asarray(stencil.nodes)[: len(data), 0].astype(np.int64)
    return share, np.where(share < _QUIET, -1, branch)


def held_shares(
    data: JointData, form: Crosstalk, events: Events
) -> Float[np.ndarray, " n"]:
    """Return which part of each event a controller takes off that holds at full acceleration.

    By all of its rows: a spike of a noisy acceleration is a small part of them.
    """
    share, _ = _shares_of(data, form)
    held = share * np.minimum(share, 1.0)
    pairs = zip(events.start, events.stop, strict=True)
    return np.array([held[a:b].sum() / np.square(share[a:b]).sum() for a, b in pairs])


def _stretches(*labels: np.ndarray) -> list[tuple[int, int]]:
    """Return first row and row after the last of each stretch in which no label changes."""
    changed = np.any([np.diff(label) != 0 for label in labels], axis=0)
    edges = (np.flatnonzero(changed) + 1).tolist()
    return list(zip([0, *edges], [*edges, len(labels[0])], strict=True))


def _sound(
    design: Float[np.ndarray, "w c"], error: Float[np.ndarray, " w"]
) -> Bool[np.ndarray, " w"]:
    """Return which readings of a window are not wild; one of them would spoil its event.

    A reading between the least and the largest of an event never is: a filter smears the
    acceleration there.
    """
    solution = np.linalg.lstsq(design, error, rcond=None)[0]
    residual = np.abs(error - design @ solution)
    limit = _FAR * float(np.median(residual))
    if residual.max(initial=0.0) <= limit:
        return np.ones(len(residual), bool)
    found = regress(design, error, noise=0.0)
    # Without noise the robust one may take the whole event for wild.
    fitted = np.concatenate([design @ solution, design @ found.coefficients])
    beyond = np.abs(error - np.clip(error, fitted.min(), fitted.max()))
    return np.asarray(~(found.wild & (beyond > limit)))


def _amplitude(
    design: Float[np.ndarray, "w c"],
    error: Float[np.ndarray, " w"],
    within: Float[np.ndarray, "w k"],
) -> tuple[float, float] | None:
    """Return the size of an event at its place, and its deviation; None where it is open.

    Its size, and that of others nearby, may change as the place does (``within``, in mm from
    the place of the event).

    Least squares make the factor too large where a filter has smeared the acceleration but not
    the error, and too small where the acceleration is noisy. What a filter keeps is the
    impulse: sums over each event, instead of products with its shares, are the instruments
    that hit the factor all the same (A. Wald, Ann. Math. Stat. 11, 1940). Where the master
    accelerates all the time they tell no level, and least squares have to do: by the shape of
    the accelerations, which must not be that of their edges alone (`_Window.has_level`).
    """
    events, level = design[:, :-2], design[:, -2:]
    shown = events != 0
    ways = (shown[:, :, None] * within[:, None, :]).reshape(len(error), -1)
    sizes = np.repeat(events, within.shape[1], axis=1)
    design = np.hstack([events, sizes * ways, level])
    impulses = np.hstack([shown, ways, level])
    freedom = len(error) - design.shape[1]
    if freedom <= 0 or np.linalg.matrix_rank(design, 1.0 / _BLIND) < design.shape[1]:
        return None
    solutions = []
    for instruments in (design, impulses):
        matrix = instruments.T @ design
        if np.linalg.cond(matrix) > _BLIND**2:
            continue
        inverse = np.linalg.inv(matrix)
        residual = error - design @ (inverse @ (instruments.T @ error))
        row, square = instruments @ inverse[0], float(residual @ residual) / freedom
        solutions.append((float(row @ row), float(row @ error), square))
    if len(solutions) == 2 and solutions[1][0] <= _DEARER * solutions[0][0]:
        solutions = solutions[1:]
    if not solutions or solutions[0][0] > _BLIND:
        return None
    variance, value, square = solutions[0]
    return value, math.sqrt(max(square * variance, 1e-18))


def without_delay(data: JointData, form: Crosstalk) -> tuple[JointData, float]:
    """Return a log whose error is not late, and by how many s it was; 0 if that is not seen.

    The residuals of all events together say how far the error is to be moved. This is the
    delay of an error that was recorded as such, beside a slave that stands still; that of an
    instrument against the encoder of the same axis is taken off before any fit.
    """
    windows, error = [*_windows(data, form)], data.error[form.axis]
    step = float(np.median(np.diff(data.clock_for(form.name))))
    reach = min(math.ceil(_FARTHEST / step), _MOST_ROWS)
    lags = np.arange(-reach, reach + 1)
    # The log with as many missing rows before and after it as the error is moved by.
    padded = np.pad(error, reach, constant_values=np.nan)
    cost, count = np.zeros(len(lags)), 0
    for window in windows[:: max(-(-len(windows) // _MOST_EVENTS), 1)]:
        shifted = padded[window.rows[:, None] + reach + lags]
        finite = np.isfinite(shifted).all(axis=1)
        shifted, design = shifted[finite], window.design[finite]
        if len(shifted) > 2 * design.shape[1]:
            base, _ = np.linalg.qr(design)
            residual = shifted - base @ (base.T @ shifted)
            spread = np.maximum((residual**2).mean(axis=0), 1e-24)
            # A contradicting event has large residuals whatever the delay.
            cost += 0.5 * len(shifted) * np.log(spread)
            count += len(shifted)
    lag = int(lags[np.argmin(cost)])
    # Mean fall of the logarithm of the standard deviation.
    if not lag or cost[reach] - cost.min() <= _GAIN * count:
        return data, 0.0
    aligned = padded[reach + lag :][: len(error)]
    return dataclasses.replace(data, error={form.axis: aligned}), lag * step


def without_jump(data: JointData, form: Crosstalk) -> tuple[JointData, float]:
    """Return a log without what its error jumps by where the master turns, and how far, in mm.

    Told by what changes from one stretch without acceleration to the next, beside speed and place
    of the master, and a drift; 0 where none shows. Starts after a turn would hold it.
    """
    time, error = data.clock_for(form.name), data.error[form.axis]
    speed = np.nan_to_num(data.velocity[form.master])
    place, log = gone_by(data, form), logs_of(data)
    way = travel_direction(place).astype(float)
    # Whence it came before that nobody recorded.
    moved = np.abs(speed) > _STANDS * float(np.abs(speed).max(initial=0.0))
    still = np.maximum.accumulate(moved) & (_shares_of(data, form)[1] < 0)
    still &= np.isfinite(error)
    stretches = [ends for ends in _stretches(still, way, log) if still[ends[0]]]
    halves = []
    # What a slave rings by after an acceleration fades: its first half holds more of it.
    for first, last in ((0.0, 0.5), (0.5, 1.0)):
        pieces = [
            slice(a + int(first * (b - a)), a + max(int(last * (b - a)), 1))
            for a, b in stretches
        ]
        means = [
            [column[rows].mean() for column in (error, way, speed, place, time)]
            for rows in pieces
        ]
        change = np.diff(np.reshape(means, (-1, 5)), axis=0)
        free, (turns, faster) = len(change) - 4, change[:, 1:3].T
        alike = float(turns @ faster) ** 2 > _ONE_SPEED * (turns @ turns) * (
            faster @ faster
        )
        if free < 1 or alike:
            return data, 0.0
        try:
            found = regress(change[:, 1:], change[:, 0])
        except FitError:  # it never turned
            return data, 0.0
        half, deviation = float(found.coefficients[0]), np.sqrt(found.covariance[0, 0])
        if not abs(half) > stdtrit(free, 1.0 - _BY_CHANCE) * deviation:
            return data, 0.0
        halves.append(half)
    half = float(np.mean(halves))
    if np.ptp(halves) > _FADES * abs(half):
        return data, 0.0
    straight = dataclasses.replace(data, error={form.axis: error - half * way})
    return straight, 2.0 * half


def from_place(
    data: JointData, form: Crosstalk, events: Events
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Return the slope of the error over the master, and what of each event is its doing, in mm.

    The slope is that of the readings in which the master does not accelerate, beside a drift;
    0 where it is no large part of what changes there.
    """
    place, error = gone_by(data, form), data.error[form.axis]
    time = data.clock_for(form.name)
    rest = (_shares_of(data, form)[1] < 0) & np.isfinite(error)
    nothing = 0.0, np.zeros(len(events))
    if rest.sum() < _ROWS * len(events):
        return nothing
    level = np.vander((time - time[0]) / max(time[-1] - time[0], 1e-300), 2)
    base, _ = np.linalg.qr(level[rest])
    seen, way = (each - base @ (base.T @ each) for each in (error[rest], place[rest]))
    found = regress(way[:, None], seen, noise=0.0)
    slope, sound = float(found.coefficients[0]), ~np.asarray(found.wild)
    left = np.var(seen[sound] - slope * way[sound])
    if left > (1.0 - _BY_PLACE) * np.var(seen[sound]):
        return nothing
    made = cut_events(
        dataclasses.replace(data, error={form.axis: slope * place + 0.0 * error}), form
    )
    rows = np.searchsorted(made.start, events.start)
    return slope, made.value[np.minimum(rows, len(made) - 1)]


def follows_speed(data: JointData, aligned: JointData, form: Crosstalk) -> bool:
    """Return whether an error follows the speed of the master better than its acceleration.

    That is no crosstalk: the slave lags behind its command, or its instrument is late. By the log
    as recorded, and as aligned: the delay of the error taken off.
    """
    velocity, cost = form.columns_of(data)[1], 0.0
    # Where the error was moved a window may have lost too many of its rows.
    moved = {window.start: window for window in _windows(aligned, form)}
    pairs = []
    for window in (each for each in _windows(data, form) if each.start in moved):
        level, _ = np.linalg.qr(window.design[:, -2:])
        columns = np.stack([velocity, data.error[form.axis]], axis=1)[window.rows]
        speed, error = (columns - level @ (level.T @ columns)).T
        pairs.append((speed, error, moved[window.start]))
    slopes = [speed @ error / max(speed @ speed, 1e-300) for speed, error, _ in pairs]
    for speed, error, window in pairs:
        base, _ = np.linalg.qr(window.design)
        late = aligned.error[form.axis][window.rows]
        left = error - float(np.median(slopes)) * speed, late - base @ (base.T @ late)
        spreads = [max(float(np.mean(each**2)), 1e-24) for each in left]
        cost += len(error) * float(np.log(spreads[0] / spreads[1]))
    return cost < 0.0

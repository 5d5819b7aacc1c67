"""Acceleration events cut out of a log, each reduced to one value."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ....models import Conventions, Crosstalk, surface_through
from ...core import FitError, filled
from ._types import BRANCHES, CrosstalkReadings, Event

_LEAST = 0.3
"""Share of the specified acceleration that an event reaches."""
_QUIET = 0.02
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


def specified(
    readings: CrosstalkReadings, acceleration: float | None, deceleration: float | None
) -> tuple[float, float]:
    """Return the accelerations that the entries stand for, in mm/s²: given, or as measured.

    Raises:
        FitError: If a given one has the wrong sign or the master never accelerates so.
    """
    result = []
    for sign, given, word in (
        (1.0, acceleration, "acceleration"),
        (-1.0, deceleration, "deceleration"),
    ):
        if given is not None:
            if not sign * given > 0:
                wanted = "above" if sign > 0 else "below"
                msg = f"{word}: found {given:g} mm/s², expected a number {wanted} 0."
                raise FitError(msg)
            result.append(float(given))
            continue
        values = sign * readings.acceleration
        top = float(values.max())
        if not top > 0:
            msg = f"the master shows no {word} at all, expected events of both signs."
            raise FitError(msg)
        # What the master reaches again and again, not its largest jerk; a list has integers.
        result.append(
            sign * math.ceil(float(np.quantile(values[values > 0.5 * top], 0.5)))
        )
    return result[0], result[1]


def cut_events(
    readings: CrosstalkReadings,
    acceleration: float,
    deceleration: float,
    *,
    conventions: Conventions | None = None,
) -> tuple[Event, ...]:
    r"""Return the acceleration events of a log, one value each.

    An event is a stretch of one sign and direction that reaches a share of the specified
    acceleration. Over it and as much of the log on both sides,
    $e = A\,\mathrm{share}(t) + b + c\,t$ (and other events nearby) is solved: what stands still
    or drifts beside the acceleration is no crosstalk. Its place is the mean of the positions
    with the weights of the readings.

    Args:
        readings: Log of master and slave.
        acceleration: Specified, in mm/s², positive.
        deceleration: Specified, in mm/s², negative.
        conventions: How signs and directions are defined; None = the defaults.

    Raises:
        FitError: If rows are not finite or there is no event.
    """
    rules = Conventions() if conventions is None else conventions
    for name in ("time", "acceleration", "velocity", "positions"):
        bad = ~np.isfinite(getattr(readings, name).reshape(len(readings.time), -1))
        if bad.any():
            row = int(np.flatnonzero(bad.any(axis=1))[0])
            msg = f"reading {row + 1}: {name} is not finite, expected numbers."
            raise FitError(msg)
    branch, share, edge = _shares(readings, acceleration, deceleration, rules)
    quiet = share < _QUIET
    known = np.isfinite(readings.error) & (quiet | ~edge)
    # One number per stretch: −1 where quiet, else the branch.
    label = np.where(quiet, -1, branch)
    found = []
    for start, stop in _stretches(label):
        if label[start] < 0 or share[start:stop].max() < _LEAST:
            continue
        if known[start:stop].sum() < _ROWS:
            continue
        event = _event(readings, label, share, known, start, stop)
        if event is not None:
            found.append(event)
    if not found:
        msg = (
            f"no acceleration of the master reaches {100 * _LEAST:.0f} % of "
            f"{acceleration:g} mm/s² or {deceleration:g} mm/s² for {_ROWS} rows: nothing "
            "to fit."
        )
        raise FitError(msg)
    return tuple(found)


def _shares(
    readings: CrosstalkReadings,
    acceleration: float,
    deceleration: float,
    conventions: Conventions,
) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
    """Return row of `BRANCHES`, share of the specified acceleration, and edges per reading.

    Row and share are those of the controller's own rule (`Crosstalk.stencil`), with the
    direction of the motion that an acceleration belongs to: a filter smears it over the
    standstill before and after, where the velocity has none. In these edges it is open what
    the controller does.
    """
    model = Crosstalk(
        surface_through(np.zeros((1, 0))), jnp.zeros((4, 1)),
        jnp.asarray(acceleration), jnp.asarray(deceleration),
        by_speed=conventions.crosstalk_accelerate == "speed",
        rest_direction=conventions.crosstalk_rest,
        held_above=conventions.crosstalk_above == "hold",
    )  # fmt: skip
    velocity = _moving(readings.acceleration, readings.velocity, model)
    count = len(velocity)
    rows, parts = filled(readings.acceleration), []
    for way in (velocity, readings.velocity):
        stencil = model.stencil(rows, filled(way))
        parts.append(
            (np.asarray(stencil.nodes)[:count, 0], np.asarray(stencil.weights)[:count])
        )
    (branch, weight), (as_it_stands, _) = parts
    return branch.astype(np.int64), weight.sum(axis=1), as_it_stands != branch


def _moving(
    acceleration: Float[np.ndarray, " t"],
    velocity: Float[np.ndarray, " t"],
    model: Crosstalk,
) -> Float[np.ndarray, " t"]:
    """Return the velocity with one direction per acceleration, or two where it turns."""
    result = velocity.copy()
    full = np.where(acceleration < 0, -model.deceleration, model.acceleration)
    share = np.abs(acceleration) / full
    sign = np.where(share < _QUIET, 0, np.sign(acceleration)).astype(np.int64)
    for start, stop in _stretches(sign):
        if sign[start] == 0:
            continue
        rows = slice(start, stop)
        way, push = np.sign(velocity[rows]), share[rows]
        forward, back = float(push[way > 0].sum()), float(push[way < 0].sum())
        if forward == back:
            continue
        turn, lead = stop - start, 1.0 if forward > back else -1.0
        if min(forward, back) >= _TURN * float(push.sum()):
            # The master turns: one direction before, the other one after.
            lead = -float(sign[start])
            wrong = np.cumsum(push * way * lead)
            turn = 1 + int(np.argmax(wrong))
        order = np.where(np.arange(stop - start) < turn, lead, -lead)
        result[rows] = order * np.maximum(np.abs(velocity[rows]), _LEAST_SPEED)
    return result


def _stretches(label: Int[np.ndarray, " t"]) -> list[tuple[int, int]]:
    """Return first row and row after the last of each stretch of equal labels."""
    edges = (np.flatnonzero(np.diff(label)) + 1).tolist()
    return list(zip([0, *edges], [*edges, len(label)], strict=True))


def _event(
    readings: CrosstalkReadings,
    label: Int[np.ndarray, " t"],
    share: Float[np.ndarray, " t"],
    known: Bool[np.ndarray, " t"],
    start: int,
    stop: int,
) -> Event | None:
    """Return the event of a stretch; None where what lies beside it does not tell it."""
    length = stop - start
    window = np.arange(max(start - length, 0), min(stop + length, len(share)))
    window = window[known[window]]
    own = (window >= start) & (window < stop)
    columns = [np.where(own, share[window], 0.0)]
    keep = np.ones(len(window), bool)
    for other in range(len(BRANCHES)):
        beside = ~own & (label[window] == other)
        if beside.sum() >= _ROWS:
            columns.append(np.where(beside, share[window], 0.0))
        else:
            keep &= ~beside
    clock = readings.time[window] - readings.time[window[keep]].mean()
    span = max(float(np.abs(clock[keep]).max()), 1e-300)
    design = np.column_stack([*columns, np.ones(len(window)), clock / span])[keep]
    error = readings.error[window[keep]]
    free = len(error) - design.shape[1]
    if free <= 0:
        return None
    solved, _, rank, _ = np.linalg.lstsq(design, error, rcond=1.0 / _BLIND)
    if rank < design.shape[1]:
        # Steady acceleration all along with nothing beside it: level and crosstalk are one.
        return None
    unit_variance = float(np.linalg.inv(design.T @ design)[0, 0])
    if unit_variance > _BLIND:
        return None
    left = error - design @ solved
    rows = slice(start, stop)
    weight = share[rows] ** 2
    place = weight @ readings.positions[rows] / weight.sum()
    at = start + int(np.argmax(np.abs(readings.acceleration[rows])))
    return Event(
        start, stop, int(label[start]), tuple(float(each) for each in place),
        float(readings.acceleration[at]), float(solved[0]),
        math.sqrt(max(float(left @ left) / free * unit_variance, 1e-18)),
    )  # fmt: skip

"""Acceleration events cut out of a log, each reduced to one value."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ....models import Conventions, Crosstalk, surface_through
from ...core._errors import FitError
from ._types import BRANCHES, CrosstalkReadings, Event

_QUIET = 0.02
"""Share of the specified acceleration up to which the master does not accelerate."""
_ROWS = 4
"""Rows of an event at least."""
_BLIND = 1e6
"""Variance of an event, relative to one reading, from which on it says nothing."""


def shares_of(
    readings: CrosstalkReadings,
    acceleration: float,
    deceleration: float,
    conventions: Conventions,
) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Return the row of `BRANCHES` and the share of the specified acceleration per reading.

    Both are those of the controller's own rule (`Crosstalk.stencil`).
    """
    model = Crosstalk(
        surface_through(np.zeros((1, 0))), jnp.zeros((4, 1)),
        jnp.asarray(acceleration), jnp.asarray(deceleration),
        by_speed=conventions.crosstalk_accelerate == "speed",
        rest_direction=conventions.crosstalk_rest,
        held_above=conventions.crosstalk_above == "hold",
    )  # fmt: skip
    stencil = model.stencil(readings.acceleration, readings.velocity)
    branch = np.asarray(stencil.nodes)[:, 0].astype(np.int64)
    return branch, np.asarray(stencil.weights).sum(axis=1)


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
    least: float = 0.3,
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
        least: Share of the specified acceleration that an event reaches.
        conventions: How signs and directions are told apart; None = the defaults.

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
    branch, share = shares_of(readings, acceleration, deceleration, rules)
    quiet = share < _QUIET
    known = np.isfinite(readings.error)
    # One number per stretch: −1 where quiet, else the branch.
    label = np.where(quiet, -1, branch)
    edges = np.flatnonzero(np.diff(label)) + 1
    starts = np.concatenate([[0], edges])
    stops = np.concatenate([edges, [len(label)]])
    found = []
    for start, stop in zip(starts, stops, strict=True):
        if label[start] < 0 or share[start:stop].max() < least:
            continue
        if known[start:stop].sum() < _ROWS:
            continue
        event = _event(readings, branch, share, quiet, known, int(start), int(stop))
        if event is not None:
            found.append(event)
    if not found:
        msg = (
            f"no acceleration of the master reaches {100 * least:.0f} % of "
            f"{acceleration:g} mm/s² or {deceleration:g} mm/s² for {_ROWS} rows: nothing "
            "to fit."
        )
        raise FitError(msg)
    return tuple(found)


def _event(
    readings: CrosstalkReadings,
    branch: Int[np.ndarray, " t"],
    share: Float[np.ndarray, " t"],
    quiet: Bool[np.ndarray, " t"],
    known: Bool[np.ndarray, " t"],
    start: int,
    stop: int,
) -> Event | None:
    length = stop - start
    window = np.arange(max(start - length, 0), min(stop + length, len(share)))
    window = window[known[window]]
    own = (window >= start) & (window < stop)
    columns = [np.where(own, share[window], 0.0)]
    for other in range(len(BRANCHES)):
        beside = ~own & ~quiet[window] & (branch[window] == other)
        if beside.sum() >= _ROWS:
            columns.append(np.where(beside, share[window], 0.0))
        elif beside.any():
            keep = ~beside
            window, own = window[keep], own[keep]
            columns = [column[keep] for column in columns]
    clock = readings.time[window] - readings.time[window].mean()
    span = max(float(np.abs(clock).max()), 1e-300)
    columns += [np.ones(len(window)), clock / span]
    design = np.column_stack(columns)
    if len(window) <= design.shape[1]:
        return None
    normal = design.T @ design
    if np.linalg.cond(normal) > _BLIND**2:
        # Steady acceleration all along with nothing beside it: level and crosstalk are one.
        return None
    inverse = np.linalg.inv(normal)
    if inverse[0, 0] > _BLIND:
        return None
    solved = inverse @ (design.T @ readings.error[window])
    left = readings.error[window] - design @ solved
    free = len(window) - design.shape[1]
    variance = float(left @ left) / free * float(inverse[0, 0])
    rows = slice(start, stop)
    weight = share[rows] ** 2
    place = weight @ readings.positions[rows] / weight.sum()
    at = start + int(np.argmax(np.abs(readings.acceleration[rows])))
    return Event(
        start, stop, int(branch[start]), tuple(float(each) for each in place),
        float(readings.acceleration[at]), float(solved[0]),
        math.sqrt(max(variance, 1e-18)),
    )  # fmt: skip

"""The four entries of a test: which motion each stands for, and what they may do."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ....models import Conventions, Crosstalk, LegacyCrosstalk
from ...proof import GateCheck, GateLimits, gate_check, reversal_dynamics
from .effect import CrosstalkReadings, cut_events

SHORT = ("accelerating +", "accelerating −", "decelerating +", "decelerating −")
"""Words for the rows of `Crosstalk.values`: what the master does, and its direction."""


def four_offsets(
    model: Crosstalk | LegacyCrosstalk,
    rates: tuple[float, float],
    by_speed: bool,
    points: Float[np.ndarray, "p k"],
) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at each place, by row of the entries.

    Args:
        model: The list.
        rates: Specified acceleration and deceleration in mm/s².
        by_speed: Rule by which the controller tells one from the other.
        points: Places of the adaptation axes in mm.
    """
    velocity = np.array([1.0, -1.0, 1.0, -1.0])
    pull = np.repeat(rates, 2) * (velocity if by_speed else 1.0)
    every = np.tile(points, (4, 1))
    count = len(points)
    added = model.offset(np.repeat(pull, count), np.repeat(velocity, count), every)
    return np.asarray(added).reshape(4, count)


def rates_of(model: Crosstalk) -> tuple[float, float]:
    """Return specified acceleration and deceleration of a list in mm/s²."""
    return float(model.acceleration), float(model.deceleration)


def full_offsets(model: Crosstalk) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at its tests, by row of the entries."""
    points = np.asarray(model.surface.points, dtype=float)
    return four_offsets(model, rates_of(model), model.by_speed, points)


def reversal_jumps(
    four: Float[np.ndarray, "4 p"], by_speed: bool
) -> Float[np.ndarray, "2 p"]:
    """Return how far the value jumps where the master turns under full acceleration."""
    # A turn keeps the sign of the acceleration and changes the direction.
    pairs = ((0, 3), (2, 1)) if by_speed else ((0, 1), (2, 3))
    return np.stack([np.abs(four[a] - four[b]) for a, b in pairs])


def largest_jump(four: Float[np.ndarray, "4 p"], by_speed: bool) -> float:
    """Return the largest jump in mm when the master's acceleration steps at will."""
    braking = np.abs(four[[0, 1]] - four[[2, 3]])
    sizes = [np.abs(four), braking, reversal_jumps(four, by_speed)]
    return max(float(each.max(initial=0.0)) for each in sizes)


def events_under(
    readings: CrosstalkReadings,
    added: Float[np.ndarray, " t"],
    acceleration: float,
    deceleration: float,
    rules: Conventions,
) -> Float[np.ndarray, " n"]:
    """Return the value of every event in mm where a list adds this to the slave."""
    left = CrosstalkReadings(
        readings.time, readings.acceleration, readings.velocity,
        readings.error + added, readings.positions,
    )  # fmt: skip
    events = cut_events(left, acceleration, deceleration, conventions=rules)
    return np.array([event.value for event in events])


_STEPS = 60
"""Places along each adaptation axis at which the surface is looked at."""


def judge_crosstalk(
    model: Crosstalk,
    names: Sequence[str],
    cycle_time: float,
    limits: GateLimits,
    change: np.ndarray | None,
) -> tuple[GateCheck, ...]:
    """Return every line of the gate.

    Args:
        model: As it is written.
        names: Of its adaptation axes.
        cycle_time: In s.
        limits: Of the job.
        change: Against the list that was there, by entry, in mm; None = not known.
    """
    points = np.asarray(model.surface.points)
    full = full_offsets(model)
    row, test = divmod(int(np.argmax(np.abs(full))), full.shape[1])
    where = f"{SHORT[row]}{_at(names, points[test])}"
    checks = [
        gate_check(
            "max_correction", abs(full[row, test]), limits.max_correction, "mm", where
        )
    ]
    turns = reversal_jumps(full, model.by_speed)
    test = int(np.argmax(turns.max(axis=0)))
    where = f"where the master turns under full acceleration{_at(names, points[test])}"
    checks.append(
        gate_check("max_reversal", turns.max(), limits.max_reversal, "mm", where)
    )
    jump = largest_jump(full, model.by_speed)
    fast, hard = reversal_dynamics(jump, model.cycles, cycle_time)
    where = (
        f"if the acceleration of the master steps, spread over {model.cycles} cycles"
    )
    checks += [
        gate_check("max_velocity", fast, limits.max_velocity, "mm/s", where),
        gate_check("max_acceleration", hard, limits.max_acceleration, "mm/s²", where),
    ]
    if names:
        checks += _along(model, names, points, limits)
    if change is not None and limits.max_change is not None:
        value = float(np.max(np.abs(change)))
        words = "against the list that was there"
        checks.append(gate_check("max_change", value, limits.max_change, "mm", words))
    return tuple(checks)


def _along(
    model: Crosstalk, names: Sequence[str], points: np.ndarray, limits: GateLimits
) -> list[GateCheck]:
    """Return what moving along the adaptation axes under full acceleration does."""
    lines = [
        np.linspace(low, high, _STEPS + 1)
        for low, high in zip(points.min(axis=0), points.max(axis=0), strict=True)
    ]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    places = grid.reshape(-1, len(names))
    four = four_offsets(model, rates_of(model), model.by_speed, places)
    four = four.reshape(4, *grid.shape[:-1])
    steepest, along = 0.0, names[0]
    for axis, (name, line) in enumerate(zip(names, lines, strict=True), start=1):
        step = float(line[1] - line[0])
        if step > 0:
            slope = float(np.max(np.abs(np.diff(four, axis=axis)))) / step
            steepest, along = max((steepest, along), (slope, name))
    where = f"along {along} under full acceleration"
    added = steepest * limits.feed / 60.0
    return [
        gate_check("max_slope", 1e3 * steepest, limits.max_slope, "µm/mm", where),
        gate_check(
            "max_velocity by position", added, limits.max_velocity, "mm/s", where
        ),
    ]


def _at(names: Sequence[str], place: np.ndarray) -> str:
    words = [f"{name} = {value:g}" for name, value in zip(names, place, strict=True)]
    return f" at {', '.join(words)}" if words else ""

"""The four entries of a test: which motion each stands for, and what lies between them."""

import numpy as np
from jaxtyping import Float

from ....models import Conventions, Crosstalk, LegacyCrosstalk
from ...kinds.crosstalk.effect import CrosstalkReadings, cut_events

SHORT = ("accelerating +", "accelerating −", "decelerating +", "decelerating −")
"""Words for the rows of `Crosstalk.values`: what the master does, and its direction."""


def full_motion(
    acceleration: float, deceleration: float, by_speed: bool
) -> tuple[Float[np.ndarray, " 4"], Float[np.ndarray, " 4"]]:
    """Return acceleration in mm/s² and velocity in mm/s at which each entry acts fully."""
    velocity = np.array([1.0, -1.0, 1.0, -1.0])
    sizes = np.array([acceleration, acceleration, deceleration, deceleration])
    return (sizes * velocity if by_speed else sizes), velocity


def four_offsets(
    model: Crosstalk | LegacyCrosstalk,
    acceleration: float,
    deceleration: float,
    by_speed: bool,
    points: Float[np.ndarray, "p k"],
) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at each place, by row of the entries."""
    rows = zip(*full_motion(acceleration, deceleration, by_speed), strict=True)
    count = len(points)
    return np.stack(
        [
            np.asarray(model.offset(np.full(count, a), np.full(count, v), points))
            for a, v in rows
        ]
    )


def full_offsets(model: Crosstalk) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at its tests, by row of the entries."""
    rates = float(model.acceleration), float(model.deceleration)
    points = np.asarray(model.surface.points, dtype=float)
    return four_offsets(model, *rates, model.by_speed, points)


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

"""What a friction list leaves of a recording: foretold from other windows, and as written."""

import numpy as np

from ....data.signals import median
from ...friction import Knots
from ._identify import Identified
from ._listing import LawCurve
from ._recording import DriveRecording
from ._result import WILD, FrictionView


def view_of(
    recording: DriveRecording,
    found: Identified,
    curve: LawCurve | None,
    knots: Knots | None,
    level: float,
) -> FrictionView:
    """Return what a list leaves of a recording.

    Args:
        recording: The recording.
        found: The law.
        curve: The law over the speeds that were driven; None where it is not determined.
        knots: Entries of the list; without them the curve stands for it, at level 1.
        level: Share of the friction that the entries give.
    """
    samples, parameters = recording.samples, found.fit.parameters
    sign, speed = np.sign(samples.velocity), np.abs(samples.velocity)
    push: np.ndarray | float = 0.0
    if samples.acceleration is not None:
        push = samples.acceleration
    left = samples.current - parameters.get("inertia", 0.0) * push
    window, predicted = found.choice.window, np.empty(len(speed))
    full, offset, sound = np.zeros(len(speed)), None, samples.in_motion
    before = left - parameters.get("offset", 0.0)
    if knots is None or curve is None:
        level = 1.0
    if curve is not None:
        if knots is None:
            full = sign * np.interp(speed, curve.speed, curve.mean)
        else:
            full = sign * knots.current(speed) / level
        far = np.abs(left - full - median((left - full)[sound]))
        # What belongs to no list is the mean of what it leaves, without faults.
        sound = sound & (far <= WILD * 1.4826 * median(far[sound]))
        offset = float((left - full)[sound].mean())
        before = left - offset
    for number, each in enumerate(found.without):
        own = window == number
        rest = samples.current - each.inertia * push
        if curve is None:
            given, constant = each.friction(samples.velocity), each.offset
        else:
            given = sign * np.interp(speed, curve.speed, curve.mean_of(each.friction))
            constant = float((rest - given)[sound & ~own].mean())
        predicted[own] = (rest - constant - level * given)[own]
    return FrictionView(
        samples=samples,
        position=recording.commanded,
        window=window,
        offset=offset,
        before=before,
        predicted=predicted,
        listed=level * full,
    )

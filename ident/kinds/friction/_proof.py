"""What a friction list leaves of a recording: foretold from other windows, and as written."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ....data.signals import median
from ...friction import DriveSamples, Knots
from ...proof import ErrorFigures, GateCheck, error_figures, gate_check
from ._identify import Identified
from ._listing import DrivenSpeeds, without_inertia
from ._result import LawCurve

_WILD = 7.0
"""Standard deviations beyond which a sample of the current is a fault."""
_AS_PREDICTED = 1.1
"""Error of the written list relative to that on windows held out, at most."""


@dataclasses.dataclass(frozen=True)
class Remaining:
    """Current with and without a list, sample by sample, in the unit of the recording.

    Attributes:
        offset: Constant load that goes with the list; None where the law is not determined.
        before: Current that friction takes: inertia and constant load taken off.
        predicted: What lists made of the other windows leave of it, at their level.
        listed: Current that the list gives, at its level; 0 where the law is not determined.
        moving: Samples that tell of kinetic friction.
    """

    offset: float | None
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    listed: Float[np.ndarray, " t"]
    moving: Bool[np.ndarray, " t"]

    @property
    def wild(self) -> Bool[np.ndarray, " m"]:
        """Which of the samples in motion lie farther out than noise does."""
        size = np.abs((self.before - self.listed)[self.moving])
        return np.asarray(size > _WILD * 1.4826 * median(size))

    def figures(self, error: Float[np.ndarray, " t"]) -> ErrorFigures:
        """Return the figures of an error over the samples in motion."""
        return error_figures(error[self.moving], wild=self.wild)

    def gate(self, unit: float, name: str) -> GateCheck:
        """Return whether the list leaves what was predicted.

        Args:
            unit: What one unit of the list is: so much may rounding cost.
            name: Of the unit of the current.
        """
        found = self.figures(self.before - self.listed).sound.rms
        limit = _AS_PREDICTED * self.figures(self.predicted).sound.rms + unit
        return gate_check(
            "from_file", found, limit, name, "over all speeds, limit as predicted"
        )


def remaining(
    samples: DriveSamples,
    found: Identified,
    speeds: DrivenSpeeds | None,
    curve: LawCurve | None,
    knots: Knots | None,
    level: float,
) -> Remaining:
    """Return what a list leaves of a recording.

    Args:
        samples: The recording.
        found: The law.
        speeds: Speeds that were driven.
        curve: The law over these; None where it is not determined.
        knots: Entries of the list; without them the curve stands for it, at level 1.
        level: Share of the friction that the entries give.
    """
    fit = found.fit
    sign, speed = np.sign(samples.velocity), np.abs(samples.velocity)
    inertia = fit.parameters.get("inertia", 0.0)
    predicted = np.empty(len(speed))
    if curve is None or speeds is None:
        before = without_inertia(samples, inertia) - fit.parameters.get("offset", 0.0)
        for number, each in enumerate(found.without):
            own = found.window == number
            friction = each.friction(samples.velocity) + each.offset
            predicted[own] = (without_inertia(samples, each.inertia) - friction)[own]
        nothing = np.zeros(len(speed))
        return Remaining(None, before, predicted, nothing, samples.in_motion)
    if knots is None:
        level, full = 1.0, np.interp(speed, curve.speed, curve.mean)
    else:
        full = knots.current(speed) / level
    left = without_inertia(samples, inertia) - sign * full
    middle = median(left[samples.in_motion])
    far = np.abs(left - middle)
    # What belongs to no list is the mean of what it leaves, without faults.
    sound = samples.in_motion & (far <= _WILD * 1.4826 * median(far[samples.in_motion]))
    offset = float(left[sound].mean())
    for number, each in enumerate(found.without):
        own = found.window == number
        mean = sign * np.interp(speed, speeds.speed, speeds.mean(each))
        left = without_inertia(samples, each.inertia)
        rest = float((left - mean)[sound & ~own].mean())
        predicted[own] = (left - rest - level * mean)[own]
    return Remaining(
        offset=offset,
        before=without_inertia(samples, inertia) - offset,
        predicted=predicted,
        listed=level * sign * full,
        moving=samples.in_motion,
    )

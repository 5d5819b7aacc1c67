"""What a friction list can say of a law: the law over the speeds, and what a unit is."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ....data.signals import quantile
from ...friction import DriveSamples, Knots
from ._identify import Identified
from .keys import Spec

_POINTS = 200
_BINS = 60
_ENOUGH = 0.05
"""Samples at a speed, as a share of the mean, at which a direction counts half."""
RATED = {"A": "rated_current", "Nm": "rated_torque", "N": "rated_torque"}
"""Key of the job that says what the rated value is, by unit of the recording."""
FIRST_LEVEL = 0.15
"""Share of the friction that a list gives until the sign of its current is settled: one of
full size with the wrong sign shakes the machine."""


def out_unit(spec: Spec, unit: str) -> float | None:
    """Return what one unit of ``out`` is in the unit of the recording; None: nobody says."""
    if spec.torque_unit is None or unit == "raw":
        return None if spec.torque_unit is None else 1.0
    rated = 100.0 if unit == "%" else getattr(spec, RATED.get(unit, ""), None)
    return None if rated is None else float(rated) * spec.torque_unit


@dataclasses.dataclass(frozen=True)
class LawCurve:
    """The law over the speeds that were driven, and which direction saw them.

    Attributes:
        speed: In mm/s or °/s, ascending, positive.
        weight: Share of the recording at each speed.
        positive_share: How much the positive direction counts in the list, 0 to 1: half
            where both were driven, all where it alone was.
        currents: Moving positive, moving negative (as a positive number), and their mean:
            what a list can say, which knows no direction.
        deviations: Standard deviations of them (`Choice.deviation`).
        without: The mean of laws fitted without each window.
    """

    speed: Float[np.ndarray, " v"]
    weight: Float[np.ndarray, " v"]
    positive_share: Float[np.ndarray, " v"]
    currents: Float[np.ndarray, "3 v"]
    deviations: Float[np.ndarray, "3 v"]
    without: Float[np.ndarray, "v n"]

    @property
    def mean(self) -> Float[np.ndarray, " v"]:
        """What a list can say."""
        return np.asarray(self.currents[2])

    def deviation_of(self, knots: Knots, level: float) -> Float[np.ndarray, " k"]:
        """Return the standard deviations of entries that give a share of the friction.

        What rounding and the straight lines of the list put beside the law is part of them.
        """
        speed = knots.velocity / 1000.0
        law, deviation = (
            level * np.interp(speed, self.speed, curve[2])
            for curve in (self.currents, self.deviations)
        )
        misfit = np.square(knots.out * knots.unit - law)
        misfit = np.maximum(misfit, knots.rms**2)
        return np.asarray(np.sqrt(deviation**2 + misfit))

    @property
    def difference(self) -> float:
        """Mean difference of the directions, as a share of the friction, where both count."""
        overlap = self.weight * 4.0 * self.positive_share * (1.0 - self.positive_share)
        difference = float(overlap @ np.abs(self.currents[0] - self.currents[1]))
        return difference / max(float(overlap @ np.abs(self.mean)), 1e-300)


def law_curve(result: Identified, samples: DriveSamples) -> LawCurve | None:
    """Return the law over the speeds that were driven.

    None where it is not determined, one direction was never driven, or nothing moved.
    """
    velocity, fit = samples.velocity[samples.in_motion], result.fit
    driven = [np.sort(sign * velocity[sign * velocity > 0]) for sign in (1, -1)]
    if not fit.has_law or any(len(speeds) == 0 for speeds in driven):
        return None
    low = max(quantile(np.abs(velocity), 0.001), 1e-3)
    high = max(speeds[-1] for speeds in driven)
    if high <= low:
        return None  # no speed stands above the slowest that counts
    half = _POINTS // 2
    grids = np.geomspace(low, high, half), np.linspace(low, high, half)
    speed = np.unique(np.concatenate(grids))
    # What is slower or faster than all speeds counts with the first and the last.
    edges = np.geomspace(low, high * (1 + 1e-9), _BINS + 1)
    every = [np.clip(values, low, high) for values in (*driven, speed)]
    *counted, points = (np.histogram(values, edges)[0] for values in every)
    counts = np.stack(counted)
    weight = np.repeat(counts.sum(axis=0) / np.maximum(points, 1), points)
    # Two directions that both saw a speed well count alike, however often they did.
    enough = _ENOUGH * counts.sum() / _BINS
    confidence = counts / (counts + enough)
    covered = confidence.sum(axis=0) > 0
    share = confidence[0, covered] / confidence[:, covered].sum(axis=0)
    middle = np.log(np.sqrt(edges[1:] * edges[:-1]))[covered]
    share = np.interp(np.log(speed), middle, share)
    # Each direction is held beyond the speeds that were driven so.
    clipped = [np.clip(speed, speeds[0], speeds[-1]) for speeds in driven]
    signed = np.concatenate([clipped[0], -clipped[1]])

    # Where directions saw other speeds, equal levels of both are an extrapolation: that of a
    # table says nothing, that of a law is used while it is known better than both differ.
    alike, sums = np.zeros(len(speed)), fit.friction(signed).reshape(2, -1).sum(axis=0)
    overlap = weight * share * (1.0 - share)
    if fit.structure.directional and overlap.any():
        overlap /= overlap.sum()
        differing = 0.5 * np.sqrt(overlap @ (sums - overlap @ sums) ** 2)
        sd = fit.standard_deviations.get("offset", np.inf)
        if not fit.structure.parametric or sd > differing:
            alike = overlap

    def currents(friction: Float[np.ndarray, "v2 *n"]) -> Float[np.ndarray, "3 v *n"]:
        """Return `LawCurve.currents` of friction at these velocities."""
        forward, backward = np.split(friction, 2)
        load = np.tensordot(alike, 0.5 * (forward + backward), 1)
        forward, backward = forward - load, load - backward
        positive = share.reshape(-1, *[1] * (friction.ndim - 1))
        mean = positive * forward + (1.0 - positive) * backward
        return np.stack([forward, backward, mean])

    return LawCurve(
        speed=speed,
        weight=weight / weight.sum(),
        positive_share=share,
        currents=currents(fit.friction(signed)),
        deviations=result.choice.deviation(fit, result.without, signed, currents),
        without=currents(result.without.friction(signed))[2],
    )

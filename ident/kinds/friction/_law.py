"""From a recording to the law, by windows held out, and to what a list can say of it."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ....data.signals import quantile
from ...core import FitError
from ...friction import (
    Choice,
    DriveSamples,
    FrictionFit,
    OutputErrorFit,
    ReversalFit,
    choose_law,
    fit_output_error,
    fit_reversal,
    friction_of,
    laws_held_out,
)
from ...job.result._result import Remark
from ._recording import DriveRecording
from .keys import Spec

_SAME_CLOCK = 0.01
_POINTS = 200
_BINS = 60
_ENOUGH = 0.05
"""Samples at a speed, as a share of the mean, at which a direction counts half."""


@dataclasses.dataclass(frozen=True)
class Identified:
    """A law and how it was found.

    Attributes:
        choice: Which laws competed on windows held out.
        output: The output-error fit, where it was asked for.
        reversal: What reversals show, where it was asked for and they show it.
        without: Laws fitted without each window in turn.
        remarks: What the user must know of reversals.
    """

    choice: Choice
    output: OutputErrorFit | None
    reversal: ReversalFit | None
    without: tuple[FrictionFit, ...]
    remarks: tuple[Remark, ...]

    @property
    def fit(self) -> FrictionFit:
        """What a list follows: the simplest law, or table, that predicts as well as the best."""
        return self.choice.fit if self.output is None else self.output.friction

    @property
    def law(self) -> FrictionFit:
        """The law in words (Coulomb, Stribeck) that predicts best; `fit` where it is one."""
        return self.choice.law if self.output is None else self.output.friction


def identify(recording: DriveRecording, spec: Spec, cycle_time: float) -> Identified:
    """Find the law of friction in a recording.

    Raises:
        FitError: If the recording does not carry any law.
    """
    samples = recording.samples
    inertia = spec.inertia if isinstance(spec.inertia, float) else None
    loss = spec.loss if "loss" in spec.model_fields_set else "trim"
    reversal, remarks = None, list[Remark]()
    if spec.reversal:
        reversal, remarks = _reversal(recording, inertia, cycle_time)
    if reversal is not None:
        # What is missing around reversals is none of the law's.
        current = samples.current + reversal.missing
        samples = dataclasses.replace(samples, current=current)
    choice = choose_law(samples, inertia=inertia, loss=loss)
    output, without = None, choice.chosen.without
    if spec.method == "output_error":
        # A table cannot be simulated sample by sample; the law in words can.
        kept = tuple(spec.constraints)
        output = fit_output_error(
            choice.law, samples, solver=spec.solver, constraints=kept
        )
        without = laws_held_out(output, choice.window, loss)
    return Identified(choice, output, reversal, without, tuple(remarks))


def _reversal(
    recording: DriveRecording, inertia: float | None, cycle_time: float
) -> tuple[ReversalFit | None, list[Remark]]:
    """Return what reversals show, or a remark that says why nothing does."""
    samples = recording.samples
    if abs(samples.cycle - cycle_time) > _SAME_CLOCK * cycle_time:
        words = (
            f"reversal: the recording has a sample every {1e3 * samples.cycle:g} ms,"
            f" expected one per cycle of {1e3 * cycle_time:g} ms (cycle_time): its"
            " cycles cannot be counted."
        )
        return None, [Remark.error(words)]
    # The file does not say whether a velocity belongs to the step before a position or to
    # the steps around it, which moves reversals by half a cycle.
    place = recording.commanded
    step = np.diff(place, prepend=place[:1]) / samples.cycle
    rates = step, np.gradient(place, samples.cycle)
    try:
        fits = [fit_reversal(samples, place, v, inertia=inertia) for v in rates]
    except FitError as error:
        return None, [Remark.error(f"reversal: {error}")]
    reversal = min(fits, key=lambda fit: fit.noise)
    remarks = [
        Remark.error(f"reversal: {name} is not known: {reason}")
        for name, reason in reversal.undetermined.items()
    ]
    if not reversal.lookahead_seen:
        words = (
            "reversal: the axis stands before every reversal, where no look-ahead shows:"
            " reversal_lookahead is 0. Record reversals without a dwell to find it."
        )
        remarks.append(Remark.warning(words))
    return reversal, remarks


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
        without=currents(friction_of(result.without, signed))[2],
    )

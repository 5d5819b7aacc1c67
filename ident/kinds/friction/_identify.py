"""From a recording to the law: the choice on windows held out, fit, reversals."""

import dataclasses

import numpy as np

from ...core import FitError
from ...friction import (
    Choice,
    FrictionFit,
    Laws,
    OutputErrorFit,
    ReversalFit,
    choose_law,
    fit_output_error,
    fit_reversal,
    laws_held_out,
)
from ...job.result._result import Remark
from ._recording import DriveRecording
from .keys import Spec

_SAME_CLOCK = 0.01


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
    without: Laws
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
    output, without = None, choice.without
    if spec.method == "output_error":
        # A table cannot be simulated sample by sample; the law in words can.
        kept = tuple(spec.constraints)
        output = fit_output_error(
            choice.law, samples, solver=spec.solver, constraints=kept
        )
        without = laws_held_out(output, samples, choice.window, loss)
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
    return reversal, [
        Remark.error(f"reversal: {name} is not known: {reason}")
        for name, reason in reversal.undetermined.items()
    ]

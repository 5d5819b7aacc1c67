"""From a recording to the law: the choice on windows held out, fit, reversals."""

import dataclasses

import numpy as np
from jaxtyping import Int

from ...core import FitError
from ...friction import (
    Choice,
    FrictionFit,
    Known,
    OutputErrorFit,
    ReversalFit,
    WindowLaw,
    choose_law,
    fit_output_error,
    fit_reversal,
    laws_held_out,
)
from ...job._result import Remark
from ._recording import DriveRecording
from .keys import Spec

_WINDOWS = 10
_SAME_CLOCK = 0.01


@dataclasses.dataclass(frozen=True)
class Identified:
    """A law and how it was found.

    Attributes:
        choice: Which laws competed.
        fit: The law: the simplest that predicts as well as the best.
        laws: The laws in words (Coulomb, Stribeck), each fitted to all samples.
        law: That of them which predicts best; `fit` itself where it is one.
        output: The output-error fit, where it was asked for.
        reversal: What reversals show, or None.
        without: Laws fitted without each window in turn.
        window: Window of each sample.
        remarks: What the user must know.
    """

    choice: Choice
    fit: FrictionFit
    laws: tuple[FrictionFit, ...]
    law: FrictionFit
    output: OutputErrorFit | None
    reversal: ReversalFit | None
    without: tuple[WindowLaw, ...]
    window: Int[np.ndarray, " t"]
    remarks: tuple[Remark, ...]


def identify(recording: DriveRecording, spec: Spec, cycle_time: float) -> Identified:
    """Find the law of friction in a recording.

    Raises:
        FitError: If the recording does not carry any law.
    """
    samples = recording.samples
    inertia = spec.inertia if isinstance(spec.inertia, float) else None
    known = Known(inertia=inertia)
    loss = spec.loss if "loss" in spec.model_fields_set else "trim"
    reversal, remarks = None, list[Remark]()
    if spec.reversal:
        reversal, remarks = _reversal(recording, known, cycle_time)
    if reversal is not None:
        # What is missing around reversals is none of the law's.
        current = samples.current + reversal.missing / known.gain
        samples = dataclasses.replace(samples, current=current)
    choice = choose_law(samples, known=known, loss=loss, windows=_WINDOWS)
    fit, output, without = choice.fit, None, choice.without
    laws = choice.laws
    law = laws[_best_law(choice)]
    if spec.method == "output_error":
        # A table cannot be simulated sample by sample; the law in words can.
        output = fit_output_error(
            law, samples, solver=spec.solver, constraints=tuple(spec.constraints)
        )
        fit = law = output.friction
        without = laws_held_out(output, samples, choice.window, loss)
    about = [Remark.info(words) for words in (*law.gauges, *law.remarks)]
    about += [
        Remark.warning(f"{name.replace('_', ' ')} is not known: {reason}")
        for name, reason in law.undetermined.items()
    ]
    return Identified(
        choice,
        fit,
        laws,
        law,
        output,
        reversal,
        without,
        choice.window,
        (*about, *remarks),
    )


def _best_law(choice: Choice) -> int:
    """Return the simplest law in words that predicts as well as the best of them."""
    laws = [each for each in choice.candidates if each.structure.parametric]
    best = min(laws, key=lambda each: each.error)
    good = [each for each in laws if each.error <= best.error + best.standard_error]
    return laws.index(min(good, key=lambda each: each.parameters))


def _reversal(
    recording: DriveRecording, known: Known, cycle_time: float
) -> tuple[ReversalFit | None, list[Remark]]:
    """Return what reversals show, or a remark that says why nothing does."""
    samples = recording.samples
    if abs(samples.cycle - cycle_time) > _SAME_CLOCK * cycle_time:
        return None, [
            Remark.error(
                f"reversal: the recording has a sample every {1e3 * samples.cycle:g} ms,"
                f" expected one per cycle of {1e3 * cycle_time:g} ms (cycle_time): its"
                " cycles cannot be counted."
            )
        ]
    # The file does not say whether a velocity belongs to the step before a position or to
    # the steps around it, which moves reversals by half a cycle.
    central = np.gradient(recording.commanded, samples.cycle)
    try:
        found = min(
            (
                fit_reversal(samples, recording.commanded, velocity, known=known)
                for velocity in (recording.commanded_velocity, central)
            ),
            key=lambda each: each.noise,
        )
    except FitError as error:
        return None, [Remark.error(f"reversal: {error}")]
    return found, [
        Remark.error(f"reversal: {name} is not known: {reason}")
        for name, reason in found.undetermined.items()
    ]

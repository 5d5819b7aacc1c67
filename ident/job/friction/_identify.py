"""From a recording to the law: the choice on windows held out, fit, reversals."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ...core import FitError
from ...fit.friction import (
    OutputErrorFit,
    ReversalFit,
    fit_output_error,
    fit_reversal,
)
from ...friction import (
    Choice,
    DriveSamples,
    FrictionFit,
    Known,
    WindowLaw,
    choose_law,
)
from .._fit_schema import FrictionSpec
from .._result import Remark
from ._listing import without_inertia
from ._recording import DriveRecording

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


def identify(
    recording: DriveRecording, spec: FrictionSpec, cycle_time: float
) -> Identified:
    """Find the law of friction in a recording.

    Raises:
        FitError: If the recording does not carry any law.
    """
    samples = recording.samples
    inertia = spec.inertia if isinstance(spec.inertia, float) else None
    known = Known(inertia=inertia)
    loss = spec.loss if "loss" in spec.model_fields_set else "trim"
    choice = choose_law(samples, known=known, loss=loss, windows=_WINDOWS)
    fit, output = choice.fit, None
    laws = choice.laws
    law = laws[_best_law(choice)]
    remarks: list[Remark] = []
    if spec.method == "output_error":
        # A table cannot be simulated sample by sample; the law in words can.
        output = fit_output_error(law, samples)
        fit = law = output.friction
    remarks += [Remark("info", words) for words in (*law.gauges, *law.remarks)]
    remarks += [
        Remark("warning", f"{name.replace('_', ' ')} is not known: {reason}")
        for name, reason in law.undetermined.items()
    ]
    reversal = None
    if spec.reversal:
        reversal, more = _reversal(recording, fit, cycle_time)
        remarks += more
    return Identified(
        choice,
        fit,
        laws,
        law,
        output,
        reversal,
        choice.without,
        choice.window,
        tuple(remarks),
    )


def _best_law(choice: Choice) -> int:
    """Return the simplest law in words that predicts as well as the best of them."""
    laws = [each for each in choice.candidates if each.structure.parametric]
    best = min(laws, key=lambda each: each.error)
    good = [each for each in laws if each.error <= best.error + best.standard_error]
    return laws.index(min(good, key=lambda each: each.parameters))


def _friction_of(samples: DriveSamples, fit: FrictionFit) -> Float[np.ndarray, " t"]:
    """Return the current that friction takes: inertia and constant load taken off."""
    inertia, offset = (fit.parameters.get(name, 0.0) for name in ("inertia", "offset"))
    return without_inertia(samples, inertia) - offset


def _beside(recording: DriveRecording) -> Float[np.ndarray, "t 5"]:
    """Return what a smoothed acceleration leaves in the current: pulses of the command."""
    step = np.diff(recording.commanded_velocity, prepend=0.0) / recording.samples.cycle
    columns = [np.roll(step, away) for away in (-1, 0, 1, 2)]
    return np.stack([*columns, np.ones_like(step)], axis=1)


def _reversal(
    recording: DriveRecording, fit: FrictionFit, cycle_time: float
) -> tuple[ReversalFit | None, list[Remark]]:
    """Return what reversals show, or a remark that says why nothing does."""
    samples = recording.samples
    if fit.law is None:
        return None, [
            Remark("error", "reversal: without a law there is nothing to see.")
        ]
    if abs(samples.cycle - cycle_time) > _SAME_CLOCK * cycle_time:
        return None, [
            Remark(
                "error",
                f"reversal: the recording has a sample every {1e3 * samples.cycle:g} ms,"
                f" expected one per cycle of {1e3 * cycle_time:g} ms (cycle_time): its"
                " cycles cannot be counted.",
            )
        ]
    try:
        found = fit_reversal(
            fit.law,
            recording.commanded,
            recording.commanded_velocity,
            _friction_of(samples, fit),
            nuisance=_beside(recording),
        )
    except FitError as error:
        return None, [Remark("error", f"reversal: {error}")]
    return found, [
        Remark("error", f"reversal: {name} is not known: {reason}")
        for name, reason in found.undetermined.items()
    ]

"""From a recording to the law: the choice on windows held out, fit, reversals."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ....models import AbstractFriction, FrictionTable
from ...fit import FitError
from ...fit.friction import (
    Choice,
    DriveSamples,
    FrictionFit,
    Known,
    OutputErrorFit,
    ReversalFit,
    choose_law,
    fit_output_error,
    fit_reversal,
)
from .._fit_schema import FrictionSpec
from .._result import Remark
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
        held_out: Friction that laws fitted to the other windows predict, per sample.
        window: Window of each sample.
        remarks: What the user must know.
    """

    choice: Choice
    fit: FrictionFit
    laws: tuple[FrictionFit, ...]
    law: FrictionFit
    output: OutputErrorFit | None
    reversal: ReversalFit | None
    held_out: Float[np.ndarray, " t"]
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
    window = choice.left_out.window_of_samples
    held_out = choice.left_out.predicted(fit)
    reversal = None
    if spec.reversal:
        reversal, more = _reversal(recording, fit, cycle_time)
        remarks += more
    return Identified(
        choice, fit, laws, law, output, reversal, held_out, window, tuple(remarks)
    )


def _best_law(choice: Choice) -> int:
    """Return the simplest law in words that predicts as well as the best of them."""
    laws = [each for each in choice.candidates if each.structure.in_words]
    best = min(laws, key=lambda each: each.error)
    good = [each for each in laws if each.error <= best.error + best.standard_error]
    return laws.index(min(good, key=lambda each: each.parameters))


def steady(
    law: AbstractFriction, velocity: Float[np.ndarray, " t"], unit: float = 1.0
) -> np.ndarray:
    """Return the current of a law at velocities, as NumPy has it.

    Args:
        law: The law.
        velocity: In mm/s or °/s.
        unit: What one unit of a table is in that of the current.
    """
    if isinstance(law, FrictionTable) and law.held_below and law.held_above:
        # A compiled table would have to be compiled anew for every number of entries.
        entries = np.asarray(law.scaling) * (np.asarray(law.values) * unit)
        level = np.interp(np.abs(velocity), np.asarray(law.nodes.points), entries)
        return np.asarray(np.sign(velocity) * level)
    if unit != 1.0:
        assert isinstance(law, FrictionTable)
        law = dataclasses.replace(law, values=law.values * unit)
    found: np.ndarray = np.array(law(velocity), dtype=float)
    return found


def friction_of(samples: DriveSamples, fit: FrictionFit) -> Float[np.ndarray, " t"]:
    """Return the current that friction takes: inertia and constant load taken off."""
    values = dict(zip(fit.names, fit.values, strict=True))
    known = fit.known

    def one(name: str, stated: float | None) -> float:
        value = stated if stated is not None else values.get(name, 0.0)
        return 0.0 if not np.isfinite(value) else float(value)

    left = samples.current - one("offset", known.offset)
    if samples.acceleration is not None:
        left = left - one("inertia", known.inertia) * samples.acceleration
    return np.asarray(left)


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
            friction_of(samples, fit),
            nuisance=_beside(recording),
        )
    except FitError as error:
        return None, [Remark("error", f"reversal: {error}")]
    return found, [
        Remark("error", f"reversal: {name} is not known: {reason}")
        for name, reason in found.undetermined.items()
    ]

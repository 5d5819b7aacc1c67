"""What a job found of the friction of an axis."""

import dataclasses
from functools import cached_property
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float

from ....data.signals import median
from ...friction import Choice, DriveSamples, FrictionFit, Knots, Stribeck, friction_of
from ...job._draft import Foreseen
from ...job._gating import leaves_what_was_predicted
from ...job.result._result import AbstractResult, Expectation
from ...proof import CircularTest, ErrorFigures, GateCheck, error_figures
from ._law import Identified, LawCurve
from ._recording import DriveRecording

_JOG = 1.0
"""Slowest speed in mm/s or °/s at which a person is told to move an axis."""
_ROUNDED = 0.25
"""Share of what a list is to take off that its rounding may leave."""
_WILD = 7.0
"""Standard deviations beyond which a sample of the current is a fault."""


@dataclasses.dataclass(frozen=True)
class FrictionView:
    """What was found of a friction, and what its list leaves of the recording.

    Currents are in the unit of the recording, one per sample.

    Attributes:
        recording: What the drive recorded.
        found: The law, how it was found, and what competed with it.
        curve: The law over the driven speeds; None where it is not determined.
        knots: Entries of the list; None where none are written: then the curve stands for it.
        level: Share of the friction that the list gives.
        offset: Constant load that goes with the list: the torque offset of the drive; None
            where the law is not determined.
        before: Current that friction takes: inertia and constant load taken off.
        predicted: What lists made of the other windows leave of it, at their level.
        listed: Current that the written list, read back, gives; one without rounding where
            none is written, 0 where the law is not determined.
    """

    recording: DriveRecording
    found: Identified
    curve: LawCurve | None
    knots: Knots | None
    level: float
    offset: float | None
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    listed: Float[np.ndarray, " t"]

    @property
    def samples(self) -> DriveSamples:
        """The recording as the estimators take it."""
        return self.recording.samples

    @property
    def from_file(self) -> Float[np.ndarray, " t"]:
        """What the list leaves of the current."""
        return np.asarray(self.before - self.listed)

    @cached_property
    def wild(self) -> Bool[np.ndarray, " m"]:
        """Which of the samples in motion lie farther out than noise does."""
        size = np.abs(self.from_file[self.samples.in_motion])
        return np.asarray(size > _WILD * 1.4826 * median(size))

    def figures(self, error: Float[np.ndarray, " t"]) -> ErrorFigures:
        """Return the figures of an error over the samples in motion, which tell of friction."""
        return error_figures(error[self.samples.in_motion], wild=self.wild)

    @property
    def foreseen(self) -> Foreseen:
        """What is promised of the samples in motion."""
        rows = self.samples.in_motion
        return Foreseen(self.before[rows], self.predicted[rows], self.wild)

    def gate(self) -> GateCheck:
        """Return whether the list leaves what was predicted.

        Rounding may leave a unit of the list more, but no large part of what it is to take off.
        """
        assert self.knots is not None  # it is written
        before, predicted = (
            self.figures(stage).sound.rms for stage in (self.before, self.predicted)
        )
        return leaves_what_was_predicted(
            self.from_file[self.samples.in_motion],
            self.foreseen,
            min(self.knots.unit, _ROUNDED * max(before - predicted, 0.0)),
            self.recording.unit,
            "over all speeds",
        )


def view_of(
    recording: DriveRecording,
    found: Identified,
    curve: LawCurve | None,
    knots: Knots | None,
    level: float,
) -> FrictionView:
    """Return what a list leaves of a recording; arguments as in `FrictionView`."""
    samples, parameters = recording.samples, found.fit.parameters
    sign, speed = np.sign(samples.velocity), np.abs(samples.velocity)
    acceleration = samples.acceleration
    friction = samples.current - parameters.get("inertia", 0.0) * acceleration
    window, predicted = found.choice.window, np.empty(len(speed))
    listed, offset, sound = np.zeros(len(speed)), None, samples.in_motion
    before = friction - parameters.get("offset", 0.0)
    share = 1.0 if knots is None else level
    if curve is not None:
        if knots is None:
            listed = sign * np.interp(speed, curve.speed, curve.mean)
        else:
            listed = sign * knots.current(speed) / share
        far = np.abs(friction - listed - median((friction - listed)[sound]))
        # What belongs to no list is the mean of what it leaves, without faults.
        sound = sound & (far <= _WILD * 1.4826 * median(far[sound]))
        offset = float((friction - listed)[sound].mean())
        before = friction - offset
    laws = found.without
    curves = friction_of(laws, samples.velocity) if curve is None else curve.without
    for number, fit in enumerate(laws):
        rows, law = window == number, curves[:, number]
        inertia, constant = fit.loads
        remainder = samples.current - inertia * acceleration
        if curve is not None:
            law = sign * np.interp(speed, curve.speed, law)
            constant = float((remainder - law)[sound & ~rows].mean())
        predicted[rows] = (remainder - constant - share * law)[rows]
    return FrictionView(
        recording, found, curve, knots, level, offset, before, predicted, share * listed
    )


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionResult(AbstractResult):
    """The friction law of an axis and the list made of it.

    Attributes:
        view: What was found, and the recording before and after.
        circle: A simulated circle without and with the list, or None.
    """

    view: FrictionView
    circle: CircularTest | None

    @property
    def entry_deviations(self) -> Float[np.ndarray, " k"]:
        """Standard deviations of the entries, in the unit of the current.

        What rounding and the straight lines of the list put beside the law is part of them.
        """
        view, curve, knots = self.view, self.view.curve, self.view.knots
        assert curve is not None
        assert knots is not None
        law, deviation = (
            view.level * np.interp(knots.velocity / 1000.0, curve.speed, each[2])
            for each in (curve.currents, curve.deviations)
        )
        misfit = np.square(knots.out * knots.unit - law)
        misfit = np.maximum(misfit, knots.rms**2)
        return np.asarray(np.sqrt(deviation**2 + misfit))

    @property
    def expectation(self) -> Expectation | None:
        """The largest current that the written list adds at a speed to jog with, positive."""
        knots = self.view.knots
        if knots is None:
            return None
        speed = knots.velocity / 1000.0
        slow = speed < min(_JOG, float(speed[-1]))
        largest = int(np.argmax(np.where(slow, -1, np.abs(knots.out))))
        return Expectation(
            {},
            1,
            self.sign * float(knots.out[largest] * knots.unit),
            self.unit,
            speed=float(speed[largest]),
        )

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        view, result = self.view, self.view.found
        law, fit = result.law, result.fit
        record = _law(law)
        parameters, deviations = record["parameters"], record["standard_deviations"]
        structure = law.structure
        if isinstance(structure, Stribeck) and structure.exponent is not None:
            parameters["stribeck_shape"] = structure.exponent  # assumed, not fitted
        if (curve := view.curve) is not None:
            parameters["curve"] = {"velocity": curve.speed, "current": curve.mean}
            deviations["curve"] = {"current": curve.deviations[2]}
        if (knots := view.knots) is not None:
            parameters["table"] = {
                "velocity": knots.velocity / 1000.0,
                "current": knots.out * knots.unit,
                "out": knots.out,
            }
            deviations["table"] = {"current": self.entry_deviations}
        reversal = result.reversal
        if reversal is not None:
            undetermined = {"undetermined": reversal.undetermined}
            parameters["reversal"] = reversal.numbers | undetermined
            deviations["position_delay"] = reversal.position_delay_sd
        circle: dict[str, Any] | None = None
        if self.circle is not None:
            names = ("without", "with_list")
            circle = dict(zip(names, self.circle.spikes, strict=True))
            circle |= {k: getattr(self.circle, k) for k in ("radius", "feed", "loop")}
        return record | {
            "list_follows": fit.structure.words,
            "method": law.method,
            "laws": [_law(rival.fit) for rival in result.choice.parametric],
            "support": fit.count,
            "noise": fit.noise,
            "relative_error": fit.relative_error,
            "level": view.level,
            "drive_offset": view.offset,
            "gauges": list(law.gauges),
            "choice": [
                {
                    "law": candidate.structure.words,
                    "parameters": candidate.parameters,
                    "held_out": candidate.error,
                    "standard_error": candidate.standard_error,
                    "fitted": candidate.fitted_error,
                    "chosen": candidate is result.choice.chosen,
                }
                for candidate in result.choice.candidates
            ],
            "free_run": None if result.output is None else result.output.free_run,
            "circle": circle,
            "message": fit.message,
        }


def _law(fit: FrictionFit) -> dict[str, Any]:
    """Return what result.json says of one law."""
    return {
        "law": fit.structure.words,
        "parameters": dict(fit.parameters),
        "standard_deviations": dict(fit.standard_deviations),
        "undetermined": dict(fit.undetermined),
        "relative_error": fit.relative_error,
    }


def choice_sentence(choice: Choice) -> str:
    """Return which law was chosen and why."""
    law, best = choice.chosen, choice.best
    low, high = law.window_error.min(), law.window_error.max()
    text = (
        f"{law.structure.words}: force error {100 * law.error:.2f} % on {len(law.window_error)} "
        f"windows held out in turn ({100 * low:.2f} to {100 * high:.2f} %)"
    )
    if law is best:
        return f"{text}, the smallest of all."
    return (
        f"{text}; {best.structure.words} has {100 * best.error:.2f} %, which is not "
        "better by more than one standard error."
    )

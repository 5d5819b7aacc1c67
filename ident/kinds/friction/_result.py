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
    """The recording as the friction sees it: one row per sample, in its unit of current.

    Attributes:
        samples: The recording.
        position: Commanded where that was recorded, in mm or °.
        offset: Constant load that goes with the list; None where the law is not determined.
        before: Current that friction takes: inertia and constant load taken off.
        predicted: What lists made of the other windows leave of it, at their level.
        listed: Current that the written list, read back, gives; one without rounding where
            none is written, 0 where the law is not determined.
    """

    samples: DriveSamples
    position: Float[np.ndarray, " t"]
    offset: float | None
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    listed: Float[np.ndarray, " t"]

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

    def gate(self, unit: float, name: str) -> GateCheck:
        """Return whether the list leaves what was predicted, in a unit of current of this name.

        Rounding may leave a unit of the list more, but no large part of what it is to take off.
        """
        moving = self.samples.in_motion
        gain = (
            self.figures(self.before).sound.rms - self.figures(self.predicted).sound.rms
        )
        spare = min(unit, _ROUNDED * max(gain, 0.0))
        return leaves_what_was_predicted(
            self.from_file[moving], self.foreseen, spare, name, "over all speeds"
        )


def view_of(
    recording: DriveRecording,
    identified: Identified,
    curve: LawCurve | None,
    knots: Knots | None,
    level: float,
) -> FrictionView:
    """Return what a list leaves of a recording.

    Args:
        recording: The recording.
        identified: The law.
        curve: The law over the speeds that were driven; None where it is not determined.
        knots: Entries of the list; without them the curve stands for it, at level 1.
        level: Share of the friction that the entries give.
    """
    samples, parameters = recording.samples, identified.fit.parameters
    sign, speed = np.sign(samples.velocity), np.abs(samples.velocity)
    acceleration = samples.acceleration
    friction = samples.current - parameters.get("inertia", 0.0) * acceleration
    window, predicted = identified.choice.window, np.empty(len(speed))
    listed, offset, sound = np.zeros(len(speed)), None, samples.in_motion
    before = friction - parameters.get("offset", 0.0)
    if knots is None or curve is None:
        level = 1.0
    if curve is not None:
        if knots is None:
            listed = sign * np.interp(speed, curve.speed, curve.mean)
        else:
            listed = sign * knots.current(speed) / level
        far = np.abs(friction - listed - median((friction - listed)[sound]))
        # What belongs to no list is the mean of what it leaves, without faults.
        sound = sound & (far <= _WILD * 1.4826 * median(far[sound]))
        offset = float((friction - listed)[sound].mean())
        before = friction - offset
    laws = identified.without
    curves = friction_of(laws, samples.velocity) if curve is None else curve.without
    for number, fit in enumerate(laws):
        rows, law = window == number, curves[:, number]
        inertia, constant = fit.loads
        remainder = samples.current - inertia * acceleration
        if curve is not None:
            law = sign * np.interp(speed, curve.speed, law)
            constant = float((remainder - law)[sound & ~rows].mean())
        predicted[rows] = (remainder - constant - level * law)[rows]
    return FrictionView(
        samples=samples,
        position=recording.commanded,
        offset=offset,
        before=before,
        predicted=predicted,
        listed=level * listed,
    )


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionResult(AbstractResult):
    """The friction law of an axis and the list made of it.

    Attributes:
        identified: The law, how it was found, and what competed with it.
        knots: Entries of the list, or None where none is written.
        level: Share of the friction that the list gives.
        curve: The law over speed; None where it is not determined.
        view: The recording before and after; its offset is the torque offset of the drive
            that goes with the list.
        circle: A simulated circle without and with the list, or None.
    """

    identified: Identified
    knots: Knots | None
    level: float
    curve: LawCurve | None
    view: FrictionView
    circle: CircularTest | None

    @property
    def fit(self) -> FrictionFit:
        """What the list follows; see `Identified`."""
        return self.identified.fit

    @property
    def law(self) -> FrictionFit:
        """The law in words that predicts best; see `Identified`."""
        return self.identified.law

    @property
    def length_unit(self) -> str:
        """``"mm"``, or ``"°"`` for a rotary axis."""
        return self.view.samples.unit

    @property
    def entry_deviations(self) -> Float[np.ndarray, " k"]:
        """Standard deviations of the entries, in the unit of the current."""
        assert self.knots is not None
        assert self.curve is not None
        return self.curve.deviation_of(self.knots, self.level)

    @property
    def expectation(self) -> Expectation | None:
        """The largest current that the written list adds at a speed to jog with, positive."""
        if self.knots is None:
            return None
        speed = self.knots.velocity / 1000.0
        slow = speed < min(_JOG, float(speed[-1]))
        largest = int(np.argmax(np.where(slow, -1, np.abs(self.knots.out))))
        return Expectation(
            {},
            1,
            self.sign * float(self.knots.out[largest] * self.knots.unit),
            self.unit,
            speed=float(speed[largest]),
        )

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        result, law, fit = self.identified, self.law, self.fit
        record = _law(law)
        parameters, deviations = record["parameters"], record["standard_deviations"]
        structure = law.structure
        if isinstance(structure, Stribeck) and structure.exponent is not None:
            parameters["stribeck_shape"] = structure.exponent  # assumed, not fitted
        if self.curve is not None:
            curve = {"velocity": self.curve.speed, "current": self.curve.mean}
            parameters["curve"] = curve
            deviations["curve"] = {"current": self.curve.deviations[2]}
        if self.knots is not None:
            parameters["table"] = {
                "velocity": self.knots.velocity / 1000.0,
                "current": self.knots.out * self.knots.unit,
                "out": self.knots.out,
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
            "level": self.level,
            "drive_offset": self.view.offset,
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

"""What a job found of the friction of an axis."""

import dataclasses
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...friction import (
    Choice,
    FrictionFit,
    Knots,
    OutputErrorFit,
    ReversalFit,
    Stribeck,
)
from ...job._result import AbstractResult, Expectation
from ...proof import CircularTest

_JOG = 1.0
"""Slowest speed in mm/s or °/s at which a person is told to move an axis."""


@dataclasses.dataclass(frozen=True)
class FrictionView:
    """The recording as the friction sees it: one row per sample, current units.

    Attributes:
        time: In s.
        position: In mm or °.
        velocity: In mm/s or °/s.
        before: Current that friction takes: inertia and constant load taken off.
        predicted: What a list made of the other windows leaves of it, at its level.
        from_file: What the written list, read back, leaves of it; a list without rounding
            where none is written.
        moving: Samples that tell of kinetic friction; the figures are those of them.
        window: Which window of the hold-out each sample belongs to.
    """

    time: Float[np.ndarray, " t"]
    position: Float[np.ndarray, " t"]
    velocity: Float[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    from_file: Float[np.ndarray, " t"]
    moving: Bool[np.ndarray, " t"]
    window: Int[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True)
class LawCurve:
    """The law over the speeds that were driven, and what its list makes of it.

    Attributes:
        speed: In mm/s or °/s, ascending, positive.
        positive: Current moving positive; held beyond the speeds that were driven so.
        negative: Current moving negative, as a positive number; likewise.
        positive_sd: Standard deviation of `positive`.
        negative_sd: Of `negative`.
        positive_share: How much the positive direction counts in the list, 0 to 1: half
            where both were driven, all where it alone was.
        listed: Current of the list; None where none is written.
        weight: Share of the recording at each speed.
    """

    speed: Float[np.ndarray, " v"]
    positive: Float[np.ndarray, " v"]
    negative: Float[np.ndarray, " v"]
    positive_sd: Float[np.ndarray, " v"]
    negative_sd: Float[np.ndarray, " v"]
    positive_share: Float[np.ndarray, " v"]
    listed: Float[np.ndarray, " v"] | None
    weight: Float[np.ndarray, " v"]

    @property
    def mean(self) -> Float[np.ndarray, " v"]:
        """What a list can say, which knows no direction."""
        share = self.positive_share
        return np.asarray(share * self.positive + (1.0 - share) * self.negative)

    @property
    def difference(self) -> float:
        """Mean difference of the directions, as a share of the friction, where both count."""
        both = self.weight * 4.0 * self.positive_share * (1.0 - self.positive_share)
        apart = float(both @ np.abs(self.positive - self.negative))
        return apart / max(float(both @ np.abs(self.mean)), 1e-300)


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionResult(AbstractResult):
    """The friction law of an axis and the list made of it.

    Attributes:
        fit: What the list follows: the simplest law, or table, that predicts as well as
            the best.
        law: The law in words (Coulomb, Stribeck) that predicts best; `fit` itself where
            that is one.
        laws: All laws in words.
        choice: Which laws competed on windows held out.
        output: The output-error fit, where the job asks for it.
        reversal: What reversals show, where the job asks for it and it can be seen.
        knots: Entries of the list, or None where none is written.
        level: Share of the friction that the list gives.
        out_unit: Current that one unit of ``out`` is, or None.
        curve: Law and list over speed; None where the law is not determined.
        view: The recording before and after.
        circle: A simulated circle without and with the list, or None.
        drive_offset: Constant load beside the list: the torque offset of the drive that
            goes with it, in the unit of the current; None where it is not determined.
        length_unit: ``"mm"``, or ``"°"`` for a rotary axis.
    """

    fit: FrictionFit
    law: FrictionFit
    laws: tuple[FrictionFit, ...]
    choice: Choice
    output: OutputErrorFit | None
    reversal: ReversalFit | None
    knots: Knots | None
    level: float
    out_unit: float | None
    curve: LawCurve | None
    view: FrictionView
    circle: CircularTest | None
    drive_offset: float | None
    length_unit: str

    @property
    def expectation(self) -> Expectation | None:
        """The largest current that the written list adds at a speed to jog with, positive."""
        if self.knots is None:
            return None
        speed = self.knots.velocity / 1000.0
        sign = next(
            (int(r.value) for r in self.conventions if r.name.endswith("_sign")), 1
        )
        slow = speed < min(_JOG, float(speed[-1]))
        largest = int(np.argmax(np.where(slow, -1, np.abs(self.knots.out))))
        return Expectation(
            {},
            1,
            sign * float(self.knots.out[largest] * self.knots.unit),
            self.unit,
            speed=float(speed[largest]),
        )

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        parameters: dict[str, Any] = dict(self.law.parameters)
        structure = self.law.structure
        if isinstance(structure, Stribeck) and structure.exponent is not None:
            parameters["stribeck_shape"] = structure.exponent  # assumed, not fitted
        if self.curve is not None:
            curve = {"velocity": self.curve.speed, "current": self.curve.mean}
            parameters["curve"] = curve
        if self.knots is not None:
            parameters["table"] = {
                "velocity": self.knots.velocity / 1000.0,
                "current": self.knots.out * self.knots.unit,
                "out": self.knots.out,
            }
        deviations: dict[str, Any] = dict(self.law.standard_deviations)
        if self.reversal is not None:
            parameters["reversal"] = {
                "reversal_lookahead": self.reversal.lookahead,
                "position_delay": self.reversal.position_delay,
                "delay_cycles": self.reversal.delay_cycles,
                "undetermined": self.reversal.undetermined,
            }
            deviations["position_delay"] = self.reversal.position_delay_sd
        return {
            "law": self.law.structure.words,
            "list_follows": self.fit.structure.words,
            "method": self.law.method,
            "parameters": parameters,
            "standard_deviations": deviations,
            "undetermined": dict(self.law.undetermined),
            "laws": [
                {
                    "law": each.structure.words,
                    "parameters": dict(each.parameters),
                    "standard_deviations": dict(each.standard_deviations),
                    "undetermined": dict(each.undetermined),
                    "relative_error": each.relative_error,
                }
                for each in self.laws
            ],
            "support": self.fit.count,
            "noise": self.fit.noise,
            "relative_error": self.fit.relative_error,
            "level": self.level,
            "drive_offset": self.drive_offset,
            "gauges": list(self.law.gauges),
            "choice": [
                {
                    "law": each.structure.words,
                    "parameters": each.parameters,
                    "held_out": each.error,
                    "standard_error": each.standard_error,
                    "fitted": each.fitted_error,
                    "chosen": place == self.choice.chosen,
                }
                for place, each in enumerate(self.choice.candidates)
            ],
            "free_run": None if self.output is None else self.output.free_run,
            "circle": None
            if self.circle is None
            else {
                "without": self.circle.spikes[0],
                "with_list": self.circle.spikes[1],
                "radius": self.circle.radius,
                "feed": self.circle.feed,
                "loop": str(self.circle.loop),
            },
            "message": self.fit.message,
        }


def choice_sentence(choice: Choice) -> str:
    """Return which law was chosen and why."""
    one, other = (choice.candidates[place] for place in (choice.chosen, choice.best))
    low, high = one.spread
    text = (
        f"{one.structure.words}: force error {100 * one.error:.2f} % on {choice.windows} "
        f"windows held out in turn ({100 * low:.2f} to {100 * high:.2f} %)"
    )
    if choice.chosen == choice.best:
        return f"{text}, the smallest of all."
    return (
        f"{text}; {other.structure.words} has {100 * other.error:.2f} %, which is not "
        "better by more than one standard error."
    )

"""What a job found of the backlash of an axis."""

import dataclasses
from typing import Any, final

import numpy as np
from jaxtyping import Float, Int

from ...kinds.backlash.effect import BacklashFit
from .._result import AbstractResult, Expectation


@dataclasses.dataclass(frozen=True)
class ReversalView:
    """Readings as they lie about the mean of both directions, in mm or °.

    Attributes:
        position: Of each reading (of each reversal, for a trace).
        direction: ±1.
        before: Half the reversal error, with the scatter of the reading.
        predicted: What is left under the backlash fitted to the other groups.
        from_file: What is left under the entry that was written, read back.
    """

    position: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    from_file: Float[np.ndarray, " t"]


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class BacklashResult(AbstractResult):
    """The backlash of an axis.

    Attributes:
        width: As written (P-AXIS-00103), in ``unit``; what was active included.
        reference: Direction in which the axis is right without it (P-AXIS-00021).
        cycles: Over which a reversal is spread (P-AXIS-00243).
        fit: The estimate behind it.
        view: The readings before and after.
        moving: Whether it was found from reversals in motion, not at standstill.
    """

    width: float
    reference: int
    cycles: int
    fit: BacklashFit
    view: ReversalView
    moving: bool

    @property
    def expectation(self) -> Expectation | None:
        """What a reversal loses at the middle of the readings."""
        place = float(np.median(self.view.position))
        return Expectation(
            {self.axis: place},
            -self.reference,
            abs(self.width),
            self.unit,
            reversal=True,
        )

    @property
    def message(self) -> str:
        """What was found, in a sentence."""
        unit, factor = self.shown
        things = "reversals" if self.moving else "readings"
        text = (
            f"{len(self.fit.residual)} {things}: {factor * self.fit.width:.2f} {unit} ±"
            f" {factor * self.fit.standard_deviation:.2f} {unit}."
        )
        wild = int(self.fit.wild.sum())
        return text + (f" {wild} wild {things} were left out." if wild else "")

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        along = self.fit.dependence
        return {
            "parameters": {
                "backlash": self.width,
                "reference": self.reference,
                "n_backlash_cyc": self.cycles,
                "measured": self.fit.width,
                "kind": self.fit.kind,
            },
            "standard_deviations": {"backlash": self.fit.standard_deviation},
            "support": {
                "positive": self.fit.support[0],
                "negative": self.fit.support[1],
            },
            "noise": self.fit.noise.white,
            "independent": self.fit.independent,
            "dependence": None if along is None else vars(along),
            "message": self.message,
        }

"""What a job found of the backlash of an axis, and what must be known of it."""

import dataclasses
from collections.abc import Iterator
from typing import Any, final

import numpy as np
from jaxtyping import Float

from ...job.result._result import AbstractResult, Expectation, Remark
from .effect import BacklashFit


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class BacklashResult(AbstractResult):
    """The backlash of an axis.

    Attributes:
        width: As written (P-AXIS-00103), in ``unit``; what was active included.
        reference: Direction in which the axis is right without it (P-AXIS-00021).
        cycles: Over which a reversal is spread (P-AXIS-00243).
        fit: The estimate behind it.
        from_file: What the entry that was written, read back, leaves of each, in mm or °.
        moving: Whether it was found from reversals in motion, not at standstill.
    """

    width: float
    reference: int
    cycles: int
    fit: BacklashFit
    from_file: Float[np.ndarray, " t"]
    moving: bool

    @property
    def expectation(self) -> Expectation | None:
        """What a reversal loses at the middle of the readings."""
        place = float(np.median(self.fit.sides.position))
        return Expectation(
            {self.axis: place},
            -self.reference,
            abs(self.width),
            self.unit,
            reversal=True,
        )

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
        }


def remarks_of(result: BacklashResult, known: bool, active: bool) -> Iterator[Remark]:
    """Return all that a fit has to say for itself.

    Args:
        result: Of the job, its remarks left out.
        known: An axis list says in which direction the axis is right.
        active: Whether backlash was active while measuring.
    """
    found = result.fit

    def warning(words: str) -> Remark:
        turns = result.unit != "mm"
        return Remark.warning(words.replace(" µm", " × 0.001°") if turns else words)

    if not found.significant:
        yield warning(
            f"No backlash shows: {1e3 * found.width:.2f} µm ±"
            f" {1e3 * found.standard_deviation:.2f} µm is less than 3 standard"
            " deviations. Nothing is written."
        )
    else:
        yield Remark.info(f"{found.kind.capitalize()}.")
    yield from map(warning, _warnings(found))
    if not known and found.significant:
        yield Remark.warning(
            "The axis is taken as right when it moves in positive direction"
            " (anwahl_losekomp 1), since no axis list says otherwise. Where it"
            " was referenced or its tables were measured moving the other way,"
            " 2 is right; the wrong one shifts all positions by the width."
        )
    if active:
        yield Remark.info(
            "Backlash was active while measuring: the new size is old + what was left."
        )


def _warnings(found: BacklashFit) -> Iterator[str]:
    """Return what must be known before the width is used, lengths in µm."""
    if found.drift is not None:
        drift, width = found.drift
        yield (
            f"The readings drift by {1e3 * drift:.1f} µm within a run, which counts as"
            f" backlash: with the drift taken off it is {1e3 * width:.1f} µm."
        )
    if found.delay_gain is not None:
        yield (
            "All reversals run at one speed: a delay of 0.1 ms between the instruments"
            f" would count as {0.1 * found.delay_gain:.2g} µm of backlash, and nothing"
            " here tells them apart."
        )
    along = found.dependence
    if along is not None and along.significant:
        yield (
            f"The backlash changes along the axis by {1e3 * along.variation:.1f} µm rms"
            f" ({1e3 * along.slope:+.1f} µm from one end to the other): one number"
            " cannot take it away, a bilateral leadscrew table is the better answer."
        )

"""What comes out of a backlash fit."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ....models import Backlash
from ...core._drift import DriftNoise

SURE = 3.0
"""Deviations from which on a backlash shows."""


@dataclasses.dataclass(frozen=True)
class Dependence:
    """How the backlash changes along the axis.

    Attributes:
        probability: Of data like these if it did not change at all.
        variation: Root mean square of the change over the measured positions, in mm or °.
        slope: Change over the measured positions, first to last, in mm or °.
        slope_deviation: Standard deviation of that.
        significant: Whether it changes by more than chance and by enough to matter.
    """

    probability: float
    variation: float
    slope: float
    slope_deviation: float
    significant: bool


@dataclasses.dataclass(frozen=True)
class Reversal:
    """One reversal cut out of a trace.

    Attributes:
        start: First row of its window.
        stop: Row after the last.
        turn: Row of the turning point.
        position: Of the turning point in mm or °.
        direction: Of the motion after it, ±1.
        width: Backlash that this reversal shows alone, in mm or °.
        standard_deviation: Of the width, from the scatter within the window.
        wild: Set aside because it contradicts the others.
    """

    start: int
    stop: int
    turn: int
    position: float
    direction: int
    width: float
    standard_deviation: float
    wild: bool


@dataclasses.dataclass(frozen=True)
class BacklashFit:
    """The backlash of an axis.

    The width has the sign of P-AXIS-00103: error moving positive − error moving negative is
    minus the width.

    Attributes:
        width: In mm or °.
        standard_deviation: Of the width.
        names: Of what was fitted beside it, in the order of the covariance.
        covariance: Of the width and those, same unit.
        noise: How the readings scatter.
        independent: Independent readings (reversals) that would leave the same uncertainty.
        support: Readings (reversals) used per direction of motion, positive first.
        dependence: How it changes along the axis; None where the positions are too few.
        delay: By how much the reference is late behind the encoder in s, and the deviation of
            that, from the speeds of the reversals; None where it was not fitted.
        reversals: Each reversal of a trace; empty for bidirectional readings.
        take_up: Travel after a reversal in which nine tenths come, in mm or °; None where it
            was not seen.
        residual: Reading − fit in mm or ° (readings, or reversals).
        wild: Readings (reversals) that the loss rejected outright.
        warnings: What must be known before it is used.
        message: One sentence on what was found.
    """

    width: float
    standard_deviation: float
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "k k"]
    noise: DriftNoise
    independent: float
    support: tuple[int, int]
    dependence: Dependence | None
    delay: tuple[float, float] | None
    reversals: tuple[Reversal, ...]
    take_up: float | None
    residual: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    warnings: tuple[str, ...]
    message: str

    @property
    def significant(self) -> bool:
        """Whether there is a backlash by more than chance."""
        return abs(self.width) > SURE * self.standard_deviation

    @property
    def kind(self) -> str:
        """Where the play is, in words."""
        if not self.significant:
            return "no backlash shows"
        if self.width > 0:
            return "positive: play between drive and slide"
        return "negative: play between slide and measuring system"

    def compensation(self, reference: int = 1, cycles: int = 0) -> Backlash:
        """Return the model that takes this backlash away.

        Args:
            reference: Direction in which the axis is right without it (P-AXIS-00021 = 1 or
                2): that of homing and of the tables. The other choice shifts all positions by
                the width.
            cycles: Over which a reversal is spread (`spread_cycles`).
        """
        return Backlash(jnp.asarray(self.width), 1 if reference > 0 else -1, cycles)

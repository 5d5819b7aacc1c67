"""What a job found of a group as a whole."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ...fit import RunEffect
from ...fit.joint import Confusion, Gauge, Part
from ...proof import ErrorFigures
from .._result import Remark


@dataclasses.dataclass(frozen=True)
class EffectShare:
    """How much of the error one effect is.

    Attributes:
        index: Of its fit in the job, or None for what was fitted beside the fits.
        name: In words.
        axis: Compensated axis.
        compensation: As in the job.
        rms: Root mean square of what it adds to the readings, about its mean, in mm or °.
        information: What is left of its information beside the other effects, 0 to 1.
        determined: Whether the readings tell it.
        written: Whether it stands in a list.
        why: What is left out and why, empty where nothing is.
    """

    index: int | None
    name: str
    axis: str
    compensation: str
    rms: float
    information: float
    determined: bool
    written: bool
    why: str = ""

    @classmethod
    def of(
        cls, index: int | None, part: Part, determined: bool, written: bool, why: str
    ) -> "EffectShare":
        """Return how much a part of the joint fit is."""
        known = part.contribution[np.isfinite(part.contribution)]
        return cls(
            index=index,
            name=part.name,
            axis=part.effect.axis,
            compensation=part.effect.compensation,
            rms=float(np.std(known)) if known.size else 0.0,
            information=part.share,
            determined=determined,
            written=written,
            why=why,
        )


@dataclasses.dataclass(frozen=True)
class AxisSum:
    """The whole sum on one axis.

    Attributes:
        axis: Compensated axis.
        unit: ``mm`` or ``deg``.
        noise: Standard deviation of one reading.
        datum: Constant error that no list of the group holds.
        error: Keys ``before``, ``predicted``, ``from_file``.
        rows: Readings, as rows of all measurements one after the other.
        before: Error as measured.
        predicted: Left under lists that were fitted without the reading.
        from_file: Left under all written files together, read back.
        wild: Readings that the loss rejected.
        runs: Offset and drift of each run; empty without.
    """

    axis: str
    unit: str
    noise: float
    datum: float
    error: Mapping[str, ErrorFigures]
    rows: Int[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    from_file: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    runs: tuple[RunEffect, ...]


@dataclasses.dataclass(frozen=True)
class GroupResult:
    """A group of fits that were identified together.

    Attributes:
        name: In the job.
        fits: Indices of its fits.
        effects: How much of the error each is; helpers last.
        freedoms: What may be moved between effects without changing the sum.
        lost: What these readings cannot tell apart.
        axes: The sum, axis by axis.
        order: Time in s, or row number, of all rows.
        timed: Whether it is a time.
        held_out: What the prediction left out together: ``run`` or ``block``.
        converged: Whether the fit settled.
        message: How it went.
        remarks: What concerns the group as a whole.
    """

    name: str
    fits: tuple[int, ...]
    effects: tuple[EffectShare, ...]
    freedoms: tuple[Gauge, ...]
    lost: tuple[Confusion, ...]
    axes: tuple[AxisSum, ...]
    order: Float[np.ndarray, " t"]
    timed: bool
    held_out: str
    converged: bool
    message: str
    remarks: tuple[Remark, ...]

    def as_tree(self) -> dict[str, Any]:
        """Return what result.json says of the group."""
        return {
            "name": self.name,
            "fits": self.fits,
            "effects": self.effects,
            "gauges": self.freedoms,
            "confusions": self.lost,
            "axes": {
                one.axis: {
                    "unit": one.unit,
                    "noise": one.noise,
                    "datum": one.datum,
                    "readings": len(one.rows),
                    "wild": int(np.sum(one.wild)),
                    "error": {key: each.as_tree() for key, each in one.error.items()},
                    "runs": one.runs,
                }
                for one in self.axes
            },
            "held_out": self.held_out,
            "converged": self.converged,
            "message": self.message,
            "remarks": self.remarks,
        }

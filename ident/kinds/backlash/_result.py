"""What a job found of the backlash of an axis, and what must be known of it."""

import dataclasses
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import legendre
from scipy.special import fdtrc  # scipy.stats takes long to load

from ....data.units import small_unit
from ...core import FitError, node_shares, regress
from ...fit.joint import Part
from ...job.result._result import AbstractResult, Expectation, Remark

if TYPE_CHECKING:
    from ...job.joint._share import Share

_SURE = 3.0
"""Deviations from which on a backlash shows."""
_CHANCE = 0.01
_MATTERS = 0.1
"""Change relative to the width that is worth a table."""
_HIGHEST = 3
"""Order of the polynomial along the axis."""
_MOST = 5_000
"""Readings that are enough to see whether a backlash changes along the axis."""


@dataclasses.dataclass(frozen=True)
class Sides:
    """Readings about the mean of both directions.

    Attributes:
        position: Of each in mm or °.
        direction: ±1.
        before: Half the reversal error, with the scatter of the reading, in mm or °.
        wild: Which the loss rejected outright.
    """

    position: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True)
class Dependence:
    """How the backlash changes along the axis.

    Attributes:
        probability: Of data like these if it did not change at all.
        variation: Root mean square of the change over the measured positions, in mm or °.
        slope: Change over the measured positions, first to last, in mm or °.
        significant: Whether it changes by more than chance and by enough to matter.
    """

    probability: float
    variation: float
    slope: float
    significant: bool


def is_sure(part: Part) -> bool:
    """Return whether there is a backlash by more than chance."""
    return bool(np.abs(part.values[0]) > _SURE * part.standard_deviation[0])


def change_along(width: float, sides: Sides) -> Dependence | None:
    """Return how the width changes along the axis; None where the places are too few.

    By Legendre polynomials over the measured range.
    """
    rows = np.flatnonzero(np.isfinite(sides.position))
    rows = rows[:: max(len(rows) // _MOST, 1)]
    place, sign, half = sides.position[rows], sides.direction[rows], sides.before[rows]
    order = min(_HIGHEST, len(np.unique(place)) - 1)
    if order < 1:
        return None
    place = 2.0 * (place - place.min()) / np.ptp(place) - 1.0
    try:
        fit = regress(-0.5 * sign[:, None] * legendre.legvander(place, order), half)
    except FitError:
        return None
    if fit.undetermined.any():
        return None
    values, covariance = fit.coefficients[1:], fit.covariance[1:, 1:]
    square = float(values @ np.linalg.pinv(covariance, hermitian=True) @ values)
    # Readings without any scatter fit exactly: what they show is what there is.
    square = square if covariance.any() else (np.inf if values.any() else 0.0)
    freedom = max(float(fit.independent.min()) - order - 1.0, 1.0)
    probability = float(fdtrc(order, freedom, square / order))
    orders = np.arange(1, order + 1)
    variation = float(np.sqrt((values**2 / (2 * orders + 1)).sum()))
    matters = variation > _MATTERS * abs(width)
    slope = 2.0 * float(values[::2].sum())
    return Dependence(probability, variation, slope, probability < _CHANCE and matters)


def drift_remark(
    share: "Share", nodes: Float[np.ndarray, " n"], unit: str
) -> Iterator[Remark]:
    """Yield that the readings drift, where a straight line in time changes the width.

    Runs that follow each other tell a line from the width; what each run has as an offset of its
    own, and what is left as noise, holds the line.

    Args:
        share: Its part of the fit.
        nodes: Of the error that both directions share.
        unit: Of a thousandth of the width.
    """
    data, axis, width = share.recording.data, share.axis, float(share.part.values[0])
    rows = np.flatnonzero(share.rows)[~share.wild]
    rows = rows[np.isfinite(data.position[axis][rows])]
    place, way = data.position[axis][rows], data.direction[axis][rows]
    span = data.order[rows] - data.order[rows].mean()
    span = span / (float(np.ptp(span)) or 1.0)
    shares = node_shares(place, nodes)
    shares = shares[:, shares.any(axis=0)]
    try:
        columns = np.column_stack([-0.5 * way, span, shares])
        found = regress(columns, data.error[axis][rows])
    except FitError:  # all of one direction came first, or each place was read once
        return
    (straight, drift), (_, sd) = found.coefficients[:2], found.standard_deviation[:2]
    if abs(drift) > _SURE * sd and abs(straight - width) > _DRIFTS * abs(width):
        yield Remark.warning(
            f"The readings drift by {1e3 * abs(drift):.2g} {unit} over the measurement: less a"
            f" straight drift the width is {1e3 * straight:.4g} {unit}, not {1e3 * width:.4g}."
            " Approach each place from both sides at once, or let machine and instrument come to"
            " rest first."
        )


FLANK = "backlash_reference"
"""The convention that says which flank is right."""
_TAKEN = Remark.warning(
    "The axis is taken as right when it moves in positive direction (anwahl_losekomp 1), since"
    " no axis list says otherwise. Where it was referenced or its tables were measured moving"
    " the other way, 2 is right; the wrong one shifts all positions by the width."
)
_DRIFTS = 0.03
"""Share of a width that a drift must change to be told."""
_VAGUE, _SMALL = 0.5, 3e-4
"""Scatter of a reading, and mm or °, beyond which the deviation of a width tells nothing of it."""


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class BacklashResult(AbstractResult):
    """The backlash of an axis.

    The width has the sign of P-AXIS-00103: error moving positive − error moving negative is
    minus the width.

    Attributes:
        width: As written (P-AXIS-00103), in ``unit``; what was active included.
        reference: Direction in which the axis is right without it (P-AXIS-00021).
        cycles: Over which a reversal is spread (P-AXIS-00243).
        fit: The estimate behind it, its one value the width that was measured.
        noise: Standard deviation of a reading, in ``unit``.
        sides: The readings that it rests on.
        from_file: What the entry that was written, read back, leaves of each, in ``unit``.
        dependence: How it changes along the axis; None where the positions are too few.
    """

    width: float
    reference: int
    cycles: int
    fit: Part
    noise: float
    sides: Sides
    from_file: Float[np.ndarray, " t"]
    dependence: Dependence | None

    def unsettled(self, settled: Collection[str]) -> tuple[Remark, ...]:
        known = FLANK in settled
        return tuple(one for one in self.remarks if not (known and one == _TAKEN))

    @property
    def subject(self) -> str:
        return f"the error of {self.axis} about the middle of both directions"

    @property
    def measured_width(self) -> tuple[float, float]:
        """What was measured, and its standard deviation, in ``unit``."""
        return float(self.fit.values[0]), float(self.fit.standard_deviation[0])

    @property
    def significant(self) -> bool:
        """Whether there is a backlash by more than chance."""
        return is_sure(self.fit)

    @property
    def type(self) -> str:
        """Where the play is, in words."""
        if not self.significant:
            return "no backlash shows"
        if abs(self.width) <= _SURE * self.measured_width[1]:
            return "none: the entries that were active made what was measured"
        if self.width > 0:
            return "positive: play between drive and slide"
        return "negative: play between slide and measuring system"

    @property
    def support(self) -> tuple[int, int]:
        """Readings that count, moving positive and moving negative."""
        direction = self.sides.direction[~self.sides.wild]
        return int((direction > 0).sum()), int((direction < 0).sum())

    @property
    def expectation(self) -> Expectation | None:
        """What a reversal loses at the middle of the readings."""
        place = float(np.nanmedian(self.sides.position))
        return Expectation(
            {self.axis: place},
            -self.reference,
            abs(self.width),
            self.unit,
            reversal=True,
        )

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        width, deviation = self.measured_width
        dependence = self.dependence
        return {
            "parameters": {
                "backlash": self.width,
                "reference": self.reference,
                "n_backlash_cyc": self.cycles,
                "measured": width,
                "kind": self.type,
            },
            "standard_deviations": {"backlash": deviation},
            "support": dict(zip(("positive", "negative"), self.support, strict=True)),
            "noise": self.noise,
            "dependence": None if dependence is None else vars(dependence),
        }


def remarks_of(result: BacklashResult, listed: bool, active: bool) -> Iterator[Remark]:
    """Return all that a fit has to say for itself.

    Args:
        result: Of the job, its remarks left out.
        listed: An axis list says in which direction the axis is right.
        active: Whether backlash was active while measuring.
    """
    unit = small_unit(result.unit)
    dependence = result.dependence
    if result.significant:
        yield Remark.info(f"{result.type.capitalize()}.")
    else:
        width, deviation = result.measured_width
        found = f"{1e3 * width:.2f} {unit} ± {1e3 * deviation:.2f} {unit}"
        if deviation > max(_VAGUE * result.noise, _SMALL):
            yield Remark.error(
                f"These readings do not tell whether there is a backlash: {found}, beside"
                f" {1e3 * result.noise:.2g} {unit} of scatter: what changes in time looks the"
                " same. Approach more places from both sides, in another order."
            )
        else:
            yield Remark.warning(
                f"No backlash shows: {found} is less than 3 standard deviations. Nothing is"
                " written."
            )
    if dependence is not None and dependence.significant:
        yield Remark.warning(
            f"The backlash changes along the axis by {1e3 * dependence.variation:.1f} {unit} rms"
            f" ({1e3 * dependence.slope:+.1f} {unit} from one end to the other): one number"
            " cannot take it away, a bilateral leadscrew table is the better answer. A drift"
            " of the readings from the way out to the way back looks the same and counts as"
            " backlash: measure again in another order to tell."
        )
    if not listed and result.significant:
        yield _TAKEN
    if active:
        yield Remark.info(
            "Backlash was active while measuring: the new size is old + what was left."
        )

"""What comes out of a joint fit, and what its data can tell."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from .._types import RunEffect
from ._effect import AbstractEffect
from ._words import Confusion, Gauge

if TYPE_CHECKING:
    from ._axis import AxisFit


@dataclasses.dataclass(frozen=True)
class Part:
    """One fitted effect; signs are those of the *error*.

    Attributes:
        effect: The effect, its nodes placed and its lag fitted: ``effect.block(data)`` works.
        values: In the order of the block, mm (coefficient of a temperature: mm/mm).
        support: Readings that touch each value.
        determined: Whether the data tell the value: some reading reaches it, and it is not
            confused with another effect.
        share: Information that all others (effects, runs, datum) leave of the effect, relative
            to what it has alone: mean over its independent directions, 0 to 1. Directions that a
            gauge gives to another effect do not count; values that no reading touches are 0.
        contribution: What it adds to each reading in mm or °; NaN where an input is missing.
        fit: Of its axis.
        smoothness: Weights of the prior by name, relative to 1/noise².
    """

    effect: AbstractEffect
    values: Float[np.ndarray, " p"]
    support: Int[np.ndarray, " p"]
    determined: Bool[np.ndarray, " p"]
    share: float
    contribution: Float[np.ndarray, " t"]
    fit: "AxisFit" = dataclasses.field(repr=False)
    smoothness: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def standard_deviation(self) -> Float[np.ndarray, " p"]:
        """Of the values under the stated gauge, same unit; inf where the data do not tell them."""
        return np.asarray(self.fit.deviation[self.places])

    @property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Joint covariance of the values, under the gauge of the fit.

        It knows of lags and of noise that drifts, as the deviations do. A value that the
        readings do not tell has the variance inf, and NaN beside it.
        """
        return self.fit.covariance(self.places)

    @property
    def places(self) -> Int[np.ndarray, " p"]:
        """Which unknowns of its axis the values are."""
        return self.fit.design.places_of(self.name)

    @property
    def lags(self) -> Mapping[str, tuple[float, float]]:
        """Time constant in s and its standard deviation, by sensor; empty without."""
        deviation = self.fit.lag_deviation
        return {
            sensor: (lag.value, deviation[sensor])
            for sensor, lag in self.fit.lags.items()
            if sensor in self.effect.sensor_names
        }

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def labels(self) -> tuple[str, ...]:
        """What each value is, in words."""
        return self.effect.labels

    @property
    def table(self) -> Float[np.ndarray, "..."]:
        """Values in the shape in which lists hold them."""
        return self.effect.table(self.values)

    @property
    def known(self) -> bool:
        """Whether all values that any reading reaches are determined, and there are some."""
        reached = self.support > 0
        return bool(reached.any() and self.determined[reached].all())


@dataclasses.dataclass(frozen=True)
class JointFit:
    """Effects fitted together; signs are those of the *error*.

    error = datum + sum of the effects + run effects + noise, per compensated axis.

    Attributes:
        parts: One per effect, in the order given.
        noise: Standard deviation of one reading by axis in mm or °, wild ones left out.
        residual: Error − fit (run effects included) by axis; NaN where it was not used.
        share: Weight that the loss left each reading, 0 to 1, by axis.
        wild: Readings that the loss rejected outright, by axis.
        runs: Offset and drift of each run against the datum, by axis.
        gauges: What may be moved between effects without changing the sum.
        confusions: What these data cannot tell apart.
        fits: Of each axis: its stack, and what its rows tell, with the rules of the gauge.
    """

    parts: tuple[Part, ...]
    noise: Mapping[str, float]
    residual: Mapping[str, Float[np.ndarray, " t"]]
    share: Mapping[str, Float[np.ndarray, " t"]]
    wild: Mapping[str, Bool[np.ndarray, " t"]]
    runs: Mapping[str, tuple[RunEffect, ...]]
    gauges: tuple[Gauge, ...]
    confusions: tuple[Confusion, ...]
    fits: Mapping[str, "AxisFit"] = dataclasses.field(repr=False)

    @property
    def datum(self) -> dict[str, tuple[float, float]]:
        """Constant of each axis in mm or °, and its standard deviation."""
        return {axis: fit.datum for axis, fit in self.fits.items()}

    @property
    def converged(self) -> bool:
        """Whether the iterations reached their tolerance."""
        return all(fit.estimate.converged for fit in self.fits.values())

    @property
    def message(self) -> str:
        """One sentence or more on how the fit went."""
        if len(self.fits) == 1:
            return next(iter(self.fits.values())).message
        fits = self.fits.items()
        return " ".join(f"Axis {axis}: {fit.message}" for axis, fit in fits)

    def part(self, name: str) -> Part:
        """Return the part with this name.

        Raises:
            KeyError: If there is none.
        """
        return {part.name: part for part in self.parts}[name]

    def predict(
        self, data: JointData, *, runs: bool = False
    ) -> dict[str, Float[np.ndarray, " t"]]:
        """Return datum and sum of all effects by axis, in mm or °.

        A lag needs the whole recording: predict all of it, then take the rows.

        Args:
            data: Rows.
            runs: Add what was taken off the runs, drift included, by run and time.
        """
        rows, result = np.arange(len(data)), {}
        for axis, fit in self.fits.items():
            total = np.full(len(data), fit.theta[fit.design.datum])
            for part in (part for part in self.parts if part.effect.axis == axis):
                total += part.effect.curve(part.values, data)
            course = fit.design.course.columns(data, axis, rows) if runs else {}
            for rank, columns in course.items():
                total += columns @ fit.theta[fit.design.places_of_rank(rank)]
            result[axis] = total
        return result

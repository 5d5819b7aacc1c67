"""What is said of a fitted axis: deviations, noise with a memory, runs, parts.

The model has white noise beside a drift that wanders (where one is stated at all). What a
reference does that is no such walk stays in the residual, and looks to a slow effect (a
temperature, above all) like its own. The scores of stretches of the recording tell how much:
their scatter, through the solution, is the variance that the values really have (the
"sandwich" of robust statistics, clustered in time). It is compared per effect with that of the
same residual in another order, so that values which few stretches touch are judged together.
"""

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import Posterior
from .._types import RunEffect
from ._axis import AxisFit
from ._data import JointData
from ._gauge import Rules
from ._lag import FoundLag
from ._result import Part, RunCurve

_STRETCHES = 24
"""Of the recording: long against the memory of the noise, and enough to scatter."""
_FEWEST = 20
"""Readings of a stretch below which nothing is judged."""
_DRAWS = 4
"""Other orders of the residual."""
_CHANCE = 1.8
"""Ratio of variances up to which 24 stretches differ by chance, at two deviations."""


def variances(found: Posterior, rules: Rules) -> Float[np.ndarray, " n"]:
    """Return the variance of each unknown under the rules, per variance of one reading.

    Moving to the rule changes what is unknown: from the spread of the values as solved it
    takes what may be moved between effects, which says nothing about either.
    """
    plain = found.inverse_diagonal
    if not rules.null.shape[1]:
        return plain
    spread = found.factor.solve(np.ascontiguousarray(rules.gain.T))
    inner = rules.gain @ spread
    result = plain - 2.0 * (spread * rules.null).sum(axis=1)
    result += ((rules.null @ inner) * rules.null).sum(axis=1)
    return np.asarray(np.maximum(result, 0.0))


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Report:
    """What is said of one axis.

    Attributes:
        data: All readings.
        fit: Of the axis.
    """

    data: JointData
    fit: AxisFit

    @cached_property
    def left(self) -> Float[np.ndarray, " r"]:
        """Error − fit of the readings that were used."""
        return np.asarray(self.fit.error - self.fit.design.columns @ self.fit.theta)

    @property
    def share(self) -> Float[np.ndarray, " r"]:
        """Weight that the loss left each of them."""
        loss = self.fit.estimate.loss
        share = loss.share(self.left / loss.scale)
        return np.where(self.fit.active, share, 0.0)

    def over_rows(self, values: np.ndarray, empty: float | bool) -> np.ndarray:
        """Return values of the used readings over all rows."""
        whole = np.full(len(self.data), empty)
        whole[self.fit.design.rows] = values
        return whole

    @cached_property
    def deviation(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of each unknown; inf where it is confused."""
        post, known = self.fit.estimate.posterior, self.fit.known
        variance = variances(post, known.rules) * post.variance * self._swell()
        for found in self.lags.values():
            moved = known.rules.project(found.slope)
            variance = variance + np.square(moved * found.deviation)
        return np.where(known.lost, np.inf, np.sqrt(variance))

    @cached_property
    def message(self) -> str:
        """One sentence or more on how the fit went."""
        used, rejected = self.fit.estimate.posterior.used, int((~self.fit.active).sum())
        message = f"{len(self.left)} readings, {used:.1f} effective parameters."
        if rejected:
            message += f" {rejected} wild readings were left out."
        if not self.fit.converged:
            message += " The iterations did not settle; treat the result with care."
        return message

    @cached_property
    def _stretches(self) -> list[Int[np.ndarray, " s"]]:
        """Rows of stretches of the recording in order of time; none where they are short."""
        order = np.arange(len(self.left))
        if self.data.time is not None:
            time = np.asarray(self.data.time)[self.fit.design.rows]
            order = np.argsort(time, kind="stable")
        active = order[self.fit.pseudo[order] != 0.0]
        if len(active) < _FEWEST * _STRETCHES:
            return []
        return np.array_split(active, _STRETCHES)

    def _swell(self) -> Float[np.ndarray, " n"]:
        """Return the factor of each unknown's variance that the noise's memory asks for, ≥ 1."""
        design, fit, stretches = self.fit.design, self.fit, self._stretches
        swell = np.ones(design.size)
        if not stretches:
            return swell
        rng = np.random.default_rng(0)
        pseudo = fit.pseudo[np.concatenate(stretches)]
        orders = np.stack([pseudo, *(rng.permutation(pseudo) for _ in range(_DRAWS))])
        ends = np.cumsum([len(own) for own in stretches])[:-1]
        scores = [
            design.columns[own].T @ part.T
            for own, part in zip(stretches, np.split(orders, ends, axis=1), strict=True)
        ]
        moved = fit.estimate.posterior.factor.solve(np.hstack(scores))
        moved = fit.known.rules.project(moved).reshape(design.size, len(stretches), -1)
        # The prior holds the sum of the scores away from zero: that is no scatter.
        spread = moved.var(axis=1)
        for part in design.components:
            seen, white = spread[part.places, 0], spread[part.places, 1:]
            typical = float(white.mean())
            ratio = float(seen.mean()) / typical if typical > 0.0 else 1.0
            if ratio > _CHANCE:
                swell[part.places] = ratio
        return swell

    def _swell_along(self, direction: Float[np.ndarray, " r"]) -> float:
        """Return that factor for one value that moves the readings like this."""
        if not self._stretches:
            return 1.0
        pseudo, active = self.fit.pseudo, np.concatenate(self._stretches)
        seen = np.var([direction[own] @ pseudo[own] for own in self._stretches])
        white = float(np.var(pseudo[active]) * np.square(direction[active]).mean())
        white *= len(active) / _STRETCHES
        ratio = float(seen) / white if white > 0.0 else 1.0
        return ratio if ratio > _CHANCE else 1.0

    @cached_property
    def lags(self) -> dict[str, FoundLag]:
        """Lags, their deviations such as noise with a memory leaves them."""
        result = {}
        for sensor, found in self.fit.lags.items():
            swell = float(np.sqrt(self._swell_along(found.direction)))
            deviation = found.deviation * swell
            result[sensor] = dataclasses.replace(found, deviation=deviation)
        return result

    def runs(self) -> tuple[RunEffect, ...]:
        """Return offset and drift of each run against the datum."""
        fit, design = self.fit, self.fit.design
        if not design.course.runs:
            return ()
        own = design.places_of_kind("runs").reshape(len(design.course.runs), -1)
        picks = np.zeros((2, len(own), design.size))
        for number, knots in enumerate(own):
            picks[0, number, knots] = 1.0 / len(knots)
            picks[1, number, knots[-1]] += 1.0
            picks[1, number, knots[0]] -= 1.0
        rules, whole = fit.known.rules, picks.reshape(-1, design.size).T
        # Functionals of the values under the rule, as functionals of the values as solved.
        before = whole - rules.gain.T @ (rules.null.T @ whole)
        post = fit.estimate.posterior
        spread = (before * post.factor.solve(before)).sum(axis=0) * post.variance
        deviation = np.sqrt(np.maximum(spread, 0.0)).reshape(2, -1)
        numbers = np.stack(
            [picks[0] @ fit.theta, deviation[0], picks[1] @ fit.theta, deviation[1]]
        )
        return tuple(
            RunEffect(run, *each)
            for run, each in zip(design.course.runs, numbers.T.tolist(), strict=True)
        )

    def curves(self) -> tuple[RunCurve, ...]:
        """Return what was taken off each run, over the time."""
        design, theta, course = self.fit.design, self.fit.theta, self.fit.design.course
        if not course.runs:
            return ()
        value = np.zeros((len(course.runs), course.pieces * course.steps + 1))
        for kind, own in (("runs", course.offsets), ("wander", course.bridges)):
            places = design.places_of_kind(kind)
            value = value + theta[places].reshape(len(value), own.shape[1]) @ own.T
        times = [np.linspace(*span, value.shape[1]) for span in course.spans]
        times = times or [np.zeros(0)] * len(value)
        return tuple(map(RunCurve, course.runs, times, value))

    def part(self, place: int) -> Part:
        """Return one fitted effect."""
        fit, design = self.fit, self.fit.design
        effect, places = design.effects[place], design.places_of(place)
        values = fit.theta[places]
        block = effect.block(self.data)
        contribution = np.where(block.known, block.columns @ values, np.nan)
        used = contribution[design.rows]
        unknown: Bool[np.ndarray, " n"] = fit.known.unknown
        return Part(
            effect=effect,
            values=values,
            standard_deviation=self.deviation[places],
            support=design.support(fit.active)[places],
            determined=~unknown[places],
            labels=design.labels[place],
            share=fit.known.share_of(place),
            contribution=contribution,
            rms=float(np.sqrt(np.mean(np.square(used)))),
            smoothness=fit.smoothness().get(effect.name, {}),
            lags={
                sensor: (found.value, found.deviation)
                for sensor, found in self.lags.items()
                if sensor in effect.sensor_names
            },
        )

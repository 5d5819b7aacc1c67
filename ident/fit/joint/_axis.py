"""The fit of one compensated axis: its stack, the lags of its sensors, and what is said of it.

The model has white noise beside a drift that wanders (where one is stated at all). What a
reference does that is no such walk stays in the residual, and looks to a slow effect (a
temperature, above all) like its own. The scores of stretches of the recording tell how much:
their scatter, through the solution, is the variance that the values really have (the
"sandwich" of robust statistics, clustered in time). It is compared per effect with that of the
same residual in another order, so that values which few stretches touch are judged together.
Stretches of a short recording are no longer than what the noise remembers: where a drift shows
and the unknowns are few enough, the variance is that under the drift (`DriftNoise`).
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...core import (
    DriftNoise,
    Estimate,
    FitError,
    Posterior,
    Problem,
    Readings,
    estimate,
    find_drift,
    memory,
    one_blas_thread,
    scatter_of_sums,
    variances_of_sums,
)
from .._checks import check_smoothness
from .._identifiable import SINGULAR, pivoted
from .._steps import Steps
from .._table import fixed_weights, floor_of
from .._types import RunEffect
from ._design import Design, design_of
from ._effect import TABLES, AbstractEffect, Rank
from ._gauge import Unheld
from ._identified import Identified, identified
from ._lag import FoundLag, find_lags, lagging, sensed_variances, sensors_to_fit
from ._result import Options, Part, Smoothness

Vector = Float[np.ndarray, " _n"]

_LAG_ROUNDS = 6
"""Rounds of lags and everything else; they end where no lag moves any more."""
_STRETCHES, _FEWEST = 24, 20
"""Of the recording: long against the memory of the noise, and enough to scatter; and readings
of a stretch below which nothing is judged."""
_LARGE = 1 << 18
"""Readings × unknowns up to which the drift itself is estimated."""
_LEAST_FREE = 3.0
"""Independent readings that are granted to a drift, however slow."""
_DRAWS = 4
"""Other orders of the residual."""
_CHANCE = 1.8
"""Ratio of variances up to which 24 stretches differ by chance, at two deviations."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class AxisFit:
    """A fitted axis.

    Attributes:
        data: All readings.
        known: What its rows tell, whatever was measured in them.
        estimate: Of its stack.
        lags: By sensor.
    """

    data: JointData
    known: Identified
    estimate: Estimate
    lags: Mapping[str, FoundLag]

    @property
    def design(self) -> Design:
        """Columns."""
        return self.known.design

    @cached_property
    def theta(self) -> Float[np.ndarray, " n"]:
        """Values under the rules."""
        return self.known.rules.project(self.estimate.values)

    @cached_property
    def pseudo(self) -> Float[np.ndarray, " r"]:
        """Pseudo-readings of the last pass about the estimate before it, see `_pseudo`."""
        return _pseudo(self.design, self.data, self.estimate)

    @cached_property
    def active(self) -> Bool[np.ndarray, " r"]:
        """Readings that are believed at all."""
        found = self.estimate
        left = _error(self.design, self.data) - self.design.columns @ found.centre
        return np.asarray(~found.loss.wild(left / found.loss.scale))

    def smoothness(self) -> dict[str, dict[str, float]]:
        """Return the weights of each table, and of the drift, by name."""
        weights = iter(self.estimate.posterior.weights.tolist())
        return {
            part.name: {name: next(weights) for name in part.weights}
            for part in self.design.named
        }

    @cached_property
    def left(self) -> Float[np.ndarray, " r"]:
        """Error − fit of the readings that were used."""
        error = _error(self.design, self.data)
        return np.asarray(error - self.design.columns @ self.theta)

    @property
    def message(self) -> str:
        """One sentence or more on how the fit went."""
        return self.estimate.message(len(self.left))

    @property
    def datum(self) -> tuple[float, float]:
        """Constant of the axis in mm or °, and its standard deviation."""
        at = self.design.datum
        return float(self.theta[at]), float(self.deviation[at])

    @property
    def share(self) -> Float[np.ndarray, " r"]:
        """Weight that the loss left each of them."""
        loss = self.estimate.loss
        share = loss.share(self.left / loss.scale)
        return np.where(self.active, share, 0.0)

    def over_rows(self, values: np.ndarray, empty: float | bool) -> np.ndarray:
        """Return values of the used readings over all rows."""
        whole = np.full(len(self.data), empty)
        whole[self.design.rows] = values
        return whole

    @cached_property
    @one_blas_thread()
    def deviation(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of each unknown; inf where it is confused."""
        known = self.known

        def under_rules(post: Posterior) -> tuple[Vector, Vector]:
            return known.rules.project(post.values), known.variances(post)

        white: Vector = np.asarray(self.estimate.spread(under_rules))
        if self.drift is None:
            variance = white * self._swell
        else:
            sums = variances_of_sums(self.drift, self._clock, self._moves)
            scatter = self.estimate.scatter[0] * np.square(self._moves).sum(axis=0)
            variance = white + self._heavy * sums - scatter
        for sensor, found in self.lags.items():
            moved = known.rules.project(found.slope)
            variance = variance + np.square(moved * self.lag_deviation[sensor])
        variance = variance + self._rounded
        return np.where(known.lost, np.inf, np.sqrt(np.maximum(variance, 0.0)))

    @cached_property
    def _stretches(
        self,
    ) -> list[tuple[Int[np.ndarray, " s"], Float[np.ndarray, "s d"]]]:
        """Rows of stretches in order of time, and the residual as it is and in other orders.

        None where the stretches are short.
        """
        order = np.arange(len(self.left))
        if self.data.time is not None:
            time = np.asarray(self.data.time)[self.design.rows]
            order = np.argsort(time, kind="stable")
        active = order[self.pseudo[order] != 0.0]
        if len(active) < _FEWEST * _STRETCHES:
            return []
        rng = np.random.default_rng(0)
        pseudo = self.pseudo[active]
        orders = [pseudo, *(rng.permutation(pseudo) for _ in range(_DRAWS))]
        rows = np.array_split(active, _STRETCHES)
        residuals = np.array_split(np.stack(orders, axis=1), _STRETCHES)
        return list(zip(rows, residuals, strict=True))

    @cached_property
    def _swell(self) -> Float[np.ndarray, " n"]:
        """Return the factor of each unknown's variance that the noise's memory asks for, ≥ 1."""
        design = self.design
        swell = np.ones(design.size)
        if not self._stretches:
            return swell
        scores = [design.columns[own].T @ rest for own, rest in self._stretches]
        moved = self.estimate.posterior.factor.solve(np.hstack(scores))
        moved = self.known.rules.project(moved).reshape(design.size, len(scores), -1)
        # The prior holds the sum of the scores away from zero: that is no scatter.
        spread = moved.var(axis=1)
        for part in design.components:
            seen, white = spread[part.places, 0], spread[part.places, 1:]
            swell[part.places] = _memory(float(seen.mean()), float(white.mean()))
        return swell

    @cached_property
    def drift(self) -> DriftNoise | None:
        """Noise of a recording with few unknowns, where it drifts."""
        count = len(self._believed)
        if not count or count * self.design.size > _LARGE:
            return None
        columns = [self.design.columns[self._believed].toarray()]
        for found in self.lags.values():
            # What is left of a lag beside the columns, as large as they are.
            own = found.direction[self._believed, None]
            columns.append(own / max(float(np.abs(own).max()), 1e-300))
        basis, size, _ = pivoted(np.hstack(columns))
        seen = basis[:, size > SINGULAR * size.max(initial=0.0)]
        pseudo, clock = self.pseudo[self._believed], self._clock
        noise = find_drift(clock, seen, pseudo, np.ones(len(pseudo)))
        return noise if noise.drift > 0.0 else None

    @cached_property
    def _believed(self) -> Int[np.ndarray, " s"]:
        """Readings that are believed."""
        return np.flatnonzero(self.pseudo != 0.0)

    @property
    def _clock(self) -> Float[np.ndarray, " s"]:
        """Their instants in s; their order where one of these was not recorded."""
        rows = self.design.rows[self._believed]
        time = None if self.data.time is None else np.asarray(self.data.time)[rows]
        known = time is not None and bool(np.isfinite(time).all())
        return np.asarray(time if known else rows, float)

    @cached_property
    def _moves(self) -> Float[np.ndarray, "s n"]:
        """How each of them moves the values under the rules."""
        columns = self.design.columns[self._believed].toarray()
        moves = self.estimate.posterior.factor.solve(np.ascontiguousarray(columns.T))
        return np.asarray(self.known.rules.project(moves).T)

    @cached_property
    def _heavy(self) -> Float[np.ndarray, " n"]:
        """How much larger variances are since the drift is not known either.

        It rests on as many independent readings as tell the values: Student's t.
        """
        assert self.drift is not None
        drifting = variances_of_sums(self.drift, self._clock, self._moves)
        total = self.drift.white**2 + self.drift.drift**2
        plain, heavy = (
            total * np.square(self._moves).sum(axis=0),
            np.ones(len(drifting)),
        )
        for part in self.design.components:
            swell = float((drifting / np.maximum(plain, 1e-300))[part.places].max())
            free = max(len(self._moves) / max(swell, 1.0), _LEAST_FREE)
            heavy[part.places] = free / (free - 2.0)
        return heavy

    @one_blas_thread()
    def covariance(self, places: Int[np.ndarray, " p"]) -> Float[np.ndarray, "p p"]:
        """Return the joint covariance of some unknowns, see `Part.covariance`."""
        known, functionals = self.known, np.zeros((self.design.size, len(places)))
        functionals[places, np.arange(len(places))] = 1.0

        def of_places(post: Posterior) -> tuple[np.ndarray, np.ndarray]:
            values = known.rules.project(post.values)[places]
            return values, known.covariance(post, functionals)

        found = self.estimate.spread(of_places)
        if self.drift is None:
            swell = np.sqrt(self._swell[places])
            found = found * np.outer(swell, swell)
        else:
            moves, heavy = self._moves[:, places], np.sqrt(self._heavy[places])
            sums = scatter_of_sums(self.drift, self._clock, moves, np.ones(len(moves)))
            found = found + np.outer(heavy, heavy) * sums
            found = found - self.estimate.scatter[0] * (moves.T @ moves)
        for sensor, lag in self.lags.items():
            moved = known.rules.project(lag.slope)[places] * self.lag_deviation[sensor]
            found = found + np.outer(moved, moved)
        found = found + np.diag(self._rounded[places])
        lost = known.lost[places]
        found[lost], found[:, lost] = np.nan, np.nan
        found[lost, lost] = np.inf
        return np.asarray(found)

    @cached_property
    def _rounded(self) -> Float[np.ndarray, " n"]:
        """Variance of each unknown by what the instrument rounds off every time at a place."""
        steps, found = _steps(self.design, self.data), np.zeros(self.design.size)
        common = steps.common(self.left, ~self.active)
        for part in self.design.components:
            found[part.places] = common if part.rank in TABLES else 0.0
        return found

    @cached_property
    def lag_deviation(self) -> dict[str, float]:
        """Standard deviation of each lag in s, such as noise with a memory leaves it."""
        result: dict[str, float] = {}
        sensed = sensed_variances(
            self.design, self.data, self.estimate.values, self.active, self.lags
        )
        for sensor, found in self.lags.items():
            seen = [found.direction[own] @ rest[:, 0] for own, rest in self._stretches]
            swell = 1.0
            if seen:
                own = np.concatenate([rows for rows, _ in self._stretches])
                white = np.var(self.pseudo[own]) * np.square(found.direction[own]).sum()
                swell = _memory(float(np.var(seen)), float(white) / _STRETCHES)
            if self.drift is not None and found.value > 0.0:
                way = found.direction[self._believed, None]
                white = self.estimate.scatter[0] * np.square(way).sum()
                drifting = variances_of_sums(self.drift, self._clock, way)[0]
                swell = max(swell, float(drifting / white))
            variance = found.deviation**2
            # What the residual shows of a sensor's noise is part of its memory.
            variance = max(swell * variance, variance + sensed.get(sensor, 0.0))
            result[sensor] = float(np.sqrt(variance))
        return result

    def runs(self) -> tuple[RunEffect, ...]:
        """Return offset and drift of each run against the datum."""
        design = self.design
        if not design.course.runs:
            return ()
        own = design.places_of_rank(Rank.RUNS).reshape(len(design.course.runs), -1)
        picks = np.zeros((2, len(own), design.size))
        for number, knots in enumerate(own):
            picks[0, number, knots] = 1.0 / len(knots)
            picks[1, number, knots[-1]] += 1.0
            picks[1, number, knots[0]] -= 1.0
        post, functionals = self.estimate.posterior, picks.reshape(-1, design.size).T
        spread = np.diag(self.known.covariance(post, functionals))
        spread = spread * self.estimate.scatter[0]
        deviation = np.sqrt(np.maximum(spread, 0.0)).reshape(2, -1)
        numbers = np.stack(
            [picks[0] @ self.theta, deviation[0], picks[1] @ self.theta, deviation[1]]
        )
        return tuple(
            RunEffect(run, *each)
            for run, each in zip(design.course.runs, numbers.T.tolist(), strict=True)
        )

    def parts(self) -> list[Part]:
        """Return the fitted effects."""
        return [self._part(effect) for effect in self.design.effects]

    def _part(self, effect: AbstractEffect) -> Part:
        design = self.design
        places = design.places_of(effect.name)
        block, values = effect.block(self.data), self.theta[places]
        contribution = np.where(block.known, block.columns @ values, np.nan)
        return Part(
            effect=effect,
            values=values,
            support=self.estimate.posterior.problem.sums.support[places],
            determined=~self.known.unknown[places],
            share=self.known.share_of(effect.name),
            contribution=contribution,
            rms=float(np.sqrt(np.mean(np.square(contribution[design.rows])))),
            fit=self,
            smoothness=self.smoothness().get(effect.name, {}),
        )


def _memory(seen: float, white: float) -> float:
    """Return by how much a variance exceeds that of white noise, ≥ 1; not by chance."""
    ratio = seen / white if white > 0.0 else 1.0
    return ratio if ratio > _CHANCE else 1.0


def _pseudo(
    design: Design, data: JointData, found: Estimate
) -> Float[np.ndarray, " r"]:
    """Return the pseudo-readings about `Estimate.centre`, 0 where one is not believed."""
    left = _error(design, data) - design.columns @ found.centre
    share = found.loss.share(left / found.loss.scale)
    return np.asarray(share * left / found.posterior.problem.gain)


def fit_axis(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    options: Options,
    use: Bool[np.ndarray, " t"] | None,
) -> AxisFit:
    """Fit all effects of one axis.

    Args:
        axis: Compensated axis.
        effects: Its effects, nodes placed.
        data: Readings.
        options: How to fit.
        use: Rows to fit; None = all.

    Raises:
        FitError: If the readings do not determine them or an option is unknown.
    """
    sensors = sensors_to_fit(effects)
    lags: dict[str, FoundLag] = {}
    design = design_of(axis, effects, data, options.drift, use)
    unheld, found = _estimated(design, data, options, None, rough=bool(sensors))
    values = dict.fromkeys(sensors, 0.0)
    for turn in range(_LAG_ROUNDS if sensors else 0):
        before = values
        lags = find_lags(design, data, found, _pseudo(design, data, found), before)
        values = {sensor: lag.value for sensor, lag in lags.items()}
        if turn and values == before:
            break
        design = lagging(design, data, values)
        unheld, found = _estimated(design, data, options, found)
    else:
        # Nothing to find, or no end to it.
        found = dataclasses.replace(found, converged=found.converged and not sensors)
    return AxisFit(data, identified(design, unheld, data, options.drift), found, lags)


def _error(design: Design, data: JointData) -> Float[np.ndarray, " r"]:
    return np.asarray(data.error[design.axis][design.rows], float)


def _steps(design: Design, data: JointData) -> Steps:
    """Return the steps in which the instrument reads; a place is one of all axes."""
    columns = [*data.position.values(), *data.direction.values()]
    places = [np.nan_to_num(each)[design.rows] for each in columns]
    return Steps.of(_error(design, data), places)


def _estimated(
    design: Design,
    data: JointData,
    options: Options,
    near: Estimate | None,
    rough: bool = False,
) -> tuple[Unheld, Estimate]:
    """Return what nothing holds, and the fit of the stack for given lags."""
    unheld, error = Unheld.of(design), _error(design, data)
    if len(error) - unheld.free < 1:
        msg = (
            f"axis {design.axis}: {len(error)} readings leave nothing to judge the "
            f"noise by; expected more than {unheld.free}."
        )
        raise FitError(msg)
    start = np.zeros(design.size)
    start[design.datum] = float(np.median(error))
    return unheld, estimate(
        design.stack,
        memory(design.stack, Readings(error, {}), design.columns),
        loss=options.loss,
        weights=_weights(design, options.smoothness),
        floor=max(floor_of(error), _steps(design, data).size),
        start=start,
        pins=unheld.pins if unheld.pins.any() else None,
        near=near,
        rough=rough,
    )


def _weights(
    design: Design, smoothness: Smoothness
) -> Callable[[Problem], Float[np.ndarray, " k"]] | None:
    """Return the weights that were asked for, given the sums; None: by evidence."""
    wanted: float | Mapping[Any, float]
    if isinstance(smoothness, Mapping):
        parts = smoothness.items()
        wanted = {(part, name): w for part, own in parts for name, w in own.items()}
    else:
        check_smoothness(smoothness)
        if isinstance(smoothness, str):
            return None
        wanted = smoothness
    names = [(part.name, name) for part in design.named for name in part.weights]
    return fixed_weights(wanted, names)

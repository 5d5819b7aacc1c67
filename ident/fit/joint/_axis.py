"""The fit of one compensated axis: its stack, the lags of its sensors, and what is said of it."""

import contextlib
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.signals import NORMAL
from ... import core
from ..._recording import JointData
from .._result import suspect_runs
from .._table import fixed_weights
from .._types import RunEffect, Smoothness
from ._design import Design, design_of, run_of
from ._effect import TABLES, AbstractEffect, Rank
from ._identified import Identified, identified
from ._lag import WORTH, FoundLag, find_lags, lag_bounds, lagging, sensed_variances
from ._memory import Memory, times

_SURE = 2.0
"""Deviations that a lag differs from none by, at least."""
_LAG_STARTS, _LAG_ROUNDS = 5, 6
"""Lags that the first is chosen from; rounds of lags and everything else, which end where no lag
moves any more."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class AxisFit:
    """A fitted axis.

    Attributes:
        design: Columns.
        estimate: Of its stack.
        lags: By sensor.
    """

    design: Design
    estimate: core.Estimate
    lags: Mapping[str, FoundLag]

    @cached_property
    def known(self) -> Identified:
        """What the rows tell, whatever was measured; what only wild ones reach none does."""
        every, believed = self.design, self.design.take(self.active)
        same = np.array_equal(believed.reached, every.reached)
        same = same and believed.unheld.shape == every.unheld.shape
        return identified(every if same else believed)

    @cached_property
    def theta(self) -> Float[np.ndarray, " n"]:
        """Values under the rules."""
        return self.known.rules.project(self.estimate.values)

    @cached_property
    def pseudo(self) -> Float[np.ndarray, " r"]:
        """Pseudo-readings of the last pass about the estimate before it, 0 if not believed."""
        return self.estimate.pseudo(self._about)

    @cached_property
    def _about(self) -> Float[np.ndarray, " r"]:
        """Error − the estimate that the last pass was about."""
        fitted = self.design.columns @ self.estimate.centre
        return np.asarray(self.design.error - fitted)

    @cached_property
    def active(self) -> Bool[np.ndarray, " r"]:
        """Readings that are believed at all."""
        loss = self.estimate.loss
        return loss.share(self._about / loss.scale) > 0.0

    @property
    def counted(self) -> Bool[np.ndarray, " r"]:
        """Readings that the noise is judged by."""
        limit = self.estimate.loss.wild_from * self.estimate.loss.scale
        return np.asarray(self.active & (np.abs(self.residual) <= limit))

    @cached_property
    def residual(self) -> Float[np.ndarray, " r"]:
        """Error − fit of the readings that were used."""
        return np.asarray(self.design.error - self.design.columns @ self.theta)

    @property
    def message(self) -> str:
        """One sentence or more on how the fit went."""
        return self.estimate.message(len(self.residual))

    @property
    def datum(self) -> tuple[float, float]:
        """Constant of the axis in mm or °, and its standard deviation."""
        at = self.design.datum
        return float(self.theta[at]), float(self.deviation[at])

    @property
    def share(self) -> Float[np.ndarray, " r"]:
        """Weight that the loss left each of them."""
        loss = self.estimate.loss
        return np.where(self.active, loss.share(self.residual / loss.scale), 0.0)

    def over_rows(self, values: np.ndarray, empty: float | bool) -> np.ndarray:
        """Return values of the used readings over all rows."""
        whole = np.full(len(self.design.data), empty)
        whole[self.design.rows] = values
        return whole

    @cached_property
    @core.one_blas_thread()
    def deviation(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of each unknown; inf where it is confused."""
        variance = np.maximum(self._spread(self.known.variances), 0.0)
        return np.where(self.known.confounded, np.inf, np.sqrt(variance))

    @cached_property
    def memory(self) -> Memory:
        """What the noise remembers."""
        return Memory(self)

    @core.one_blas_thread()
    def covariance(self, places: Int[np.ndarray, " p"]) -> Float[np.ndarray, "p p"]:
        """Return the joint covariance of some unknowns, see `Part.covariance`."""
        known, functionals = self.known, np.zeros((self.design.size, len(places)))
        functionals[places, np.arange(len(places))] = 1.0

        def within(post: core.Posterior) -> core.Spread:
            return known.covariance(post, functionals)

        result, confounded = self._spread(within, places), known.confounded[places]
        result[confounded], result[:, confounded] = np.nan, np.nan
        result[confounded, confounded] = np.inf
        return np.asarray(result)

    def _spread(
        self,
        within: Callable[[core.Posterior], core.Spread],
        places: Int[np.ndarray, " p"] | slice = slice(None),
    ) -> core.Spread:
        """Return variances, or the covariance, of unknowns at some places under the rules.

        Given those of a posterior per variance of one reading.
        """
        project = self.known.rules.project
        white = self.estimate.spread(
            lambda post: (project(post.values)[places], within(post))
        )
        rounded = self._rounded[places]
        result = self.memory.swollen(white, places)
        result = result + (np.diag(rounded) if white.ndim > 1 else rounded)
        for sensor, lag in self.lags.items():
            change = project(lag.slope)[places] * self.lag_deviation[sensor]
            result = result + times(np.ones_like(white), change)
        return result

    @cached_property
    def _rounded(self) -> Float[np.ndarray, " n"]:
        """Variance of each unknown by what the instrument rounds off every time at a place."""
        common = self.design.steps.common(self.residual, ~self.active)
        result = np.zeros(self.design.size)
        for component in self.design.components:
            result[component.places] = common if component.rank in TABLES else 0.0
        return result

    @cached_property
    def lag_deviation(self) -> dict[str, float]:
        """Standard deviation of each lag in s, such as noise with a memory leaves it."""
        design, values = self.design, self.estimate.values
        sensed = sensed_variances(design, values, self.active, self.lags)
        result: dict[str, float] = {}
        for sensor, lag in self.lags.items():
            variance = lag.deviation**2
            swell = self.memory.swell_along(lag.direction)
            # What the residual shows of a sensor's noise is part of its memory.
            variance = max(swell * variance, variance + sensed.get(sensor, 0.0))
            result[sensor] = float(np.sqrt(variance))
        return result

    @property
    def suspects(self) -> tuple[int, ...]:
        """Runs that contradict the others; of those whose zero is the machine's."""
        design, own = self.design, self.design.course.counted
        runs = [each for k, each in enumerate(self.runs()) if not own or own[k]]
        run = run_of(design.data, design.axis, design.rows)
        return suspect_runs(runs, self.residual, run)

    def runs(self) -> tuple[RunEffect, ...]:
        """Return offset and drift of each run against the datum."""
        design = self.design
        if not design.course.runs:
            return ()
        places, count = design.places_of_rank(Rank.RUNS), len(design.course.runs)
        knots = np.eye(len(places) // count)
        shares = np.stack([knots.mean(axis=0), knots[-1] - knots[0]])
        rows = np.zeros((2, count, design.size))
        rows[:, :, places] = [np.kron(np.eye(count), share) for share in shares]
        post, functionals = self.estimate.posterior, rows.reshape(-1, design.size).T
        spread = np.diag(self.known.covariance(post, functionals))
        spread = spread * self.estimate.scatter[0]
        deviation = np.sqrt(np.maximum(spread, 0.0)).reshape(2, -1)
        numbers = np.stack([rows @ self.theta, deviation], axis=1).reshape(4, -1)
        pairs = zip(design.course.runs, numbers.T.tolist(), strict=True)
        return tuple(RunEffect(run, *values) for run, values in pairs)


def fit_axis(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    smoothness: Smoothness,
    drift: int,
    use: Bool[np.ndarray, " t"] | None,
    loss: str,
) -> AxisFit:
    """Fit all effects of one axis, their nodes placed; errors and arguments of `fit_joint`."""
    all_lags = [item for effect in effects for item in effect.lags.items()]
    sensors = dict.fromkeys(sensor for sensor, lag in all_lags if lag == "fit")
    lags: dict[str, FoundLag] = {}
    design = design_of(axis, effects, data, drift, use)
    estimated = partial(_estimated, smoothness, loss)
    fit = estimated(design, None, rough=bool(sensors))
    values = dict.fromkeys(sensors, 0.0)
    for sensor in sensors if loss != "gauss" else ():
        values, design, fit = _start(design, values, sensor, fit, estimated)
    for number in range(_LAG_ROUNDS if sensors else 0):
        before = values
        lags = find_lags(design, fit, before)
        values = {sensor: lag.value for sensor, lag in lags.items()}
        if number and values == before:
            break
        design = lagging(design, values)
        fit = estimated(design, fit)
    else:
        # Nothing to find, or no end to it.
        fit = dataclasses.replace(fit, converged=fit.converged and not sensors)
    found = AxisFit(design, fit, lags)
    vague = [
        s for s, lag in lags.items() if _SURE * found.lag_deviation[s] > lag.value > 0.0
    ]
    if not vague:
        return found
    # Noise with a memory looks like a lag that may as well be none.
    values |= dict.fromkeys(vague, 0.0)
    design = lagging(design, values)
    none = {s: dataclasses.replace(lags[s], value=0.0, deviation=0.0) for s in vague}
    fit = estimated(design, fit)
    return AxisFit(design, fit, lags | none)


def _start(
    design: Design,
    lags: Mapping[str, float],
    sensor: str,
    fit: core.Estimate,
    estimated: Callable[..., core.Estimate],
) -> tuple[dict[str, float], Design, core.Estimate]:
    """Return lags with a rough one of a sensor, their columns and a rough fit by these.

    Without its lag, what follows a quick change of temperature looks wild, so that the search
    for the lag would not see it: a robust fit of each trial lag is needed to tell.

    Args:
        design: Columns of these lags.
        lags: By sensor in s, 0 for this one.
        sensor: Whose lag is looked for.
        fit: By these columns.
        estimated: Fits a design, given the fit of one that is near.
    """
    trials = [(dict(lags), design, fit)]
    low, high = lag_bounds(design)
    for lag in np.exp(np.linspace(low, high, _LAG_STARTS + 2))[1:-1]:
        trial = {**lags, sensor: float(lag)}
        columns = lagging(design, trial)
        # One that is so long leaves nothing of a change.
        with contextlib.suppress(core.FitError):
            trials.append((trial, columns, estimated(columns, fit, rough=True)))
    sizes = np.array([d.error - d.columns @ f.values for _, d, f in trials])
    least = core.least_scale(design.error)
    scale = max(float(np.median(np.abs(sizes), axis=1).min()), least)
    # Minus log likelihood of Student's t: wild readings count alike for all lags.
    costs = 2.5 * np.log1p(np.square(sizes / (NORMAL * scale)) / 4.0).sum(axis=1)
    best = int(np.argmin(costs))
    return trials[best if costs[0] - costs[best] > WORTH else 0]


def _estimated(
    smoothness: Smoothness,
    loss: str,
    design: Design,
    near: core.Estimate | None,
    rough: bool = False,
) -> core.Estimate:
    """Return the fit of the stack for given lags."""
    error, weights = design.error, fixed_weights(smoothness)
    if len(error) <= design.free:
        msg = (
            f"axis {design.axis}: {len(error)} readings leave nothing to judge the "
            f"noise by; expected more than {design.free}."
        )
        raise core.FitError(msg)
    start = np.zeros(design.size)
    start[design.datum] = float(np.median(error))
    over = core.memory(design.stack, core.Readings(error, {}), design.columns)
    floor = max(core.least_scale(error), design.steps.size)
    passes = core.Passes(design.stack, over, loss, weights, floor, design.pins, rough)
    return passes.run(start, near)

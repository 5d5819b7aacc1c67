"""Lags between sensors and structure by variable projection.

For trial lags everything else is eliminated by the factor of a fit; the restricted likelihood
is then a function of the logarithms of the lags alone.

Source: G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize_scalar
from scipy.special import comb

from ..._recording import clocked, lagged
from ...core import Estimate, FitError, Loss, Posterior, Readings, sums_of
from ...core._readings import Vector
from ._design import Design

_GRID, _SWEEPS, _FINE = 14, 3, 1e-4
"""Lags that are tried first; sweeps over several sensors; logarithm at which a search ends."""
WORTH = 4.0
"""Gain in evidence below which there is no lag."""
_SETTLED = 0.01
"""Gain below which lags stay where they were: a tenth of a deviation, for a single one."""
_STEP = 0.02
"""Step in a lag for its slope, as a share of it."""
_ORDER, _DRAWS, _SHIFT = 3, 64, 1e-3
"""Order of the differences that tell the noise of a sensor; how often it is drawn anew; change
of a temperature in K for what it moves."""
_STRAIGHT = 1e-6
"""Change of a slope, in the largest one, up to which a line is straight."""
_RIDGE = 1e-9
_SEEN = 1e-9
"""Least share of a lag's effect that counts as its own beside all other unknowns."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class FoundLag:
    """The lag of one sensor in s, its standard deviation, and what it moves.

    Attributes:
        value: Time constant in s; 0 = none shows.
        deviation: Of it, in s.
        slope: Change of all unknowns per s.
        direction: Change of the fitted readings per s, that of the unknowns included.
    """

    value: float
    deviation: float
    slope: Float[np.ndarray, " n"]
    direction: Float[np.ndarray, " r"]


def lag_bounds(design: Design) -> tuple[float, float]:
    """Return the logarithms of the shortest and the longest lag that a clock could show.

    Raises:
        FitError: If there is no clock.
    """
    clock = design.data.clock_for(f"axis {design.axis}: a lag")
    clock = np.unique(clock[np.isfinite(clock)])
    if len(clock) < 3:
        msg = "all readings have the same time, expected a clock that runs."
        raise FitError(msg)
    span, gap = float(clock[-1] - clock[0]), float(np.median(np.diff(clock)))
    return float(np.log(max(gap, 1e-4 * span))), float(np.log(span))


def find_lags(
    design: Design, fit: Estimate, near: Mapping[str, float]
) -> dict[str, FoundLag]:
    """Return the lags with the best evidence, smoothness and weights of readings as they are.

    Args:
        design: Columns; of its data a lag remembers the rows that are not fitted, too.
        fit: By the same columns.
        near: Lags that are about right in s, by sensor; 0 = unknown.

    Raises:
        FitError: If there is no clock.
    """
    low, high = lag_bounds(design)
    fitted = design.columns @ fit.centre
    pseudo = fit.pseudo(design.error - fitted)
    active, problem = pseudo != 0.0, fit.posterior.problem
    believed = sp.diags_array(active.astype(float))
    readings = Readings(np.where(active, pseudo + fitted, 0.0), {})

    def posterior(trial: Design) -> Posterior | None:
        """Return the posterior by other columns; None where the matrix is singular.

        The matrix of the fit may hold a few readings that are not believed: their errors are more
        than a lag explains.
        """
        columns = sp.csr_array(believed @ trial.columns)
        about = problem.stack, readings, fit.centre, Loss()
        sums, _ = sums_of(*about, design=columns)
        linear = dataclasses.replace(problem, sums=sums, theta=fit.centre, gain=1.0)
        return linear.at(fit.posterior.weights)

    def evidence(lags: Mapping[str, float]) -> float:
        trial = lagging(design, lags)
        return _evidence(trial, posterior(trial), active)

    lags, width = dict(near), (high - low) / (_GRID - 1)
    for sensor, start in near.items():
        # One after the other roughly; then each between its neighbours on the grid.
        grid = np.log([start]) if start > 0.0 else np.linspace(low, high, _GRID)
        trials = [{**lags, sensor: float(lag)} for lag in np.exp(grid)]
        costs = [evidence(trial) for trial in trials]
        best = int(np.argmin(costs))
        without = {**lags, sensor: 0.0}
        lags = trials[best] if evidence(without) - costs[best] > WORTH else without
    shown = [sensor for sensor, lag in lags.items() if lag > 0.0]
    for sensor in shown * (_SWEEPS if len(shown) > 1 else 1):
        middle = float(np.log(lags[sensor]))
        bracket = max(low, middle - width), min(high, middle + width)

        def cost(log: float, sensor: str = sensor) -> float:
            return evidence({**lags, sensor: float(np.exp(log))})

        optimum = minimize_scalar(cost, bounds=bracket, options={"xatol": _FINE})
        lags[sensor] = float(np.exp(optimum.x))
    if evidence(near) - evidence(lags) < _SETTLED:
        lags = dict(near)
    design = lagging(design, lags)
    # Without any residual there is none that could have changed sides.
    return _with_deviations(design, posterior(design) or fit.posterior, active, lags)


def _evidence(
    design: Design, post: Posterior | None, active: Bool[np.ndarray, " r"]
) -> float:
    """Return the evidence of the lags of columns, by readings that are believed.

    Relative to the columns of the temperatures alone: their size, and how alike they are, is no
    evidence.
    """
    if post is None:
        return np.inf
    warm = design.columns[active][:, _heated_places(design)].toarray()
    scale = np.sqrt(np.maximum(np.square(warm).sum(axis=0), 1e-300))
    alone = (warm / scale).T @ (warm / scale) + _RIDGE * np.eye(len(scale))
    size = np.linalg.slogdet(alone)[1] + 2.0 * np.log(scale).sum()
    return post.evidence - float(size)


def lagging(design: Design, lags: Mapping[str, float]) -> Design:
    """Return a design with other lags by sensor: only the columns of temperatures change."""
    effects = tuple(effect.lagging(lags) for effect in design.effects)
    blocks = [effect.block(design.data) for effect in effects if effect.sensor_names]
    places, order = _heated_places(design), np.arange(design.size)
    order[places] = design.size + np.arange(len(places))
    heated = [block[design.rows] for block, _ in blocks]
    both: Any = sp.hstack([design.columns, *heated], format="csc")
    columns = sp.csr_array(both[:, order])
    return dataclasses.replace(design, effects=effects, columns=columns)


def _with_deviations(
    design: Design,
    post: Posterior,
    active: Bool[np.ndarray, " r"],
    lags: Mapping[str, float],
) -> dict[str, FoundLag]:
    """Return the lags with their deviations: as further columns, linear near the best ones."""
    delayed = [sensor for sensor, lag in lags.items() if lag > 0.0]
    change = np.zeros((len(design.rows), len(delayed)))
    for k, sensor in enumerate(delayed):
        ends = [lags[sensor] * (1.0 + sign * _STEP) for sign in (1.0, -1.0)]
        designs = (lagging(design, {**lags, sensor: end}) for end in ends)
        later, sooner = (_heat(each, post.values) for each in designs)
        change[:, k] = (later - sooner) / (ends[0] - ends[1])
    moves = change * active[:, None]
    response = post.factor.solve(np.asarray(design.columns.T @ moves))
    direction = change - design.columns @ response
    deviation = np.sqrt(post.variance * lag_variances(moves, direction))
    absent = FoundLag(0.0, 0.0, np.zeros(design.size), np.zeros(len(design.rows)))
    return dict.fromkeys(lags, absent) | {
        sensor: FoundLag(
            lags[sensor], float(deviation[k]), -response[:, k], direction[:, k]
        )
        for k, sensor in enumerate(delayed)
    }


def sensed_variances(
    design: Design,
    theta: Vector,
    active: Bool[np.ndarray, " r"],
    fitted: Mapping[str, FoundLag],
) -> dict[str, float]:
    """Return the variance in s² of each lag that shows, by the noise of its sensor.

    The structure remembers that noise for the whole lag: drawing it anew tells how far it moves
    the lag. Columns are those of the fitted lags, ``theta`` all unknowns.
    """
    lags = {sensor: lag.value for sensor, lag in fitted.items() if lag.value > 0.0}
    data, rng, result = design.data, np.random.default_rng(0), dict[str, float]()
    for sensor, lag in lags.items():
        warmth = data.temperature[sensor]
        sensed = clocked(np.asarray(data.time, float), warmth)
        ends = ({**data.temperature, sensor: warmth + k} for k in (_SHIFT, -_SHIFT))
        shifted = (dataclasses.replace(data, temperature=end) for end in ends)
        designs = (dataclasses.replace(design, data=end) for end in shifted)
        above, below = (_heat(lagging(each, lags), theta) for each in designs)
        direction = np.where(active, fitted[sensor].direction, 0.0)
        influence = np.zeros(len(data))
        influence[design.rows] = direction * (above - below) / (2.0 * _SHIFT)
        influence /= max(float(direction @ direction), 1e-300)
        # What a temperature does is smooth over a few readings of its sensor. Rows between two
        # readings of a slow one have their noise from both.
        read = np.flatnonzero(_bends(sensed.clock, sensed.values))
        steps = np.diff(sensed.values[read], _ORDER)
        square = float(steps @ steps) / max(len(steps), 1)
        noise = np.sqrt(square / comb(2 * _ORDER, _ORDER))
        draws = noise * rng.standard_normal((_DRAWS, len(read)))
        draws[:, 0] = 0.0  # a line through the first readings begins
        changes = [
            influence[sensed.known]
            @ lagged(
                sensed.clock, np.interp(sensed.clock, sensed.clock[read], draw), lag
            )[sensed.back]
            for draw in draws
        ]
        result[sensor] = float(np.mean(np.square(changes)))
    return result


def _bends(time: Vector, values: Vector) -> Bool[np.ndarray, " n"]:
    """Return where values do not go on straight; both ends count."""
    slopes = np.diff(values) / np.diff(time)
    bends = np.ones(len(time), dtype=bool)
    bends[1:-1] = np.abs(np.diff(slopes)) > _STRAIGHT * np.abs(slopes).max(initial=0.0)
    return bends


def lag_variances(
    moves: Float[np.ndarray, "r k"], direction: Float[np.ndarray, "r k"]
) -> Float[np.ndarray, " k"]:
    """Return the variances of lags for noise of variance 1.

    Where tables do all that a lag does, it counts as hardly seen.

    Args:
        moves: Change of the readings that are believed, per s of each lag.
        direction: The same less what all other unknowns do of it.
    """
    scale = np.sqrt((moves**2).sum(axis=0))
    values, vectors = np.linalg.eigh(moves.T @ direction / np.outer(scale, scale))
    return np.asarray((vectors**2 / np.maximum(values, _SEEN)).sum(axis=1) / scale**2)


def _heated_places(design: Design) -> Int[np.ndarray, " k"]:
    warm = [effect.name for effect in design.effects if effect.sensor_names]
    return np.concatenate([design.places_of(name) for name in warm])


def _heat(design: Design, theta: Vector) -> Float[np.ndarray, " r"]:
    """Return what the temperatures add to each reading: of all, a small change would be lost."""
    places = _heated_places(design)
    return np.asarray(design.columns[:, places] @ theta[places])

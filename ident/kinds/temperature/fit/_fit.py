"""Temperature: errors over position and temperature in, the thermal line out."""

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...._recording import JointData
from ....core import FitError, Regression, one_blas_thread
from ....fit.joint import Temperature
from ._choice import choose_lags, choose_law, find_meeting, leave_out
from ._estimate import Confusion, Effect, Lag, Meeting, TemperatureFit
from ._line import FOLDS, Data, fit_line, names_of

_ALIKE = 0.98
"""Partial correlation of two effects from which the readings do not tell them apart."""


@one_blas_thread()
def fit_temperature(
    data: JointData, line: Temperature, *, meet: bool = False, loss: str = "student"
) -> TemperatureFit:
    r"""Fit $e = o(T_1) + c(T_2)(s - s_0)$ to errors at positions and temperatures.

    Least squares, wild readings set aside. Standard deviations count in that residuals drift:
    white noise plus an Ornstein–Uhlenbeck drift is fitted to them by restricted maximum
    likelihood, and its covariance is carried through the estimate.

    Args:
        data: Readings, NaN = missed; without a clock the rows are in order of time, at equal
            distances.
        line: What is asked for. Without a sensor of its own the offset is a constant; without
            one of the coefficient no slope is fitted (the error was measured at one position).
            Laws that are not given are chosen: the simplest of constant, linear and piecewise
            linear ones that predicts readings left out as well as the best. A lag to be fitted
            is applied where it predicts better.
        meet: Look from the reference of the line for the position where the lines of all
            temperatures meet, so that only the coefficient depends on the temperature.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the readings cannot determine what is asked for.
    """
    complete, rows = Data.of(line, data, loss)
    few = complete.thinned()
    lags = choose_lags(few)
    late = {sensor for sensor, constant in lags.items() if constant < 0.0}
    lags = {sensor: max(constant, 0.0) for sensor, constant in lags.items()}
    shape, scores = choose_law(few, lags)
    # A sensor that no law follows has no lag.
    laws = zip(complete.line.sensors.items(), shape, strict=True)
    follows = {sensor for (_, sensor), count in laws if count > 1}
    lags = {name: lags[name] * (name in follows) for name in lags}
    placed = complete.laid_out(shape, lags)
    if placed is None:
        msg = f"too few readings between {max(shape)} nodes."
        raise FitError(msg)
    free = [name for name in complete.open_lags if lags[name] > 0]
    if free:
        placed, _ = fit_line(placed, few, False, free, quick=True)
    fitted = fit_line(placed, complete, False, free)
    _refuse_undetermined(*fitted)
    meeting: Meeting = "given"
    unsure = None
    if meet and "coefficient" in complete.moved:
        fitted, meeting, unsure = find_meeting(fitted, complete, free)
        _refuse_undetermined(*fitted)
    line, found = fitted
    columns, value = complete.columns(line), found.coefficients[: line.size]
    sensors = tuple(data.temperature)
    used, wild = np.zeros((2, len(data)), bool)
    residual, predicted = np.full((2, len(data)), np.nan)
    temperature: Float[np.ndarray, "t s"] = np.full((len(data), len(sensors)), np.nan)
    used[rows], wild[rows] = True, found.wild
    residual[rows] = complete.error - columns @ value
    left, _ = leave_out(complete, fitted, complete.stretches % FOLDS)
    level = complete.error - np.median(complete.error)
    predicted[rows] = np.where(np.isnan(left), level, left)
    for name in complete.sensors:
        structure = line.structure(complete.whole, name)
        temperature[rows, sensors.index(name)] = structure
    return TemperatureFit(
        line=line,
        sensors=sensors,
        values=value,
        covariance=found.covariance,
        names=names_of(line, meeting == "met", len(free)),
        meeting=meeting,
        meeting_deviation=unsure,
        lags=_reported_lags(sensors, line, found, free, late),
        noise=found.noise,
        independent=float(found.independent[: line.size].min()),
        used=used,
        wild=wild,
        residual=residual,
        predicted=predicted,
        temperature=temperature,
        scores=scores,
        confounded=_confusions(complete, line),
        support=tuple((np.abs(columns[~found.wild]) > 0).sum(axis=0).tolist()),
        converged=found.converged,
    )


def _refuse_undetermined(line: Temperature, found: Regression) -> None:
    """Refuse a law of which the kept readings do not determine every value."""
    lacking = itertools.compress(names_of(line), found.undetermined)
    if words := ", ".join(lacking):
        msg = (
            f"the readings that agree with each other do not determine {words}: "
            f"{int(found.wild.sum())} wild ones are left out."
        )
        raise FitError(msg)


def _reported_lags(
    names: Sequence[str],
    line: Temperature,
    found: Regression,
    free: Sequence[str],
    late: set[str],
) -> tuple[Lag, ...]:
    """Return the lag of each sensor with its 95 % interval; logarithms come last."""
    logs = found.standard_deviation[len(found.coefficients) - len(free) :]
    own = dict(zip(free, logs.tolist(), strict=True))
    result = []
    for sensor, lag in line.lags.items():
        constant = float(lag)
        factor = float(np.exp(min(1.96 * own.get(sensor, 0.0), 50.0)))
        interval = (constant / factor, constant * factor)
        result.append(
            Lag(names.index(sensor), constant, interval, constant > 0, sensor in late)
        )
    return tuple(result)


def _confusions(data: Data, line: Temperature) -> tuple[Confusion, ...]:
    """Return the pairs of effects that these positions and temperatures confuse.

    Looks at the columns only, never at the errors: offset over temperature, slope over the
    position, and the slope's own change with the temperature.
    """
    if "coefficient" not in data.moved:
        return ()
    offset, slope = data.warmth(line)
    away = data.position - data.position.mean()
    product = (slope - slope.mean()) * away
    effects: dict[Effect, Float[np.ndarray, " t"]] = {}
    if "offset" in data.moved:
        effects["offset"] = offset - offset.mean()
    effects |= {"slope": away, "slope change": product - product.mean()}
    result = []
    level = abs(product.mean()) / np.sqrt(max(float(np.mean(product**2)), 1e-300))
    if level > _ALIKE:
        # As warm as it is far out: the change of the slope is the same number everywhere.
        result.append(Confusion("level", "slope change", float(level)))
    for (first, one), (second, other) in itertools.combinations(effects.items(), 2):
        size = float(np.linalg.norm(one) * np.linalg.norm(other))
        correlation = float(one @ other) / size if size > 0 else 0.0
        if abs(correlation) > _ALIKE:
            result.append(Confusion(first, second, correlation))
    return tuple(result)

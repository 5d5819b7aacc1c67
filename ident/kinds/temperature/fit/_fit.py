"""Temperature: errors over position and temperature in, the thermal line out."""

import dataclasses
import itertools
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ...._recording import JointData
from ....core import FitError, Regression, one_blas_thread
from ....fit.joint import Temperature
from ._choice import choose_lags, choose_law, leave_out
from ._estimate import Confusion, Effect, Lag, TemperatureFit
from ._line import FOLDS, Data, Shape, fit_line, names_of
from ._meeting import about_meeting

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
    complete = Data.of(line, data, loss)
    few = complete.thinned()
    lags = choose_lags(few)
    late = {sensor for sensor, constant in lags.items() if constant < 0.0}
    lags = {sensor: max(constant, 0.0) for sensor, constant in lags.items()}
    shape, scores = choose_law(few, lags)
    # A sensor that no law follows has no lag.
    laws = zip(complete.line.sensors.items(), shape, strict=True)
    follows = {sensor for (_, sensor), count in laws if count > 1}
    lags = {name: lags[name] * (name in follows) for name in lags}

    fit, found = _fitted(complete, shape, lags)
    if meet and "coefficient" in complete.moved:
        met, own = fit, found
        try:
            if shape[0] < shape[1]:
                # Where the lines meet, the offset bends as the coefficient does.
                met, own = _fitted(complete, (shape[1], shape[1]), lags)
            met = about_meeting(met, float(np.ptp(complete.position)))
        except FitError:
            met = dataclasses.replace(met, meeting="too few")
        if met.meeting == "met":
            fit, found = met, own
        fit = dataclasses.replace(
            fit, meeting=met.meeting, meeting_deviation=met.meeting_deviation
        )
    columns, predicted = complete.columns(fit.line), np.full(len(data), np.nan)
    left, _ = leave_out(complete, (fit.line, found), complete.stretches % FOLDS)
    level = complete.error - np.median(complete.error)
    predicted[complete.rows] = np.where(np.isnan(left), level, left)
    return dataclasses.replace(
        fit,
        lags=tuple(
            dataclasses.replace(lag, sensor_late=sensor in late)
            for lag, sensor in zip(fit.lags, fit.line.lags, strict=True)
        ),
        predicted=predicted,
        scores=scores,
        confounded=_confusions(complete, fit.line),
        support=tuple((np.abs(columns[~found.wild]) > 0).sum(axis=0).tolist()),
    )


def _fitted(
    complete: Data, shape: Shape, lags: Mapping[str, float]
) -> tuple[TemperatureFit, Regression]:
    """Return the fit of a law with what its regression says, the prediction left open.

    Args:
        complete: Readings of the line.
        shape: Of the law.
        lags: In s by sensor; those that a job leaves open are where to begin.
    """
    line = complete.laid_out(shape, lags)
    if line is None:
        msg = f"too few readings between {max(shape)} nodes."
        raise FitError(msg)
    free = [name for name in complete.open_lags if lags[name] > 0]
    line, found = fit_line(line, complete, free)
    names = names_of(line, len(free))
    if lacking := ", ".join(itertools.compress(names, found.undetermined)):
        msg = (
            f"the readings that agree with each other do not determine {lacking}: "
            f"{int(found.wild.sum())} wild ones are left out."
        )
        raise FitError(msg)
    sensors, rows = tuple(complete.whole.temperature), complete.rows
    used, wild = np.zeros((2, complete.count), bool)
    used[rows], wild[rows] = True, found.wild
    temperature = np.full((complete.count, len(sensors)), np.nan)
    for name in complete.sensors:
        structure = line.structure(complete.whole, name)
        temperature[rows, sensors.index(name)] = structure
    logs = dict(zip(free, found.standard_deviation[line.size :].tolist(), strict=True))
    reported = list[Lag]()
    for name, lag in line.lags.items():
        constant = float(lag)
        factor = float(np.exp(min(1.96 * logs.get(name, 0.0), 50.0)))
        interval = (constant / factor, constant * factor)
        reported.append(Lag(sensors.index(name), constant, interval, constant > 0))
    fit = TemperatureFit(
        line=line,
        sensors=sensors,
        values=found.coefficients[: line.size],
        covariance=found.covariance,
        names=names,
        meeting="given",
        lags=tuple(reported),
        noise=found.noise,
        independent=float(found.independent[: line.size].min()),
        used=used,
        wild=wild,
        predicted=np.full(complete.count, np.nan),
        temperature=temperature,
        support=(0,) * line.size,
        converged=found.converged,
    )
    return fit, found


def _confusions(data: Data, line: Temperature) -> tuple[Confusion, ...]:
    """Return the pairs of effects that these positions and temperatures confuse.

    Looks at the columns only, never at the errors: offset over temperature, slope over the
    position, and the slope's own change with the temperature.
    """
    if "coefficient" not in data.moved:
        return ()
    offset, slope, _ = data.inputs(line)
    away = data.position - data.position.mean()
    effects: dict[Effect, Float[np.ndarray, " t"]] = {"level": np.ones(len(away))}
    if "offset" in data.moved:
        effects["offset"] = offset - offset.mean()
    effects |= {"slope": away, "slope change": (slope - slope.mean()) * away}
    result = []
    for (first, one), (second, other) in itertools.combinations(effects.items(), 2):
        # As warm as it is far out: the change of the slope is the same number everywhere.
        beside = other if first == "level" else other - other.mean()
        size = float(np.linalg.norm(one) * np.linalg.norm(beside))
        correlation = float(one @ beside) / size if size > 0 else 0.0
        if abs(correlation) > _ALIKE:
            result.append(Confusion(first, second, correlation))
    return tuple(result)

"""Temperature: errors over position and temperature in, the thermal line out.

Read before: `_types` (what goes in and comes out), `_structure` (the temperature behind a
sensor: the one first-order lag), `_line` (readings in order, and the line fitted to them),
`_choice` (law, lag and intersection by readings left out).
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from ...core import FitError, Regression, one_blas_thread
from ...fit.joint import Temperature
from ...fit.joint._temperature import LAWS as LAWS
from ._choice import Contest
from ._line import (
    LEAST_RANGE as LEAST_RANGE,
    Data,
    Shape,
    complete_data,
    fit_line,
    names_of,
)
from ._structure import (
    Clocked as Clocked,
    clocked as clocked,
    lagged as lagged,
    steady as steady,
)
from ._types import (
    Confusion as Confusion,
    Effect as Effect,
    Lag as Lag,
    Law as Law,
    LawScore as LawScore,
    Meeting as Meeting,
    TemperatureFit as TemperatureFit,
    ThermalReadings as ThermalReadings,
    laws_of as laws_of,
)

LawKey = Literal["constant", "linear"] | int
"""A law over the temperature, or its number of nodes."""
_LAWS = {"constant": 1, "linear": 2}
_FEW = 20
"""Readings below which no lag is looked for."""
_ALIKE = 0.98
"""Partial correlation of two effects from which the readings do not tell them apart."""


@one_blas_thread()
def fit_temperature(
    readings: ThermalReadings,
    *,
    offset_sensor: int | None = 0,
    coefficient_sensor: int | None = 0,
    law: Literal["auto"] | tuple[LawKey, LawKey] = "auto",
    reference: float | Literal["intersection"] = "intersection",
    lag: float | Literal["auto", "none"] = "auto",
    loss: str = "student",
    names: Sequence[str] = (),
) -> TemperatureFit:
    r"""Fit $e = o(T_1) + c(T_2)(s - s_0)$ to errors at positions and temperatures.

    Least squares, wild readings set aside. Standard deviations count in that residuals drift:
    white noise plus an Ornstein–Uhlenbeck drift is fitted to them by restricted maximum
    likelihood, and its covariance is carried through the estimate.

    Args:
        readings: Errors in mm, positions in mm, temperatures in °C, times in s. NaN = missed.
        offset_sensor: Sensor that moves the offset; None = the offset is a constant.
        coefficient_sensor: Sensor that moves the slope over the position; None = no slope is
            fitted (the error was measured at one position).
        law: ``"auto"`` lets readings left out choose the simplest of constant, linear and
            piecewise linear laws that predicts as well as the best; a pair for offset and
            coefficient out of ``"constant"``, ``"linear"`` and numbers of nodes sets it.
        reference: $s_0$ in mm, or ``"intersection"``: where the lines of all temperatures meet,
            so that only the coefficient depends on the temperature; the middle of the
            positions where they meet nowhere.
        lag: ``"auto"`` estimates a first-order lag of the structure behind each sensor and
            applies it where it predicts better; ``"none"``; or the time constant in s.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.
        names: Of the sensors, for messages; none = their numbers from 1.

    Raises:
        FitError: If the readings cannot determine what is asked for.
    """
    names = list(names) or [str(k + 1) for k in range(len(readings.temperature.T))]
    data, rows = complete_data(readings, (offset_sensor, coefficient_sensor), names)
    contest = Contest.of(data, loss)
    place, wanted = 0.0, False
    if not isinstance(reference, str):
        place = reference
    elif coefficient_sensor is not None:
        place, wanted = float(data.position.min() + data.position.max()) / 2.0, True
    lags = _lags(contest, lag, place)
    late = {sensor for sensor, constant in lags.items() if constant < 0.0}
    lags = {sensor: max(constant, 0.0) for sensor, constant in lags.items()}
    shape, scores, scale = _shape(contest, law, place, lags)
    # A sensor that no law follows has no lag.
    follows = {
        data.line.sensors[name]
        for name, count in zip(data.line.sensors, shape, strict=True)
        if count > 1
    }
    lags = {name: lags[name] * (name in follows) for name in lags}
    line = data.laid_out(shape, place, lags)
    if line is None:
        msg = f"too few readings between {max(shape)} nodes."
        raise FitError(msg)
    free = [name for name in data.sensors if lags[name] > 0 and lag == "auto"]
    if free:
        line, _ = fit_line(line, contest.data, loss, False, free, quick=True)
    line, found = fit_line(line, data, loss, False, free)
    _refuse_undetermined(line, found)
    meeting: Meeting = "given"
    unsure = None
    if wanted:
        met, meeting, unsure = contest.meeting((line, found), data, scale, free)
        line, found = (line, found) if met is None else met
        _refuse_undetermined(line, found)
    columns, value = data.columns(line), found.coefficients[: line.size]
    further = found.standard_deviation[line.size :]
    whole = len(readings.error)
    used, wild = np.zeros(whole, bool), np.zeros(whole, bool)
    residual: Float[np.ndarray, " t"] = np.full(whole, np.nan)
    temperature = np.full_like(readings.temperature, np.nan)
    used[rows], wild[rows] = True, found.wild
    residual[rows] = data.error - columns @ value
    for name in data.sensors:
        temperature[rows, names.index(name)] = line.structure(data.whole, name)
    laws = laws_of(line, names, value, found.standard_deviation[: line.size])
    return TemperatureFit(
        offset=laws["offset"],
        coefficient=laws.get("coefficient"),
        reference=line.reference,
        reference_deviation=float(further[0]) if meeting == "met" else None,
        meeting=meeting,
        lags=_reported_lags(names, line, found, free, late),
        names=names_of(line, meeting == "met", len(free)),
        covariance=found.covariance,
        noise=found.noise,
        independent=float(found.independent[: line.size].min()),
        used=used,
        wild=wild,
        residual=residual,
        temperature=temperature,
        scores=scores,
        confounded=_confusions(data, line),
        support=tuple((np.abs(columns[~found.wild]) > 0).sum(axis=0).tolist()),
        converged=found.converged,
        meeting_deviation=unsure,
    )


def _lags(
    contest: Contest, lag: float | Literal["auto", "none"], place: float
) -> dict[str, float]:
    """Return time constants in s by sensor; below 0 where the sensor itself is late."""
    if lag == "auto" and len(contest.data.error) >= _FEW:
        return contest.lags(place)
    given = 0.0 if isinstance(lag, str) else lag
    return dict.fromkeys(contest.data.sensors, given)


def _shape(
    contest: Contest,
    law: Literal["auto"] | tuple[LawKey, LawKey],
    place: float,
    lags: Mapping[str, float],
) -> tuple[Shape, tuple[LawScore, ...], float | None]:
    """Return the law, those it was compared with, and the scale of their residuals."""
    if law == "auto":
        return contest.shape(place, lags)
    counts = [_LAWS[each] if isinstance(each, str) else each for each in law]
    if "offset" not in contest.data.moved:
        counts[0] = 1
    return tuple(counts[: len(contest.data.line.sensors)]), (), None


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

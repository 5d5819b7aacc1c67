"""The temperature estimator: errors over position and temperature in, the line out."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import FitError, Regression, one_blas_thread
from ._choice import choose_shape, find_lags, find_meeting
from ._line import (
    Data,
    Line,
    Pair,
    Shape,
    complete_rows,
    fit_line,
    laid_out,
    ordered_data,
)
from ._types import (
    Confusion,
    Effect,
    Lag,
    Law,
    LawScore,
    Meeting,
    SensorLog,
    TemperatureFit,
    ThermalReadings,
)

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
    law: str | tuple[str | int, str | int] = "auto",
    reference: float | str = "intersection",
    lag: str | float = "auto",
    log: SensorLog | None = None,
    loss: str = "student",
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
        log: Temperatures on the clock of the readings, denser than these; None = those of
            the readings.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the readings cannot determine what is asked for.
    """
    sensors = offset_sensor, coefficient_sensor
    keep = complete_rows(readings, *sensors, log is None)
    data, rows = ordered_data(readings, keep, sensors, log)
    place, wanted = _place(data, reference)
    thin = data.thinned()
    lags, late = _lags(thin, lag, place, loss)
    shape, scores, scale = _shape(thin, law, place, lags, loss)
    # A law that does not follow its sensor has no lag.
    follows = [shape.offset > 1, shape.coefficient > 1]
    if data.sensors[0] == data.sensors[1]:
        follows = [any(follows)] * 2
    lags = (lags[0] * follows[0], lags[1] * follows[1])
    line = laid_out(data.structure(lags), shape, place, lags)
    if line is None:
        msg = f"too few readings between {max(shape.offset, shape.coefficient)} nodes."
        raise FitError(msg)
    free = [group for group in data.lag_groups if lags[group[0]] > 0 and lag == "auto"]
    if free:
        line, _ = fit_line(line, thin, loss, False, free, quick=True)
    line, found = fit_line(line, data, loss, False, free)
    _refuse_undetermined(line, found)
    meeting: Meeting = "given"
    unsure = None
    if wanted:
        met, meeting, unsure = find_meeting(line, found, data, scale, loss, free)
        line, found = (line, found) if met is None else met
        _refuse_undetermined(line, found)
    return _result(
        readings, keep, rows, data, line, found,
        scores, free, meeting, unsure, late,
    )  # fmt: skip


def _place(data: Data, reference: float | str) -> tuple[float, bool]:
    """Return where to begin, and whether the intersection is wanted."""
    if not isinstance(reference, str):
        return float(reference), False
    if reference != "intersection":
        msg = f"reference: found {reference!r}, expected 'intersection' or a position in mm."
        raise FitError(msg)
    if data.sensors[1] is None:
        return 0.0, False
    return 0.5 * float(data.position.min() + data.position.max()), True


def _lags(
    data: Data, lag: str | float, place: float, loss: str
) -> tuple[Pair, tuple[bool, bool]]:
    """Return time constants in s, and which sensors are late."""
    own = [sensor is not None for sensor in data.sensors]
    if lag == "auto" and len(data.error) >= _FEW:
        return find_lags(data, place, loss)
    if lag in ("auto", "none"):
        return (0.0, 0.0), (False, False)
    if isinstance(lag, str) or not 0 <= lag < np.inf:
        msg = f"lag: found {lag!r}, expected 'auto', 'none' or a time in s."
        raise FitError(msg)
    return (float(lag) * own[0], float(lag) * own[1]), (False, False)


def _shape(
    data: Data,
    law: str | tuple[str | int, str | int],
    place: float,
    lags: Pair,
    loss: str,
) -> tuple[Shape, tuple[LawScore, ...], float | None]:
    """Return the law, those it was compared with, and the scale of their residuals."""
    if law == "auto":
        shape, scores, score = choose_shape(data, place, lags, loss)
        return shape, scores, score.scale
    if isinstance(law, str):
        msg = (
            f"law: found {law!r}, expected 'auto' or a pair for offset and coefficient."
        )
        raise FitError(msg)
    counts = []
    for each, sensor in zip(law, data.sensors, strict=True):
        count = _LAWS.get(each, 0) if isinstance(each, str) else each
        if count < 1:
            msg = f"law: found {each!r}, expected 'constant', 'linear' or a number of nodes."
            raise FitError(msg)
        counts.append(1 if sensor is None else count)
    return Shape(counts[0], 0 if data.sensors[1] is None else counts[1]), (), None


def _refuse_undetermined(line: Line, found: Regression) -> None:
    """Refuse a law of which the kept readings do not determine every value."""
    lacking = [
        name
        for name, each in zip(line.names(), found.undetermined, strict=False)
        if each
    ]
    if lacking:
        msg = (
            f"the readings that agree with each other do not determine {', '.join(lacking)}: "
            f"{int(found.wild.sum())} wild ones are left out."
        )
        raise FitError(msg)


def _result(
    readings: ThermalReadings,
    keep: Bool[np.ndarray, " t"],
    rows: Int[np.ndarray, " r"],
    data: Data,
    line: Line,
    found: Regression,
    scores: tuple[LawScore, ...],
    free: Sequence[tuple[int, ...]],
    meeting: Meeting,
    unsure: float | None,
    late: tuple[bool, bool],
) -> TemperatureFit:
    """Return the fit in the order of the rows that were handed in."""
    deviation = found.standard_deviation
    size, count = line.shape.size, line.shape.offset
    offset, coefficient = (
        Law(sensor or 0, nodes, line.value[part], deviation[part])
        for sensor, nodes, part in zip(
            data.sensors, line.nodes, (slice(0, count), slice(count, size)), strict=True
        )
    )
    theta = data.structure(line.lags)
    columns = line.columns(theta, data.position)
    wild = np.zeros(len(keep), bool)
    wild[rows[found.wild]] = True
    residual: Float[np.ndarray, " t"] = np.full(len(keep), np.nan)
    residual[rows] = data.error - columns @ line.value
    temperature = np.full(readings.temperature.shape, np.nan)
    for sensor, values in zip(data.sensors, theta, strict=True):
        if sensor is not None:
            temperature[rows, sensor] = values
    names = [*line.names(), *["reference position"] * (meeting == "met")]
    names += ["time constant"] * len(free)
    return TemperatureFit(
        offset=offset,
        coefficient=coefficient if len(coefficient.value) else None,
        reference=line.reference,
        reference_deviation=float(deviation[size]) if meeting == "met" else None,
        meeting=meeting,
        lags=_reported_lags(data, line, deviation, free, late),
        names=tuple(names),
        covariance=found.covariance,
        noise=found.noise,
        independent=float(found.independent[:size].min()),
        used=keep,
        wild=wild,
        residual=residual,
        temperature=temperature,
        scores=scores,
        confounded=_confusions(data, line),
        support=tuple(
            int(each) for each in (np.abs(columns[~found.wild]) > 0).sum(axis=0)
        ),
        converged=found.converged,
        meeting_deviation=unsure,
    )


def _reported_lags(
    data: Data,
    line: Line,
    deviation: Float[np.ndarray, " k"],
    free: Sequence[tuple[int, ...]],
    late: tuple[bool, bool],
) -> tuple[Lag, ...]:
    """Return the lag of each sensor with its 95 % interval; logarithms come last."""
    result = []
    for group in data.lag_groups:
        sensor, constant = data.sensors[group[0]], line.lags[group[0]]
        assert sensor is not None  # those without have no group
        interval = (constant, constant)
        if group in free:
            own = deviation[len(deviation) - len(free) + list(free).index(group)]
            factor = float(np.exp(min(1.96 * own, 50.0)))
            interval = (constant / factor, constant * factor)
        behind = any(late[number] for number in group)
        result.append(Lag(sensor, constant, interval, constant > 0, behind))
    return tuple(result)


def _confusions(data: Data, line: Line) -> tuple[Confusion, ...]:
    """Return the pairs of effects that these positions and temperatures confuse.

    Looks at the columns only, never at the errors: offset over temperature, slope over the
    position, and the slope's own change with the temperature.
    """
    if data.sensors[1] is None:
        return ()
    offset, slope = data.structure(line.lags)
    away = data.position - data.position.mean()
    product = (slope - slope.mean()) * away
    effects: dict[Effect, Float[np.ndarray, " t"]] = {}
    if data.sensors[0] is not None:
        effects["offset"] = offset
    effects |= {"slope": away, "slope change": product}
    result = []
    level = float(
        np.sqrt(product.mean() ** 2 / max(float(np.mean(product**2)), 1e-300))
    )
    if level > _ALIKE:
        # As warm as it is far out: the change of the slope is the same number everywhere.
        result.append(Confusion("level", "slope change", level))
    for i, (first, one) in enumerate(effects.items()):
        for second, other in list(effects.items())[i + 1 :]:
            both = one - one.mean(), other - other.mean()
            size = float(np.linalg.norm(both[0]) * np.linalg.norm(both[1]))
            correlation = float(both[0] @ both[1]) / size if size > 0 else 0.0
            if abs(correlation) > _ALIKE:
                result.append(Confusion(first, second, correlation))
    return tuple(result)

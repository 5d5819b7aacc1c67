"""The temperature estimator: errors over position and temperature in, the line out."""

import numpy as np

from ...core._errors import FitError
from ._choice import Score, choose_shape, find_lags, shapes_for
from ._laws import Shape
from ._line import Data, fit_line, laid_out
from ._meeting import find_meeting
from ._prepare import check_data, complete_rows, ordered_data
from ._report import line_result
from ._types import LawScore, SensorLog, TemperatureFit, ThermalReadings

_LAWS = {"constant": 1, "linear": 2}


def fit_temperature(
    readings: ThermalReadings,
    *,
    offset_sensor: int | None = 0,
    coefficient_sensor: int | None = 0,
    law: str | tuple[str | int, str | int] = "auto",
    reference: float | str = "intersection",
    fallback: float | None = None,
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
            so that only the coefficient depends on the temperature.
        fallback: Reference in mm where the lines meet nowhere; None = middle of the positions.
        lag: ``"auto"`` estimates a first-order lag of the structure behind each sensor and
            applies it where it predicts better; ``"none"``; or the time constant in s.
        log: Temperatures on the clock of the readings, denser than these; None = those of
            the readings.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the readings cannot determine what is asked for.
    """
    keep = complete_rows(readings, offset_sensor, coefficient_sensor, log is None)
    data, rows = ordered_data(readings, keep, offset_sensor, coefficient_sensor, log)
    check_data(data, readings)
    place, wanted = _place(data, reference, fallback)
    thin = data.thinned()
    lags, late, applied = _lags(thin, lag, place, loss)
    shape, scores, score = _shape(thin, law, place, lags, loss)
    lags, applied = _without_idle(shape, data, lags, applied)
    line = laid_out(data, shape, place, lags)
    if line is None:
        msg = f"too few readings between {max(shape.offset, shape.coefficient)} nodes."
        raise FitError(msg)
    free = tuple(k for k in (0, 1) if isinstance(lag, str) and applied[k])
    if free:
        line, _, _ = fit_line(line, thin, loss, False, free, quick=True)
    line, found, settled = fit_line(line, data, loss, False, free)
    messages: list[str] = []
    intersects = False
    if wanted:
        meeting, why = find_meeting(line, found, data, score, loss, free)
        messages.append(why)
        if meeting is not None:
            line, found, settled = meeting
            intersects = True
    if not settled:
        messages.append("The iterations did not settle; treat the result with care.")
    return line_result(
        readings, keep, rows, data, line, found, settled, scores,
        free, intersects, late, tuple(messages),
    )  # fmt: skip


def _place(
    data: Data, reference: float | str, fallback: float | None
) -> tuple[float, bool]:
    """Return where to begin, and whether the intersection is wanted."""
    if not isinstance(reference, str):
        return float(reference), False
    if reference != "intersection":
        msg = f"reference: found {reference!r}, expected 'intersection' or a position in mm."
        raise FitError(msg)
    if data.sensors[1] is None:
        return 0.0, False
    middle = 0.5 * float(data.position.min() + data.position.max())
    return (middle if fallback is None else float(fallback)), True


def _lags(
    data: Data, lag: str | float, place: float, loss: str
) -> tuple[tuple[float, float], tuple[bool, bool], tuple[bool, bool]]:
    """Return time constants, which sensors are late, and which lags are applied."""
    own = (data.sensors[0] is not None, data.sensors[1] is not None)
    if not isinstance(lag, str):
        if not 0 <= lag < np.inf:
            msg = f"lag: found {lag!r}, expected 'auto', 'none' or a time in s."
            raise FitError(msg)
        lags = (float(lag) * own[0], float(lag) * own[1])
        return lags, (False, False), (lag > 0 and own[0], lag > 0 and own[1])
    if lag not in ("auto", "none"):
        msg = f"lag: found {lag!r}, expected 'auto', 'none' or a time in s."
        raise FitError(msg)
    if lag == "none" or len(data.error) < 20:
        return (0.0, 0.0), (False, False), (False, False)
    shape = Shape(3 if own[0] else 1, 2 if own[1] else 0)
    lags, late = find_lags(data, place, loss, shape)
    return lags, late, (lags[0] > 0, lags[1] > 0)


def _without_idle(
    shape: Shape,
    data: Data,
    lags: tuple[float, float],
    applied: tuple[bool, bool],
) -> tuple[tuple[float, float], tuple[bool, bool]]:
    """Drop lags of sensors that the chosen law does not follow."""
    follows = [shape.offset > 1, shape.coefficient > 1]
    if data.sensors[0] == data.sensors[1]:
        follows = [any(follows)] * 2
    return (
        (lags[0] * follows[0], lags[1] * follows[1]),
        (applied[0] and follows[0], applied[1] and follows[1]),
    )


def _shape(
    data: Data,
    law: str | tuple[str | int, str | int],
    place: float,
    lags: tuple[float, float],
    loss: str,
) -> tuple[Shape, tuple[LawScore, ...], Score | None]:
    own = (data.sensors[0] is not None, data.sensors[1] is not None)
    if law == "auto":
        return choose_shape(data, shapes_for(*own), place, lags, loss)
    if isinstance(law, str):
        msg = (
            f"law: found {law!r}, expected 'auto' or a pair for offset and coefficient."
        )
        raise FitError(msg)
    counts = []
    for each, has in zip(law, own, strict=True):
        count = _LAWS.get(each, 0) if isinstance(each, str) else each
        if count < 1:
            msg = f"law: found {each!r}, expected 'constant', 'linear' or a number of nodes."
            raise FitError(msg)
        counts.append(count if has else 1)
    return Shape(counts[0], counts[1] if own[1] else 0), (), None

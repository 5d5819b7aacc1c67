"""Complete readings in order of time, and the thermal line fitted to them."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import FitError, Regression, node_shares, regress, regress_curve
from ._structure import Clocked, clocked, missed_temperatures
from ._types import SensorLog, ThermalReadings

LEAST_RANGE = 0.5
"""Range of a sensor in K below which no law is determined."""
_MANY = 3_000
"""Readings by which laws and lags are chosen; the chosen one is fitted to all."""
_LEAST = 4
"""Readings of a fit, and between two nodes below which no node is set."""
_STEP = 0.02
"""Step in the logarithm of a time constant for slopes."""
_REACH = 1e3
"""Distance of the reference in measured ranges that is looked at."""

Pair = tuple[float, float]
Structure = tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]


@dataclasses.dataclass(frozen=True)
class Shape:
    """Number of nodes of offset and coefficient: 1 constant, 2 linear, more piecewise."""

    offset: int
    coefficient: int = 0

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.offset + self.coefficient


@dataclasses.dataclass(frozen=True)
class Data:
    """Complete readings of one fit, in order of time.

    Attributes:
        error: In mm.
        position: In mm.
        time: In s, on the clock of the log.
        logs: Of the sensor of offset and coefficient; None = has none.
        sensors: Their numbers.
    """

    error: Float[np.ndarray, " t"]
    position: Float[np.ndarray, " t"]
    time: Float[np.ndarray, " t"]
    logs: tuple[Clocked | None, Clocked | None]
    sensors: tuple[int | None, int | None]

    def structure(self, lags: Pair) -> Structure:
        """Return the structure temperatures for offset and coefficient in °C."""
        one, other = (
            np.zeros(len(self.time))
            if log is None
            else log.structure_at(self.time, lag)
            for log, lag in zip(self.logs, lags, strict=True)
        )
        return one, other

    @property
    def lag_groups(self) -> list[tuple[int, ...]]:
        """Return which laws (0 = offset, 1 = coefficient) share a lag: that of a sensor."""
        used = [k for k, sensor in enumerate(self.sensors) if sensor is not None]
        if len(used) == 2 and self.sensors[0] == self.sensors[1]:
            return [(0, 1)]
        return [(k,) for k in used]

    @property
    def lag_range(self) -> Pair:
        """Return the shortest and the longest lag in s that the clock could show.

        Raises:
            FitError: If the clock stands still.
        """
        if not np.ptp(self.time) > 0:
            msg = "all readings have the same time, expected a clock that runs."
            raise FitError(msg)
        clock = next(log.clock for log in self.logs if log is not None)
        least = float(np.median(np.diff(clock)))
        return 0.2 * least, 3.0 * max(float(np.ptp(clock)), least)

    def thinned(self) -> "Data":
        """Return every n-th reading so that choices cost the same for logs of any length."""
        step = -(-len(self.error) // _MANY)
        return self.take(np.arange(len(self.error)) % step == 0)

    def take(self, keep: Bool[np.ndarray, " t"]) -> "Data":
        """Return the readings for which ``keep`` is true; the logs stay whole."""
        return dataclasses.replace(
            self,
            error=self.error[keep],
            position=self.position[keep],
            time=self.time[keep],
        )


@dataclasses.dataclass(frozen=True)
class Line:
    """A line with its parameters; `value` is offset nodes, then coefficient nodes."""

    nodes: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " m"]]
    value: Float[np.ndarray, " k"]
    reference: float
    lags: Pair

    @property
    def shape(self) -> Shape:
        """Number of nodes of both laws."""
        return Shape(len(self.nodes[0]), len(self.nodes[1]))

    def columns(
        self, theta: Structure, position: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, "t k"]:
        """Return the functions of which the node values are the factors."""
        parts = [node_shares(theta[0], self.nodes[0])]
        if len(self.nodes[1]):
            away = (position - self.reference)[:, None]
            parts.append(node_shares(theta[1], self.nodes[1]) * away)
        return np.hstack(parts)

    def predict(self, data: Data) -> Float[np.ndarray, " t"]:
        """Return the error in mm."""
        theta = data.structure(self.lags)
        return np.asarray(self.columns(theta, data.position) @ self.value)

    def names(self) -> tuple[str, ...]:
        """Return the node values in words."""
        words = []
        for effect, nodes in zip(("offset", "coefficient"), self.nodes, strict=True):
            for node in nodes:
                where = "" if len(nodes) == 1 else f" at {node:.4g} °C"
                words.append(effect + where)
        return tuple(words)


def laid_out(
    theta: Structure, shape: Shape, reference: float, lags: Pair
) -> Line | None:
    """Return a line with its nodes over temperatures in °C; None where they are too few."""
    first = _nodes(theta[0], shape.offset)
    second = _nodes(theta[1], shape.coefficient) if shape.coefficient else np.zeros(0)
    if first is None or second is None:
        return None
    return Line((first, second), np.zeros(shape.size), reference, lags)


def _nodes(
    temperature: Float[np.ndarray, " t"], count: int
) -> Float[np.ndarray, " n"] | None:
    """Return equidistant nodes in °C; None where two of them have too few readings between."""
    low, high = float(temperature.min()), float(temperature.max())
    if count == 1:
        return np.array([0.5 * (low + high)])
    nodes = np.linspace(low, high, count)
    if not high > low:
        return None
    if count > 2 and np.histogram(temperature, nodes)[0].min() < _LEAST:
        return None
    return nodes


def fit_line(
    line: Line,
    data: Data,
    loss: str,
    free_reference: bool = False,
    free_lags: Sequence[tuple[int, ...]] = (),
    quick: bool = False,
) -> tuple[Line, Regression]:
    """Return the line with all that is free fitted, and the regression behind it.

    Args:
        line: Start; its temperatures stay.
        data: Readings.
        loss: As for `regress`.
        free_reference: Fit the reference position (needs a constant offset).
        free_lags: Groups of `Data.lag_groups` whose lag is fitted.
        quick: The regression needs no covariance.

    Returns:
        Line and regression; its coefficients are node values, then the reference in mm and
        the logarithms of the lags, as far as they are free.
    """
    names = [*line.names(), *["reference position"] * free_reference]
    names += ["time constant"] * len(free_lags)
    if not free_reference and not free_lags:
        columns = line.columns(data.structure(line.lags), data.position)
        found = regress(
            columns, data.error, time=data.time, names=names, loss=loss, quick=quick
        )
        return dataclasses.replace(line, value=found.coefficients), found
    span = max(float(np.ptp(data.position)), 1e-9)
    ends = np.log(data.lag_range) if free_lags else np.zeros(2)
    start, width, low, high = [], [], [], []
    if free_reference:
        start, width = [line.reference], [1e-3 * span]
        low, high = [start[0] - _REACH * span], [start[0] + _REACH * span]
    for group in free_lags:
        start.append(float(np.clip(np.log(line.lags[group[0]]), ends[0], ends[1])))
        width.append(_STEP)
        low.append(float(ends[0]))
        high.append(float(ends[1]))

    def at(shapes: Float[np.ndarray, " s"]) -> Line:
        lags = list(line.lags)
        logs = shapes[len(shapes) - len(free_lags) :]
        for group, log in zip(free_lags, logs, strict=True):
            for number in group:
                lags[number] = float(np.exp(log))
        place = float(shapes[0]) if free_reference else line.reference
        return dataclasses.replace(line, reference=place, lags=(lags[0], lags[1]))

    def columns_at(shapes: Float[np.ndarray, " s"]) -> Float[np.ndarray, "t k"]:
        trial = at(shapes)
        return trial.columns(data.structure(trial.lags), data.position)

    shapes, found = regress_curve(
        columns_at,
        data.error,
        np.array(start),
        width=np.array(width),
        bounds=(np.array(low), np.array(high)),
        time=data.time,
        names=names,
        loss=loss,
        quick=quick,
    )
    value = found.coefficients[: line.shape.size]
    return dataclasses.replace(at(shapes), value=value), found


def complete_rows(
    readings: ThermalReadings,
    offset_sensor: int | None,
    coefficient_sensor: int | None,
    own_log: bool,
) -> Bool[np.ndarray, " t"]:
    """Return the rows of which nothing is missing, after the arguments are checked."""
    sensors = readings.temperature.shape[1]
    used = [s for s in (offset_sensor, coefficient_sensor) if s is not None]
    if not used:
        msg = "no sensor is given, expected one for the offset or for the coefficient."
        raise FitError(msg)
    for sensor in used:
        if not 0 <= sensor < sensors:
            msg = (
                f"found sensor {sensor + 1} of {sensors}, expected one that was logged."
            )
            raise FitError(msg)
    if coefficient_sensor is not None and readings.position is None:
        msg = (
            "a coefficient needs the position of every reading; without positions only "
            "the offset can be fitted."
        )
        raise FitError(msg)
    keep = np.isfinite(readings.error)
    for values in (readings.position, readings.time):
        if values is not None:
            keep &= np.isfinite(values)
    for sensor in used if own_log else ():
        keep &= ~missed_temperatures(readings.temperature[:, sensor])
    return np.asarray(keep)


def ordered_data(
    readings: ThermalReadings,
    keep: Bool[np.ndarray, " t"],
    sensors: tuple[int | None, int | None],
    log: SensorLog | None,
) -> tuple[Data, Int[np.ndarray, " r"]]:
    """Return the complete readings in order of time, and the rows where they stood.

    Raises:
        FitError: If they cannot tell what is asked for.
    """
    rows = np.flatnonzero(keep)
    clock = (
        np.arange(len(keep), dtype=float) if readings.time is None else readings.time
    )
    rows = rows[np.argsort(clock[rows], kind="stable")]
    position = readings.position

    def behind(sensor: int | None) -> Clocked | None:
        if sensor is None:
            return None
        if log is None:
            return clocked(clock[rows], readings.temperature[rows, sensor])
        values = log.temperature[:, sensor]
        missed = missed_temperatures(values)
        return clocked(log.time, np.where(missed, np.nan, values))

    data = Data(
        readings.error[rows],
        np.zeros(len(rows)) if position is None else position[rows],
        clock[rows],
        (behind(sensors[0]), behind(sensors[1])),
        sensors,
    )
    inside = np.asarray(np.isfinite(data.structure((0.0, 0.0))).all(axis=0))
    keep[rows[~inside]] = False
    data = data.take(inside)
    _check(data, len(readings.error))
    return data, rows[inside]


def _check(data: Data, whole: int) -> None:
    count = len(data.error)
    if count < _LEAST:
        msg = f"{count} of {whole} readings are complete, expected at least {_LEAST}."
        raise FitError(msg)
    theta = data.structure((0.0, 0.0))
    for effect, sensor, values in zip(
        ("offset", "coefficient"), data.sensors, theta, strict=True
    ):
        if sensor is not None and np.ptp(values) < LEAST_RANGE:
            msg = (
                f"sensor {sensor + 1} of the {effect} stays at {values[0]:.4g} °C within "
                f"{np.ptp(values):.2g} K, expected a range of {LEAST_RANGE} K or more."
            )
            raise FitError(msg)
    if data.sensors[1] is not None and np.ptp(data.position) == 0:
        msg = (
            f"all readings stand at {data.position[0]:g} mm: a coefficient needs two "
            "positions or more; at one position only the offset can be fitted."
        )
        raise FitError(msg)

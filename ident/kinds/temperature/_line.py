"""Complete readings in order of time, and the thermal line fitted to them."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ...core import FitError, Regression, node_shares, regress, regress_curve
from ._structure import Clocked, clocked, missed_temperatures
from ._types import ThermalReadings

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
Shape = tuple[int, int]
"""Nodes of offset and coefficient: 0 none, 1 constant, 2 linear, more piecewise linear."""
Structure = tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]


@dataclasses.dataclass(frozen=True)
class Data:
    """Complete readings of one fit, in order of time.

    Attributes:
        error: In mm.
        position: In mm.
        time: In s.
        logs: Of the sensor of offset and coefficient; None = has none.
        sensors: Their numbers.
        rows: Which row of the logs each reading is.
    """

    error: Float[np.ndarray, " t"]
    position: Float[np.ndarray, " t"]
    time: Float[np.ndarray, " t"]
    logs: tuple[Clocked | None, Clocked | None]
    sensors: tuple[int | None, int | None]
    rows: Int[np.ndarray, " t"]

    def structure(self, lags: Pair) -> Structure:
        """Return the structure temperatures for offset and coefficient in °C."""
        one, other = (
            np.zeros(len(self.time)) if log is None else log.structure(lag)[self.rows]
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
        keep = slice(None, None, -(-len(self.error) // _MANY))
        error, position, time, rows = (
            each[keep] for each in (self.error, self.position, self.time, self.rows)
        )
        return Data(error, position, time, self.logs, self.sensors, rows)


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
        return len(self.nodes[0]), len(self.nodes[1])

    def columns(
        self, theta: Structure, position: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, "t k"]:
        """Return the functions of which the node values are the factors."""
        parts = [node_shares(theta[0], self.nodes[0])]
        if len(self.nodes[1]):
            away = (position - self.reference)[:, None]
            parts.append(node_shares(theta[1], self.nodes[1]) * away)
        return np.hstack(parts)

    def columns_of(self, data: Data) -> Float[np.ndarray, "t k"]:
        """Return the columns of readings behind the lags of this line."""
        return self.columns(data.structure(self.lags), data.position)

    def names(self, met: bool = False, lags: int = 0) -> list[str]:
        """Return what is fitted in words: node values, the reference, lags."""
        words = [
            effect + ("" if len(nodes) == 1 else f" at {node:.4g} °C")
            for effect, nodes in zip(("offset", "coefficient"), self.nodes, strict=True)
            for node in nodes
        ]
        return [*words, *["reference position"] * met, *["time constant"] * lags]


def laid_out(
    theta: Structure, shape: Shape, reference: float, lags: Pair
) -> Line | None:
    """Return a line with equidistant nodes over temperatures in °C.

    None where two of them have too few readings between.
    """
    nodes = []
    for temperature, count in zip(theta, shape, strict=True):
        low, high = float(temperature.min()), float(temperature.max())
        line = np.linspace(low, high, count)
        if count == 1:
            line = np.array([0.5 * (low + high)])
        elif count and not high > low:
            return None
        elif count > 2 and np.histogram(temperature, line)[0].min() < _LEAST:
            return None
        nodes.append(line)
    return Line((nodes[0], nodes[1]), np.zeros(sum(shape)), reference, lags)


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
    names = line.names(free_reference, len(free_lags))
    span = max(float(np.ptp(data.position)), 1e-9)
    far = _REACH * span
    start, widths = [line.reference] * free_reference, [1e-3 * span] * free_reference
    ends = [(line.reference - far, line.reference + far)] * free_reference
    for group in free_lags:
        start.append(float(np.log(line.lags[group[0]])))
        widths.append(_STEP)
        low, high = np.log(data.lag_range)
        ends.append((float(low), float(high)))

    def at(shapes: Float[np.ndarray, " s"]) -> Line:
        lags = list(line.lags)
        for group, log in zip(free_lags, shapes[int(free_reference) :], strict=True):
            for number in group:
                lags[number] = float(np.exp(log))
        place = float(shapes[0]) if free_reference else line.reference
        return dataclasses.replace(line, reference=place, lags=(lags[0], lags[1]))

    shapes = np.array(start)
    if not start:
        found = regress(
            line.columns_of(data), data.error, time=data.time, names=names, loss=loss,
            quick=quick,
        )  # fmt: skip
    else:
        low, high = np.array(ends).T
        shapes, found = regress_curve(
            lambda trial: at(trial).columns_of(data), data.error,
            np.clip(shapes, low, high), width=np.array(widths), bounds=(low, high),
            time=data.time, names=names, loss=loss, quick=quick,
        )  # fmt: skip
    value = found.coefficients[: sum(line.shape)]
    return dataclasses.replace(at(shapes), value=value), found


def complete_data(
    readings: ThermalReadings, sensors: tuple[int | None, int | None]
) -> tuple[Data, Int[np.ndarray, " r"]]:
    """Return the complete readings in order of time, and the rows where they stood.

    Args:
        readings: As they were handed in.
        sensors: Of offset and coefficient; None = has none.

    Raises:
        FitError: If they cannot tell what is asked for.
    """
    whole = len(readings.error)
    position = np.zeros(whole) if readings.position is None else readings.position
    clock = np.arange(whole, dtype=float) if readings.time is None else readings.time
    keep = np.isfinite(readings.error) & np.isfinite(position) & np.isfinite(clock)
    for sensor in sensors:
        if sensor is not None:
            keep &= ~missed_temperatures(readings.temperature[:, sensor])
    rows = np.flatnonzero(keep)
    rows = rows[np.argsort(clock[rows], kind="stable")]
    one, other = (
        None
        if sensor is None
        else clocked(clock[rows], readings.temperature[rows, sensor])
        for sensor in sensors
    )
    data = Data(
        readings.error[rows], position[rows], clock[rows], (one, other), sensors,
        np.arange(len(rows)),
    )  # fmt: skip
    _check(data, whole)
    return data, rows


def _check(data: Data, whole: int) -> None:
    """Refuse readings that show no law."""
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

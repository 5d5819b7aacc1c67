"""The line as a model to fit: linear node values, and lags and intersection beside them."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...core._errors import FitError
from ...core._regression import Regression, regress
from ._lag import structure_at
from ._laws import Shape, hats, nodes_over
from ._types import SensorLog

_MANY = 3_000
"""Readings by which laws and lags are chosen; the chosen one is fitted to all."""
_PASSES = 30
"""Gauss–Newton passes at most."""
_STEP = 0.02
"""Step in the logarithm of a time constant for slopes."""


@dataclasses.dataclass(frozen=True)
class Data:
    """Complete readings of one fit, in order of time.

    Attributes:
        error: In mm.
        position: In mm.
        time: In s, on the clock of the log.
        log: All temperatures.
        sensors: Of offset and coefficient; None = has none.
    """

    error: Float[np.ndarray, " t"]
    position: Float[np.ndarray, " t"]
    time: Float[np.ndarray, " t"]
    log: SensorLog
    sensors: tuple[int | None, int | None]

    def structure(
        self, lags: tuple[float, float]
    ) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return the structure temperatures for offset and coefficient in °C."""
        parts = [
            np.zeros(len(self.time))
            if sensor is None
            else structure_at(self.log, sensor, self.time, lag)
            for sensor, lag in zip(self.sensors, lags, strict=True)
        ]
        return parts[0], parts[1]

    def thinned(self) -> "Data":
        """Return every n-th reading so that choices cost the same for logs of any length."""
        step = -(-len(self.error) // _MANY)
        return self.take(np.arange(len(self.error)) % step == 0)

    def take(self, keep: Bool[np.ndarray, " t"]) -> "Data":
        """Return the readings for which ``keep`` is true; the log stays whole."""
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
    lags: tuple[float, float]

    def columns(self, data: Data) -> Float[np.ndarray, "t k"]:
        """Return the functions of which the node values are the factors."""
        offset, slope = data.structure(self.lags)
        parts = [hats(offset, self.nodes[0])]
        if len(self.nodes[1]):
            away = data.position - self.reference
            parts.append(hats(slope, self.nodes[1]) * away[:, None])
        return np.hstack(parts)

    def predict(self, data: Data) -> Float[np.ndarray, " t"]:
        """Return the error in mm."""
        return np.asarray(self.columns(data) @ self.value)

    def names(self) -> tuple[str, ...]:
        """Return the node values in words."""
        words = []
        for effect, nodes in zip(("offset", "coefficient"), self.nodes, strict=True):
            for node in nodes:
                where = "" if len(nodes) == 1 else f" at {node:.4g} °C"
                words.append(effect + where)
        return tuple(words)


def laid_out(
    data: Data, shape: Shape, reference: float, lags: tuple[float, float]
) -> Line | None:
    """Return a line of this shape with its nodes over the data; None where they are too few."""
    offset, slope = data.structure(lags)
    first = nodes_over(offset, shape.offset)
    second = nodes_over(slope, shape.coefficient) if shape.coefficient else np.zeros(0)
    if first is None or second is None:
        return None
    return Line((first, second), np.zeros(shape.size), reference, lags)


def fit_linear(line: Line, data: Data, loss: str) -> Line:
    """Return the line with node values fitted, nothing else."""
    found = regress(
        line.columns(data), data.error, names=line.names(), loss=loss, quick=True
    )
    return dataclasses.replace(line, value=found.coefficients)


def fit_line(
    line: Line,
    data: Data,
    loss: str,
    free_reference: bool,
    free_lags: tuple[int, ...],
    quick: bool = False,
) -> tuple[Line, Regression, bool]:
    """Return the line with all that is free fitted, and the regression at the solution.

    Args:
        line: Start.
        data: Readings.
        loss: As for `regress`.
        free_reference: Fit the reference position (needs a constant offset).
        free_lags: Which lags are fitted: 0 = of the offset, 1 = of the coefficient; (0, 1)
            with one sensor means one lag for both.
        quick: The regression needs no covariance.

    Returns:
        Line, regression (coefficients are node values, then *steps* of the reference in mm
        and of the logarithms of the lags) and whether the steps died out.
    """
    shared = len(free_lags) == 2 and data.sensors[0] == data.sensors[1]
    groups = [free_lags] if shared else [(number,) for number in free_lags]
    if not groups and not free_reference:
        found = regress(
            line.columns(data),
            data.error,
            time=data.time,
            names=line.names(),
            loss=loss,
        )
        line = dataclasses.replace(line, value=found.coefficients)
        return line, found, found.converged
    line = fit_linear(line, data, loss)
    settled = False
    for _ in range(_PASSES):
        design, names = _linearised(line, data, free_reference, groups)
        found = regress(design, data.error, names=names, loss=loss, quick=True)
        line, settled = _moved(line, data, found.coefficients, free_reference, groups)
        line = _renewed(line, data, loss)
        if settled:
            break
    design, names = _linearised(line, data, free_reference, groups)
    found = regress(
        design, data.error, time=data.time, names=names, loss=loss, quick=quick
    )
    return line, found, settled and found.converged


def _linearised(
    line: Line, data: Data, free_reference: bool, groups: Sequence[tuple[int, ...]]
) -> tuple[Float[np.ndarray, "t k"], list[str]]:
    """Return the slopes of the error over all that is free, and their names."""
    columns, names = [line.columns(data)], list(line.names())
    if free_reference:
        _, warm = data.structure(line.lags)
        slope = hats(warm, line.nodes[1]) @ line.value[1:]
        columns.append(-slope[:, None])
        names.append("reference position")
    for group in groups:
        columns.append(_lag_slope(line, data, group)[:, None])
        names.append("time constant")
    return np.hstack(columns), names


def _moved(
    line: Line,
    data: Data,
    found: Float[np.ndarray, " k"],
    free_reference: bool,
    groups: Sequence[tuple[int, ...]],
) -> tuple[Line, bool]:
    """Return the line one Gauss–Newton step further, and whether that was a small one."""
    steps = list(found[len(line.value) :])
    settled = True
    reference = line.reference
    if free_reference:
        span = max(float(np.ptp(data.position)), 1e-9)
        step = float(np.clip(steps.pop(0), -5.0 * span, 5.0 * span))
        reference += step
        settled = abs(step) < 1e-5 * span
    low, high = _bounds(data)
    lags = list(line.lags)
    for group, step in zip(groups, steps, strict=True):
        before = float(np.log(lags[group[0]]))
        after = float(np.clip(before + np.clip(step, -0.7, 0.7), low, high))
        settled = settled and abs(after - before) < 1e-3
        for number in group:
            lags[number] = float(np.exp(after))
    moved = dataclasses.replace(line, reference=reference, lags=(lags[0], lags[1]))
    return moved, settled


def _renewed(line: Line, data: Data, loss: str) -> Line:
    """Return the line after its reference or lags moved: nodes over the range, new values."""
    shape = Shape(len(line.nodes[0]), len(line.nodes[1]))
    fresh = laid_out(data, shape, line.reference, line.lags)
    return fit_linear(
        dataclasses.replace(line, nodes=line.nodes if fresh is None else fresh.nodes),
        data,
        loss,
    )


def _lag_slope(
    line: Line, data: Data, group: tuple[int, ...]
) -> Float[np.ndarray, " t"]:
    """Return the change of the error per logarithm of the lags of a group."""
    ends = []
    for step in (_STEP, -_STEP):
        lags = list(line.lags)
        for number in group:
            lags[number] *= np.exp(step)
        ends.append(dataclasses.replace(line, lags=(lags[0], lags[1])).predict(data))
    return np.asarray((ends[0] - ends[1]) / (2.0 * _STEP))


def _bounds(data: Data) -> tuple[float, float]:
    gaps = np.diff(data.log.time)
    least = float(np.median(gaps[gaps > 0])) if (gaps > 0).any() else 1.0
    span = max(float(np.ptp(data.log.time)), least)
    return float(np.log(0.2 * least)), float(np.log(3.0 * span))


def lag_grid(data: Data, count: int = 14) -> Float[np.ndarray, " g"]:
    """Return time constants in s that the log could show, ascending.

    Raises:
        FitError: If the clock stands still.
    """
    low, high = _bounds(data)
    if not np.ptp(data.time) > 0:
        msg = "all readings have the same time, expected a clock that runs."
        raise FitError(msg)
    return np.exp(np.linspace(low + np.log(5.0), high - np.log(6.0), count))

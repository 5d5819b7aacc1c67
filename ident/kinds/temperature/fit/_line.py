"""Readings of a thermal line in order of time, and the line fitted to them by regression."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import median_filter

from ...._recording import JointData
from ....core import FitError, Regression, regress_curve
from ....fit.joint import Temperature
from ....fit.joint._temperature import LAWS

LEAST_RANGE = 0.5
"""Range of a sensor in K below which no law is determined."""
_MANY = 3_000
"""Readings by which laws and lags are chosen; the chosen one is fitted to all."""
_LEAST = 4
"""Readings of a fit, and between two nodes below which no node is set."""
_STEP = 0.02
"""Step in the logarithm of a time constant for slopes."""
BLOCKS, FOLDS = 20, 5
"""Stretches of time, and in how many turns they are left out, far from each other."""
_VISIT = 0.05
"""Share of the range of temperatures that counts as staying where it is."""
_ABSOLUTE_ZERO = -273.15
_WINDOW = 7
"""Readings over which a temperature is compared with its neighbours."""
_GLITCH = 8.0
"""Distance from the neighbours, in typical distances, that no structure can follow."""
_LEAST_GLITCH = 1.0
"""Distance in K that is no glitch in any case."""

Shape = tuple[int, ...]
"""Nodes of offset and coefficient: 1 constant, 2 linear, more piecewise linear."""


@dataclasses.dataclass(frozen=True)
class Data:
    """Complete readings of one line, in order of time.

    Attributes:
        whole: All of them.
        rows: Where they stood among all that were handed in.
        count: How many these were.
        line: The line; its nodes and lags may still be open.
        moved: The laws that follow a sensor; the offset may be a constant.
        loss: As for `regress`.
    """

    whole: JointData
    rows: Int[np.ndarray, " t"]
    count: int
    line: Temperature
    moved: tuple[str, ...]
    loss: str

    @classmethod
    def of(cls, line: Temperature, data: JointData, loss: str) -> "Data":
        """Return the complete readings.

        Args:
            line: What is asked for; without an offset of its own it gets a constant one.
            data: All readings; without a clock they count as one per second.
            loss: As for `regress`.

        Raises:
            FitError: If they cannot tell what is asked for.
        """
        error = data.column("error", line.axis, line.name)
        clock = np.arange(len(data), dtype=float) if data.time is None else data.time
        keep = np.isfinite(error) & np.isfinite(clock)
        for axis in line.masters:
            keep &= np.isfinite(data.column("position", axis, line.name))
        for sensor in line.sensor_names:
            warm = data.column("temperature", sensor, line.name)
            keep &= ~missed_temperatures(warm)
        rows = np.flatnonzero(keep)
        rows = rows[np.argsort(clock[rows], kind="stable")]
        moved = tuple(law for law in LAWS if law in line.sensors)
        constant = {} if "offset" in moved else {"offset": 1}
        # An offset that is a constant has the sensor of the coefficient: that tells it no node.
        other = line.sensors[moved[0]]
        followed = {law: line.sensors.get(law, other) for law in ("offset", *moved)}
        line = dataclasses.replace(line, sensors=followed, law={**line.law, **constant})
        whole = dataclasses.replace(data, time=clock).take(rows)
        found = cls(whole, rows, len(data), line, moved, loss)
        found._check()
        return found

    def _check(self) -> None:
        """Refuse readings that show no law."""
        if len(self.error) < _LEAST:
            msg = (
                f"{len(self.error)} of {self.count} readings are complete, expected at least"
                f" {_LEAST}."
            )
            raise FitError(msg)
        for law in self.moved:
            sensor = self.line.sensors[law]
            values = self.whole.temperature[sensor]
            if np.ptp(values) < LEAST_RANGE:
                msg = (
                    f"sensor {sensor} of the {law} stays at {values[0]:.4g} °C within "
                    f"{np.ptp(values):.2g} K, expected a range of {LEAST_RANGE} K or more."
                )
                raise FitError(msg)
        if "coefficient" in self.moved and np.ptp(self.position) == 0:
            asked = self.line.sensors["offset"]
            msg = (
                f"found all readings at {self.position[0]:g} mm, expected two positions or more"
                f" for the coefficient, or sensors = {{ offset = {asked!r} }}: at one position"
                " only the offset can be fitted"
            )
            raise FitError(msg)

    @property
    def error(self) -> Float[np.ndarray, " t"]:
        """In mm."""
        return np.asarray(self.whole.error[self.line.axis])

    @property
    def position(self) -> Float[np.ndarray, " t"]:
        """In mm."""
        return np.asarray(self.whole.position[self.line.axis])

    @property
    def time(self) -> Float[np.ndarray, " t"]:
        """In s."""
        assert self.whole.time is not None  # `of` makes one
        return np.asarray(self.whole.time)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Those that move a law, each once."""
        return tuple(dict.fromkeys(self.line.sensors[law] for law in self.moved))

    @property
    def open_lags(self) -> tuple[str, ...]:
        """Sensors whose lag is to be found."""
        return tuple(name for name in self.sensors if self.line.lags[name] == "fit")

    @property
    def given_lags(self) -> dict[str, float]:
        """Lags in s by sensor, 0 where it is to be found."""
        lags = self.line.lags
        return {
            name: 0.0 if lags[name] == "fit" else float(lags[name])
            for name in self.sensors
        }

    @property
    def given_law(self) -> dict[str, int]:
        """Nodes of the laws that are given."""
        nodes = self.line.placed(self.whole).nodes
        return {law: len(own) for law, own in nodes.items() if law in self.line.law}

    def inputs(self, line: Temperature) -> list[Float[np.ndarray, " t"]]:
        """Return the temperature of each law's structure in °C, then the position."""
        return list(line.columns_of(self.whole))

    def columns(self, line: Temperature) -> Float[np.ndarray, "t k"]:
        """Return the functions of which the node values of a line are the factors."""
        return line.rows(self.inputs(line))[1]

    def laid_out(self, shape: Shape, lags: Mapping[str, float]) -> Temperature | None:
        """Return the line over these readings, as `laid_out`; lags in s by sensor."""
        line = self.line.lagging(lags)
        return laid_out(line, self.inputs(line)[: len(shape)], shape)

    @property
    def stretches(self) -> Int[np.ndarray, " t"]:
        """Stretches of time of the readings, as many in each."""
        return np.arange(len(self.error)) * BLOCKS // len(self.error)

    @cached_property
    def blocks(self) -> Int[np.ndarray, " t"]:
        """Stays at one temperature, which are held out together, or stretches of time."""
        theta = self.whole.temperature[self.sensors[0]]
        limit = _VISIT * max(float(np.ptp(theta)), 1e-9)
        stay = np.zeros(len(theta), np.int64)
        start, number = theta[0], 0
        for row, value in enumerate(theta):
            if abs(value - start) > limit:
                start, number = value, number + 1
            stay[row] = number
        return stay if 3 <= number + 1 < BLOCKS else self.stretches

    @property
    def lag_range(self) -> tuple[float, float]:
        """Return the shortest and the longest lag in s that the clock could show.

        Raises:
            FitError: If the clock stands still.
        """
        if not np.ptp(self.time) > 0:
            msg = "all readings have the same time, expected a clock that runs."
            raise FitError(msg)
        clock = self.whole.clocked(self.sensors[0], "a lag").clock
        least = float(np.median(np.diff(clock)))
        return 0.2 * least, 3.0 * max(float(np.ptp(clock)), least)

    def thinned(self) -> "Data":
        """Return every n-th reading so that choices cost the same for logs of any length."""
        few = np.arange(0, len(self.whole), -(-len(self.whole) // _MANY))
        return dataclasses.replace(
            self, whole=self.whole.take(few), rows=self.rows[few]
        )


def laid_out(
    line: Temperature, warmth: Sequence[Float[np.ndarray, " t"]], shape: Shape
) -> Temperature | None:
    """Return a line with equidistant nodes over temperatures in °C.

    None where two of them have too few readings between.
    """
    law = {}
    for name, warm, count in zip(line.sensors, warmth, shape, strict=True):
        low, high = float(warm.min()), float(warm.max())
        nodes = np.linspace(low, high, count)
        if count == 1:
            nodes = np.array([0.5 * (low + high)])
        elif not high > low:
            return None
        elif count > 2 and np.histogram(warm, nodes)[0].min() < _LEAST:
            return None
        law[name] = nodes
    return dataclasses.replace(line, law=law)


def shape_of(line: Temperature) -> Shape:
    """Return the number of nodes of each law."""
    return tuple(len(nodes) for nodes in line.nodes.values())


def names_of(line: Temperature, lags: int = 0) -> tuple[str, ...]:
    """Return what is fitted in words: node values, then lags."""
    words = [
        law + ("" if len(nodes) == 1 else f" at {node:.4g} °C")
        for law, nodes in line.nodes.items()
        for node in nodes
    ]
    return (*words, *["time constant"] * lags)


def fit_line(
    line: Temperature, data: Data, free_lags: Sequence[str] = (), quick: bool = False
) -> tuple[Temperature, Regression]:
    """Return the line with all that is free fitted, and the regression behind it.

    Args:
        line: Start; its temperatures and its reference stay.
        data: Readings.
        free_lags: Sensors whose lag is fitted.
        quick: The regression needs no covariance.

    Returns:
        Line and regression; its coefficients are node values, then the logarithms of the
        lags that are free.
    """
    first, last = np.log(data.lag_range) if free_lags else (0.0, 0.0)
    count = len(free_lags)

    def at(logs: Float[np.ndarray, " s"]) -> Temperature:
        return line.lagging(dict(zip(free_lags, np.exp(logs).tolist(), strict=True)))

    start = np.log([float(line.lags[sensor]) for sensor in free_lags])
    logs, found = regress_curve(
        lambda trial: data.columns(at(trial)), data.error, np.clip(start, first, last),
        width=np.full(count, _STEP), bounds=(np.full(count, first), np.full(count, last)),
        time=data.time, names=names_of(line, count), loss=data.loss, quick=quick,
    )  # fmt: skip
    return at(logs), found


def missed_temperatures(
    temperature: Float[np.ndarray, " t"],
) -> Bool[np.ndarray, " t"]:
    """Return which readings of a sensor are none: not finite, impossible, or lone jumps.

    Args:
        temperature: In °C, in order of time.
    """
    missed = ~np.isfinite(temperature) | (temperature < _ABSOLUTE_ZERO)
    values = temperature[~missed]
    if len(values) >= _WINDOW:
        away = np.abs(values - median_filter(values, _WINDOW, mode="nearest"))
        typical = 1.4826 * float(np.median(away))
        missed[~missed] = away > max(_GLITCH * typical, _LEAST_GLITCH)
    return np.asarray(missed)

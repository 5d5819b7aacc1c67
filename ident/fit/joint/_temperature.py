"""The thermal line as an effect: offset and coefficient as functions of temperature."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, Shaped

from .... import models
from ..._recording import JointData
from ...core import FitError, node_shares
from ._effect import (
    TABLES,
    AbstractEffect,
    Component,
    Inputs,
    Number,
    Ranges,
    Rank,
    Rows,
    dense_rows,
    in_a_row,
    is_number,
    numbers_of,
)

Nodes = str | int | Sequence[Number] | Float[np.ndarray, " _n"]
"""``"constant"``, ``"linear"``, a number of nodes over the measured range, or °C."""

LAWS = ("offset", "coefficient")
"""Parameters of the line, in the order of the values."""
_COUNTS = {"constant": 1, "linear": 2}


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Temperature(AbstractEffect):
    r"""Thermal line of an axis: $e = o(T) + c(T)\,(s - s_0)$.

    Values: the offset in mm at its temperatures, then the coefficient in mm/mm at its own;
    linear between, held outside. Nothing is corrected at the reference temperature: what does
    not depend on the temperature belongs to the datum and to the leadscrew.

    Attributes:
        sensors: Sensor of ``"offset"`` and of ``"coefficient"``, or of one of them.
        sensor: Sensor of both, instead of `sensors`.
        reference: Position $s_0$ in mm (P-AXIS-00272).
        law: How each depends on its temperature: ``"linear"`` where not given, or a number of
            nodes.
        lag: Time constant in s by which the structure follows its sensors (below 0: they
            follow it), ``"none"``, or ``"fit"`` (``"auto"``, as a job says); or by sensor.
        reference_temperature: In °C, where nothing is to be corrected; the nearest measured
            one counts.
    """

    sensors: Mapping[str, str] = dataclasses.field(default_factory=dict)
    reference: Number = 0.0
    law: Mapping[str, Nodes] = dataclasses.field(default_factory=dict)
    lag: Number | str | Mapping[str, Number | str] = 0.0
    reference_temperature: Number = 20.0
    sensor: dataclasses.InitVar[str | None] = dataclasses.field(
        default=None, kw_only=True
    )

    compensation = "temperature"
    no_keys = ("reference_temperature",)
    rank = Rank.OFFSET
    remedy = "measure {axis} at two temperatures of {sensors} at least."
    remedies: ClassVar[Mapping[Rank | None, str]] = {
        **dict.fromkeys(
            TABLES,
            "the temperature of {sensors} changed together with the position of {axes}. "
            "Measure the same positions again at another temperature.",
        ),
        Rank.RUNS: "the temperature of {sensors} changed together with the runs (or with the"
        " time). Let it rise and fall within a run, or repeat a temperature in another run.",
        Rank.DATUM: "the temperature of {sensors} did not change. Measure at two temperatures at"
        " least.",
        Rank.OFFSET: "at each temperature {axes} stood at one position only. Measure each"
        " temperature at several positions.",
        None: "the temperature of {sensors} changed together with the other. Vary it while the"
        " other stays as it is.",
    }

    def __post_init__(self, sensor: str | None) -> None:
        if (sensor is None) == (not self.sensors):
            msg = f"temperature of {self.axis}: expected either sensor or sensors"
            raise FitError(msg)
        if sensor is not None:
            object.__setattr__(self, "sensors", dict.fromkeys(LAWS, sensor))
        wrong = [name for name in (*self.sensors, *self.law) if name not in LAWS]
        found, sensors = ", ".join(wrong), "sensors of 'offset', 'coefficient' or both."
        self.expect(self.sensors and not wrong, found or "no sensor", sensors)
        numeric = not isinstance(self.reference, str)
        self.expect(numeric, f"reference {self.reference!r}", "a position in mm")
        ordered = {law: self.sensors[law] for law in LAWS if law in self.sensors}
        object.__setattr__(self, "sensors", ordered)
        by_sensor = self.lag if isinstance(self.lag, Mapping) else {}
        strange = {*by_sensor} - {*self.sensor_names}
        self.expect(not strange, f"lag of {in_a_row([*strange])}", "of its sensors")
        for value in self.lags.values():
            valid = value == "fit" or is_number(value)
            self.expect(
                valid, f"lag {value!r}", "'fit' (or 'auto'), 'none' or seconds."
            )
        law: dict[str, Nodes] = {}
        for name, entry in self.law.items():
            nodes: str | int | Float[np.ndarray, " _n"]
            nodes = entry if isinstance(entry, str | int) else numbers_of(entry)
            if isinstance(nodes, np.ndarray):
                ascending = nodes.ndim == 1 and (np.diff(nodes) > 0).all()
                valid = bool(ascending and len(nodes))
            else:
                valid = nodes in _COUNTS if isinstance(nodes, str) else nodes > 0
            expected = (
                "'constant', 'linear', a number of temperatures or temperatures in ascending"
                " order."
            )
            self.expect(valid, f"law {entry!r}", expected)
            law[name] = nodes
        object.__setattr__(self, "law", law)

    @cached_property
    def masters(self) -> tuple[str, ...]:
        return (self.axis,) if "coefficient" in self.sensors else ()

    @property
    def name(self) -> str:
        return f"temperature of {self.axis} ({' and '.join(self.sensor_names)})"

    @property
    def lags(self) -> dict[str, Number | str]:
        """Time constant in s or ``"fit"``, by sensor."""
        lags = self.lag
        if not isinstance(lags, Mapping):
            lags = dict.fromkeys(self.sensor_names, lags)
        words: dict[Number | str, Number | str] = {"auto": "fit", "none": 0.0}
        all_lags = {sensor: lags.get(sensor, 0.0) for sensor in self.sensor_names}
        return {
            sensor: words.get(lag, lag) if isinstance(lag, str) else lag
            for sensor, lag in all_lags.items()
        }

    @property
    def nodes(self) -> dict[str, Float[np.ndarray, " _n"]]:
        """Temperatures of the values in °C, by parameter.

        Raises:
            FitError: Where they are still to be read off the data (`placed`).
        """
        result = {}
        for law in self.sensors:
            nodes = self.law.get(law, "linear")
            if not isinstance(nodes, np.ndarray):
                msg = f"{self.name}: its temperatures are not placed on data yet."
                raise FitError(msg)
            result[law] = nodes
        return result

    def placed(self, data: JointData) -> "Temperature":
        """Return the effect with its temperatures spread over those of the data."""
        law: dict[str, Nodes] = {}
        for name, sensor in self.sensors.items():
            nodes = self.law.get(name, "linear")
            if not isinstance(nodes, np.ndarray):
                values = data.column("temperature", sensor, self.name)
                values = values[np.isfinite(values)]
                if not len(values):
                    msg = f"{self.name}: sensor {sensor} has no readings."
                    raise FitError(msg)
                count: Any = _COUNTS[nodes] if isinstance(nodes, str) else nodes
                low, high = float(values.min()), float(values.max())
                if not high > low:
                    # It never changed: the nodes exist, but nothing tells them apart.
                    low, high = low - 0.5, high + 0.5
                middle = np.array([0.5 * (low + high)])
                nodes = np.linspace(low, high, count) if count > 1 else middle
            law[name] = nodes
        return dataclasses.replace(self, law=law)

    def ends(self, data: JointData) -> Float[np.ndarray, " e"]:
        """Return the ends of the line over the axis that no temperature moves, in mm.

        It belongs to a leadscrew, which stands beside; fewer than two: there is no line.
        """
        place = data.position[self.axis] if self.masters else np.zeros(1)
        return np.unique([np.nanmin(place), np.nanmax(place)])

    def lagging(self, lags: Mapping[str, Number | str]) -> "Temperature":
        """Return the effect with these time constants in s or ``"fit"``, by sensor, if its own."""
        merged = {sensor: lags.get(sensor, lag) for sensor, lag in self.lags.items()}
        return dataclasses.replace(self, lag=merged)

    def components(self, places: Int[np.ndarray, " p"]) -> list[Component]:
        """See `AbstractEffect`: its laws, which correct nothing at the reference temperature."""
        at = self.reference_temperature
        rule = f"the temperature corrects nothing at {at:g} °C"
        line = f"A straight line over {self.axis}"
        return [
            Component(
                f"{law} of the {self.name}",
                Rank[law.upper()],
                columns,
                self,
                reference=node_shares(np.array([at]), self.nodes[law]),
                level=rule,
                rule=rule,
                shared=line if law == "coefficient" else "",
            )
            for law, columns in self.split(places).items()
        ]

    @property
    def inputs(self) -> Inputs:
        sensors = [("temperature", sensor) for sensor in self.sensors.values()]
        return (*sensors, *(("position", axis) for axis in self.masters))

    @property
    def ranges(self) -> Ranges:
        ranges: dict[tuple[str, str], tuple[float, float]] = {}
        for law, nodes in self.nodes.items():
            half = 0.5 * max(float(np.ptp(nodes)), 1.0)
            middle = 0.5 * float(nodes[0] + nodes[-1])
            key = ("temperature", self.sensors[law])
            low, high = ranges.get(key, (np.inf, -np.inf))
            ranges[key] = min(low, middle - half), max(high, middle + half)
        return ranges

    @cached_property
    def labels(self) -> tuple[str, ...]:
        return tuple(
            f"{law} at {node:.4g} °C" if len(nodes) > 1 else law
            for law, nodes in self.nodes.items()
            for node in nodes
        )

    def columns_of(self, data: JointData) -> list[Float[np.ndarray, " t"]]:
        """See `AbstractEffect`; temperatures are those of the structure."""
        warmth = [self.structure(data, sensor) for sensor in self.sensors.values()]
        places = [data.column("position", axis, self.name) for axis in self.masters]
        return [*warmth, *places]

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        laws = zip(self.nodes.items(), columns, strict=False)
        parts = {law: node_shares(values, nodes) for (law, nodes), values in laws}
        if "coefficient" in parts:
            parts["coefficient"] *= (columns[-1] - self.reference)[:, None]
        return dense_rows(np.hstack([*parts.values()]))

    def structure(self, data: JointData, sensor: str) -> Float[np.ndarray, " t"]:
        """Return the temperature of the structure behind a sensor in °C, per row.

        Raises:
            FitError: If a lag needs a clock and there is none.
        """
        lag = self.lags[sensor]
        if isinstance(lag, str) or lag == 0.0:
            values = data.column("temperature", sensor, self.name)
            if lag == 0.0 or data.time is None:
                return values
            # A lag that is to be fitted needs the time of each reading.
            return np.where(np.isfinite(data.time), values, np.nan)
        return data.clocked(sensor, self.name).structure(lag)

    def to_model(self, table: Any, sign: float) -> models.TemperatureLine:
        """See `AbstractEffect`; sensors are numbered as `TemperatureLine` wants them."""
        curves: dict[str, Any] = dict.fromkeys(LAWS, 0.0)
        for law, values in self.split(table).items():
            number, nodes = self.sensor_names.index(self.sensors[law]), self.nodes[law]
            curves[law] = (
                models.TemperatureCurve.of(nodes, sign * values, number)
                if len(nodes) > 1
                else float(sign * values[0])
            )
        reference: Any = jnp.asarray(float(self.reference))
        offset, coefficient = (curves[law] for law in LAWS)
        return models.TemperatureLine(reference, offset, coefficient)

    def split(
        self, values: Shaped[np.ndarray, " p"]
    ) -> dict[str, Shaped[np.ndarray, " _n"]]:
        """Return the values by parameter."""
        nodes = self.nodes
        ends = np.cumsum([len(places) for places in nodes.values()])
        return dict(zip(nodes, np.split(values, ends[:-1]), strict=True))

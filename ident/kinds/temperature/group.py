"""The thermal line of a group."""

import dataclasses
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from ...fit import DriftNoise
from ...fit.joint import Leadscrew, Temperature, examine_design
from ...job._draft import AxisLists
from ...job._load import Job
from ...job.joint._member import AbstractMember, at_once, few
from ...job.joint._recording import GroupRecording
from ...job.joint._share import Share
from ...readings import Tables, sensor_name
from ._identify import Identified, drift_instead
from ._recording import ThermalRecording, only_sensor
from .effect import (
    LAWS,
    LEAST_RANGE,
    Lag,
    Law,
    TemperatureFit,
    ThermalReadings,
    laws_of,
)
from .job import TemperatureDraft, refuse_unstated_law
from .keys import Effect, Spec

_SURE = 3.0
"""Deviations up to which lines of all temperatures count as meeting in a point."""
_TWICE = 1.96
_NODES = 11
"""Of the leadscrew that a thermal line is compared with."""


def member(
    job: Job, tables: Tables, index: int, fit: Spec, lists: AxisLists
) -> "TemperatureMember":
    """Plan the thermal line of a group.

    Raises:
        JobError: If a temperature compensation is switched on already and a measurement
            does not say whether it acted.
        MeasurementError: If the only sensor is to be taken and there is none.
    """
    refuse_unstated_law(job, fit, lists)
    effects: dict[Effect, str] | None = fit.effects
    if effects is None:
        measured = tables.measured(fit.sources[0], fit.axis, (fit.axis,))
        only = only_sensor(measured, fit.axis)
        effects = {"offset": only, "coefficient": only}
    sensors: dict[Effect, str] = {
        key: sensor_name(name) for key, name in effects.items()
    }
    return TemperatureMember(index, fit, lists, sensors)


@final
@dataclasses.dataclass(frozen=True)
class TemperatureMember(AbstractMember):
    """A thermal line.

    Attributes:
        effects: Sensor of each effect that is fitted.
    """

    fit: Spec
    effects: dict[Effect, str]

    @property
    def positions(self) -> tuple[str, ...]:
        return (self.axis,) if "coefficient" in self.effects else ()

    @property
    def sensors(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(self.effects.values()))

    def unfit(self, recording: GroupRecording) -> str:
        known = np.isfinite(recording.data.error[self.axis])
        for name in self.sensors:
            warm = recording.data.temperature[name][known]
            warm = warm[np.isfinite(warm)]
            # What a noisy sensor shows of a temperature that stays is no range.
            low, high = np.percentile(warm, [1.0, 99.0]) if warm.size else (0.0, 0.0)
            if high - low < LEAST_RANGE:
                return (
                    f"{name} stays at {0.5 * (low + high):.4g} °C within"
                    f" {high - low:.2g} K, expected a range of {LEAST_RANGE:g} K or more."
                )
        return ""

    @property
    def needs_line(self) -> bool:
        return bool(self.positions)

    def confused(
        self,
        job: Job,
        members: Sequence[AbstractMember],
        recording: GroupRecording,
    ) -> str:
        """Return that an error along the axis looks like its temperature, or nothing.

        Beside a leadscrew of the same axis the readings show that themselves.
        """
        beside = any(one.takes_line and one.axis == self.axis for one in members)
        if beside or not self.positions:
            return ""
        place = recording.data.position[self.axis]
        low, high = float(np.nanmin(place)), float(np.nanmax(place))
        if not high > low:
            return ""
        screw = Leadscrew(self.axis, np.linspace(low, high, _NODES))
        heat = at_once(self.effect(job, recording, None))
        told = examine_design(few(recording.data), [screw, heat])
        own = [each for each in told.confusions if len(set(each.effects)) > 1]
        return own[0].sentence if own else ""

    def effect(
        self,
        job: Job,
        recording: GroupRecording,
        left: Float[np.ndarray, " t"] | None,
    ) -> Temperature:
        reference = 0.0
        if "coefficient" in self.effects:
            if isinstance(self.fit.reference, float):
                reference = self.fit.reference
            else:
                place = recording.data.position[self.axis]
                reference = 0.5 * float(np.nanmin(place) + np.nanmax(place))
        lag: float | str = 0.0
        if recording.data.time is not None and self.fit.lag != "none":
            lag = "fit" if self.fit.lag == "auto" else self.fit.lag
        warmth = {
            job.spec.measurements[name].reference_temperature
            for name in self.fit.sources
        }
        return Temperature(
            self.axis,
            {str(key): sensor for key, sensor in self.effects.items()},
            reference=reference,
            law={str(key): law for key, law in (self.fit.law or {}).items()},
            lag=lag,
            reference_temperature=warmth.pop(),
        )

    def draft(self, job: Job, share: Share) -> TemperatureDraft:
        effect = share.part.effect
        assert isinstance(effect, Temperature)  # of `effect`
        rows = share.rows
        position = None
        if self.positions:
            position = share.column("position", self.axis)
        sensors = self.sensors
        temperature = np.stack(
            [share.column("temperature", name) for name in sensors], axis=1
        )
        structure = np.stack(
            [effect.structure(share.recording.data, name)[rows] for name in sensors],
            axis=1,
        )
        recording = ThermalRecording(
            readings=ThermalReadings(share.error, temperature, position, share.time),
            rows=np.flatnonzero(rows),
            sensors=sensors,
            effects={key: sensors.index(name) for key, name in self.effects.items()},
            datum=None,
            reference_temperature=effect.reference_temperature,
            remarks=tuple(share.remarks()),
            carriers=share.tables,
        )
        fit = self._line(share, effect, structure)
        instead = drift_instead(recording, fit)
        found = Identified(
            fit=fit,
            predicted=share.predicted[rows],
            held_out=share.recording.held_out,
            instead=instead,
        )
        return TemperatureDraft(self.index, self.fit, self.lists, recording, found)

    def _line(
        self,
        share: Share,
        effect: Temperature,
        structure: Float[np.ndarray, "t s"],
    ) -> TemperatureFit:
        """Return the part as the fit of a single line."""
        part = share.part
        laws = laws_of(effect, self.sensors, part.values, part.standard_deviation)
        support: dict[str, np.ndarray] = dict(effect.split(part.support.astype(float)))
        # A law is zero at one temperature: its values go up and down together.
        zero = effect.reference_temperature
        spread = {
            name: np.where(law.temperature < zero, -1.0, 1.0)
            * np.nan_to_num(law.standard_deviation, posinf=0.0)
            for name, law in laws.items()
        }
        meeting = None
        if len(laws) > 1 and not isinstance(self.fit.reference, float):
            meeting = _meeting(laws["offset"], laws["coefficient"])
        if "offset" not in laws or meeting is not None:
            # A line needs an offset: nothing at all temperatures.
            own = laws["coefficient" if meeting is None else "offset"]
            middle = np.array([float(np.mean(own.temperature))])
            laws["offset"] = Law(own.sensor, middle, np.zeros(1), np.zeros(1))
            spread["offset"], support["offset"] = (
                np.zeros(1),
                np.array([len(structure)]),
            )
        order = [name for name in LAWS if name in laws]
        shift, sure = (0.0, None) if meeting is None else meeting
        return TemperatureFit(
            offset=laws["offset"],
            coefficient=laws.get("coefficient"),
            reference=effect.reference + shift if "coefficient" in laws else 0.0,
            reference_deviation=sure,
            meeting="given" if meeting is None else "met",
            lags=self._lags(share),
            names=tuple(
                f"{name} at {node:.4g} °C"
                for name in order
                for node in laws[name].temperature
            ),
            covariance=np.asarray(
                block_diag(*(np.outer(spread[n], spread[n]) for n in order))
            ),
            noise=DriftNoise(share.noise),
            independent=float(np.sum(~share.wild)),
            used=np.ones(len(structure), dtype=bool),
            wild=share.wild,
            residual=share.left,
            temperature=structure,
            scores=(),
            confounded=(),
            support=tuple(int(each) for name in order for each in support[name]),
            converged=share.fit.converged,
        )

    def _lags(self, share: Share) -> tuple[Lag, ...]:
        found = []
        for number, name in enumerate(self.sensors):
            constant, deviation = map(float, share.part.lags.get(name, (0.0, 0.0)))
            half = _TWICE * deviation if np.isfinite(deviation) else 0.0
            interval = max(constant - half, 0.0), constant + half
            found.append(Lag(number, constant, interval, applied=constant > 0.0))
        return tuple(found)


def _meeting(offset: Law, coefficient: Law) -> tuple[float, float] | None:
    """Return where the lines of all temperatures meet, from the reference, in mm, ± 1 sd.

    None where they are parallel or pass each other.
    """
    if len(coefficient.value) < 2 or offset.sensor != coefficient.sensor:
        return None
    known = np.abs(coefficient.value) > _SURE * coefficient.standard_deviation
    warm = np.union1d(offset.temperature, coefficient.temperature)
    own, slope = offset.at(warm), coefficient.at(warm)
    sure = np.interp(warm, offset.temperature, offset.standard_deviation)
    if not known.any() or not np.isfinite(sure).all():
        return None
    weight = 1.0 / np.maximum(sure, 1e-9) ** 2
    normal = float(np.sum(weight * slope**2))
    shift = -float(np.sum(weight * slope * own)) / normal
    left = own + slope * shift
    if np.any(np.abs(left) > _SURE * np.maximum(sure, 1e-9)):
        return None
    return shift, float(1.0 / np.sqrt(normal))

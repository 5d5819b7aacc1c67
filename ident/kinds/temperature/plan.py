"""A planned thermal line: fitted alone, or in a group."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from ....data.measurements import MeasurementError
from ..._recording import JointData
from ...fit import DriftNoise
from ...fit.joint import Leadscrew, Temperature, examine_design
from ...job._draft import AbstractPlan, Leftovers
from ...job.table._plan import refuse_unstated
from ...readings import Tables, sensor_name
from . import KIND
from ._draft import TemperatureDraft
from ._recording import ThermalRecording, read_thermal
from .fit import LEAST_RANGE, Lag, TemperatureFit, about_meeting, fit_temperature
from .keys import Spec

if TYPE_CHECKING:
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share

_TWICE = 1.96
_NODES = 11
"""Of the leadscrew that a thermal line is compared with."""


def plan(tables: Tables, index: int, fit: Spec) -> "TemperaturePlan":
    """Plan a thermal line.

    Raises:
        JobError: If a temperature compensation is switched on already and a measurement
            does not say whether it acted.
    """
    job, machine = tables.job, tables.job.lists[fit.axis].machine
    if machine is not None and machine.integer(KIND.prefix):
        refuse_unstated(job, fit, machine.source, "measure again with COMP OFF TEMP")
    return TemperaturePlan(job, index, fit, tables)


@final
@dataclasses.dataclass(frozen=True)
class TemperaturePlan(AbstractPlan):
    """A planned thermal line.

    Attributes:
        tables: Measurements of the job.
    """

    fit: Spec
    tables: Tables

    @functools.cached_property
    def effects(self) -> dict[str, str]:
        """Sensor of each effect that is fitted.

        Raises:
            MeasurementError: If the only sensor is to be taken and there is none, or several.
        """
        found = self.fit.effects
        if found is None:
            only = self._only_sensor()
            found = {"offset": only, "coefficient": only}
        return {str(effect): sensor_name(role) for effect, role in found.items()}

    def _only_sensor(self) -> str:
        """Return the role of the only sensor of the first measurement."""
        axis = self.axis
        measured = self.tables.measured(self.fit.sources[0], axis, (axis,))
        found = [role for role in measured.values if sensor_name(role) != role]
        if len(found) == 1:
            return found[0]
        listed = ", ".join(found) or "no temperature"
        reason = f"found {listed}, expected sensor = the one that the error of {axis} follows"
        raise MeasurementError(str(measured.source), reason)

    def alone(self, tables: Tables, left: Leftovers) -> TemperatureDraft:
        recording, fit = read_thermal(self), self.fit
        data, line, asked = recording.data, recording.line, recording.effects
        meet = recording.datum is None and not isinstance(fit.reference, float)
        found = fit_temperature(data, line, meet=meet, loss=fit.loss)
        named = {name for one in found.confounded for name in (one.first, one.second)}
        dropped = "offset" in asked and bool(named) and "offset" not in named
        if dropped:
            # The slope and its change are one column: the offset stands apart from both.
            law = {"offset": len(found.offset.value), "coefficient": 1}
            line = dataclasses.replace(line, law=law)
            found = fit_temperature(data, line, meet=meet, loss=fit.loss)
        return TemperatureDraft(self.job, self.index, fit, recording, found, dropped)

    @property
    def positions(self) -> tuple[str, ...]:
        return (self.axis,) if "coefficient" in self.effects else ()

    @property
    def sensors(self) -> tuple[str, ...]:
        asked = self.fit.steady
        steady = () if asked is None else (sensor_name(asked.sensor),)
        return tuple(dict.fromkeys((*self.effects.values(), *steady)))

    @property
    def without_position(self) -> str:
        return (
            ", or sensors = { offset = … } where the error was measured at one position"
        )

    def unfit(self, recording: "GroupRecording") -> str:
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
        self, members: Sequence[AbstractPlan], recording: "GroupRecording"
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
        from ...job.joint._group import at_once, few  # takes long to load

        screw = Leadscrew(self.axis, np.linspace(low, high, _NODES))
        heat = at_once(self.effect(recording, None))
        told = examine_design(few(recording.data), [screw, heat])
        own = [each for each in told.confusions if len(set(each.effects)) > 1]
        return own[0].sentence if own else ""

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> Temperature:
        return self.line(recording.data)

    def line(self, data: JointData) -> Temperature:
        """Return the line that is asked for; it turns in the middle where no reference is given."""
        fit, effects = self.fit, self.effects
        place = data.position[fit.axis] if "coefficient" in effects else np.zeros(0)
        place = place[np.isfinite(place)]
        reference = 0.5 * float(place.min() + place.max()) if place.size else 0.0
        if isinstance(fit.reference, float):
            reference = fit.reference
        lag: float | str = 0.0
        if data.time is not None and fit.lag != "none":
            lag = "fit" if fit.lag == "auto" else fit.lag
        measured = self.job.spec.measurements[fit.sources[0]]
        return Temperature(
            fit.axis,
            effects,
            reference=reference,
            law={str(effect): law for effect, law in (fit.law or {}).items()},
            lag=lag,
            reference_temperature=measured.reference_temperature,
        )

    def draft(self, share: "Share") -> TemperatureDraft:
        effect = share.part.effect
        assert isinstance(effect, Temperature)  # of `effect`
        data = share.recording.data.take(share.rows)
        recording = ThermalRecording(
            data=JointData(
                position={axis: data.position[axis] for axis in self.positions},
                error={self.axis: share.error},
                temperature={name: data.temperature[name] for name in self.sensors},
                time=data.time,
            ),
            rows=np.flatnonzero(share.rows),
            line=effect,
            effects=self.effects,
            datum=None,
            remarks=tuple(share.remarks()),
            carriers=share.tables,
        )
        return TemperatureDraft(
            self.job,
            self.index,
            self.fit,
            recording,
            self._line(share, effect),
            held_out=share.recording.held_out,
        )

    def _line(self, share: "Share", effect: Temperature) -> TemperatureFit:
        """Return the part as the fit of a single line."""
        part, data, rows = share.part, share.recording.data, share.rows
        # A law is zero at one temperature: its values go up and down together.
        deviation = np.nan_to_num(part.standard_deviation, posinf=0.0)
        spread = [
            np.where(effect.nodes[name] < effect.reference_temperature, -own, own)
            for name, own in effect.split(deviation).items()
        ]
        fit = TemperatureFit(
            line=effect,
            sensors=self.sensors,
            values=part.values,
            covariance=np.asarray(block_diag(*(np.outer(own, own) for own in spread))),
            names=effect.labels,
            meeting="given",
            lags=self._lags(share),
            noise=DriftNoise(share.noise),
            independent=float(np.sum(~share.wild)),
            used=np.ones(int(rows.sum()), dtype=bool),
            wild=share.wild,
            predicted=share.predicted[rows],
            temperature=np.stack(
                [effect.structure(data, name)[rows] for name in self.sensors], axis=1
            ),
            support=tuple(part.support.tolist()),
            converged=share.fit.converged,
        )
        if len(fit.laws) < 2 or isinstance(self.fit.reference, float):
            return fit
        span = float(np.ptp(share.column("position", self.axis)))
        met = about_meeting(fit, span)
        return met if met.meeting == "met" else fit

    def _lags(self, share: "Share") -> tuple[Lag, ...]:
        found = []
        for number, name in enumerate(self.sensors):
            constant, deviation = map(float, share.part.lags.get(name, (0.0, 0.0)))
            half = _TWICE * deviation if np.isfinite(deviation) else 0.0
            interval = max(constant - half, 0.0), constant + half
            found.append(Lag(number, constant, interval, applied=constant > 0.0))
        return tuple(found)

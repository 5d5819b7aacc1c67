"""A planned thermal line: fitted alone, or in a group."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float, Int

from ....data.measurements import MeasurementError
from ..._recording import JointData
from ...fit import DriftNoise, FitError
from ...fit.joint import Leadscrew, Temperature, examine_design
from ...job._draft import AbstractPlan, Leftovers
from ...job.table._plan import refuse_unstated
from ...job.table._readings import datum_of
from ...readings import Tables, sensor_name
from . import KIND
from ._alone import choose_line, complete_rows, only_these, place_nodes, read_thermal
from ._draft import TemperatureDraft
from ._line import Lag, TemperatureFit, about_meeting, bent_to_meet
from .keys import Spec

if TYPE_CHECKING:
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share

_AWAY = 0.5
"""Share of what was measured by which a datum may lie outside of it."""
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
        chosen: The line where its laws and lags are chosen already.
    """

    fit: Spec
    tables: Tables
    chosen: Temperature | None = None

    @property
    def without_position(self) -> str:
        return (
            ", or sensors = { offset = … } where the error was measured at one position"
        )

    @property
    def datum(self) -> float | None:
        """Where the instrument was set to zero at all temperatures, or None."""
        datum = datum_of(self.job, self.index, self.fit)
        return None if datum is None else datum[0]

    @functools.cached_property
    def effects(self) -> dict[str, str]:
        """Sensor of each effect that is fitted.

        Raises:
            MeasurementError: If the only sensor is to be taken and there is none, or several.
        """
        roles = self.fit.effects
        if roles is None:
            only = self._only_sensor()
            roles = {"offset": only, "coefficient": only}
        return {str(effect): sensor_name(role) for effect, role in roles.items()}

    def _only_sensor(self) -> str:
        """Return the role of the only sensor of the first measurement."""
        axis = self.axis
        measured = self.tables.measured(self.fit.sources[0], axis, (axis,))
        roles = [role for role in measured.values if sensor_name(role) != role]
        if len(roles) == 1:
            return roles[0]
        listed = ", ".join(roles) or "no temperature"
        reason = f"found {listed}, expected sensor = the one that the error of {axis} follows"
        raise MeasurementError(str(measured.source), reason)

    def fit_single(self, tables: Tables, left: Leftovers) -> TemperatureDraft:
        recording, counted = read_thermal(self)
        line, data = self.line(recording.data), recording.data
        datum = self.datum
        if datum is not None and "coefficient" in line.sensors:
            # The instrument was set to zero there: what the offset does, nobody saw.
            self._refuse_far(datum, data.position[self.axis])
            only = {"coefficient": line.sensors["coefficient"]}
            line = dataclasses.replace(line, sensors=only, reference=datum)
        rows = complete_rows(line, data, counted)
        if confounded := self._confused(line, data):
            # Where the slope and its change are one, the offset may stand apart from both.
            line = dataclasses.replace(line, law={**line.law, "coefficient": 1})
            if "offset" not in line.sensors or self._confused(line, data):
                raise FitError(confounded)
        line = choose_line(data, rows, line, self.fit.loss)
        recording = only_these(recording, rows)
        bent = bent_to_meet(line) if self.meets and datum is None else line
        draft = self._of(bent, recording, rows)
        meeting = draft.found.meeting
        if bent is not line and meeting != "met":
            draft = self._of(line, recording, rows)
        missed = len(counted) - len(rows)
        fit = dataclasses.replace(draft.found, missed=missed, meeting=meeting)
        return dataclasses.replace(draft, found=fit, confounded=confounded)

    def _refuse_far(self, datum: float, place: Float[np.ndarray, " t"]) -> None:
        """Raise where nothing was measured anywhere near the datum.

        Raises:
            FitError: With what was measured.
        """
        low, high = float(np.nanmin(place)), float(np.nanmax(place))
        if max(low - datum, datum - high) > _AWAY * (high - low):
            msg = (
                f"datum: found {datum:g} mm, expected where the instrument was set to zero,"
                f" near {low:.6g} to {high:.6g} mm, which was measured"
            )
            raise FitError(msg)

    def _of(
        self,
        line: Temperature,
        recording: "GroupRecording",
        rows: Int[np.ndarray, " n"],
    ) -> TemperatureDraft:
        """Return the draft of a line whose laws and lags are chosen."""
        from ...job.joint._group import fit_group_of_one  # takes long to load

        lags = self.line(recording.data).lags
        applied = {sensor: lags[sensor] for sensor, lag in line.lags.items() if lag}
        line = place_nodes(line, recording.data, rows).lagging(applied)
        plan = dataclasses.replace(self, chosen=line)
        return plan.draft(fit_group_of_one(plan, recording))

    @property
    def inputs(self) -> dict[str, tuple[str, ...]]:
        plateau = self.fit.steady
        steady = () if plateau is None else (sensor_name(plateau.sensor),)
        sensors = tuple(dict.fromkeys((*self.effects.values(), *steady)))
        axes = (self.axis,) if "coefficient" in self.effects else ()
        return {"position": axes, "temperature": sensors}

    @property
    def shifting(self) -> bool:
        return "offset" in self.effects

    def unfit(self, recording: "GroupRecording") -> str:
        data = recording.data
        try:
            complete_rows(self.effect(recording, None), data, np.arange(len(data)))
        except FitError as error:
            return str(error)
        return ""

    def nodes_beside(self, data: JointData) -> Float[np.ndarray, " n"]:
        return self.line(data).ends(data)

    def confused(
        self, members: Sequence[AbstractPlan], recording: "GroupRecording"
    ) -> str:
        """Return that an error along the axis looks like its temperature, or nothing.

        Beside a leadscrew of the same axis the readings show that themselves.
        """
        screw = any(plan.takes_line and plan.axis == self.axis for plan in members)
        if screw or self.chosen is not None:
            return ""
        return self._confused(self.line(recording.data), recording.data)

    def _confused(self, line: Temperature, data: JointData) -> str:
        """Return that readings cannot tell a line from a leadscrew, in words, or nothing."""
        place = data.position.get(self.axis, np.zeros(1))
        low, high = float(np.nanmin(place)), float(np.nanmax(place))
        if not high > low or "coefficient" not in line.sensors:
            return ""
        from ...job.joint._group import at_once, few  # takes long to load

        screw = Leadscrew(self.axis, np.linspace(low, high, _NODES))
        _, confusions = examine_design(few(data), [screw, at_once(line)])
        mixed = [pair for pair in confusions if len(set(pair.effects)) > 1]
        return mixed[0].sentence if mixed else ""

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> Temperature:
        return self.chosen or self.line(recording.data)

    @property
    def meets(self) -> bool:
        """Whether the line turns where those of all temperatures meet, if they do."""
        return not isinstance(self.fit.reference, float)

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
        line, part, rows = share.part.effect, share.part, share.rows
        assert isinstance(line, Temperature)  # of `effect`
        recorded = share.recording.data
        data = recorded.take(rows)
        timed = data.time is not None and bool(np.isfinite(data.time).all())
        zeros = np.zeros(len(data))
        if not share.recording.drifting:  # else they are taken off already
            with_zeros, without = (
                share.fit.predict(recorded, runs=on)[self.axis][rows]
                for on in (True, False)
            )
            zeros = with_zeros - without
        fit = TemperatureFit(
            line=line,
            data=dataclasses.replace(
                data,
                time=data.time if timed else None,
                error={self.axis: share.error - zeros},
                position={
                    axis: data.position[axis] for axis in self.inputs["position"]
                },
            ),
            rows=np.flatnonzero(rows),
            structure={k: line.structure(recorded, k)[rows] for k in line.sensor_names},
            values=part.values,
            # Of what these readings do not tell nothing is written.
            covariance=np.nan_to_num(share.part.covariance, posinf=0.0),
            lags=tuple(
                Lag(s, float(lag), part.lags.get(s, (0.0, 0.0))[1])
                for s, lag in line.lags.items()
            ),
            noise=share.fit.fits[self.axis].memory.drift or DriftNoise(share.noise),
            wild=share.wild,
            predicted=share.predicted[rows] - zeros,
            support=tuple(part.support.tolist()),
            converged=share.fit.converged,
        )
        if self.meets and len(fit.laws) > 1:
            fit = about_meeting(fit)
        elif self.meets and self.datum is None and fit.coefficient is not None:
            fit = dataclasses.replace(fit, meeting="no offset")
        return TemperatureDraft(self.job, self.index, self.fit, self, fit, share)

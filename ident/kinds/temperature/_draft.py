"""The thermal line of one axis, fitted: judged, written for list and PLC, read back."""

import contextlib
import dataclasses
import functools
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Bool, Float

from ....data.lists import ListFile, Value
from ....models import TemperatureLine
from ...core import FitError, regress
from ...fit.joint import Leadscrew
from ...job._draft import AbstractDraft, Foreseen
from ...job._gating import spread_over
from ...job.result._result import Remark, staged
from ...job.result._second import SecondMeasurement, near_of, part_of
from ...proof import GateCheck
from ...proof.axis import check_switching
from ...readings import Tables
from .._keys import FitSpec
from ._alone import FEWEST, about_runs, read_thermal
from ._law import RATE, ThermalLaw, plc_objects, rates, structured_text, thermal_law
from ._line import TemperatureFit, Warmth
from ._result import TemperatureResult, asks_for_none, remarks_of
from .entries import (
    PREFIX,
    Table,
    entries_of_temperature,
    held_in,
    read_law,
    temperature_line,
)
from .keys import Spec

if TYPE_CHECKING:
    from ...job.joint._share import Share
    from ...job.write._lists import AxisFiles
    from .plan import TemperaturePlan

_SHOWS = 0.1
"""Scatter of a reading that a line must add to show how many times it acts."""
_SURE = 5.0
"""Standard deviations from which on a slope is one that does not follow the temperature."""
_MORE = 0.05
"""Share of the temperatures of a law beyond which it is held for long enough to matter."""
_JUDGED = 20_000
"""Readings of a second measurement among which neighbours are looked for."""


@final
@dataclasses.dataclass(frozen=True)
class TemperatureDraft(AbstractDraft):
    """A fitted thermal line.

    Attributes:
        plan: What was asked for.
        found: The estimate, in the sign of the error.
        share: Its part of the joint fit.
        confounded: Why the coefficient is held constant, in words; empty where it is not.
    """

    fit: Spec
    plan: "TemperaturePlan"
    found: TemperatureFit
    share: "Share"
    confounded: str = ""

    @property
    def needs(self) -> str:
        return "Works once the axis is homed and the PLC program runs"

    @property
    def written(self) -> bool:
        return bool(self.found.moving)

    @property
    def converged(self) -> bool:
        return self.found.converged

    @property
    def partial(self) -> bool:
        return bool(self.confounded)

    @functools.cached_property
    def zero(self) -> float:
        """Temperature in °C at which nothing is corrected: measured, near the reference.

        Where two sensors move the line it is the reference itself: each law is held at its
        own end, the measured temperature next to it.
        """
        wished = float(self.found.line.reference_temperature)
        laws = self.found.moving or tuple(self.found.laws.values())
        if len({law.sensor for law in laws}) > 1:
            return wished
        low = max(float(law.temperature[0]) for law in laws)
        high = min(float(law.temperature[-1]) for law in laws)
        return float(np.clip(wished, low, max(low, high)))

    def machine_entries(self, cycles: int | None) -> dict[str, Value]:
        idle = TemperatureLine(self.position, 0.0, 0.0, cycles=self._filter)
        return {**entries_of_temperature(idle), **self.manual_entry}

    def machine_remarks(self) -> Iterator[Remark]:
        listing = self.lists.machine
        if listing is not None and (held := held_in(listing)):
            yield Remark.warning(
                f"{', '.join(held)} of {listing.source} become 0: the PLC writes the law"
                " from now on, and the list holds the state at the reference"
                " temperature."
            )

    def extra_files(self) -> Mapping[str, bytes]:
        table, program, *_ = self.fit.plc_files
        plc = self._program
        objects = {f"{name}.TcPOU": text for name, text in plc_objects(plc).items()}
        law = self._law.csv(*self._followed)
        texts = {table: law, program: structured_text(plc)} | objects
        return {name: text.encode() for name, text in texts.items()}

    @property
    def foreseen(self) -> Foreseen:
        fit = self.found
        if self.written:
            return Foreseen(fit.error, fit.predicted, fit.wild)
        about_middle = fit.error - np.median(fit.error)
        return Foreseen(about_middle, about_middle, fit.wild)

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        law, places, limits = self._law, self.places, self.job.spec.gate
        correction, warm, place = law.largest(places - self.position)
        where = f"at {warm:.4g} °C"
        if len(places) > 1:
            where += f", {self.axis} = {places[place]:g}"
        steep = int(np.argmax(np.abs(law.coefficient)))
        slope = float(abs(law.coefficient[steep]))
        steepest = f"at {law.temperature[steep]:.4g} °C"
        speed = 1e-6 * slope * limits.feed / 60.0
        follows = "while the PLC follows the temperature"
        entry = f"{PREFIX}_n_cycles"
        switched = (
            "COMP ON/OFF, homing, reload or loss of power, while warm and standing"
        )
        return (
            limits.check("max_correction", correction, "mm", where),
            limits.check("max_slope", 1e-3 * slope, "µm/mm", steepest),
            limits.check("max_velocity", speed, "mm/s", steepest),
            limits.check("max_velocity by the PLC", RATE, "mm/s", follows),
            check_switching(self.jump, self._filter, limits, "mm", entry, switched),
        )

    @property
    def jump(self) -> float:
        return self._law.largest(self.places - self.position)[0]

    @property
    def lags(self) -> Mapping[str, float]:
        return {lag.sensor: lag.time_constant for lag in self.found.lags}

    @property
    def warmth(self) -> Warmth:
        return self.found.structure

    def line(self, machine: ListFile | None) -> TemperatureLine | None:
        return self._line_of(self._law.columns, machine)

    def second_measurement(
        self, tables: Tables, fit: FitSpec
    ) -> SecondMeasurement | None:
        assert isinstance(fit, Spec)
        plan = dataclasses.replace(self.plan, job=tables.job, fit=fit, tables=tables)
        recording, rows = read_thermal(plan)
        data, line = recording.data, self.found.line
        readings = data.take(rows)
        warm = {k: line.structure(data, k)[rows] for k in self.found.sensors}
        place = readings.position.get(self.axis, np.zeros(len(rows)))
        predicted = self.found.predict(warm, place)
        finite = np.isfinite(readings.error[self.axis]) & np.isfinite(predicted)
        error, predicted = readings.error[self.axis][finite], predicted[finite]
        place, warm = place[finite], {k: each[finite] for k, each in warm.items()}
        # What the first fit left beside its law, as the slope of a screw, is left here as well.
        error = error - self._still * (place - place.mean())
        if (run := readings.run_of(self.axis)) is not None:
            # The instrument was zeroed anew in each: what it shows is the change within.
            error, predicted = (
                about_runs(each, run[finite]) for each in (error, predicted)
            )
        within = self._within(warm)
        # The zero is where the line takes nothing off, as in the first measurement: the
        # middle of the readings is another one, where the line is not what it should be.
        zero, factor, near = float(np.median(error)), None, ""
        scatter = float(self.foreseen.predicted[~self.foreseen.wild].std())
        counts = int(within.sum()) >= FEWEST
        if counts and np.std(predicted[within]) > _SHOWS * scatter:
            with contextlib.suppress(FitError):
                columns = np.stack([np.ones(len(error)), predicted], axis=1)[within]
                fitted = regress(columns, error[within])
                zero, remaining = map(float, fitted.coefficients)
                factor = 1.0 - remaining, float(fitted.standard_deviation[1])
        if counts:
            some = np.flatnonzero(within)[:: -(-int(within.sum()) // _JUDGED)]
            at = [each[some].round(1) for each in warm.values()]
            left, clock = (error - zero)[some], readings.order[finite][some]
            # Neighbours in time at all places that the axis ran through, or at one of them.
            for names, places in (((), ()), ((self.axis,), (place[some],))):
                columns = np.column_stack([*at, *places, clock])
                words = (*self.found.sensors, *names)
                near = near or near_of(
                    words, columns, left, None, scatter, sloped=False
                )
        return SecondMeasurement(
            ", ".join(fit.sources),
            place[:, None],
            error - zero,
            added=float(np.std(predicted)),
            adds=-predicted,
            unseen=self._unseen(place, warm),
            factor=factor,
            near=near,
            beyond=self._beyond(within),
        )

    @functools.cached_property
    def _still(self) -> float:
        """Slope in mm/mm that the first readings show, whatever the temperature; 0 for none.

        Where a table is fitted as well, it holds that.
        """
        alone = [fit.axis for fit in self.job.spec.fits].count(self.axis) == 1
        for part in self.share.group.helpers if alone else ():
            screw = part.effect
            if isinstance(screw, Leadscrew) and screw.axis == self.axis:
                ends = np.array([-1.0, 1.0]) / np.ptp(screw.nodes)
                slope, variance = ends @ part.values, ends @ part.covariance @ ends
                if abs(slope) > _SURE * np.sqrt(variance):
                    return float(slope)
        return 0.0

    def _unseen(self, place: Float[np.ndarray, " t"], warm: Warmth) -> dict[str, Any]:
        """Return which part of the travel and of the temperatures readings saw, if not all."""
        unseen, first = dict[str, Any](), self.found.position
        law = self.found.laws.get("coefficient")
        grows = law is not None and np.ptp(law.value) > 0.0
        if first is not None and grows:
            part = part_of((self.axis,), first[:, None], place[:, None])
            unseen |= zip(("axis", "low", "high"), part or (), strict=part is not None)
        for name, ends in self._ends.items():
            if part := part_of((name,), np.array(ends)[:, None], warm[name][:, None]):
                unseen["warmth"] = [*part]
        return unseen

    @property
    def _ends(self) -> Mapping[str, tuple[float, float]]:
        """First and last temperature in °C of each sensor that moves the line."""
        laws = self.found.moving
        return {law.sensor: (law.temperature[0], law.temperature[-1]) for law in laws}

    def _within(self, warm: Warmth) -> Bool[np.ndarray, " t"]:
        """Return which readings lie within the temperatures of the laws."""
        inside = np.array(True)
        for name, (low, high) in self._ends.items():
            more = _MORE * (high - low)
            inside = inside & (warm[name] >= low - more) & (warm[name] <= high + more)
        return inside

    def _beyond(self, within: Bool[np.ndarray, " t"]) -> str:
        """Return that a law is held beyond its temperatures, in words; empty: it was not."""
        if within.all():
            return ""
        ends = " and ".join(
            f"{name} = {low:.4g} to {high:.4g} °C"
            for name, (low, high) in self._ends.items()
        )
        return (
            f"{int((~within).sum())} of {len(within)} readings lie beyond {ends}, where the"
            " law was measured and from where on the PLC holds it"
        )

    def prove(self, done: "AxisFiles") -> TemperatureResult:
        table, fit = done.path(self.fit.plc_files[0]), self.found
        before, predicted, wild = self.foreseen
        from_file = before
        if self.written and table is not None:
            line = self._line_of(read_law(table)[0], done.machine)
            place, warm = fit.position, np.stack([*fit.structure.values()], axis=1)
            distance = np.zeros(len(before)) if place is None else place
            from_file = before + np.asarray(line.offset(distance, warm))
        return TemperatureResult(
            **self.frame(done),
            error=staged(before, predicted, from_file, wild),
            remarks=tuple(remarks_of(self)),
            held_out=self.share.recording.held_out,
            no_effect=not (self.written or asks_for_none(self.fit)),
            reference=self.position,
            zero=self.zero,
            law=self._law if self.written else None,
            fit=fit,
            cycles=self._filter if self.written else 0,
            before=before,
            predicted=predicted,
            from_file=from_file,
        )

    def _line_of(self, table: Table, machine: ListFile | None) -> TemperatureLine:
        """Return the line that the PLC makes of a table, beside an axis list."""
        first, second = map(self.found.sensors.index, self._followed)
        return temperature_line(table, (first, second), self.job.conventions, machine)

    @property
    def _followed(self) -> tuple[str, str]:
        """Sensors of offset and coefficient: of one of them for both."""
        effects, first = self.found.line.sensors, self.found.sensors[0]
        return effects.get("offset", first), effects.get("coefficient", first)

    @property
    def position(self) -> float:
        """Reference position in mm, in whole units of the list."""
        return round(self.found.reference * 1e4) / 1e4

    @functools.cached_property
    def _law(self) -> ThermalLaw:
        sign = int(self.job.conventions.temperature_sign)
        return thermal_law(self.found, self.zero, sign)

    @functools.cached_property
    def places(self) -> Float[np.ndarray, " p"]:
        """The ends of what the axis reaches in mm; its reference without those."""
        place = self.found.position
        if place is None:
            return np.array([self.position])
        reached = [*place, *(self.job.spec.axes[self.axis].limits or ())]
        return np.array([min(reached), max(reached)], dtype=float)

    @functools.cached_property
    def _filter(self) -> int:
        """P-AXIS-00275: as given, or what switching off while warm wants."""
        if self.fit.n_cycles is not None:
            return self.fit.n_cycles
        machine, entry = self.lists.machine, f"{PREFIX}_n_cycles"
        return spread_over(self.job, self.jump, machine, entry, switched=True)

    @property
    def _program(self) -> dict[str, Any]:
        job, (offset, coefficient) = self.job, self._followed
        return {
            "axis": self.axis,
            "number": job.spec.axes[self.axis].number,
            "title": job.spec.title or job.path.name,
            "law": self._law,
            "position": self.position,
            "zero": self.zero,
            "sensors": self.lags,
            "offset": offset,
            "coefficient": coefficient,
            "rates": rates(self.places - self.position),
            "sign": int(job.conventions.temperature_sign),
        }

"""The friction of one axis: law, list within the controller's limits, proof."""

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ....data.lists import Value
from ....data.signals import quantile
from ....data.units import small_unit
from ....models import FrictionCompensation, FrictionTable, Setpoints
from ...friction import Knots, place_knots
from ...job._draft import AbstractDraft, AbstractPlan, Foreseen, Leftovers
from ...job.result._result import STAGES, Remark
from ...proof import CircularTest, GateCheck, circular_test, gate_check
from ...readings import Tables
from ._changes import changes
from ._law import (
    FIRST_LEVEL,
    RATED,
    Identified,
    LawCurve,
    identify,
    law_curve,
    out_unit,
)
from ._recording import DriveRecording, read_drive
from ._result import FrictionResult, FrictionView, choice_sentence, view_of
from .entries import ENTRIES, entries_of_friction, friction_from_list
from .keys import Spec

if TYPE_CHECKING:
    from ...job.write._lists import AxisFiles

_ENTRIES = 20
_SLOW = 2.0
"""mm/s or °/s that the fastest motion of a recording reaches, unless a unit is another one."""
_MOST_DELAY = 0.001
"""mm: P-COMP-00043 goes no further."""
_SURE = 3.0
"""Standard deviations from which on an inertia or a load is one."""
_USUAL, _FASTER = 0.98, 3.0
"""Quantile that is the highest speed of a direction, and how many times that of the other."""
_COARSE = 0.05
"""Share of the friction by which entries may miss the law before it is said."""


def plan(tables: Tables, index: int, fit: Spec) -> "FrictionPlan":
    """Plan a friction fit."""
    return FrictionPlan(tables.job, index, fit)


@final
@dataclasses.dataclass(frozen=True)
class FrictionPlan(AbstractPlan):
    """A planned friction."""

    fit: Spec

    def fit_single(self, tables: Tables, left: Leftovers) -> "FrictionDraft":
        job, fit = self.job, self.fit
        recording = read_drive(tables, fit)
        level = fit.level
        if level is None:
            level = 1.0 if "friction_sign" in job.verified else FIRST_LEVEL
        identified = identify(recording, fit, job.spec.controller.cycle_time)
        curve, knots = law_curve(identified, recording.samples), None
        unit = out_unit(fit, recording.unit)
        if not recording.unsure and curve is not None and unit is not None:
            knots = place_knots(
                curve.speed,
                curve.mean * level,
                curve.weight,
                entries=fit.table_entries or _ENTRIES,
                unit=unit,
                reach=float(np.max(np.abs(recording.samples.velocity))),
            )
            if "monotone" in fit.constraints:  # of its rounded lines as of the law
                rising = np.maximum.accumulate(knots.out)
                knots = dataclasses.replace(knots, out=rising)
            # Friction never drives an axis, whatever a law says where little was measured.
            knots = dataclasses.replace(knots, out=np.maximum(knots.out, 0))
        view = view_of(recording, identified, curve, knots, level)
        return FrictionDraft(
            job, self.index, fit, recording, identified, curve, knots, view, level
        )


@final
@dataclasses.dataclass(frozen=True)
class FrictionDraft(AbstractDraft):
    """A law of friction, and the list made of it.

    Attributes:
        recording: What the drive recorded.
        found: The law.
        curve: The law over the driven speeds, or None where it is not determined.
        knots: The entries; None where none are written.
        view: What the list leaves of the recording.
        level: Share of the friction that the list gives.
    """

    fit: Spec
    recording: DriveRecording
    found: Identified
    curve: LawCurve | None
    knots: Knots | None
    view: FrictionView
    level: float

    @property
    def needs(self) -> str:
        return "Works without referencing"

    @property
    def written(self) -> bool:
        return self.knots is not None

    @property
    def converged(self) -> bool:
        return self.found.fit.converged

    def entries(self) -> dict[str, Value]:
        assert self.knots is not None  # it is written
        rules, existing = self.job.conventions, self.lists.compensation
        nodes = Setpoints(self.knots.velocity / 1000.0)
        law = FrictionTable(nodes, rules.friction_sign * self.knots.out.astype(float))
        compensation, reversal = FrictionCompensation(law), self.found.reversal
        if reversal is not None:
            numbers, unknown = reversal.numbers, reversal.undetermined
            around: dict[str, Any] = {
                k: numbers[k] for k in numbers if k not in unknown
            }
            if "position_delay" in around:
                around["position_delay"] = min(around["position_delay"], _MOST_DELAY)
            compensation = dataclasses.replace(compensation, **around)
        elif existing is not None and ENTRIES.is_in(existing):
            # What was not looked for around reversals stays as it was.
            previous = friction_from_list(existing, rules)
            compensation = dataclasses.replace(previous, law=law)
        return dict(entries_of_friction(compensation, target=self.target))

    @property
    def unit(self) -> str:
        return self.recording.unit or "raw"

    @property
    def foreseen(self) -> Foreseen:
        return self.view.foreseen

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        assert self.knots is not None  # it is written
        assert self.fit.torque_unit is not None  # else no entry could be
        largest = int(np.argmax(np.abs(self.knots.out)))
        value = float(abs(self.knots.out[largest]) * self.fit.torque_unit)
        speed = self.knots.velocity[largest] / 1000.0
        where = f"at {speed:g} {self.recording.samples.unit}/s"
        more = gate_check(
            "level", self.level, 1.0, "of the friction", "over all speeds"
        )
        return (
            self.job.spec.gate.check("max_current", value, "of rated", where),
            self.view.gate(self.knots.unit, self.recording.unit),
            *[more] * (not more.passed),
        )

    def prove(self, done: "AxisFiles") -> FrictionResult:
        view, listing, model = self.view, done.compensation, None
        if listing is not None and self.knots is not None:
            model = friction_from_list(listing, self.job.conventions)
        if model is not None and self.knots is not None:
            law = model.law.evaluate(view.samples.velocity)
            listed = self.knots.unit * model.sign * law
            view = dataclasses.replace(view, listed=listed)
        return FrictionResult(
            **self.frame(done),
            error={stage: view.figures(getattr(view, stage)) for stage in STAGES},
            remarks=tuple(self._remarks()),
            held_out="window",
            identified=self.found,
            knots=self.knots,
            level=self.level,
            curve=self.curve,
            view=view,
            circle=self._circle(model),
        )

    def _circle(self, model: FrictionCompensation | None) -> CircularTest | None:
        """Return a simulated circle, where mass, law and list are known."""
        fit = self.found.fit
        inertia = fit.parameters.get("inertia", 0.0)
        law, knots = fit.law, self.knots
        if model is None or law is None or knots is None:
            return None
        if inertia <= _SURE * fit.standard_deviations.get("inertia", 0.0):
            return None  # without a mass nothing moves as an axis does
        if self.recording.samples.unit != "mm":
            return None  # a circle is drawn by linear axes
        cycle = self.job.spec.controller.cycle_time
        return circular_test(law, inertia, model, out_unit=knots.unit, cycle=cycle)

    def _remarks(self) -> Iterator[Remark]:
        yield from self.recording.remarks
        fit, law = self.found.fit, self.found.law
        yield from map(Remark.info, law.gauges)
        for name, reason in law.undetermined.items():
            yield Remark.warning(f"{name.replace('_', ' ')} is not known: {reason}")
        yield from self.found.remarks
        yield Remark.info(choice_sentence(self.found.choice))
        inertia = fit.parameters.get("inertia", 0.0)
        sd = fit.standard_deviations.get("inertia", 0.0)
        if inertia < -_SURE * sd:
            yield Remark.warning(
                f"The inertia is {inertia:.4g} ± {sd:.2g}, below 0: no axis brakes when its current"
                " accelerates it. Look at the signs of velocity, acceleration and current: the"
                " friction is as wrong as they are."
            )
        load, sd = self.view.offset, fit.standard_deviations.get("offset", 0.0)
        if load is not None and abs(load) > _SURE * sd:
            yield Remark.info(
                f"A constant load of {load:.4g} {self.recording.unit}"
                " (gravity, counterweight) is no friction: it belongs into the torque"
                " offset of the drive, not into the list. With the list written here"
                " this offset leaves the least of the current."
            )
        if fit.has_law:
            samples, unit = self.recording.samples, self.recording.unit
            yield from changes(
                samples, fit.friction, inertia, unit, stated=fit.inertia is not None
            )
        if self.curve is not None and self.curve.speed[-1] < _SLOW:
            yield Remark.warning(
                f"The fastest motion is {self.curve.speed[-1]:.2g} {self.recording.samples.unit}/s,"
                " where machines hardly move: are the units of position and time right (m for"
                " mm, ms for s)? Faster than that the list gives what it gives there."
            )
        if self.recording.unsure:
            yield Remark.error(f"No list is written. {self.recording.unsure}")
        elif not fit.has_law:
            yield Remark.error(
                "The law of friction cannot be told from this recording: no list is"
                " written."
            )
        elif self.curve is None:
            speed = float(np.abs(self.recording.samples.velocity).max())
            yield Remark.error(
                f"No list is written. The largest speed is {speed:.2g}"
                f" {self.recording.samples.unit}/s: look at the units of time and position."
            )
        elif self.knots is None and self.fit.torque_unit is None:
            yield Remark.info(
                "The job does not state torque_unit: the law is reported, and no list is"
                " written."
            )
        elif self.knots is None:
            unit, other = self.recording.unit, ""
            missing = RATED.get(unit, "a current in A, %, Nm, N or raw")
            for key in ("rated_current", "rated_torque"):
                other = f" in place of {key}" if getattr(self.fit, key) else other
            found = f"is in {unit}" if unit else "states no unit"
            yield Remark.error(
                "No list is written. torque_unit asks for one, and the recorded current"
                f" {found}: state {missing}{other}."
            )
        if self.knots is not None and self.curve is not None:
            yield from self._unsaid(self.curve, self.knots)

    def _unsaid(self, curve: LawCurve, knots: Knots) -> Iterator[Remark]:
        """Return what the list cannot say of the law."""
        share = curve.difference
        if share > 0.02:
            yield Remark.warning(
                f"The two directions differ by {share:.0%} of the friction on"
                " average. A list knows no direction: it gives the mean of both."
            )
        samples = self.recording.samples
        velocity = samples.velocity[samples.in_motion]
        slower, faster = sorted(
            quantile(np.abs(velocity[way * velocity > 0]), _USUAL) for way in (1, -1)
        )
        if faster > _FASTER * slower:
            yield Remark.warning(
                f"One direction was driven at up to {faster:.3g} {samples.unit}/s, the other at up"
                f" to {slower:.3g} only: above that the list gives what the first one shows."
                " Record both directions at all speeds."
            )
        misfit = knots.current(curve.speed) - self.level * curve.mean
        missed = float(np.sqrt(curve.weight @ np.square(misfit)))
        size = float(np.sqrt(curve.weight @ np.square(curve.mean)))
        if _COARSE * size < missed < knots.unit:
            unit = self.recording.unit
            yield Remark.warning(
                f"The list misses the law by {missed:.3g} {unit} rms: one unit of its entries"
                f" is {knots.unit:.3g} {unit}. What it leaves is the error from file. Are"
                " rated_current and torque_unit right?"
            )
        below = curve.speed[self.level * curve.mean < -knots.unit]
        if len(below):
            yield Remark.warning(
                f"The law is below 0 at speeds up to {below[-1]:.3g}"
                f" {self.recording.samples.unit}/s: friction never drives an axis, and the"
                " list gives 0 there. Record these speeds for longer, and current and"
                " position of the same moment."
            )
        if self.level > 1.0:
            yield Remark.error(
                f"The list gives {self.level:.0%} of the friction (level): more than there"
                " is shakes the machine at reversals; expected 1 at most."
            )
        if self.level < 1.0:
            why = ""
            if self.fit.level is None:
                why = ", as long as no measurement has settled the sign of its current"
            yield Remark.info(
                f"The list gives {self.level:.0%} of the friction (level), a"
                f" cautious beginning{why}; scaling_factor stays at 1000. The rest remains,"
                " as the figures say: once slow reversals with the list show less"
                " following error, not more, raise level and fit again."
            )
        reversal = self.found.reversal
        if reversal is not None and reversal.position_delay > _MOST_DELAY:
            small = small_unit(self.recording.samples.unit)
            yield Remark.warning(
                f"After a reversal friction takes {1e3 * reversal.position_delay:.1f}"
                f" {small} to build up; the list goes no further than 1 {small}"
                " (position_delay, P-COMP-00043)."
            )

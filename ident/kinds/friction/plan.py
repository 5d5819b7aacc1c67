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
from ._law import LawCurve, identify, law_curve
from ._recording import read_drive
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
_RATED = {"A": "rated_current", "Nm": "rated_torque", "N": "rated_torque"}
"""Key of the job that says what the rated value is, by unit of the recording."""
_FIRST_LEVEL = 0.15
"""Share of the friction that a list gives until the sign of its current is settled: one of
full size with the wrong sign shakes the machine."""


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
            level = 1.0 if "friction_sign" in job.verified else _FIRST_LEVEL
        found = identify(recording, fit, job.spec.controller.cycle_time)
        curve, knots = law_curve(found, recording.samples), None
        unit = _out_unit(fit, recording.unit)
        if not recording.unsure and curve is not None and unit is not None:
            knots = place_knots(
                curve.speed,
                curve.mean * level,
                curve.weight,
                entries=fit.table_entries or _ENTRIES,
                unit=unit,
                reach=float(np.max(np.abs(recording.samples.velocity))),
            )
            # Friction never drives an axis, whatever a law says where little was measured.
            out = np.maximum(knots.out, 0)
            if "monotone" in fit.constraints:  # of its rounded lines as of the law
                out = np.maximum.accumulate(out)
            knots = dataclasses.replace(knots, out=out)
        view = view_of(recording, found, curve, knots, level)
        return FrictionDraft(job, self.index, fit, view)


@final
@dataclasses.dataclass(frozen=True)
class FrictionDraft(AbstractDraft):
    """A law of friction, and the list made of it.

    Attributes:
        view: What was found, and what the list leaves of the recording.
    """

    fit: Spec
    view: FrictionView

    @property
    def needs(self) -> str:
        return "Works without referencing"

    @property
    def written(self) -> bool:
        return self.view.knots is not None

    @property
    def converged(self) -> bool:
        return self.view.found.fit.converged

    def entries(self) -> dict[str, Value]:
        knots, reversal = self.view.knots, self.view.found.reversal
        assert knots is not None  # it is written
        rules, existing = self.job.conventions, self.lists.compensation
        nodes = Setpoints(knots.velocity / 1000.0)
        law = FrictionTable(nodes, rules.friction_sign * knots.out.astype(float))
        compensation = FrictionCompensation(law)
        if reversal is not None:
            around: dict[str, Any] = {
                name: min(number, _MOST_DELAY) if name == "position_delay" else number
                for name, number in reversal.numbers.items()
                if name not in reversal.undetermined
            }
            compensation = dataclasses.replace(compensation, **around)
        elif existing is not None and ENTRIES.is_in(existing):
            # What was not looked for around reversals stays as it was.
            previous = friction_from_list(existing, rules)
            compensation = dataclasses.replace(previous, law=law)
        return dict(entries_of_friction(compensation, target=self.target))

    @property
    def unit(self) -> str:
        return self.view.recording.unit or "raw"

    @property
    def foreseen(self) -> Foreseen:
        return self.view.foreseen

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        view, knots = self.view, self.view.knots
        assert knots is not None  # it is written
        assert self.fit.torque_unit is not None  # else no entry could be
        largest = int(np.argmax(np.abs(knots.out)))
        value = float(abs(knots.out[largest]) * self.fit.torque_unit)
        speed = knots.velocity[largest] / 1000.0
        where = f"at {speed:g} {view.samples.unit}/s"
        more = gate_check(
            "level", view.level, 1.0, "of the friction", "over all speeds"
        )
        return (
            self.job.spec.gate.check("max_current", value, "of rated", where),
            view.gate(),
            *[more] * (not more.passed),
        )

    def prove(self, done: "AxisFiles") -> FrictionResult:
        view, listing, circle = self.view, done.compensation, None
        if listing is not None and (knots := view.knots) is not None:
            model = friction_from_list(listing, self.job.conventions)
            law = model.law.evaluate(view.samples.velocity)
            view = dataclasses.replace(view, listed=knots.unit * model.sign * law)
            circle = self._circle(model, knots.unit)
        return FrictionResult(
            **self.frame(done),
            error={stage: view.figures(getattr(view, stage)) for stage in STAGES},
            remarks=tuple(self._remarks()),
            held_out="window",
            view=view,
            circle=circle,
        )

    def _circle(self, model: FrictionCompensation, unit: float) -> CircularTest | None:
        """Return a simulated circle of a linear axis, where mass and law are known."""
        fit = self.view.found.fit
        inertia = fit.parameters.get("inertia", 0.0)
        # Without a mass nothing moves as an axis does.
        known = inertia > _SURE * fit.standard_deviations.get("inertia", 0.0)
        if not known or fit.law is None or self.view.samples.unit != "mm":
            return None
        cycle = self.job.spec.controller.cycle_time
        return circular_test(fit.law, inertia, model, out_unit=unit, cycle=cycle)

    def _remarks(self) -> Iterator[Remark]:
        view, found = self.view, self.view.found
        fit, law, curve = found.fit, found.law, view.curve
        per, unit = view.samples.unit, view.recording.unit
        yield from view.recording.remarks
        yield from map(Remark.info, law.gauges)
        for name, reason in law.undetermined.items():
            yield Remark.warning(f"{name.replace('_', ' ')} is not known: {reason}")
        yield from found.remarks
        yield Remark.info(choice_sentence(found.choice))
        inertia = fit.parameters.get("inertia", 0.0)
        sd = fit.standard_deviations.get("inertia", 0.0)
        if inertia < -_SURE * sd:
            yield Remark.warning(
                f"The inertia is {inertia:.4g} ± {sd:.2g}, below 0: no axis brakes when its current"
                " accelerates it. Look at the signs of velocity, acceleration and current: the"
                " friction is as wrong as they are."
            )
        load, sd = view.offset, fit.standard_deviations.get("offset", 0.0)
        if load is not None and abs(load) > _SURE * sd:
            yield Remark.info(
                f"A constant load of {load:.4g} {unit} (gravity, counterweight) is no friction: it"
                " belongs into the torque offset of the drive, not into the list. With the list"
                " written here this offset leaves the least of the current."
            )
        if fit.has_law:
            yield from changes(view.samples, fit, unit)
        if curve is not None and curve.speed[-1] < _SLOW:
            yield Remark.warning(
                f"The fastest motion is {curve.speed[-1]:.2g} {per}/s, where machines hardly move:"
                " are the units of position and time right (m for mm, ms for s)? Faster than that"
                " the list gives what it gives there."
            )
        if view.knots is None:
            yield self._why_no_list()
        elif curve is not None:
            yield from self._unsaid(curve, view.knots)

    def _why_no_list(self) -> Remark:
        """Return why no list is written."""
        recording, unit = self.view.recording, self.view.recording.unit
        if recording.unsure:
            return Remark.error(f"No list is written. {recording.unsure}")
        if not self.view.found.fit.has_law:
            return Remark.error(
                "The law of friction cannot be told from this recording: no list is"
                " written."
            )
        if self.view.curve is None:
            speed = float(np.abs(self.view.samples.velocity).max())
            return Remark.error(
                f"No list is written. The largest speed is {speed:.2g}"
                f" {self.view.samples.unit}/s: look at the units of time and position."
            )
        if self.fit.torque_unit is None:
            return Remark.info(
                "The job does not state torque_unit: the law is reported, and no list is"
                " written."
            )
        missing, other = _RATED.get(unit, "a current in A, %, Nm, N or raw"), ""
        for key in ("rated_current", "rated_torque"):
            other = f" in place of {key}" if getattr(self.fit, key) else other
        found = f"is in {unit}" if unit else "states no unit"
        return Remark.error(
            "No list is written. torque_unit asks for one, and the recorded current"
            f" {found}: state {missing}{other}."
        )

    def _unsaid(self, curve: LawCurve, knots: Knots) -> Iterator[Remark]:
        """Return what the list cannot say of the law."""
        samples, level = self.view.samples, self.view.level
        unit = self.view.recording.unit
        share, per, small = curve.difference, samples.unit, small_unit(samples.unit)
        if share > 0.02:
            yield Remark.warning(
                f"The two directions differ by {share:.0%} of the friction on"
                " average. A list knows no direction: it gives the mean of both."
            )
        velocity = samples.velocity[samples.in_motion]
        slower, faster = sorted(
            quantile(np.abs(velocity[way * velocity > 0]), _USUAL) for way in (1, -1)
        )
        if faster > _FASTER * slower:
            yield Remark.warning(
                f"One direction was driven at up to {faster:.3g} {per}/s, the other at up"
                f" to {slower:.3g} only: above that the list gives what the first one shows."
                " Record both directions at all speeds."
            )
        misfit = knots.current(curve.speed) - level * curve.mean
        missed = float(np.sqrt(curve.weight @ np.square(misfit)))
        size = float(np.sqrt(curve.weight @ np.square(curve.mean)))
        if _COARSE * size < missed < knots.unit:
            yield Remark.warning(
                f"The list misses the law by {missed:.3g} {unit} rms: one unit of its entries"
                f" is {knots.unit:.3g} {unit}. What it leaves is the error from file. Are"
                " rated_current and torque_unit right?"
            )
        below = curve.speed[level * curve.mean < -knots.unit]
        if len(below):
            yield Remark.warning(
                f"The law is below 0 at speeds up to {below[-1]:.3g} {per}/s: friction never drives"
                " an axis, and the list gives 0 there. Record these speeds for longer, and current"
                " and position of the same moment."
            )
        if level > 1.0:
            yield Remark.error(
                f"The list gives {level:.0%} of the friction (level): more than there"
                " is shakes the machine at reversals; expected 1 at most."
            )
        if level < 1.0:
            why = ""
            if self.fit.level is None:
                why = ", as long as no measurement has settled the sign of its current"
            yield Remark.info(
                f"The list gives {level:.0%} of the friction (level), a"
                f" cautious beginning{why}; scaling_factor stays at 1000. The rest remains,"
                " as the figures say: once slow reversals with the list show less"
                " following error, not more, raise level and fit again."
            )
        reversal = self.view.found.reversal
        if reversal is not None and reversal.position_delay > _MOST_DELAY:
            yield Remark.warning(
                f"After a reversal friction takes {1e3 * reversal.position_delay:.1f} {small} to"
                f" build up; the list goes no further than 1 {small} (position_delay,"
                " P-COMP-00043)."
            )


def _out_unit(spec: Spec, unit: str) -> float | None:
    """Return what one unit of ``out`` is in the unit of the recording; None: nobody says."""
    if spec.torque_unit is None or unit == "raw":
        return None if spec.torque_unit is None else 1.0
    rated = 100.0 if unit == "%" else getattr(spec, _RATED.get(unit, ""), None)
    return None if rated is None else float(rated) * spec.torque_unit

"""The friction of one axis: law, list within the controller's limits, proof."""

import dataclasses
import functools
from collections.abc import Iterator
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float, Int

from ....data.lists import Value
from ....data.units import small_unit
from ....models import FrictionCompensation
from ...friction import Knots, place_knots
from ...job._draft import AbstractDraft, AbstractPlan, Foreseen, Leftovers
from ...job.result._result import STAGES, Remark
from ...proof import CircularTest, GateCheck, circular_test
from ...readings import Tables
from ._identify import Identified, identify
from ._listing import (
    FIRST_LEVEL,
    LawCurve,
    OutUnit,
    compensation_of,
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
_LOOKED_AT, _PARTS = 3_000, 5
"""Samples by which a load that changes with the position is looked for, and parts of the
recording that have to agree on it."""
_BY_PLACE = 0.05
"""Share of the friction from which on such a load is told."""
_BY_TIME, _BOTH = 0.1, 0.1
"""Share of the friction by which it changes over a recording before that is told, and of the
samples of a part that each direction has."""
_SURE = 3.0
"""Standard deviations from which on an inertia or a load is one."""


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
        if not recording.unsure and curve is not None and unit.current is not None:
            knots = place_knots(
                curve.speed,
                curve.mean * level,
                curve.weight,
                entries=fit.table_entries or _ENTRIES,
                unit=unit.current,
                reach=float(np.max(np.abs(recording.samples.velocity))),
            )
            if "monotone" in fit.constraints:  # of its rounded lines as of the law
                rising = np.maximum.accumulate(knots.out)
                knots = dataclasses.replace(knots, out=rising)
            # Friction never drives an axis, whatever a law says where little was measured.
            knots = dataclasses.replace(knots, out=np.maximum(knots.out, 0))
        view = view_of(recording, identified, curve, knots, level)
        return FrictionDraft(
            job, self.index, fit, recording, identified, curve, unit, knots, view, level
        )


@final
@dataclasses.dataclass(frozen=True)
class FrictionDraft(AbstractDraft):
    """A law of friction, and the list made of it.

    Attributes:
        recording: What the drive recorded.
        found: The law.
        curve: The law over the driven speeds, or None where it is not determined.
        out_unit: What one unit of the list is.
        knots: The entries; None where none are written.
        view: What the list leaves of the recording.
        level: Share of the friction that the list gives.
    """

    fit: Spec
    recording: DriveRecording
    found: Identified
    curve: LawCurve | None
    out_unit: OutUnit
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
        existing, previous = self.lists.compensation, None
        rules = self.job.conventions
        if existing is not None and ENTRIES.is_in(existing):
            previous = friction_from_list(existing, rules)
        compensation = compensation_of(
            self.knots, self.found.reversal, previous, rules.friction_sign
        )
        return dict(entries_of_friction(compensation, target=self.target))

    @property
    def unit(self) -> str:
        return self.recording.unit or "raw"

    @property
    def foreseen(self) -> Foreseen:
        view = self.view
        rows = view.samples.in_motion
        return Foreseen(view.before[rows], view.predicted[rows], view.wild)

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        assert self.knots is not None  # it is written
        assert self.fit.torque_unit is not None  # else no entry could be
        largest = int(np.argmax(np.abs(self.knots.out)))
        value = float(abs(self.knots.out[largest]) * self.fit.torque_unit)
        speed = self.knots.velocity[largest] / 1000.0
        where = f"at {speed:g} {self.recording.samples.unit}/s"
        return (
            self.job.limits.check("max_current", value, "of rated", where),
            self.view.gate(self.knots.unit, self.recording.unit),
        )

    def prove(self, done: "AxisFiles") -> FrictionResult:
        view, listing, model = self.view, done.compensation, None
        if listing is not None and self.knots is not None:
            model = friction_from_list(listing, self.job.conventions)
        if model is not None and self.out_unit.current is not None:
            law = model.law.evaluate(view.samples.velocity)
            listed = self.out_unit.current * model.sign * law
            view = dataclasses.replace(view, listed=listed)
        return FrictionResult(
            **self.frame(done),
            error={stage: view.figures(getattr(view, stage)) for stage in STAGES},
            remarks=(*self._remarks(), *done.remarks),
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
        law, unit = fit.law, self.out_unit.current
        if model is None or law is None or unit is None:
            return None
        if inertia <= _SURE * fit.standard_deviations.get("inertia", 0.0):
            return None  # without a mass nothing moves as an axis does
        if self.recording.samples.unit != "mm":
            return None  # a circle is drawn by linear axes
        cycle = self.job.spec.controller.cycle_time
        return circular_test(law, inertia, model, out_unit=unit, cycle=cycle)

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
            yield from self._of_place()
            yield from self._of_time()
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
        elif self.knots is None:
            yield Remark.info(
                f"The job does not state {self.out_unit.missing}: the law is reported,"
                " and no list is written."
            )
        if self.knots is not None and self.curve is not None:
            yield from self._unsaid(self.curve, self.knots)

    @functools.cached_property
    def _looked_at(self) -> Int[np.ndarray, " r"]:
        """Rows in motion that are enough to see what the law does not say."""
        rows = np.flatnonzero(self.recording.samples.in_motion)
        return rows[:: -(-len(rows) // _LOOKED_AT)]

    def _by_part(self, *columns: Float[np.ndarray, " r"]) -> Float[np.ndarray, " p"]:
        """Return the factor of the first column in the current of each part of the recording.

        A constant, the other columns and the acceleration stand beside it.
        """
        samples, rows = self.recording.samples, self._looked_at
        every = [*columns, np.ones(len(rows))]
        if samples.acceleration is not None:
            every.append(samples.acceleration[rows])
        design, current = np.stack(every, axis=1), samples.current[rows]
        parts = np.array_split(np.arange(len(rows)), _PARTS)
        return np.array(
            [np.linalg.lstsq(design[part], current[part])[0][0] for part in parts]
        )

    def _of_place(self) -> Iterator[Remark]:
        """Return that the load changes with the position, which no law of friction knows."""
        samples, rows = self.recording.samples, self._looked_at
        if samples.position is None:
            return
        place, speed = samples.position[rows], samples.velocity[rows]
        friction = self.found.fit.friction(speed)
        slopes = self._by_part(place, friction, np.sign(speed))
        mean, scatter = float(np.mean(slopes)), float(np.std(slopes))
        change = abs(mean) * float(np.ptp(place))
        size = float(np.sqrt(np.mean(friction**2)))
        if abs(mean) > _SURE * scatter / _PARTS**0.5 and change > _BY_PLACE * size:
            yield Remark.warning(
                f"The load changes by {change:.3g} {self.recording.unit} over the positions"
                " driven, as a spring, a cable or a lever does: that is no friction, and the"
                " law, the inertia and what differs between the directions hold a part of"
                " it. Record on a short way to and fro."
            )

    def _of_time(self) -> Iterator[Remark]:
        """Return that friction changes over the recording, as it does while an axis warms."""
        speed = self.recording.samples.velocity[self._looked_at]
        ahead = np.array([np.mean(part > 0) for part in np.array_split(speed, _PARTS)])
        if np.minimum(ahead, 1.0 - ahead).min() < _BOTH:
            return  # a constant load is no friction only where both directions show it
        shares = self._by_part(self.found.fit.friction(speed))
        # A straight line over the parts, and how far they lie beside it.
        when = np.linspace(-0.5, 0.5, _PARTS)
        line, (beside,), *_ = np.polyfit(when, shares, 1, full=True)
        scatter = float(np.sqrt(beside / (_PARTS - 2) / (when @ when)))
        if abs(line[0]) > max(_SURE * scatter, _BY_TIME):
            yield Remark.warning(
                f"Friction {'falls' if line[0] < 0 else 'grows'} by {abs(line[0]):.0%} over the"
                " recording, as it does while an axis warms: the list holds the mean. Run the"
                " axis warm first, and record it then."
            )

    def _unsaid(self, curve: LawCurve, knots: Knots) -> Iterator[Remark]:
        """Return what the list cannot say of the law."""
        share = curve.difference
        if share > 0.02:
            yield Remark.warning(
                f"The two directions differ by {share:.0%} of the friction on"
                " average. A list knows no direction: it gives the mean of both."
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
            yield Remark.warning(
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
        if reversal is not None and reversal.position_delay > 0.001:
            small = small_unit(self.recording.samples.unit)
            yield Remark.warning(
                f"After a reversal friction takes {1e3 * reversal.position_delay:.1f}"
                f" {small} to build up; the list goes no further than 1 {small}"
                " (position_delay, P-COMP-00043)."
            )

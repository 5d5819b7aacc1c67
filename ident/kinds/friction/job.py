"""The friction of one axis: law, list within the controller's limits, proof."""

import dataclasses
from collections.abc import Iterator
from typing import Any, final

import numpy as np

from ....data.lists import ListFile, Value
from ....models import FrictionCompensation
from ...exchange import (
    ExchangeError,
    entries_of_friction,
    has_friction,
    read_friction,
)
from ...friction import Knots
from ...job._draft import AbstractDraft, AxisLists, Leftovers, Planned, Written
from ...job._gating import limits_of
from ...job._load import Job
from ...job._result import Remark
from ...proof import CircularTest, GateCheck, circular_test, gate_check
from ...readings import Tables
from ._identify import Identified, identify
from ._listing import (
    OutUnit,
    driven_speeds,
    knots_of,
    law_curve,
    level_of,
    numbers_of,
    out_unit,
)
from ._proof import Remaining, remaining
from ._recording import DriveRecording, read_drive
from ._result import FrictionResult, FrictionView, LawCurve, choice_sentence
from .keys import Spec


def plan(job: Job, tables: Tables, index: int, fit: Spec, lists: AxisLists) -> Planned:
    """Plan a friction fit; what it returns fits it.

    Raises:
        FitError: Of what it returns: if the recording does not determine it.
    """

    def draft(left: Leftovers) -> AbstractDraft:
        recording = read_drive(tables, fit)
        level = level_of(fit, "friction_sign" in job.verified)
        found = identify(recording, fit, job.spec.controller.cycle_time)
        samples, curve, knots = recording.samples, None, None
        speeds = driven_speeds(samples)
        if speeds is not None and found.fit.has_law:
            curve = law_curve(found.fit, speeds)
        unit = out_unit(fit, recording.unit)
        if not recording.unsure and curve is not None and unit.current is not None:
            fastest = float(np.max(np.abs(samples.velocity)))
            knots = knots_of(curve, fit, level, unit.current, fastest)
        rest = remaining(samples, found, speeds, curve, knots, level)
        return FrictionDraft(
            index, fit, lists, recording, found, curve, unit, knots, rest, level
        )

    return draft


@final
@dataclasses.dataclass(frozen=True)
class FrictionDraft(AbstractDraft):
    """A law of friction, and the list made of it.

    Attributes:
        recording: What the drive recorded.
        found: The law.
        curve: The law over the driven speeds, or None where it is not determined.
        unit: What one unit of the list is.
        knots: The entries; None where none are written.
        rest: What the list leaves of the recording.
        level: Share of the friction that the list gives.
    """

    fit: Spec
    recording: DriveRecording
    found: Identified
    curve: LawCurve | None
    unit: OutUnit
    knots: Knots | None
    rest: Remaining
    level: float

    @property
    def written(self) -> bool:
        return self.knots is not None

    @property
    def needs(self) -> str:
        return "Works without referencing"

    @property
    def replaces(self) -> tuple[str, ...]:
        return (f"{self.kind.prefix}.table[",)

    def entries(self, job: Job) -> dict[str, Value]:
        assert self.knots is not None  # it is written
        existing = self.lists.compensation
        try:
            before = None
            if existing is not None and has_friction(existing):
                before = read_friction(existing, job.conventions)
            return dict(
                entries_of_friction(
                    numbers_of(self.knots, self.found.reversal, before),
                    existing=existing,
                    max_points=self.fit.max_points,
                    build=job.spec.controller.build,
                )
            )
        except ExchangeError as error:
            raise job.error(("fits", self.index), str(error)) from None

    def gate(self, job: Job, cycles: int | None) -> tuple[GateCheck, ...]:
        assert self.knots is not None  # it is written
        assert self.unit.share is not None  # else no entry could be
        limit = limits_of(job).max_current
        largest = int(np.argmax(np.abs(self.knots.out)))
        value = float(abs(self.knots.out[largest]) * self.unit.share)
        speed = self.knots.velocity[largest] / 1000.0
        where = f"at {speed:g} {self.recording.samples.unit}/s"
        return (
            gate_check("max_current", value, limit, "of rated", where),
            self.rest.gate(self.knots.unit, self.recording.unit),
        )

    def refuse_misread(self, job: Job, listing: ListFile) -> None:
        assert self.knots is not None  # it is written
        parsed = ListFile.parse(listing.dumps(), listing.source)
        out = list(parsed.table("frict_comp", "out").values())
        speed = list(parsed.table("frict_comp", "in").values())
        pairs = dict(zip(speed, out, strict=True))
        wanted = dict(
            zip(self.knots.velocity.tolist(), self.knots.out.tolist(), strict=True)
        )
        if any(pairs.get(place) != value for place, value in wanted.items()):
            raise job.error(
                ("fits", self.index),
                f"found another table in {listing.source} when it was read back,"
                " expected the one that was fitted",
            )

    def restart(self, existing: ListFile, listing: ListFile) -> str | None:
        name = "frict_comp.max_points"
        if existing.integer(name) == listing.integer(name):
            return None
        return f"{name} changes (a reload would end in error 110641)"

    def prove(self, done: Written) -> FrictionResult:
        job = done.job
        samples, found, rest = self.recording.samples, self.found, self.rest
        back = self._read_back(done)
        listed = rest.listed
        if back is not None and self.unit.current is not None:
            listed = self.unit.current * back.law.evaluate(samples.velocity)
        from_file = rest.before - listed
        curve = self.curve
        if curve is not None and self.knots is not None:
            curve = dataclasses.replace(curve, listed=self.knots.current(curve.speed))
        unit: dict[str, Any] = {"unit": self.recording.unit or "raw"}
        return FrictionResult(
            **self.frame(done) | unit,
            error={
                "before": rest.figures(rest.before),
                "predicted": rest.figures(rest.predicted),
                "from_file": rest.figures(from_file),
            },
            remarks=(*self._remarks(), *done.files.remarks),
            files=done.files.of_lists(done.names) if self.knots is not None else (),
            held_out="window",
            fit=found.fit,
            law=found.law,
            laws=found.laws,
            choice=found.choice,
            output=found.output,
            reversal=found.reversal,
            knots=self.knots,
            level=self.level,
            out_unit=self.unit.current,
            curve=curve,
            view=FrictionView(
                time=samples.time,
                position=self.recording.commanded,
                velocity=samples.velocity,
                before=rest.before,
                predicted=rest.predicted,
                from_file=from_file,
                moving=rest.moving,
                window=found.window,
            ),
            circle=self._circle(job, back),
            drive_offset=rest.offset,
            length_unit=samples.unit,
        )

    def _read_back(self, done: Written) -> FrictionCompensation | None:
        listing = done.compensation
        if listing is None or self.knots is None:
            return None
        return read_friction(listing, done.job.conventions)

    def _circle(
        self, job: Job, back: FrictionCompensation | None
    ) -> CircularTest | None:
        """Return a simulated circle, where mass, law and list are known."""
        fit = self.found.fit
        inertia = fit.known.inertia or fit.parameters.get("inertia")
        law, unit = fit.law, self.unit.current
        if back is None or law is None or not inertia or unit is None:
            return None
        if self.recording.samples.unit != "mm":
            return None  # a circle is drawn by linear axes
        return circular_test(
            law,
            float(inertia),
            back,
            out_unit=unit,
            cycle=job.spec.controller.cycle_time,
        )

    def _remarks(self) -> Iterator[Remark]:
        yield from self.recording.remarks
        yield from self.found.remarks
        fit = self.found.fit
        yield Remark.info(choice_sentence(self.found.choice))
        if self.rest.offset is not None:
            yield Remark.info(
                f"A constant load of {self.rest.offset:.4g} {self.recording.unit}"
                " (gravity, counterweight) is no friction: it belongs into the torque"
                " offset of the drive, not into the list. With the list written here"
                " this offset leaves the least of the current."
            )
        if self.recording.unsure:
            yield Remark.error(f"No list is written. {self.recording.unsure}")
        elif not fit.has_law:
            yield Remark.error(
                "The law of friction cannot be told from this recording: no list is"
                " written."
            )
        elif self.knots is None:
            yield Remark.info(
                f"The job does not state {self.unit.missing}: the law is reported,"
                " and no list is written."
            )
        if self.knots is not None and self.curve is not None:
            yield from self._unsaid()

    def _unsaid(self) -> Iterator[Remark]:
        """Return what the list cannot say of the law."""
        assert self.curve is not None
        share = self.curve.difference
        if share > 0.02:
            yield Remark.warning(
                f"The two directions differ by {share:.0%} of the friction on"
                " average. A list knows no direction: it gives the mean of both."
            )
        if self.level != 1.0:
            why = ""
            if self.fit.level is None:
                why = ", as long as no measurement has settled the sign of its current"
            yield Remark.info(
                f"The list gives {self.level:.0%} of the friction (level), a"
                f" cautious beginning{why}; scaling_factor stays at 1000. The rest remains,"
                " as the figures say: once slow reversals with the list show less"
                " following error, not more, raise level and fit again."
            )
        found = self.found.reversal
        if found is not None and found.position_delay > 0.001:
            small = "µm" if self.recording.samples.unit == "mm" else "· 0.001°"
            yield Remark.warning(
                f"After a reversal friction takes {1e3 * found.position_delay:.1f}"
                f" {small} to build up; the list goes no further than 1 {small}"
                " (position_delay, P-COMP-00043)."
            )

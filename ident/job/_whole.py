"""All that will act on each axis, read from the files of a job and judged together."""

import dataclasses
import functools
import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from ...data.lists import EXTERNAL_LIMITS
from ...data.measurements import MeasurementError
from ...models import TemperatureCurve
from .._recording import clocked
from ..exchange import (
    REVERSAL_CYCLES,
    AxisLists,
    ExchangeError,
    Motion,
    reversal_cycles,
)
from ..kinds import kind
from ..proof import GateCheck, Measured, gate_check
from ..proof.axis import (
    Together,
    Travel,
    acts_against,
    added_beyond,
    judge_together,
    judge_workspace,
    switching_cycles,
)
from ..readings import Tables, longer_than, read_error, without_zero
from ._acting import absent
from ._draft import AbstractDraft
from ._gating import spread_over
from .file._load import Job
from .result._job_result import WholeAxis
from .result._result import Remark
from .write._lists import AxisFiles, with_cycles

_WARM = (
    "Lengths that were not measured at the reference temperature are brought there by"
    " expansion and material_temperature."
)
_EXTERNAL = f"{EXTERNAL_LIMITS}.err_limit"
"""Entry of the axis list without which no external compensation moves the axis (P-AXIS-00744)."""
_Read = tuple[Measured, Motion]
"""The error of an axis in one measurement, and where all axes were."""


def judge_whole(
    tables: Tables, files: Sequence[AxisFiles]
) -> tuple[tuple[AxisFiles, ...], tuple[WholeAxis, ...]]:
    """Return what acts on each axis that is written, judged as one; its files before it."""
    job, axes, files = tables.job, list[WholeAxis](), [*files]
    for place, axis_files in enumerate(files):
        acting = tuple(d for d in axis_files.drafts if d.written and d.jump > 0)
        if not acting:
            continue
        axis = _Axis(tables, axis_files, acting)
        whole = axis.judged()
        if axis_files.cycles is not None and (needed := axis.more_cycles(whole.gate)):
            # All of a reversal, of whatever fit, is spread by the one entry that is written.
            files[place] = with_cycles(job, axis_files, needed)
            whole = _Axis(tables, files[place], acting).judged()
        axes.append(whole)
    stopped = {axis_files.axis for axis_files in files if axis_files.failed}
    stopped |= {axis.axis for axis in axes if axis.failed}
    by_axis = {axis.axis: _with_partner(job, axis, files, stopped) for axis in axes}
    judged = tuple(
        axis.judged(by_axis[axis.axis]) if axis.axis in by_axis else axis
        for axis in files
    )
    return judged, tuple(by_axis.values())


@dataclasses.dataclass(frozen=True)
class _Axis:
    """One axis with the fits that move it."""

    tables: Tables
    files: AxisFiles
    drafts: tuple[AbstractDraft, ...]

    @property
    def name(self) -> str:
        return self.files.axis

    @property
    def job(self) -> Job:
        return self.tables.job

    @property
    def unit(self) -> str:
        return self.job.spec.axes[self.name].unit

    def judged(self) -> WholeAxis:
        """Return all that acts on the axis, judged together."""
        fitted = tuple(draft.compensation for draft in self.drafts)
        try:
            names = fitted
            if len(fitted) > 1 or self.files.existing.used.keys() - set(fitted):
                loaded = self.files.after
                # Tables of zeros do not act.
                names = tuple(n for n in loaded.used if n in fitted or loaded.acts(n))
                if len(names) > 1:
                    return self._together(loaded, names)
        except ExchangeError as error:
            words = (
                f"What acts on {self.name} cannot be judged as a whole: {error}. Mend that"
                " entry, or switch its compensation off in the axis list (machine_data)."
            )
            return self._whole(fitted, (), (), (), [Remark.error(words)])
        # One fit alone: its gate is that of the axis.
        draft = next(d for d in self.drafts if d.compensation in names)
        where = f"{draft.compensation}, in all, where it comes or goes"
        check = self.job.spec.gate.check("max_jump", draft.jump, self.unit, where)
        lines = (*self.files.gates[draft.index], check)
        return self._whole((draft.compensation,), (check,), lines, (), [])

    def _together(self, loaded: AxisLists, names: tuple[str, ...]) -> WholeAxis:
        """Return an axis on which several compensations act."""
        lines, jumps = judge_workspace(loaded, self._travel(), self.job.spec.gate)
        remarks = [
            *self._abrupt(loaded, jumps),
            *self._hasty(loaded, lines),
            *self._late(loaded, jumps),
        ]
        readings = self._readings(loaded, names, remarks)
        checks = (*lines, *(reading.check(self.unit) for reading in readings))
        remarks += [
            self._doubled(reading, names) for reading in readings if not reading.passed
        ]
        return self._whole(names, checks, lines, readings, remarks)

    def _abrupt(
        self, loaded: AxisLists, jumps: Mapping[str, float]
    ) -> Iterator[Remark]:
        """Yield what to set for compensations of the list that come in too few cycles.

        The job does not write them, and leaves them as they are.
        """
        limit = self.job.spec.gate.max_switching
        fitted = {draft.compensation for draft in self.drafts}
        for name, jump in jumps.items():
            cycles = kind(name).cycles
            if cycles is None or name in fitted:
                continue
            entry, largest = cycles
            listing = loaded.used[name].listing
            stated = listing.integer(entry)
            if needed := switching_cycles(jump, limit, stated, largest):
                yield Remark.warning(
                    f"The {name} of {listing.source} moves {self.name} by up to {jump:.4g}"
                    f" {self.unit} where it comes or goes, in {stated or 0} cycles: set"
                    f" {entry} {needed}, so that a cycle brings no more than {limit:g}"
                    f" {self.unit} (max_switching)."
                )

    def _hasty(self, loaded: AxisLists, lines: Sequence[GateCheck]) -> Iterator[Remark]:
        """Yield what to set where a reversal of the axis list is too fast for the gate."""
        if needed := self.more_cycles(lines):
            jump = next(c.value for c in lines if c.name == "axis max_reversal")
            yield Remark.error(
                f"A reversal moves {self.name} by up to {jump:.4g} {self.unit} in"
                f" {reversal_cycles(loaded.machine)} cycles: set {REVERSAL_CYCLES} {needed} in"
                f" the axis list of {self.name} (machine_data), so that it is spread."
            )

    def _late(self, loaded: AxisLists, jumps: Mapping[str, float]) -> Iterator[Remark]:
        """Yield what waits for COMP ON, of what acts beside fits that do not wait."""
        used = loaded.used
        fitted = {draft.compensation for draft in self.drafts}
        if all(used[name].manual for name in fitted if name in used):
            return
        for name, jump in jumps.items():
            if name in fitted or not used[name].manual:
                continue
            yield Remark.warning(
                f"The {name} of {used[name].listing.source} waits for {self.name}[COMP ON"
                f" {kind(name).keyword}] (manual_activation 1), and what is written does not:"
                f" until a program says that, and after its end, {self.name} lacks up to"
                f" {jump:.4g} {self.unit} of what was judged. Let all wait, or none."
            )

    def more_cycles(self, lines: Sequence[GateCheck]) -> int | None:
        """Return the cycles that a reversal needs which is too fast for the gate, or None."""
        if all(c.passed or not c.name.endswith(" at reversal") for c in lines):
            return None
        jump = next(c.value for c in lines if c.name == "axis max_reversal")
        needed = spread_over(self.job, jump, None, REVERSAL_CYCLES)
        return needed if needed > reversal_cycles(self.files.after.machine) else None

    def _whole(
        self,
        names: tuple[str, ...],
        checks: tuple[GateCheck, ...],
        lines: Sequence[GateCheck],
        readings: Sequence[Together],
        remarks: list[Remark],
    ) -> WholeAxis:
        limits, name = self.job.spec.gate, self.name
        remarks = [*self._external(), *remarks]
        jump = next((c for c in checks if c.name == "max_jump"), None)
        if jump is not None and not jump.passed:
            verb = "comes or goes" if len(names) == 1 else "come or go"
            words = (
                f"{name} moves by up to {jump.value:.4g} {self.unit} by itself where"
                f" {' and '.join(names)} {verb}, more than max_jump"
                f" ({limits.max_jump:g} {self.unit}). Move the zero of the tables to"
                f" where {name} is homed (datum), take the bulk of it out mechanically,"
                " or raise max_jump in [gate] if the builder of the machine allows it."
            )
            remarks = [*remarks, Remark.error(words)]
        switching, stages = {}, ("before", "alone", "together")
        for draft in self.drafts:
            gate = self.files.gates[draft.index]
            steps = [check.value for check in gate if check.name == "max_switching"]
            # All of a jump in one cycle, where nothing spreads it.
            switching[draft.compensation] = max(steps, default=draft.jump)
        return WholeAxis(
            axis=name,
            compensations=names,
            sizes={line.name.removeprefix("axis "): line.value for line in lines},
            error={
                f"{one.measurement}, {' and '.join(one.fitted)}": {
                    stage: getattr(one, stage) for stage in stages
                }
                for one in readings
            },
            gate=checks,
            remarks=tuple(dict.fromkeys(remarks)),
            switching=switching,
        )

    def _external(self) -> Iterator[Remark]:
        """Yield that an external compensation moves the axis beside a table.

        The axis list does not tell what it adds, nor the job whether it was on while measuring.
        """
        machine = self.files.existing.machine
        tables = [draft.compensation for draft in self.drafts if draft.kind.table]
        if not tables or machine is None or not machine.integer(_EXTERNAL):
            return
        names, held = " and ".join(tables), ", ".join(f'"{name}"' for name in tables)
        yield Remark.error(
            f"{machine.source} lets an external compensation move {self.name} ({_EXTERNAL}"
            f" {machine.integer(_EXTERNAL)}): it and the {names} would correct the same error."
            f" Set its entries {EXTERNAL_LIMITS} to 0 there, fit again, and load the lists"
            " without it, or export them again (axcomp export-external). Where it held the"
            f" {names} of the list of {self.name} and was on while measuring, state active ="
            f" [{held}]; where it was off, active = []."
        )

    def _travel(self) -> Travel:
        axes = self.job.spec.axes
        spans = {
            a.number: (a.limits[0], a.limits[1]) for a in axes.values() if a.limits
        }
        spans |= self.job.ranges
        reached = dict[int, tuple[float, float]]()
        for _, _, reading in self._measured:
            places = {} if isinstance(reading, str) else reading[0].positions
            for number, place in places.items():
                ends = np.append(place, reached.get(number, ()))
                reached[number] = float(ends.min()), float(ends.max())
        # How warm the sensors get that temperature laws follow, laws of zeros among them.
        warmth: dict[str, tuple[float, float]] = {}
        for draft in (each for each in self.files.drafts if each.written):
            line = draft.line(self.files.existing.machine)
            if line is not None and isinstance(line.offset_0, TemperatureCurve):
                ends = np.asarray(line.offset_0.nodes.positions)[[0, -1]]
                warmth |= dict.fromkeys(draft.warmth, (float(ends[0]), float(ends[1])))
        states = itertools.product(*warmth.values())
        return Travel(
            names={axis.number: name for name, axis in axes.items()},
            spans=reached | spans,
            closed=frozenset(spans),
            warmth=tuple(dict(zip(warmth, state, strict=True)) for state in states),
            unit=self.unit,
            cycle_time=self.job.spec.controller.cycle_time,
        )

    def _readings(
        self, loaded: AxisLists, names: tuple[str, ...], remarks: list[Remark]
    ) -> list[Together]:
        """Return what is left of each measurement; remarks of what cannot be told."""
        before, together = self.files.existing, list[Together]()
        seen = list[tuple[str, tuple[str, ...]]]()
        for draft, source, reading in self._measured:
            spec = self.job.spec.measurements[source]
            if isinstance(reading, str):
                words = f"What all that acts on {self.name} leaves of measurement {source!r}"
                remarks.append(Remark.info(f"{words} is not known: {reading}."))
                continue
            measured, motion = reading
            lags = {k: v for draft in self.drafts for k, v in draft.lags.items()}
            shown = motion.temperatures
            warm = {name: shown[name] for name in lags if lags.keys() <= shown.keys()}
            if (time := measured.time) is not None:
                warm = {k: clocked(time, v).structure(lags[k]) for k, v in warm.items()}
            motion = dataclasses.replace(motion, temperatures=warm)
            added = added_beyond(loaded, before, spec.active, motion)
            if spec.at_reference and not draft.warmth:
                # Lengths as they are where no law acts.
                laws = (d.compensation for d in self.drafts if d.warmth)
                added |= dict.fromkeys(laws, np.zeros(motion.rows))
            lacking = [n for n in names if n not in added and not kind(n).unseen]
            # Over axes that stood still it adds a constant, which nobody knows.
            over = {n: loaded.inputs(n) or [self.files.number] for n in lacking}
            moved = {k for k, place in motion.positions.items() if np.ptp(place) > 0}
            still = [name for name in lacking if moved.isdisjoint(over[name])]
            own_zero = not spec.zeroed
            # One that was off would add it to a zero that holds it already.
            unknown = {n for n in still if n not in spec.active} if own_zero else set()
            places = {*lacking} - {*still} | unknown
            if remark := self._lacking(loaded, places, motion, source):
                remarks.append(remark)
                continue
            if measured.line:  # nobody knows the slope that the axis has then
                axes = self.job.spec.axes
                along = [measured.positions[axes[k].number] for k in draft.fit.over]
                added = {k: without_zero(v, along, "line") for k, v in added.items()}
            about_zero = own_zero and not still
            group, members = draft.fit.group, [draft]
            if group is not None:
                members = [each for each in self.drafts if each.fit.group == group]
            own = tuple(each.compensation for each in members)
            if (source, own) in seen:
                continue  # by another fit of its group
            seen.append((source, own))
            predicted = max(each.predicted or 0.0 for each in members)
            fitted = own, measured.error, added, predicted
            together.append(judge_together(source, *fitted, about_zero))
        return together

    def _lacking(
        self, loaded: AxisLists, names: Collection[str], motion: Motion, source: str
    ) -> Remark | None:
        """Return which columns a measurement lacks that compensations follow, or None."""
        inputs = {axis for name in names for axis in loaded.inputs(name)}
        roles, warm = absent(self.job, inputs, motion.positions)
        if any("temperature" in kind(name).follows for name in names):
            sensors = dict.fromkeys(s for draft in self.drafts for s in draft.warmth)
            roles += [f"temperature.{name}" for name in sensors]
            warm += f" {_WARM}" * bool(sensors)
        if not roles:
            return None
        words = ", ".join(f'"{role}" = {{ value = … }}' for role in roles)
        return Remark.error(
            f"What all that acts on {self.name} leaves of measurement {source!r} cannot be"
            f" told: it lacks {' and '.join(roles)}. State what it was then in"
            f" [measurements.{source}.columns], as a column or as {words}: without it"
            f" nobody sees whether two lists correct the same error.{warm}"
        )

    @functools.cached_property
    def _measured(self) -> list[tuple[AbstractDraft, str, _Read | str]]:
        """Every measurement of each fit, or why it is not known."""
        readings: list[tuple[AbstractDraft, str, _Read | str]] = []
        for draft in self.drafts:
            for source in draft.fit.sources:
                reading: _Read | str = "it is read in pieces"
                if draft.in_memory:
                    try:
                        reading = read_error(self.tables, source, self.name)
                    except MeasurementError as error:
                        reading = str(error)
                readings.append((draft, source, reading))
        return readings

    def _doubled(self, comparison: Together, names: tuple[str, ...]) -> Remark:
        others = [name for name in names if name not in comparison.fitted]
        own = " and ".join(comparison.fitted)
        leaves = "leaves" if len(comparison.fitted) == 1 else "leave"
        follows = any("temperature" in kind(name).follows for name in names)
        warm = f" {_WARM}" if follows else ""
        fits = [draft.fit for draft in self.drafts if draft.compensation in names]
        jointly = fits[0].group is not None and len({fit.group for fit in fits}) == 1
        lacking = [d.name for d in self.files.drafts if not d.written]
        if lacking:
            warm = (
                f" Or {' and '.join(lacking)}, which is left out of the lists, is in these"
                f" readings, and hides what they do: mend that first.{warm}"
            )
        parts = {
            source: (one[1].positions[self.files.number], one[0].error)
            for _, source, one in self._measured
            if not isinstance(one, str) and self.files.number in one[1].positions
        }
        found = (
            f"With all that will act on {self.name}, {comparison.together:.4g} {self.unit} rms"
            f" are left of measurement {comparison.measurement!r}, where the {own} alone"
            f" {leaves} {comparison.alone:.4g} {self.unit}"
        )
        if not follows and self.unit == "mm" and (words := longer_than(parts)):
            return Remark.error(f"{found}. {words}.")
        group = 'identify them together (the same group = "…" in their [[fits]]), '
        return Remark.error(
            f"{found}: it and {' and '.join(others)} correct the same error. State in"
            f" [measurements.{comparison.measurement}] what was on while measuring (active),"
            f" {'' if jointly else group}or switch one of them off in the axis list of"
            f" {self.name} (machine_data).{warm}"
        )


def _with_partner(
    job: Job, whole: WholeAxis, files: Sequence[AxisFiles], stopped: Collection[str]
) -> WholeAxis:
    """Return an axis with what its gantry partner lacks of its compensations.

    Lists of the axes that are stopped are not let out.
    """
    by_axis, axis = {item.axis: item for item in files}, whole.axis
    for partner in job.spec.partners(axis):
        fitted, mine = by_axis.get(partner), by_axis[axis].after
        theirs = fitted.after if fitted else job.lists[partner]
        waits, others = _waiting(mine), _waiting(theirs)
        lacking = [
            name
            for name in whole.compensations
            if name not in others or _follows(theirs, name) != _follows(mine, name)
        ]
        apart = [name for name in waits if others.get(name, waits[name]) != waits[name]]
        compared = () if lacking else whole.compensations
        against, fault = dict[str, tuple[bool, float]](), ""
        try:
            against = {name: acts_against(theirs, mine, name) for name in compared}
        except ExchangeError as error:
            fault = str(error)
        turned = [name for name, (other_way, _) in against.items() if other_way]
        twist = max((offset for _, offset in against.values()), default=0.0)
        where, advice, doubt = f"{partner} has all that acts on {axis}", "", ""
        fit_both = f'Fit {partner} as well ([[fits]] with axis = "{partner}")'
        if lacking:
            where = f"{partner} has no {' and no '.join(lacking)} like that of {axis}"
            advice = f"{fit_both}, or give its list ([axes.{partner}] list = …) if it has one."
            held = theirs.compensation
            unused = [name for name in lacking if name not in theirs.used]
            off = [
                n for n in unused if held is not None and kind(n).entries.is_in(held)
            ]
            if off:
                entries = " and ".join(f"{kind(name).activation} 1" for name in off)
                advice = (
                    f"The list of {partner} holds {' and '.join(off)}, and its axis list"
                    f" (machine_data) does not switch it on: set {entries} there."
                )
            if fitted and {*lacking} <= {draft.compensation for draft in fitted.drafts}:
                advice = (
                    f"The fit of {partner} found nothing to correct: look at its readings"
                    " and at their unit."
                )
        elif fitted and partner in stopped:
            where = f"{partner} is stopped by its own gate"
            advice = f"Mend what stops {partner}: both are let out together."
        elif fault:
            where = f"{partner} has a list that cannot be compared with that of {axis}"
            advice = f"Mend it: {fault}."
        elif turned and not fitted:
            where = f"{partner} acts with the opposite sign: {' and '.join(turned)}"
            advice = (
                f"{fit_both}: where both are measured, each has its own sign. Or is the sign"
                f" of the error of {axis} turned (sign = -1 of its column)?"
            )
        elif apart:
            where = f"{partner} has another manual_activation of {' and '.join(apart)}"
            advice = "Let both wait for COMP ON, or none."
        elif extra := [name for name in others if name not in waits]:
            doubt = (
                f"{partner}, the gantry partner of {axis}, has {' and '.join(extra)}, and"
                f" {axis} has not: they move apart by what it adds. Name the list that"
                f" {axis} has ([axes.{axis}] list = …), or fit {axis} as well."
            )
        elif turned:
            # Where both were measured, each has the sign that its readings ask for.
            doubt = (
                f"{axis} and its gantry partner {partner} were measured with opposite errors"
                f" ({' and '.join(turned)}): their lists move them up to"
                f" {max(against[name][1] for name in turned):.4g} mm apart. Was one of them"
                " measured from the other end, so that its sign is turned (sign = -1 of"
                " its column)?"
            )
        elif twist:
            remedy = f"{fit_both}, unless its list was measured on this machine."
            if fitted:
                remedy = "Is the unit of both columns right?"
            doubt = (
                f"{axis} and its gantry partner {partner} are moved up to {twist:.4g} mm"
                f" apart by their lists, more than half of what {axis} is moved. {remedy}"
            )
        wrong = float(len(lacking) or bool(advice))
        check = gate_check("gantry", wrong, 0.0, "faults", where)
        remarks = [*whole.remarks, *[Remark.warning(doubt)] * bool(doubt)]
        if advice:
            jumps = [c.value for c in whole.gate if c.name == "max_jump"]
            largest = f" by up to {jumps[0]:.4g} mm" if jumps else ""
            words = (
                f"{partner} is the gantry partner of {axis} and"
                f"{where.removeprefix(partner)}: one of the two alone would twist the"
                f" gantry{largest}. {advice}"
            )
            remarks.append(Remark.error(words))
        gate = (*whole.gate, check)
        whole = dataclasses.replace(whole, gate=gate, remarks=tuple(remarks))
    return whole


def _follows(lists: AxisLists, name: str) -> set[int]:
    """Return the other axes over whose positions a compensation acts."""
    return set(lists.inputs(name)) - {lists.axis} if name in lists.used else set()


def _waiting(lists: AxisLists) -> dict[str, bool]:
    """Return whether it waits for COMP ON, of all that adds something to an axis."""
    return {name: lists.used[name].manual for name in lists.used if lists.acts(name)}

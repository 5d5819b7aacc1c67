"""Plane, cross and leadscrew as a job handles every compensation."""

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float, Int

from ....data.lists import Value
from ....data.signals import wild_readings
from ...exchange import LIST_UNITS, REVERSAL_CYCLES, by_branch
from ...fit import TableFit
from ...kinds._keys import FitSpec, TableSpec
from ...proof import GateCheck, GateTable, HeldOut, error_figures, judge
from ...proof.axis import check_switching, switching_cycles
from ...readings import Readings, Tables, without_zero
from .._draft import AbstractDraft, Foreseen
from .._gating import spread_over, switching_remarks
from ..result._result import Remark, SampleView, TableResult, staged
from ..result._second import SecondMeasurement, gap_of, near_of, part_of, scatter_of
from ._plan import Plan
from ._readings import datum_of, read_fit, run_table, with_one_zero, zero_at
from ._remarks import LOG, fit_remarks, outside, places_of
from ._trend import trend_left

_WORSE = 1.5
"""Times what is predicted that a list may leave of the readings it was fitted to."""
_SEEN, _SAME = 5.0, 0.3
"""Noise of a reading that an old table must exceed to show, and share of it below which what was
measured is not what it takes off."""

if TYPE_CHECKING:
    from ..file._load import Job
    from ..write._lists import AxisFiles
    from ._log_draft import FittedLog


@final
@dataclasses.dataclass(frozen=True)
class TableDraft(AbstractDraft):
    """A fitted table.

    Attributes:
        estimate: The fit, zero at the datum (sign of the error).
        run_effects: What each run was allowed of its own.
        readings: What was measured, zero at the datum; some of a log in pieces.
        left: Each of them under the list that was fitted without it.
        said: What is to be said of them.
        log: All of a log in pieces; None: `readings` are all.
    """

    fit: TableSpec
    plan: Plan
    estimate: TableFit
    run_effects: str
    readings: Readings
    left: HeldOut
    said: Sequence[Remark]
    log: "FittedLog | None" = None

    @functools.cached_property
    def integers(self) -> Int[np.ndarray, "..."]:
        """Entries of the new table."""
        return self.plan.to_integers(self.plan.offset(self.estimate.values))

    @functools.cached_property
    def offset(self) -> Float[np.ndarray, "..."]:
        """Offset at the nodes in mm or ° as it is written."""
        return self.plan.table.to_offsets(self.integers)

    @functools.cached_property
    def change(self) -> Float[np.ndarray, "..."] | None:
        """Offset at the nodes against that of the old table, or None."""
        old = self.plan.old_offset
        return None if old is None else self.offset - old

    @property
    def rounding(self) -> float:
        """Largest change of an offset by rounding, in mm or °.

        Between nodes the table is a weighted mean, which cannot be off by more.
        """
        exact = self.plan.offset(self.estimate.values)
        return float(np.max(np.abs(self.offset - exact)))

    @property
    def converged(self) -> bool:
        return self.estimate.converged

    @property
    def needs(self) -> str:
        subject = "it is" if self.fit.lengths else "its masters are"
        return f"Works once {subject} referenced"

    def entries(self) -> dict[str, Value]:
        values = self.plan.table.entries(self.integers, self.target)
        sizes = {key: value for key, value in values.items() if "[" not in key}
        if self.spread[0] is not None:
            sizes[f"{self.kind.prefix}.n_cycles"] = self.spread[0]
        return sizes | self.manual_entry | {k: v for k, v in values.items() if "[" in k}

    def machine_entries(self, cycles: int | None) -> dict[str, Value]:
        values: dict[str, Value] = super().machine_entries(cycles)
        if self._bilateral and cycles is not None:
            # A bilateral table contains the backlash; the parameter beside it would
            # compensate it twice.
            values |= {"lr_param.anwahl_losekomp": 0, REVERSAL_CYCLES: cycles}
        return values

    def machine_remarks(self) -> Iterator[Remark]:
        listing, on = self.lists.machine, "lr_param.anwahl_losekomp"
        if self._bilateral and listing is not None and listing.integer(on):
            yield Remark.warning(
                f"{listing.source}: backlash compensation is switched off"
                " (anwahl_losekomp 0), since the bilateral leadscrew table contains"
                " the backlash."
            )

    @property
    def cycles(self) -> int | None:
        if not self._bilateral:
            return None
        jump = float(abs(self.offset[0] - self.offset[1]).max())
        return spread_over(self.job, jump, self.lists.machine, REVERSAL_CYCLES)

    @property
    def jump(self) -> float:
        both = (self.offset,) if self.change is None else (self.offset, self.change)
        return max(float(np.abs(part).max()) for part in both)

    @functools.cached_property
    def spread(self) -> tuple[int | None, int]:
        """The `n_cycles` to write, None where that of the list stays; and what it then holds.

        As the job says; else the smallest that keeps every step within `max_switching`.
        """
        listing, chosen, existing = self.lists.compensation, self.fit.n_cycles, None
        if self.kind.cycles is not None:
            existing = None if listing is None else listing.integer(self.kind.cycles[0])
            if chosen is None:
                limit = self.job.spec.gate.max_switching
                chosen = switching_cycles(self.jump, limit, existing)
        return chosen, (existing or 0) if chosen is None else chosen

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        job, table, change = self.job, self.plan.table, self.change
        axis, closed = job.spec.axes[self.axis], []
        for name, nodes in zip(self.fit.over, table.nodes, strict=True):
            low, high = job.spec.axes[name].limits or (-np.inf, np.inf)
            first, last = nodes.positions[[0, -1]]
            closed.append(bool(first <= low and last >= high))
        judged = GateTable(
            names=self.fit.over,
            nodes=tuple(nodes.positions for nodes in table.nodes),
            offset=tuple(by_branch(table, self.offset).values()),
            change=None if change is None else tuple(by_branch(table, change).values()),
            closed=tuple(closed),
            periodic=table.periodic,
            unit=axis.unit,
            cycles=(cycles or 0) if self._bilateral else 0,
            cycle_time=job.spec.controller.cycle_time,
        )
        lines = judge(judged, job.spec.gate)
        if self.kind.cycles is None:  # a leadscrew table
            return lines
        entry, spread = self.kind.cycles[0], self.spread[1]
        switched = check_switching(self.jump, spread, job.spec.gate, axis.unit, entry)
        return (*lines, switched)

    def second_measurement(
        self, tables: Tables, fit: FitSpec
    ) -> SecondMeasurement | None:
        assert isinstance(fit, TableSpec)
        plan, table = self.plan, self.plan.table
        again = dataclasses.replace(plan, job=tables.job, fit=fit)
        readings, _ = with_one_zero(again, read_fit(tables, again, {})[0])
        datum = datum_of(tables.job, self.index, fit)
        branch = plan.branch(readings.direction)
        added = table.offset(table.model(self.integers), readings.positions, branch)
        acted = plan.acted(readings.positions, branch)
        added = added - acted
        turn = None if table.modulo is None else float(np.diff(table.modulo)[0])
        ways = set() if readings.direction is None else set(readings.direction.tolist())
        places = fit.over, self.readings.positions, readings.positions
        unseen, before = dict[str, Any](), None
        if part := self._part_seen(readings, turn):
            unseen |= zip(("axis", "low", "high"), part, strict=True)
        if self._bilateral and len(ways) == 1:
            unseen["direction"] = ways.pop()
        if not (part or turn) and (gap := gap_of(*places)):
            unseen["gap"] = [*gap]
        if "line" in _removed(tables.job, fit):  # no reading shows a slope
            along = [*readings.positions.T]
            added, acted = (without_zero(one, along, "line") for one in (added, acted))
            if "line" not in _removed(self.job, self.fit):
                old, unseen["slope"] = self.readings, [*fit.over]
                level = without_zero(old.error, [*old.positions.T], "line")
                before = error_figures(level, wild=wild_readings(level)).sound.rms
        error = readings.error - zero_at(readings, datum, table)
        near, noise, old = "", 0.0, self.readings
        if self.in_memory and old.late is None:  # a recording scatters in its own way
            repeats = scatter_of(old.positions, old.error, old.direction)
            noise = min(self.estimate.noise, repeats)
        # Somebody went from place to place.
        if readings.late is None and len(error) < LOG:
            visits = readings.positions, error, readings.direction
            near = near_of(fit.over, *visits, self.predicted or 0.0)
        return SecondMeasurement(
            ", ".join(fit.sources),
            readings.positions,
            error,
            readings.direction if table.masters == (table.axis,) else None,
            readings.run if run_table(readings, table) is not None else None,
            added=float(np.std(added)),
            adds=added,
            acted=acted,
            noise=noise,
            near=near,
            trend=trend_left(again, plan, readings.positions, error),
            unseen=unseen,
            before=before,
        )

    def stays_on(self) -> Iterator[Remark]:
        """See `AbstractDraft`; and that the readings contradict what the job says was on."""
        old, name = self.plan.old_offset, self.compensation
        if old is None or not self.lists.acts(name):
            return
        # What the axis is given by a table that was off, its readings show; that was on, not.
        own, new = old - np.mean(old), self.offset - np.mean(self.offset)
        size, shown = float(np.std(old)), float(np.std(new))
        factor = float(np.sum(own * new) / max(float(np.sum(own**2)), 1e-300))
        once_more = 2.0 if self.plan.active else 0.0
        if size < _SEEN * self.estimate.noise or abs(factor - once_more) > _SAME:
            return
        if self.plan.active:
            yield Remark.warning(
                f"Readings that were taken with the {name} of {self.axis} on (active) show once"
                f" more what it takes off, {self.small(size, '.3g')} rms. Was it off? Then state"
                " active = [] of these measurements: what is written takes it off twice."
            )
            return
        words = (
            f"The {name} of {self.axis} in {self.lists.used[name].listing.source} takes off"
            f" {self.small(size, '.3g')} rms, and readings that were taken with it off"
            f" (active = []) show {abs(factor):.0%} of that. Was it on? Then state active ="
            f' ["{name}"] of these measurements'
        )
        if shown < _SAME * size:
            words += ". If it was off, it is wrong: switch it off there."
            yield Remark.error(words)
        else:
            yield Remark.warning(f"{words}: what is written takes its place.")

    @property
    def in_memory(self) -> bool:
        return self.log is None

    @property
    def foreseen(self) -> Foreseen | None:
        if not self.left.by_run:
            # A place that is left out with its node is told by the nodes around it: that this
            # fails for a short wave speaks for repeated runs, and not against the table.
            return None
        return Foreseen(self.readings.error, self.left.residual, self.estimate.wild)

    @property
    def predicted(self) -> float | None:
        residual = self.left.residual[~self.estimate.wild]
        return float(np.std(residual)) if residual.size and self.in_memory else None

    def prove(self, done: "AxisFiles") -> TableResult:
        plan, table = self.plan, self.plan.table
        fit, read = self.estimate, self.readings
        assert done.compensation is not None  # a table stands in it
        back = table.read(done.compensation)
        at = read.positions, plan.branch(read.direction)
        samples = SampleView(
            **vars(read),
            predicted=self.left.residual,
            from_file=read.error + table.offset(back, *at) - plan.acted(*at),
            predicted_sd=self.left.standard_deviation,
            wild=fit.wild,
        )
        places: tuple[str, ...] = ()
        if self.log is None:
            stages = samples.before, samples.predicted, samples.from_file
            error = staged(*stages, fit.wild, run_table(read, table))
            count, wild = len(read.error), int(fit.wild.sum())
            beyond = int(outside(table, read.positions).sum())
            places = places_of(samples, fit.wild, self.fit.over)
        else:
            error, beyond = self.log.figures(back)
            count, wild = self.log.streamed.count, self.log.streamed.wild
        doubts = []
        held_out, written = error["predicted"].sound.rms, error["from_file"].sound.rms
        if written > _WORSE * max(held_out, 1.0 / LIST_UNITS):
            doubts.append(
                Remark.error(
                    f"The list as written leaves {self.small(written)} rms of these readings,"
                    f" where {self.small(held_out)} were predicted: its values at what was"
                    " measured are not those of the fit. Measure beyond the readings, or take"
                    " nodes that end with them."
                )
            )
        deviation = written_deviation(self.estimate)
        axes = self.job.spec.axes
        return TableResult(
            **self.frame(done),
            masters=self.fit.over,
            units=tuple(axes[name].unit for name in self.fit.over),
            limits={name: own for name in self.fit.over if (own := axes[name].limits)},
            nodes=tuple(nodes.positions for nodes in table.nodes),
            table=by_branch(table, table.sign * self.offset),
            standard_deviation=by_branch(table, deviation),
            support=by_branch(table, self.estimate.support),
            fit=fit,
            samples=samples,
            error=error,
            rounding=self.rounding,
            readings=count,
            wild=wild,
            remarks=(
                *plan.remarks,
                *self.said,
                *doubts,
                *fit_remarks(self, count, wild, beyond, places),
                *switching_remarks(self),
            ),
            cycles=done.cycles if self._bilateral else None,
            held_out="run" if self.left.by_run else "block",
            every=None if self.log is None else self.log.every,
        )

    def _part_seen(
        self, second: Readings, turn: float | None
    ) -> tuple[str, float, float] | None:
        """Return which part of the table, or of what one direction of it was read at, was seen.

        As `part_of`: None where it was nearly all.
        """
        over, table, first = self.fit.over, self.plan.table, self.readings
        limits = [self.job.spec.axes[name].limits or (-np.inf, np.inf) for name in over]
        ends = [
            np.clip(line.positions[[0, -1]], low, high)
            for line, (low, high) in zip(table.nodes, limits, strict=True)
        ]
        # What was read neither time, nobody has verified either.
        whole = np.vstack([first.positions, np.column_stack(ends)])
        part = part_of(over, first.positions if turn else whole, second.positions, turn)
        for way, sign in ((1, "+"), (-1, "−")) if self._bilateral else ():
            assert first.direction is not None  # a table for each needs it
            assert second.direction is not None
            before, after = first.direction == way, second.direction == way
            if not part and before.any() and after.any():
                named = [f"{name} in {sign} direction" for name in over]
                old, new = first.positions[before], second.positions[after]
                part = part_of(named, old, new, turn)
        return part

    @property
    def _bilateral(self) -> bool:
        return self.plan.table.branches == 2


def _removed(job: "Job", fit: TableSpec) -> set[str]:
    """Return what is taken off the errors of the measurements of a fit."""
    return {job.spec.measurements[name].remove for name in fit.sources}


def written_deviation(fit: TableFit) -> Float[np.ndarray, "..."]:
    """Return the standard deviation of entries in mm or °: rounding is part of it."""
    rounding = 1.0 / (12.0 * LIST_UNITS**2)
    return np.asarray(np.sqrt(np.square(fit.standard_deviation) + rounding))

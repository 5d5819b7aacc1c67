"""Plane, cross and leadscrew as a job handles every compensation."""

import abc
import dataclasses
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from ...data.lists import ListFile, Value
from ..exchange import ExchangeError
from ..kinds._keys import FitSpec, TableSpec
from ..proof import GateCheck
from ._draft import AbstractDraft, AxisLists, Beside, Leftovers, Planned, Written
from ._fitting import AbstractFitted, Fitted, fit_plan
from ._gating import chosen_cycles, cycles_for, jump_of, pass_gate, switching_checks
from ._load import Job
from ._plan import plan_fit
from ._prove import Proof, offset_at_readings, prove, result_of
from ._readings import read_fit
from ._remove import without_zero
from ._result import Remark, TableResult
from ._second import SecondMeasurement
from ._source import Tables
from ._trend import refuse_unowned_trend
from .streamed import StreamedFitted, fit_log_plan, in_pieces, prove_streamed


def plan(
    job: Job, tables: Tables, index: int, fit: TableSpec, lists: AxisLists
) -> Planned:
    """Plan a table fit; what it returns fits it.

    Raises:
        JobError: If nodes, masters or existing lists do not suit; of what it returns: if
            the readings do not determine the fit, or show a constant or a slope and the
            job does not say whose.
    """
    plan = plan_fit(job, tables, index, fit, lists)

    def draft(left: Leftovers) -> AbstractDraft:
        log, words = in_pieces(tables, index, fit, plan.table)
        beside = {
            name: left.beside[index, name]
            for name in fit.sources
            if (index, name) in left.beside
        }
        if log is not None:
            _refuse_beside(job, index, beside)
            streamed = fit_log_plan(job, plan, log)
            refuse_unowned_trend(job, plan, streamed.fit)
            return StreamedDraft(index, fit, lists, streamed)
        extra = {
            name: left.earlier[fit.axis, name]
            for name in fit.sources
            if (fit.axis, name) in left.earlier
        }
        readings = read_fit(tables, index, fit, plan.table, extra, beside, words)
        fitted = fit_plan(job, plan, readings)
        refuse_unowned_trend(job, plan, fitted.fit)
        return TableDraft(index, fit, lists, fitted)

    return draft


def _refuse_beside(
    job: Job, index: int, beside: Mapping[str, Sequence[Beside]]
) -> None:
    for name, others in beside.items():
        raise job.error(
            ("measurements", name, "stream"),
            f"found a log that is read in pieces, beside {others[0].words}, which was off"
            f" while measuring and will act as well: expected stream = false, so that"
            f" fits[{index}] can correct what it leaves",
        )


@dataclasses.dataclass(frozen=True)
class AbstractTableDraft(AbstractDraft):
    """A fitted table, wherever its readings are.

    Attributes:
        one: The fit.
    """

    one: AbstractFitted

    @property
    def needs(self) -> str:
        whose = "it is" if self.fit.lengths else "its masters are"
        return f"Works once {whose} referenced"

    @property
    def replaces(self) -> tuple[str, ...]:
        return (f"{self.one.plan.table.prefix}.table[",)

    def entries(self, job: Job) -> dict[str, Value]:
        return table_entries(job, self.one)

    def machine_entries(self, job: Job, cycles: int | None) -> dict[str, Value]:
        values: dict[str, Value] = super().machine_entries(job, cycles)
        if self._bilateral and cycles is not None:
            # A bilateral table contains the backlash; the parameter beside it would
            # compensate it twice.
            values |= {"lr_param.anwahl_losekomp": 0, "lr_param.n_backlash_cyc": cycles}
        return values

    def machine_remarks(self) -> list[Remark]:
        listing = self.lists.machine
        if not self._bilateral or listing is None:
            return []
        if not listing.integer("lr_param.anwahl_losekomp"):
            return []
        return [
            Remark.warning(
                f"{listing.source}: backlash compensation is switched off"
                " (anwahl_losekomp 0), since the bilateral leadscrew table contains"
                " the backlash."
            )
        ]

    def cycles(self, job: Job) -> int | None:
        return cycles_for(job, self.one)

    def jump(self, job: Job) -> float:
        return jump_of(self.one)

    def gate(self, job: Job, cycles: int | None) -> tuple[GateCheck, ...]:
        lines = pass_gate(job, self.one, cycles if self._bilateral else None)
        return (*lines, *switching_checks(job, self.one))

    def refuse_misread(self, job: Job, listing: ListFile) -> None:
        refuse_misread(job, listing, self.one)

    def left_over(self, tables: Tables, fit: FitSpec) -> SecondMeasurement | None:
        assert isinstance(fit, TableSpec)
        table = self.one.plan.table
        found = read_fit(tables, self.index, fit, table, {}, {})
        own = table.masters == (table.axis,)
        branch = None
        if table.branches == 2:
            assert found.direction is not None  # `read_fit` refuses it otherwise
            branch = (found.direction < 0).astype(np.int64)
        model = table.model(self.one.integers)
        added = table.offset(model, found.positions, branch)
        if self.one.plan.active and (old := self.one.plan.old) is not None:
            added = added - table.offset(old, found.positions, branch)
        removed = {tables.job.spec.measurements[name].remove for name in fit.sources}
        if "line" in removed:  # a slope that no reading shows
            added = without_zero(added, found.positions, "line")
        return SecondMeasurement.of(
            ", ".join(fit.sources),
            found.positions,
            found.error - found.zero_at_datum(table),
            found.direction if own else None,
            found.run if own and found.run_table(own) is not None else None,
            float(np.std(added)),
        )

    def prove(self, done: Written) -> TableResult:
        return result_of(self.one, self.proof(done), self.frame(done), done)

    @abc.abstractmethod
    def proof(self, done: Written) -> Proof:
        """Return the proof of the fit: its file, read back."""

    @property
    def _bilateral(self) -> bool:
        return self.one.plan.table.branches == 2


@final
@dataclasses.dataclass(frozen=True)
class TableDraft(AbstractTableDraft):
    """A table fitted to readings in memory."""

    one: Fitted

    @property
    def predicted(self) -> float | None:
        left = self.one.held_out.residual[~self.one.fit.wild]
        return float(np.std(left)) if left.size else None

    def left_by(self) -> Mapping[tuple[str, str], np.ndarray]:
        one = self.one
        added = offset_at_readings(one, one.plan.table.model(one.integers)) - one.active
        return {
            (self.axis, name): added[rows] for name, rows in one.readings.slices.items()
        }

    def proof(self, done: Written) -> Proof:
        return prove(self.one, done)


@final
@dataclasses.dataclass(frozen=True)
class StreamedDraft(AbstractTableDraft):
    """A table fitted to a log in pieces."""

    one: StreamedFitted

    @property
    def in_memory(self) -> bool:
        return False

    def proof(self, done: Written) -> Proof:
        return prove_streamed(self.one, done)


def table_entries(job: Job, one: AbstractFitted) -> dict[str, Value]:
    """Return the entries of one table, with the options of its fit.

    Raises:
        JobError: If it fits no list of the controller's build.
    """
    plan = one.plan
    spec, prefix = plan.fit, plan.table.prefix
    try:
        found: dict[str, Value] = dict(
            plan.table.entries(
                one.integers,
                existing=plan.existing,
                max_points=spec.max_points,
                build=job.spec.controller.build,
            )
        )
    except ExchangeError as error:
        raise job.error(("fits", plan.index), str(error)) from None
    options = {
        "n_cycles": chosen_cycles(job, one),
        "manual_activation": spec.manual_activation,
    }
    sizes = {key: value for key, value in found.items() if "[" not in key}
    table = {key: value for key, value in found.items() if "[" in key}
    chosen = {
        f"{prefix}.{key}": int(value)
        for key, value in options.items()
        if value is not None
    }
    return sizes | chosen | table


def refuse_misread(job: Job, listing: ListFile, one: AbstractFitted) -> None:
    """Raise where the bytes to be written, read back, are not the table that was fitted.

    Raises:
        JobError: Naming the list; nothing has been written then.
    """
    table = one.plan.table
    back = table.read(ListFile.parse(listing.dumps(), listing.source))
    if not np.array_equal(table.to_integers(table.at_nodes(back)), one.integers):
        raise job.error(
            ("fits", one.plan.index),
            f"found another table in {listing.source} when it was read back, expected"
            " the one that was fitted",
        )

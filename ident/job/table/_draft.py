"""Plane, cross and leadscrew as a job handles every compensation."""

import abc
import dataclasses
import functools
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Float, Int

from ....data.lists import ListFile, Value
from ...exchange import LIST_UNITS, Model, by_branch
from ...fit import Samples, TableFit
from ...kinds._keys import FitSpec, TableSpec
from ...proof import ErrorFigures, GateCheck, HeldOut
from ...readings import Readings, Tables, without_zero
from .._draft import AbstractDraft, Leftovers, Written
from .._gating import (
    chosen_cycles,
    pass_gate,
    spread_over,
    switching_checks,
    switching_remarks,
)
from ..result._result import Remark, SampleView, Streamed, TableResult, staged
from ..result._second import SecondMeasurement
from ._plan import Plan
from ._readings import datum_of, read_fit, run_table, zero_at
from ._remarks import fit_remarks, outside, places_of, use_remarks


@dataclasses.dataclass(frozen=True)
class Proof:
    """A fit and its readings under the file as it lies in the folder.

    Attributes:
        fit: The estimate; its arrays over readings are those of ``samples``.
        samples: The readings that are shown.
        error: By stage, over all readings.
        readings: How many there are.
        wild: How many of them the fit leaves out.
        outside: How many lie outside the table.
        by_run: Whether runs were held out, else spatial blocks.
        remarks: What is to be said of the readings.
        places: Where each wild reading lies, in words; empty where nobody kept that.
        streamed: What was read in pieces; None: all readings were in memory.
    """

    fit: TableFit
    samples: SampleView
    error: Mapping[str, ErrorFigures]
    readings: int
    wild: int
    outside: int
    by_run: bool
    remarks: tuple[Remark, ...]
    places: tuple[str, ...] = ()
    streamed: Streamed | None = None


@dataclasses.dataclass(frozen=True)
class AbstractTableDraft(AbstractDraft):
    """A fitted table, wherever its readings are.

    Attributes:
        plan: What is written.
        estimate: The fit, zero at the datum (sign of the error).
        run_effects: What each run was allowed of its own.
    """

    fit: TableSpec
    plan: Plan
    estimate: TableFit
    run_effects: str

    @functools.cached_property
    def integers(self) -> Int[np.ndarray, "..."]:
        """Entries of the new table."""
        return self.plan.table.to_integers(self.plan.offset(self.estimate.values))

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
    def settled(self) -> bool:
        return self.estimate.converged

    @property
    def needs(self) -> str:
        whose = "it is" if self.fit.lengths else "its masters are"
        return f"Works once {whose} referenced"

    def entries(self) -> dict[str, Value]:
        prefix = self.plan.table.prefix
        found: dict[str, Value] = dict(
            self.plan.table.entries(self.integers, self.target)
        )
        options = {
            "n_cycles": chosen_cycles(self),
            "manual_activation": self.fit.manual_activation,
        }
        sizes = {key: value for key, value in found.items() if "[" not in key}
        chosen = {
            f"{prefix}.{key}": int(value)
            for key, value in options.items()
            if value is not None
        }
        return sizes | chosen | {k: v for k, v in found.items() if "[" in k}

    def machine_entries(self, cycles: int | None) -> dict[str, Value]:
        values: dict[str, Value] = super().machine_entries(cycles)
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

    @property
    def cycles(self) -> int | None:
        if not self._bilateral:
            return None
        jump = float(abs(self.offset[0] - self.offset[1]).max())
        return spread_over(
            self.job, jump, self.lists.machine, "lr_param.n_backlash_cyc"
        )

    @property
    def jump(self) -> float:
        both = (self.offset,) if self.change is None else (self.offset, self.change)
        return max(float(np.abs(part).max()) for part in both)

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        lines = pass_gate(self, cycles if self._bilateral else None)
        return (*lines, *switching_checks(self))

    def refuse_misread(self, listing: ListFile) -> None:
        table = self.plan.table
        back = table.read(ListFile.parse(listing.dumps(), listing.source))
        if not np.array_equal(table.to_integers(table.at_nodes(back)), self.integers):
            words = f"found another table in {listing.source} when it was read back,"
            words += " expected the one that was fitted"
            raise self.refusal(words)

    def left_over(self, tables: Tables, fit: FitSpec) -> SecondMeasurement | None:
        assert isinstance(fit, TableSpec)
        plan, table = self.plan, self.plan.table
        found, _ = read_fit(tables, self.index, fit, table, Leftovers())
        datum = datum_of(tables.job, self.index, fit)
        own = table.masters == (table.axis,)
        branch = plan.branch(found.direction)
        added = table.offset(table.model(self.integers), found.positions, branch)
        added = added - plan.acted(found.positions, branch)
        removed = {tables.job.spec.measurements[name].remove for name in fit.sources}
        if "line" in removed:  # a slope that no reading shows
            added = without_zero(added, [*found.positions.T], "line")
        return SecondMeasurement.of(
            ", ".join(fit.sources),
            found.positions,
            found.error - zero_at(found, datum, table),
            found.direction if own else None,
            found.run if run_table(found, table) is not None else None,
            float(np.std(added)),
        )

    def prove(self, done: Written) -> TableResult:
        plan, table = self.plan, self.plan.table
        listing = done.compensation
        assert listing is not None  # a table stands in it
        proof = self.proof(table.read(listing))
        old, deviation = plan.old_offset, written_deviation(self.estimate)
        return TableResult(
            **self.frame(done),
            masters=self.fit.over,
            nodes=tuple(nodes.positions for nodes in table.nodes),
            table=by_branch(table, table.sign * self.offset),
            old_table=None if old is None else by_branch(table, table.sign * old),
            standard_deviation=by_branch(table, deviation),
            support=by_branch(table, self.estimate.support),
            fit=proof.fit,
            samples=proof.samples,
            error=proof.error,
            rounding=self.rounding,
            remarks=(
                *plan.remarks,
                *proof.remarks,
                *fit_remarks(self, proof),
                *use_remarks(proof.error, proof.by_run),
                *switching_remarks(self),
                *done.files.remarks,
            ),
            files=done.files.of_lists(done.names),
            cycles=done.cycles if self._bilateral else None,
            held_out="run" if proof.by_run else "block",
            streamed=proof.streamed,
        )

    @abc.abstractmethod
    def proof(self, back: Model) -> Proof:
        """Return the proof of the fit; ``back`` is the written table, read back."""

    @property
    def _bilateral(self) -> bool:
        return self.plan.table.branches == 2


@final
@dataclasses.dataclass(frozen=True)
class TableDraft(AbstractTableDraft):
    """A table fitted to readings in memory.

    Attributes:
        readings: What was measured.
        remarks: What is to be said of them.
        samples: The same as the estimator saw it.
        before: Error of each reading, zero at the datum, in mm or °.
        held_out: Each reading under the list that was fitted without it.
    """

    readings: Readings
    remarks: tuple[Remark, ...]
    samples: Samples
    before: Float[np.ndarray, " t"]
    held_out: HeldOut

    @property
    def predicted(self) -> float | None:
        left = self.held_out.residual[~self.estimate.wild]
        return float(np.std(left)) if left.size else None

    def left_by(self) -> Mapping[tuple[str, str], np.ndarray]:
        added = self._added(self.plan.table.model(self.integers)) - self._acted
        return {
            (self.axis, name): added[rows]
            for name, rows in self.readings.slices.items()
        }

    def proof(self, back: Model) -> Proof:
        readings, table, estimate = self.readings, self.plan.table, self.estimate
        from_file = self.before + self._added(back) - self._acted
        runs = run_table(readings, table)
        wild, left = estimate.wild, self.held_out
        return Proof(
            fit=estimate,
            samples=SampleView(
                positions=readings.positions,
                direction=readings.direction,
                run=readings.run,
                order=readings.order,
                before=self.before,
                predicted=left.residual,
                from_file=from_file,
                predicted_sd=left.standard_deviation,
                share=estimate.share,
                timed=readings.timed,
            ),
            error=staged(self.before, left.residual, from_file, wild, runs),
            readings=len(self.before),
            wild=int(wild.sum()),
            outside=int(outside(table, readings.positions).sum()),
            places=places_of(readings, wild, self.fit.over),
            by_run=left.by_run,
            remarks=self.remarks,
        )

    def _added(self, model: Model) -> Float[np.ndarray, " t"]:
        """Return what a table adds at each reading, in mm or °."""
        positions, branch = self.readings.positions, self.samples.branch
        return self.plan.table.offset(model, positions, branch)

    @functools.cached_property
    def _acted(self) -> Float[np.ndarray, " t"]:
        return self.plan.acted(self.readings.positions, self.samples.branch)


def written_deviation(fit: TableFit) -> Float[np.ndarray, "..."]:
    """Return the standard deviation of entries in mm or °: rounding is part of it."""
    rounding = 1.0 / (12.0 * LIST_UNITS**2)
    return np.asarray(np.sqrt(np.square(fit.standard_deviation) + rounding))

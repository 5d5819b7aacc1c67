"""Which table each fit writes: nodes, masters and the list that is there already."""

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, Num

from ....data.lists import ListFile
from ...exchange import AbstractTable, ExchangeError, Model, refuse_lost_nodes
from ...fit import Inequalities, TableFit, kept, mean_row, zeroed
from ...kinds import kinds
from ...kinds._keys import FitSpec, TableSpec
from ...readings import Tables
from .._draft import AbstractDraft, AbstractPlan, Leftovers
from ..file._load import Job
from ..result._result import Remark
from ._layout import empty_table, table_of
from ._readings import datum_of

if TYPE_CHECKING:
    from ...fit.joint import AbstractEffect, JointData
    from ..joint._recording import GroupRecording
    from ..joint._share import Share

_TOGETHER = 0.99
"""Correlation of two masters from which on a table over them is told on a line only."""


@dataclasses.dataclass(frozen=True)
class Plan(AbstractPlan):
    """One table before its measurement is looked at.

    Attributes:
        table: What will be written.
        old: Table of this compensation in the existing list, or None.
        active: Whether it was active while measuring: the new table is then old +
            residual, else it replaces the old one.
        datum: Where the error is zero, per master, or None.
        remarks: What the user must know.
    """

    fit: TableSpec
    table: AbstractTable
    old: Model | None
    active: bool
    datum: tuple[float, ...] | None
    remarks: tuple[Remark, ...]

    def fit_single(self, tables: Tables, left: Leftovers) -> AbstractDraft:
        from ._fitting import fit_planned

        return fit_planned(self, tables, left)

    @property
    def inputs(self) -> dict[str, tuple[str, ...]]:
        ways = {"direction": (self.axis,)} if self.table.branches == 2 else {}
        return {"position": self.fit.over} | ways

    def unfit(self, recording: "GroupRecording") -> str:
        data = recording.data
        read = np.isfinite(data.error[self.axis])
        for name in self.fit.over:
            place = data.position[name][read & np.isfinite(data.position[name])]
            if len(place) and not np.ptp(place) > 0:
                return f"All readings stand at {place[0]:g} along {name}."
        if self.table.branches > 1:
            if missing := missing_way(data.direction[self.axis][read]):
                return (
                    f"No reading in {missing} direction of {self.axis}: a table for each"
                    " direction (bilateral = true) needs both."
                )
        return ""

    def undetermined(self, data: "JointData") -> str:
        if len(self.fit.over) < 2:
            return ""
        first, second = (data.position[name] for name in self.fit.over)
        finite = np.isfinite(first) & np.isfinite(second)
        finite &= np.isfinite(data.error[self.axis])
        x, y = first[finite], second[finite]
        if len(x) < 3 or not np.ptp(x) > 0 or not np.ptp(y) > 0:
            return ""
        correlation = float(np.corrcoef(x, y)[0, 1])
        if abs(correlation) < _TOGETHER:
            return ""
        names = " and ".join(self.fit.over)
        return (
            f"{names} moved together (correlation {correlation:.4f}): beside the line on which"
            " they went nothing was measured. Move each of them while the other stands"
            " still."
        )

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> "AbstractEffect":
        return self.table.effect(self.axis, self.fit.over)

    def draft(self, share: "Share") -> AbstractDraft:
        from ._fitting import draft_of_share

        return draft_of_share(self, share)

    @property
    def old_offset(self) -> Float[np.ndarray, "..."] | None:
        """Offset of the old table at the new nodes in mm or °, or None."""
        return None if self.old is None else self.table.at_nodes(self.old)

    @property
    def acting_offset(self) -> Float[np.ndarray, "..."]:
        """Offset at the new nodes in mm or ° that acted while measuring; 0 where none did."""
        acting = self.old_offset if self.active else None
        return np.zeros(self.table.layout.shape) if acting is None else acting

    @functools.cached_property
    def datum_row(self) -> Float[np.ndarray, " n"]:
        """Share of each value in what the table says at the datum, the mean of both directions.

        Zeros without a datum.

        Raises:
            JobError: If the datum lies outside the table.
        """
        if self.datum is None:
            return np.zeros(self.table.layout.size)
        for place, nodes in zip(self.datum, self.table.nodes, strict=True):
            ends = nodes.positions[[0, -1]]
            if not ends[0] <= place <= ends[1]:
                raise self.job.error(
                    ("measurements", self.fit.sources[0], "datum", "at"),
                    f"found {place:g}, expected a position within the table of"
                    f" fits[{self.index}], {ends[0]:g} to {ends[1]:g}",
                )
        return mean_row(self.table.layout, self.datum)

    def zero_of(self, values: Float[np.ndarray, "..."]) -> float:
        """Return what values at the nodes say at the datum."""
        return float(self.datum_row @ self.table.layout.to_values(values))

    def zeroed(self, estimate: TableFit) -> tuple[float, TableFit]:
        """Return what a table says at the datum, and it less that."""
        if self.datum is None:
            return 0.0, estimate
        return self.zero_of(estimate.values), zeroed(estimate, self.datum_row)

    def offset(self, residual: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Return the offset at the nodes that a residual there asks for, in mm or °."""
        return np.asarray(self.acting_offset - residual)

    def integers(self, estimates: Sequence[TableFit]) -> Int[np.ndarray, "k ..."]:
        """Return the list entries of several estimates, for proofs: no list is written of them.

        A value beyond the range of an entry becomes the end of that range.
        """
        values = [fit.values for fit in estimates]
        offsets = [self.offset(each - self.zero_of(each)) for each in values]
        ends = self.table.to_offsets(np.array(self.table.value_bounds))
        inside = np.clip(np.stack(offsets), min(ends), max(ends))
        return np.stack([self.to_integers(offset) for offset in inside])

    def to_integers(self, offset: Float[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
        """Return offsets at the nodes as the entries of the list, which keep `constraints`.

        Raises:
            JobError: If one does not fit its type.
        """
        nodes = self.table.layout.nodes
        words = (
            f"too large a correction (is the unit of {self.fit.axis}.error right?): "
        )
        with self.job.blaming(("fits", self.index), words):
            return kept(self.fit.constraints, self.table.to_integers(offset), nodes)

    @property
    def inequalities(self) -> Inequalities | None:
        """What the values of the fit keep, so that the entries do; None: nothing."""
        if not self.fit.constraints:
            return None
        words, sign = tuple(self.fit.constraints), self.table.sign
        return Inequalities(words, -sign, sign * self.acting_offset, self.datum_row)

    def branch(
        self, direction: Int[np.ndarray, " t"] | None
    ) -> Int[np.ndarray, " t"] | None:
        """Return which branch of the table holds at each reading; None: it has one."""
        if self.table.branches == 1:
            return None
        assert direction is not None  # the reader refuses it otherwise
        return (direction < 0).astype(np.int64)

    def acted(
        self, positions: Float[np.ndarray, "t d"], branch: Int[np.ndarray, " t"] | None
    ) -> Float[np.ndarray, " t"]:
        """Return what the old table added at readings while measuring, in mm or °."""
        if not self.active or self.old is None:
            return np.zeros(len(positions))
        return self.table.offset(self.old, positions, branch)


def missing_way(direction: Num[np.ndarray, " t"]) -> str:
    """Return the sign of the direction in which nothing was read, or nothing."""
    if not np.any(direction > 0):
        return "+"
    return "" if np.any(direction < 0) else "−"


def plan(tables: Tables, index: int, fit: TableSpec) -> Plan:
    """Return what a table fit writes.

    Raises:
        JobError: If nodes, masters or existing lists do not suit.
    """
    job, existing = tables.job, tables.job.lists[fit.axis].compensation
    where = ("fits", index)
    holder = None  # the list that has this table already
    if existing is not None and not fit.kind.entries.adds_nothing(existing):
        holder = existing.source
    active = was_active(job, index, fit, holder)
    with job.blaming(where):
        old, notes = _old_table(job, fit, existing, active)
        table = table_of(tables, index, fit, old)
        masters = table.masters
        if existing is not None and old is not None:
            masters = fit.kind.entries.named_masters(existing) or (table.axis,)
        if active:
            if existing is None or old is None:
                raise job.error(
                    ("axes", fit.axis, "list"),
                    f"{fit.compensation} was active while measuring, but no list with"
                    " its table is given, expected list = the file that was loaded; where it"
                    f" was that of another axis, name these readings of {fit.axis} once more,"
                    f" as a measurement whose active has no {fit.compensation}",
                )
            if masters != table.masters:
                known = {axis.number: name for name, axis in job.spec.axes.items()}
                stated, there = (
                    " and ".join(known.get(number, f"axis {number}") for number in each)
                    for each in (table.masters, masters)
                )
                raise job.error(
                    where,
                    f"found a {fit.compensation} over {stated}, expected one over {there} as in"
                    f" the active table of {existing.source}, for which there is one place in a"
                    " list: fit over these axes, or measure with the old table off (active = []),"
                    " and the new one takes its place",
                )
            refuse_lost_nodes(table, old, existing.source)
        elif holder is not None and set(masters) != set(table.masters):
            notes, old = [_displaced(job, fit, holder, masters)], None
    fit.refuse(job, index, table)
    if table.periodic and "monotone" in fit.constraints:
        reason = (
            "found 'monotone' for a table that goes round, expected one with two ends"
        )
        raise job.error((*where, "constraints"), reason)
    planned = Plan(job, index, fit, table, old, active, datum_of(job, index, fit), ())
    return dataclasses.replace(planned, remarks=(*notes, *_remarks(planned)))


def _old_table(
    job: Job, fit: TableSpec, existing: ListFile | None, active: bool
) -> tuple[Model | None, list[Remark]]:
    """Return the table that the existing list holds, or None, and what to say of it.

    Raises:
        ExchangeError: If it cannot be read and something rests on it: it was active, its
            nodes are taken over, or the gate limits the change.
    """
    probe = empty_table(job, fit)
    if existing is None or not fit.kind.entries.is_in(existing):
        return None, []
    try:
        return probe.read(existing, job.increments), []
    except ExchangeError as error:
        if active or not fit.nodes or job.spec.gate.max_change is not None:
            raise
        words = f"The new table replaces one that cannot be compared with it: {error}"
        return None, [Remark.warning(words)]


def _displaced(job: Job, fit: TableSpec, source: str, masters: Sequence[int]) -> Remark:
    """Return what becomes of an old table over other axes: there is room for one."""
    by_number = {axis.number: name for name, axis in job.spec.axes.items()}
    names = " and ".join(by_number.get(number, f"axis {number}") for number in masters)
    return Remark.warning(
        f"The old {fit.compensation} table of {source} follows {names}: the new one takes"
        f" its place, and nothing corrects what it corrected. Where {fit.axis} needs both,"
        " fit a plane over the axes of both, or hold one of them in an external"
        " compensation (axcomp export-external)."
    )


def _remarks(plan: Plan) -> Iterator[Remark]:
    job, fit, existing = plan.job, plan.fit, plan.lists.compensation
    axis_list = plan.lists.machine
    if plan.active:
        yield Remark.info(
            "The old table was active while measuring: the new one is old + residual."
        )
        if axis_list is not None and not fit.kind.entries.is_activated(axis_list):
            yield Remark.warning(
                f"{axis_list.source} switches the {fit.compensation} of {fit.axis} off"
                f" ({fit.kind.activation}), and active says that it was on while measuring:"
                " where it was off, the new table holds the old one once too often."
            )
    elif plan.old is not None:
        yield Remark.info(
            "The old table was off while measuring: the new one replaces it."
        )
    yield from (Remark.warning(words) for words in fit.warnings(job))
    if existing is None:
        return
    others = {spec.compensation for spec in job.spec.fits if spec.axis == fit.axis}
    on = set().union(*(job.spec.measurements[name].active for name in fit.sources))
    for kind in kinds():
        if not kind.table or kind.name in on | others:
            continue
        if axis_list is not None and kind.entries.is_activated(axis_list):
            continue  # the axis is judged with it
        if not kind.entries.adds_nothing(existing):
            yield Remark.warning(
                f"The list also holds a {kind.name} table that was off while measuring:"
                " what it corrects is part of the new table as well. Leave it off,"
                f" or measure with {kind.name} active."
            )


def refuse_unstated(job: Job, fit: FitSpec, holder: str | None, on: str) -> None:
    """Raise where a list has the compensation already and a measurement does not say more.

    What was measured is then either the whole error or what that list leaves of it. The holder
    is that list, if any, `on` what follows where it acted while measuring.
    """
    for name in fit.sources:
        stated, kind = job.spec.measurements[name].stated_active, fit.compensation
        if holder is not None and stated is None:
            raise job.error(
                ("measurements", name),
                f"found no active, and {Path(holder).name} holds {kind} of {fit.axis} already,"
                f' expected active = ["{kind}"] if it was on while measuring ({on}), or active'
                " = [] if it was off (the new values replace the old)",
            )


def was_active(job: Job, index: int, fit: FitSpec, holder: str | None) -> bool:
    """Return whether the compensation of a fit was on in all its measurements.

    The holder is the list of the axis that holds it already, or None.

    Raises:
        JobError: If it was on in some of them only, or there is a list with it and a
            measurement does not say.
    """
    refuse_unstated(job, fit, holder, "the new values are old + measured")
    kind = fit.compensation
    states = {kind in job.spec.measurements[name].active for name in fit.sources}
    if len(states) > 1:
        raise job.error(
            ("fits", index),
            f"found measurements with {kind} on and off (active), expected one state"
            " for all that are joined",
        )
    return states == {True}

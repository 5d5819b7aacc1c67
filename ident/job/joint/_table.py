"""A table of a group, of whatever compensation."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ...core import CellCovariance
from ...exchange import LIST_UNITS
from ...fit import Samples, TableFit
from ...fit.joint import AbstractEffect, JointData, Part
from ...kinds._keys import TableSpec
from ...proof import HeldOut
from ...readings import Readings, Tables
from ..table._draft import TableDraft
from ..table._plan import Plan, plan_fit
from ..table._trend import refuse_unowned_trend
from ._member import AbstractMember
from ._recording import GroupRecording
from ._share import Share

_TOGETHER = 0.99
"""Correlation of two masters from which on a table over them is told on a line only."""


def member(tables: Tables, index: int, fit: TableSpec) -> "TableMember":
    """Plan a table of a group.

    Raises:
        JobError: If nodes, masters or existing lists do not suit.
    """
    return TableMember(tables.job, index, fit, plan_fit(tables, index, fit))


@final
@dataclasses.dataclass(frozen=True)
class TableMember(AbstractMember):
    """A table.

    Attributes:
        plan: What is written.
    """

    fit: TableSpec
    plan: Plan

    @property
    def positions(self) -> tuple[str, ...]:
        return self.fit.over

    @property
    def turning(self) -> tuple[str, ...]:
        return (self.axis,) if self.plan.table.branches == 2 else ()

    @property
    def takes_line(self) -> bool:
        return self.fit.lengths

    def undetermined(self, data: JointData) -> str:
        if len(self.fit.over) < 2:
            return ""
        first, second = (data.position[name] for name in self.fit.over)
        known = np.isfinite(first) & np.isfinite(second)
        known &= np.isfinite(data.error[self.axis])
        x, y = first[known], second[known]
        if len(x) < 3 or not np.ptp(x) > 0 or not np.ptp(y) > 0:
            return ""
        alike = float(np.corrcoef(x, y)[0, 1])
        if abs(alike) < _TOGETHER:
            return ""
        names = " and ".join(self.fit.over)
        return (
            f"{names} moved together (correlation {alike:.4f}): beside the line on which"
            " they went nothing was measured. Move each of them while the other stands"
            " still."
        )

    def effect(
        self, recording: GroupRecording, left: Float[np.ndarray, " t"] | None
    ) -> AbstractEffect:
        return self.plan.table.effect(self.axis, self.fit.over)

    def draft(self, share: Share) -> TableDraft:
        plan, recording, rows = self.plan, share.recording, share.rows
        positions = np.stack(
            [share.column("position", name) for name in self.fit.over], axis=1
        )
        direction = None
        if plan.table.branches == 2:
            direction = share.column("direction", self.axis).astype(np.int64)
        run = None if recording.data.run is None else recording.data.run[rows]
        readings = Readings(
            positions=positions,
            error=share.error,
            direction=direction,
            run=run,
            order=recording.order[rows],
            timed=recording.timed,
            slices=share.slices(),
        )
        fit = self._table_fit(share, share.part)
        refuse_unowned_trend(plan, fit)
        spread = float(np.hypot(share.noise, 1 / (np.sqrt(12.0) * LIST_UNITS)))
        return TableDraft(
            self.job,
            self.index,
            self.fit,
            plan=plan,
            estimate=fit,
            run_effects="offset" if share.fit.runs.get(self.axis) else "none",
            readings=readings,
            remarks=tuple(share.remarks()),
            samples=Samples(
                positions, share.error, branch=plan.branch(direction), run=run
            ),
            before=share.error,
            held_out=HeldOut(
                residual=share.predicted[rows],
                standard_deviation=np.full(len(share.error), spread),
                groups=recording.fold[rows],
                by_run=recording.by_run,
            ),
        )

    def _table_fit(self, share: Share, part: Part) -> TableFit:
        """Return the part as the fit of a single table."""
        deviation = np.array(part.deviation_table, dtype=float)
        support = np.asarray(part.effect.table(part.support.astype(float)))
        # What only neighbours of the same table hide is filled like any other gap.
        hidden = ~np.isfinite(deviation)
        deviation[hidden] = float(np.std(part.table))
        support = np.where(hidden, 0.0, support).astype(np.int64)
        return TableFit(
            layout=self.plan.table.layout,
            values=np.asarray(part.table + share.constant),
            standard_deviation=deviation,
            support=support,
            noise=share.noise,
            smoothness=dict(part.smoothness),
            loss=self.fit.loss,
            residual=np.asarray(share.fit.residual[self.axis][share.rows]),
            share=np.asarray(share.fit.share[self.axis][share.rows], dtype=float),
            wild=share.wild,
            runs=tuple(share.fit.runs.get(self.axis, ())),
            suspect_nodes=(),
            suspect_runs=(),
            covariance=CellCovariance((0,), np.zeros((0, 1))),
            converged=share.fit.converged,
            message=share.message,
        )

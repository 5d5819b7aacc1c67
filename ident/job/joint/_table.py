"""The draft of a table that was fitted in a group, of whatever compensation."""

import numpy as np

from ...core import CellCovariance
from ...exchange import LIST_UNITS
from ...fit import Samples, TableFit
from ...proof import HeldOut
from ..table._draft import InMemory, TableDraft
from ..table._fitting import doubted
from ..table._plan import Plan
from ..table._trend import refuse_unowned_trend
from ._share import Share


def table_draft(plan: Plan, share: Share) -> TableDraft:
    """Return the table of a group as one that was fitted alone."""
    recording = share.recording
    readings = share.readings(plan.fit.over, plan.table.branches == 2)
    fit = _table_fit(plan, share)
    refuse_unowned_trend(plan, fit)
    spread = float(np.hypot(share.noise, 1 / (np.sqrt(12.0) * LIST_UNITS)))
    error = readings.error
    samples = Samples(
        readings.positions,
        error,
        branch=plan.branch(readings.direction),
        run=readings.run,
    )
    if share.constant:
        fit = doubted(plan, readings, samples, fit)
    left = HeldOut(
        residual=share.predicted[share.rows],
        standard_deviation=np.full(len(error), spread),
        groups=recording.fold[share.rows],
        by_run=recording.by_run,
    )
    fitted = InMemory(plan, readings, share.remarks(), samples, error, left, fit)
    effects = "offset" if share.fit.runs.get(plan.axis) else "none"
    return TableDraft(plan.job, plan.index, plan.fit, plan, fit, effects, fitted)


def _table_fit(plan: Plan, share: Share) -> TableFit:
    """Return the part as the fit of a single table."""
    part = share.part
    deviation = np.hypot(part.deviation_table, share.constant_deviation)
    support = np.asarray(part.effect.table(part.support.astype(float)))
    # What only neighbours of the same table hide is filled like any other gap.
    hidden = ~np.isfinite(deviation)
    deviation[hidden] = float(np.std(part.table))
    support = np.where(hidden, 0.0, support).astype(np.int64)
    return TableFit(
        layout=plan.table.layout,
        values=np.asarray(part.table + share.constant),
        standard_deviation=deviation,
        support=support,
        noise=share.noise,
        smoothness=dict(part.smoothness),
        loss=plan.fit.loss,
        residual=np.asarray(share.fit.residual[plan.axis][share.rows]),
        share=np.asarray(share.fit.share[plan.axis][share.rows], dtype=float),
        wild=share.wild,
        runs=tuple(share.fit.runs.get(plan.axis, ())),
        suspect_nodes=(),
        suspect_runs=(),
        covariance=CellCovariance((0,), np.zeros((0, 1))),
        converged=share.fit.converged,
        message=share.message,
    )

"""A leadscrew as a job handles it: one of the tables."""

from ...job._fitting import plan_table as plan
from ...job._load import Job
from .entries import LeadscrewTable
from .keys import Spec

__all__ = ["empty_table", "plan"]


def empty_table(job: Job, fit: Spec) -> LeadscrewTable:
    """Return the table that a fit writes, its nodes not yet known."""
    axes = job.spec.axes
    masters = tuple(axes[name].number for name in fit.over)
    return LeadscrewTable(
        axes[fit.axis].number, masters, (), job.conventions, bilateral=fit.bilateral
    )

"""One fit to a log in pieces: readings in, integers of the list out."""

import dataclasses
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Int

from ...fit import (
    Grouping,
    Stream,
    StreamedFit,
    fit_streamed,
)
from .._fitting import AbstractFitted, Rounded
from .._load import Job
from .._plan import Plan
from ._groups import Runs, grouping_of
from ._readings import LogReadings


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class StreamedFitted(AbstractFitted):
    """A fit to a log in pieces, before it is written.

    Attributes:
        readings: What was measured.
        estimate: What the passes over it gave, with a table for every group left out.
        grouping: Tells the group of each reading.
        folds: Entries of the list fitted without each group.
        zero: What was taken off the error, so that it is zero at the datum, in mm or °.
    """

    readings: LogReadings
    estimate: StreamedFit
    grouping: Grouping
    folds: Mapping[int, Int[np.ndarray, "..."]]
    zero: float

    @property
    def by_run(self) -> bool:
        """Whether runs were left out, else spatial blocks."""
        return isinstance(self.grouping, Runs)


def fit_log_plan(job: Job, plan: Plan, readings: LogReadings) -> StreamedFitted:
    """Fit the table of a plan to a log and round it to the list.

    Raises:
        FitError: If the readings cannot determine it.
        ExchangeError: If the result fits no list.
        MeasurementError: If a cell of the log cannot be used.
    """
    table, spec = plan.table, plan.fit
    stream = Stream(readings.parts)
    grouping = grouping_of(readings, stream)
    found = fit_streamed(
        table.layout,
        readings.parts,
        grouping,
        smoothness=spec.smoothness,
        loss=spec.loss,
    )
    rounded = Rounded(job, plan, readings.datum)
    zero = rounded.zero(found.fit)
    entries = rounded.integers(found.fit)
    return StreamedFitted(
        plan=plan,
        fit=dataclasses.replace(found.fit, values=found.fit.values - zero),
        integers=entries,
        rounding=rounded.rounding(found.fit, entries),
        run_effects="none",
        readings=readings,
        estimate=found,
        grouping=grouping,
        folds={group: rounded.integers(fold) for group, fold in found.folds.items()},
        zero=zero,
    )

"""One fit: readings in, integers of the list and what they leave of the error out."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ..exchange import ExchangeError
from ..fit import FitError, Samples, TableFit, fit_table, predict
from ..proof import HeldOut, held_out
from ._load import Job
from ._plan import Plan
from ._readings import Readings

_DRIFT_NEEDS = 4
"""Readings that every run must have, so that a drift is more than a guess."""


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A fit before it is written.

    Attributes:
        plan: What is written.
        readings: What was measured.
        samples: The same as the estimator saw it.
        fit: The estimate, zero at the datum (sign of the error).
        before: Error of each reading, zero at the datum, in mm or °.
        active: Offset that was active at each reading while measuring.
        integers: Entries of the new table.
        rounding: Largest change of an offset by rounding, in mm or °.
        held_out: Each reading under the list that was fitted without it.
        run_effects: What each run was allowed of its own.
    """

    plan: Plan
    readings: Readings
    samples: Samples
    fit: TableFit
    before: Float[np.ndarray, " t"]
    active: Float[np.ndarray, " t"]
    integers: Int[np.ndarray, "..."]
    rounding: float
    held_out: HeldOut
    run_effects: str

    @property
    def offset(self) -> Float[np.ndarray, "..."]:
        """Offset at the nodes in mm or ° as it is written."""
        return self.plan.table.to_offsets(self.integers)

    @property
    def change(self) -> Float[np.ndarray, "..."] | None:
        """Offset at the nodes against that of the old table, or None."""
        old = self.plan.old_offset
        return None if old is None else self.offset - old


def fit_plan(job: Job, plan: Plan, readings: Readings) -> Fitted:
    """Fit the table of a plan to its readings and round it to the list.

    Raises:
        JobError: If the readings cannot determine it, or the result fits no list.
    """
    try:
        return _fitted(job, plan, readings)
    except (FitError, ExchangeError) as error:
        spec = plan.fit
        reason = f"{spec.compensation} of {spec.axis} from {', '.join(spec.sources)}"
        raise job.error(("fits", plan.index), f"{reason}: {error}") from None


def _fitted(job: Job, plan: Plan, readings: Readings) -> Fitted:
    table, spec = plan.table, plan.fit
    branch = None
    if table.branches == 2:
        assert readings.direction is not None  # `read_fit` refuses it otherwise
        branch = (readings.direction < 0).astype(np.int64)
    samples = Samples(
        positions=readings.positions,
        error=readings.error,
        branch=branch,
        run=readings.run if readings.repeated else None,
        order=readings.place if readings.repeated else None,
    )
    effects = _run_effects(samples)
    fit = fit_table(
        table.layout,
        samples,
        smoothness=spec.smoothness,
        loss=spec.loss,
        run_effects=effects,
    )
    zero = _zero(job, plan, readings, fit)
    old = plan.old_offset if plan.active else None

    def offset_of(estimate: TableFit) -> Float[np.ndarray, "..."]:
        residual = estimate.values - _zero(job, plan, readings, estimate)
        return -residual if old is None else old - residual

    def integers_of(estimate: TableFit) -> Int[np.ndarray, "..."]:
        return table.to_integers(offset_of(estimate))

    before = readings.error - zero
    active = np.zeros(len(before))
    if plan.active and plan.old is not None:
        active = table.offset(plan.old, readings.positions, branch)
    integers = integers_of(fit)
    exact = offset_of(fit)
    return Fitted(
        plan=plan,
        readings=readings,
        samples=samples,
        fit=dataclasses.replace(fit, values=fit.values - zero),
        before=before,
        active=active,
        integers=integers,
        # Between nodes the table is a weighted mean, which cannot be off by more.
        rounding=float(np.max(np.abs(table.to_offsets(integers) - exact))),
        held_out=held_out(
            table, samples, fit, integers_of, before, active, run_effects=effects
        ),
        run_effects=effects,
    )


def _run_effects(samples: Samples) -> str:
    """Return what each run may have of its own: ``none``, ``offset`` or ``drift``."""
    if samples.run is None:
        return "none"
    labels, counts = np.unique(samples.run, return_counts=True)
    if len(labels) < 2:
        return "none"
    return "drift" if counts.min() >= _DRIFT_NEEDS else "offset"


def _zero(job: Job, plan: Plan, readings: Readings, fit: TableFit) -> float:
    """Return what the table says at the datum, the mean of both directions."""
    if readings.datum is None:
        return 0.0
    for place, nodes in zip(readings.datum, plan.table.nodes, strict=True):
        ends = nodes.positions[[0, -1]]
        if not ends[0] <= place <= ends[1]:
            raise job.error(
                ("measurements", plan.fit.sources[0], "datum", "at"),
                f"found {place:g}, expected a position within the table of"
                f" fits[{plan.index}], {ends[0]:g} to {ends[1]:g}",
            )
    count = plan.table.branches
    where = np.tile(np.array([readings.datum]), (count, 1))
    branch = np.arange(count) if count == 2 else None
    return float(np.mean(predict(fit, where, branch)[0]))

"""One fit: readings in, integers of the list and what they leave of the error out."""

import abc
import dataclasses
from collections import Counter
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float, Int

from ..exchange import AbstractTable
from ..fit import Samples, TableFit, TableLayout, fit_table, predict
from ..proof import HeldOut, held_out
from ._found_nodes import grid_words, suit
from ._load import Job
from ._plan import Plan
from ._readings import Readings
from ._result import Remark

_DRIFT_NEEDS = 4
"""Readings that every run must have, so that a drift is more than a guess."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AbstractFitted(abc.ABC):
    """A fit before it is written.

    Attributes:
        plan: What is written.
        fit: The estimate, zero at the datum (sign of the error).
        integers: Entries of the new table.
        rounding: Largest change of an offset by rounding, in mm or °.
        run_effects: What each run was allowed of its own.
    """

    plan: Plan
    fit: TableFit
    integers: Int[np.ndarray, "..."]
    rounding: float
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


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class Fitted(AbstractFitted):
    """A fit to readings in memory.

    Attributes:
        readings: What was measured.
        samples: The same as the estimator saw it.
        before: Error of each reading, zero at the datum, in mm or °.
        active: Offset that was active at each reading while measuring.
        held_out: Each reading under the list that was fitted without it.
    """

    readings: Readings
    samples: Samples
    before: Float[np.ndarray, " t"]
    active: Float[np.ndarray, " t"]
    held_out: HeldOut


@dataclasses.dataclass(frozen=True)
class Rounded:
    """From an estimate to the entries of a list.

    Attributes:
        job: The job.
        plan: What is written.
        datum: Where the error is zero, per master, or None.
    """

    job: Job
    plan: Plan
    datum: tuple[float, ...] | None

    def offset(self, estimate: TableFit) -> Float[np.ndarray, "..."]:
        """Return the offset at the nodes that an estimate asks for, in mm or °."""
        residual = estimate.values - self.zero(estimate)
        old = self.plan.old_offset if self.plan.active else None
        return -residual if old is None else old - residual

    def integers(self, estimate: TableFit) -> Int[np.ndarray, "..."]:
        """Return the entries of its list."""
        return np.asarray(self.integers_of([estimate])[0])

    def integers_of(self, estimates: Sequence[TableFit]) -> Int[np.ndarray, "k ..."]:
        """Return the entries of the lists of several estimates."""
        offsets = np.stack([self.offset(estimate) for estimate in estimates])
        return self.plan.table.to_integers(offsets)

    def rounding(self, estimate: TableFit, entries: Int[np.ndarray, "..."]) -> float:
        """Return the largest change of an offset by rounding, in mm or °.

        Between nodes the table is a weighted mean, which cannot be off by more.

        Args:
            estimate: What is written.
            entries: Of its list.
        """
        written = self.plan.table.to_offsets(entries)
        return float(np.max(np.abs(written - self.offset(estimate))))

    def zero(self, estimate: TableFit) -> float:
        """Return what the table says at the datum, the mean of both directions.

        Raises:
            JobError: If it lies outside the table.
        """
        plan = self.plan
        if self.datum is None:
            return 0.0
        for place, nodes in zip(self.datum, plan.table.nodes, strict=True):
            ends = nodes.positions[[0, -1]]
            if not ends[0] <= place <= ends[1]:
                raise self.job.error(
                    ("measurements", plan.fit.sources[0], "datum", "at"),
                    f"found {place:g}, expected a position within the table of"
                    f" fits[{plan.index}], {ends[0]:g} to {ends[1]:g}",
                )
        count = plan.table.branches
        where = np.tile(np.array([self.datum]), (count, 1))
        branch = np.arange(count) if count == 2 else None
        return float(np.mean(predict(estimate, where, branch)[0]))


def fit_plan(job: Job, plan: Plan, readings: Readings) -> Fitted:
    """Fit the table of a plan to its readings and round it to the list.

    Raises:
        FitError: If the readings cannot determine it.
        ExchangeError: If the result fits no list.
    """
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
    finer = _finer_than(table.layout, branch, len(readings.error))
    fit = fit_table(
        table.layout,
        samples,
        smoothness=spec.smoothness,
        loss=spec.loss,
        run_effects=effects,
        allow_gaps=finer,
    )
    if finer:
        words = "There are more nodes than readings: the prior fills in between."
        places = [*readings.positions.T]
        if not suit([nodes.positions for nodes in table.nodes], places):
            words += f" Nodes that suit these readings: {grid_words(places)}."
        readings = readings.with_remark(Remark.warning(words))
    rounded = Rounded(job, plan, readings.datum)
    zero = rounded.zero(fit)
    before = readings.error - zero
    entries = rounded.integers(fit)
    active = np.zeros(len(before))
    if plan.active and plan.old is not None:
        active = table.offset(plan.old, readings.positions, branch)
    return Fitted(
        plan=plan,
        readings=readings,
        samples=samples,
        fit=dataclasses.replace(
            fit,
            values=fit.values - zero,
            standard_deviation=np.hypot(
                fit.standard_deviation, _late(table, samples, readings.late)
            ),
        ),
        before=before,
        active=active,
        integers=entries,
        rounding=rounded.rounding(fit, entries),
        held_out=held_out(table, samples, fit, rounded.integers_of, before, active),
        run_effects=effects,
    )


def _late(
    table: AbstractTable, samples: Samples, late: Float[np.ndarray, " t"] | None
) -> Float[np.ndarray, "..."]:
    """Return what one standard deviation of the delay of an instrument makes of each node.

    An error in motion that is taken a moment too late has changed by that moment times the
    speed: readings about a node that were taken in one direction err together.
    """
    shape = table.layout.shape
    if late is None:
        return np.zeros(shape)
    at: list[np.ndarray] = [] if samples.branch is None else [samples.branch]
    for nodes, places in zip(
        reversed(table.nodes), reversed(samples.positions.T), strict=True
    ):
        middles = 0.5 * (nodes.positions[1:] + nodes.positions[:-1])
        at.append(np.searchsorted(middles, places))
    index = np.ravel_multi_index(tuple(at), shape)
    size = int(np.prod(shape))
    count = np.bincount(index, minlength=size)
    mean = np.bincount(index, late, minlength=size) / np.maximum(count, 1)
    everywhere = np.sqrt(np.mean(mean[count > 0] ** 2))
    return np.where(count > 0, np.abs(mean), everywhere).reshape(shape)


def _finer_than(
    layout: TableLayout, branch: Int[np.ndarray, " t"] | None, count: int
) -> bool:
    """Return whether there are more nodes than readings, in a direction at least."""
    counts = [count] if branch is None else np.bincount(branch, minlength=2)
    return bool(min(counts) < layout.effect.size // layout.branches)


def _run_effects(samples: Samples) -> str:
    """Return what each run may have of its own: ``none``, ``offset`` or ``drift``."""
    if samples.run is None:
        return "none"
    counts = Counter(samples.run.tolist()).values()
    if len(counts) < 2:
        return "none"
    return "drift" if min(counts) >= _DRIFT_NEEDS else "offset"

"""What goes into a table fit, what is refused of it, and what comes out."""

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ..core import Estimate, FitError, Readings, TableEffect

Array = np.ndarray
Smoothness = float | str
"""``"auto"``, or a weight."""


@dataclasses.dataclass(frozen=True)
class Samples:
    """What was measured, ready to fit: one row per reading, no NaN.

    Attributes:
        positions: In mm or °, columns in the order of `TableEffect.nodes`.
        error: Actual − commanded in mm or °.
        branch: 0 or 1 per reading for a table with two branches, else None.
        run: Number of the repeated run of each reading; None where there are no runs.
        order: Place of the reading within its run, 0 at the start and 1 at the end, for drift.
    """

    positions: Float[Array, "t d"]
    error: Float[Array, " t"]
    branch: Int[Array, " t"] | None = None
    run: Int[Array, " t"] | None = None
    order: Float[Array, " t"] | None = None

    @cached_property
    def readings(self) -> Readings:
        """The same as inputs of `TableEffect.design`; runs by number from 0, places centred."""
        inputs = {
            f"position {k + 1}": np.ascontiguousarray(column, float)
            for k, column in enumerate(self.positions.T)
        }
        if self.branch is not None:
            inputs["direction"] = 1.0 - 2.0 * self.branch
        if self.run is not None:
            inputs["run"] = np.unique(self.run, return_inverse=True)[1].reshape(-1)
        if self.order is not None:
            inputs["order"] = self.order - 0.5
        return Readings(np.asarray(self.error, float), inputs)

    def check(self) -> None:
        """Refuse what is no number, and that there is no reading at all."""
        count = len(self.error)
        if not count:
            msg = "found no readings, expected at least one per node."
            raise FitError(msg)
        for name in ("positions", "error", "order"):
            values = getattr(self, name)
            if values is None:
                continue
            finite = np.isfinite(values)
            if not finite.all():
                row = int(np.argmin(finite.reshape(count, -1).all(axis=1)))
                msg = f"reading {row + 1}: {name} is not finite, expected numbers."
                raise FitError(msg)

    def take(self, keep: Bool[Array, " t"] | Int[Array, " n"]) -> "Samples":
        """Return the readings for which ``keep`` is true, or those of these rows."""
        arrays = {
            field.name: value[keep]
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) is not None
        }
        return Samples(**arrays)


@dataclasses.dataclass(frozen=True)
class Extent:
    """How many readings there are and where they lie; extents of pieces add up.

    Attributes:
        counts: Readings per direction; all in the first where there is one table for both.
        low: Least position per axis.
        high: Largest one.
    """

    counts: Int[Array, " b"]
    low: Float[Array, " d"]
    high: Float[Array, " d"]

    @classmethod
    def of(cls, layout: TableEffect, samples: Samples) -> "Extent":
        """Return the extent of readings, after their check.

        Raises:
            FitError: If the check fails, or there is no direction where the table needs one.
        """
        samples.check()
        counts = np.array([len(samples.error)])
        if layout.branches == 2:
            if samples.branch is None:
                msg = (
                    "a table with two directions needs the direction of every reading."
                )
                raise FitError(msg)
            counts = np.bincount(samples.branch, minlength=2)
        # Column by column: NumPy is slow along the short axis.
        columns = samples.positions.T
        low = np.array([float(column.min()) for column in columns])
        return cls(counts, low, np.array([float(column.max()) for column in columns]))

    def __add__(self, other: "Extent") -> "Extent":
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return Extent(self.counts + other.counts, low, high)

    def check(self, layout: TableEffect, free: int, allow_gaps: bool) -> None:
        """Refuse readings that stand at one place or are too few.

        More than the free unknowns, which no prior holds, are needed; as many as nodes unless
        gaps are allowed.
        """
        for axis, nodes in enumerate(layout.nodes):
            if len(nodes) > 1 and self.low[axis] == self.high[axis]:
                msg = (
                    f"all readings stand at {float(self.low[axis]):g} along axis "
                    f"{axis + 1}, expected positions spread over {len(nodes)} nodes."
                )
                raise FitError(msg)
        needed = layout.size // layout.branches
        ways = (" in positive direction", " in negative direction")
        where_of = ways if layout.branches == 2 else ("",)
        for where, count in zip(where_of, self.counts, strict=True):
            if count < needed and not allow_gaps:
                msg = f"{count} readings{where} for {needed} nodes, expected at least {needed}."
                raise FitError(msg)
        if self.counts.sum() <= free:
            msg = (
                f"{self.counts.sum()} readings leave nothing to judge the noise by; "
                f"expected more than {free}."
            )
            raise FitError(msg)


@dataclasses.dataclass(frozen=True)
class RunEffect:
    """Offset and drift of one run against the mean of all, in mm, with standard deviations."""

    run: int
    offset: float
    offset_sd: float
    drift: float
    drift_sd: float


@dataclasses.dataclass(frozen=True)
class TableFit:
    """A fitted table with what is known about it; signs are those of the *error*.

    Attributes:
        layout: Where the nodes lie.
        values: Estimated error at each node in mm or °, shape `TableEffect.shape`.
        standard_deviation: Of each node value, same shape and unit.
        support: Readings that touch each node; 0 = not measured, the prior fills in.
        noise: Standard deviation of one reading in mm or °, wild readings left out; the
            ``line_offset`` is part of it.
        smoothness: Weights of the prior by name (``"order 2, axis 1"`` …), relative to 1/noise².
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.
        residual: Reading − table − run effects per sample in mm or °, shape ``(t,)``.
        wild: Readings too far off to judge the noise by.
        runs: Fitted offset and drift per run; empty where there are no runs.
        suspect_nodes: Nodes of the flattened table whose readings contradict their surroundings.
        suspect_runs: Runs that contradict the others.
        covariance: Between nodes of one cell, in the order of the effect, in mm²; 0 elsewhere.
        converged: Whether the iterations reached their tolerance.
        message: One sentence on how the fit went, for the report.
        apart: By how much in mm or ° the run of each reading lies off the others on a stretch where
            they contradict each other, else zero, shape ``(t,)``; empty where nobody looked.
        line_offset: Standard deviation in mm or ° of an offset of every line of readings that a
            single probing cannot show, and that is allowed for; else 0.
        estimate: The fit of the stack behind it, from which groups are left out.
        keeps: Makes a fold keep the inequalities that this one keeps; None without.
    """

    layout: TableEffect
    values: Float[Array, "..."]
    standard_deviation: Float[Array, "..."]
    support: Int[Array, "..."]
    noise: float
    smoothness: Mapping[str, float]
    loss: str
    residual: Float[Array, " t"]
    wild: Bool[Array, " t"]
    runs: tuple[RunEffect, ...]
    suspect_nodes: tuple[int, ...]
    suspect_runs: tuple[int, ...]
    covariance: sp.csr_array
    converged: bool
    message: str
    apart: Float[Array, " _t"] = dataclasses.field(default_factory=lambda: np.zeros(0))
    line_offset: float = 0.0
    estimate: Estimate | None = dataclasses.field(default=None, repr=False)
    keeps: "Callable[[TableFit], TableFit] | None" = None

    def doubted(self, variance: float | Float[Array, " n"]) -> "TableFit":
        """Return it with a further variance of every node, or each, by itself, in mm² or °²."""
        more = np.broadcast_to(variance, self.layout.size)
        squares = np.square(self.standard_deviation) + self.layout.to_table(more)
        return dataclasses.replace(
            self,
            standard_deviation=np.sqrt(squares),
            covariance=sp.csr_array(self.covariance + sp.diags_array(more)),
        )

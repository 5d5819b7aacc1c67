"""Offset and drift of repeated runs, as nuisance beside the table.

The effects of all runs sum to zero, so that the table keeps the mean of the runs; a drift
that all runs share cannot be told from the table and stays in it. A run that contradicts the
others does not count in that mean.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from ..core._errors import FitError
from ._types import RunEffect, Samples


@dataclasses.dataclass(frozen=True)
class RunDesign:
    """Columns of the nuisance effects.

    Attributes:
        labels: The runs, ascending.
        index: Run per reading as index into ``labels``.
        order: Centred place within the run, None without drift.
        contrast: Orthonormal columns that sum to zero over the runs.
    """

    labels: Int[np.ndarray, " r"]
    index: Int[np.ndarray, " t"]
    order: Float[np.ndarray, " t"] | None
    contrast: Float[np.ndarray, "r c"]

    @property
    def count(self) -> int:
        """Number of nuisance parameters."""
        return int(self.contrast.shape[1]) * (1 if self.order is None else 2)

    def parts(self, rows: Int[np.ndarray, "f n"]) -> "list[RunDesign | None]":
        """Return the designs of parts of the readings; None for one that is of one run."""
        index, count = self.index[rows], len(self.labels)
        own = np.arange(len(rows))[:, None]
        visits = np.bincount((index + count * own).ravel(), minlength=count * len(rows))
        present = visits.reshape(-1, count) > 0
        index = (np.cumsum(present, axis=1) - 1)[own, index]
        late = [None] * len(rows) if self.order is None else self.order[rows]
        return [
            design_of(self.labels[there], part, order)
            for there, part, order in zip(present, index, late, strict=True)
        ]

    def without(self, apart: Sequence[int]) -> "RunDesign | None":
        """Return the design with runs that do not count in the mean of the runs."""
        return design_of(self.labels, self.index, self.order, apart)

    def columns(self) -> Float[np.ndarray, "t c"]:
        """Return the design matrix of the effects."""
        offset = np.asarray(self.contrast[self.index])
        if self.order is None:
            return offset
        return np.hstack([offset, offset * self.order[:, None]])

    def start(self, error: Float[np.ndarray, " t"]) -> Float[np.ndarray, " c"]:
        """Return effects to begin with: the median of each run, so that a far one is not wild."""
        return np.asarray(starts_of([self], error[None])[0])

    def effects(
        self, values: Float[np.ndarray, " c"], covariance: Float[np.ndarray, "c c"]
    ) -> tuple[RunEffect, ...]:
        """Return the effects run by run."""
        return self.named(effects_of([self], values[None], covariance[None])[0])

    def named(self, effects: Float[np.ndarray, "r 4"]) -> tuple[RunEffect, ...]:
        """Return effects (`effects_of`) with their runs."""
        rows = zip(self.labels.tolist(), effects.tolist(), strict=True)
        return tuple(RunEffect(label, *row) for label, row in rows)


def columns_of(designs: Sequence[RunDesign]) -> Float[np.ndarray, "k t c"]:
    """Return the design matrices of several fits with the same contrast."""
    first = designs[0]
    offset = first.contrast[np.stack([one.index for one in designs])]
    if first.order is None:
        return np.asarray(offset)
    late = np.stack([one.order for one in designs if one.order is not None])
    return np.concatenate([offset, offset * late[:, :, None]], axis=2)


def starts_of(
    designs: Sequence[RunDesign], error: Float[np.ndarray, "k t"]
) -> Float[np.ndarray, "k c"]:
    """Return effects to begin with, for several fits with the same contrast."""
    contrast = designs[0].contrast
    median = run_medians(designs, error)
    result = np.zeros((len(designs), designs[0].count))
    result[:, : contrast.shape[1]] = np.matmul(contrast.T, median[..., None])[..., 0]
    return result


def effects_of(
    designs: Sequence[RunDesign],
    values: Float[np.ndarray, "k c"],
    covariance: Float[np.ndarray, "k c c"],
) -> Float[np.ndarray, "k r 4"]:
    """Return the effects run by run, for several fits with the same contrast.

    Returns:
        Offset, its standard deviation, drift and its standard deviation.
    """
    contrast = designs[0].contrast
    part = contrast.shape[1]
    table = np.zeros((len(designs), len(contrast), 4))
    for column, start in enumerate(range(0, values.shape[1], part)):
        own = slice(start, start + part)
        found = np.matmul(contrast, values[:, own, None])[..., 0]
        spread = np.einsum("rc,kcd,rd->kr", contrast, covariance[:, own, own], contrast)
        table[:, :, 2 * column] = found
        table[:, :, 2 * column + 1] = np.sqrt(np.maximum(spread, 0.0))
    return table


def run_design(
    samples: Samples, effects: str, apart: Sequence[int] = ()
) -> RunDesign | None:
    """Return the design for ``"none"``, ``"offset"`` or ``"drift"``; None where there is none.

    Args:
        samples: Readings with their runs.
        effects: Kind of effects.
        apart: Runs that do not count in the mean of the runs, which the table keeps.

    Raises:
        FitError: If the kind is unknown, or runs or order are missing.
    """
    if effects not in ("none", "offset", "drift"):
        msg = f"run_effects: found {effects!r}, expected 'none', 'offset' or 'drift'."
        raise FitError(msg)
    if effects == "none":
        return None
    if samples.run is None:
        msg = f"run_effects {effects!r} need the run of every reading, found none."
        raise FitError(msg)
    if effects == "drift" and samples.order is None:
        msg = "run_effects 'drift' need the place of every reading within its run, found none."
        raise FitError(msg)
    labels, index = np.unique(samples.run, return_inverse=True)
    order = (
        samples.order - 0.5
        if effects == "drift" and samples.order is not None
        else None
    )
    return design_of(labels.astype(np.int64), index.reshape(-1), order, apart)


def design_of(
    labels: Int[np.ndarray, " r"],
    index: Int[np.ndarray, " t"],
    order: Float[np.ndarray, " t"] | None,
    apart: Sequence[int] = (),
) -> RunDesign | None:
    """Return the design of readings whose runs are known; None where they are of one run.

    Args:
        labels: The runs, ascending.
        index: Run per reading as index into ``labels``; each has readings.
        order: Centred place within the run, None without drift.
        apart: As for `run_design`.
    """
    if len(labels) < 2:
        return None
    out = set(apart)
    counted = tuple(label not in out for label in labels.tolist())
    return RunDesign(labels, index, order, _contrast(counted))


@functools.lru_cache(maxsize=256)
def _contrast(counted: tuple[bool, ...]) -> Float[np.ndarray, "r c"]:
    """Return orthonormal columns that sum to zero over the runs that count."""
    result = np.asarray(scipy.linalg.null_space(np.array([counted], float)))
    result.setflags(write=False)
    return result


def medians(
    group: Int[np.ndarray, " t"], values: Float[np.ndarray, " t"], count: int
) -> Float[np.ndarray, " g"]:
    """Return the median of each group of values; zero for a group without any."""
    ascending = values[np.lexsort((values, group))]
    size = np.bincount(group, minlength=count)
    several = size[size > 0]
    first = (np.cumsum(size) - size)[size > 0]
    result = np.zeros(count)
    low, high = first + (several - 1) // 2, first + several // 2
    result[size > 0] = 0.5 * (ascending[low] + ascending[high])
    return result


def row_medians(rows: Float[np.ndarray, "*k t"]) -> Float[np.ndarray, "*k"]:
    """Return the medians of rows; short ones take a fraction of `numpy.median`'s time."""
    count = rows.shape[-1]
    ascending = np.sort(rows, axis=-1)
    middle = ascending[..., (count - 1) // 2] + ascending[..., count // 2]
    return np.asarray(0.5 * middle)


def run_medians(
    designs: Sequence[RunDesign], values: Float[np.ndarray, "k t"]
) -> Float[np.ndarray, "k r"]:
    """Return the median of the values of each run, for several fits with as many runs."""
    count = len(designs[0].labels)
    run = np.concatenate([count * k + one.index for k, one in enumerate(designs)])
    size = np.bincount(run, minlength=count * len(designs))
    longest = int(size[0])
    if (size != longest).any():
        return medians(run, values.ravel(), len(size)).reshape(-1, count)
    # Runs of equal length: many short rows are sorted faster than one long one.
    beside = values.ravel()[np.argsort(run, kind="stable")]
    return row_medians(beside.reshape(-1, count, longest))

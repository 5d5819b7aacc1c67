"""Fits of one recording without some of its rows, side by side: which rows, and sums over them.

A law fitted without a window shares nine tenths of its rows with the others. Sums over the
stretches between the windows' edges are made once and added up per fit; only rows that count
neither in full nor not at all are looked at fit by fit.
"""

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Lanes:
    """Which rows of an equation each of several fits uses.

    Attributes:
        use: 1 where a fit uses a row, else 0.
        usable: Rows that may be used at all.
        edges: Where stretches of rows begin that all fits treat alike, and the end.
        member: 1 where a fit uses a stretch (as far as its rows are usable), else 0.
    """

    use: Float[np.ndarray, "w s"]
    usable: Bool[np.ndarray, " s"]
    edges: Int[np.ndarray, " g1"]
    member: Float[np.ndarray, "w g"]

    def __len__(self) -> int:
        return len(self.use)

    @cached_property
    def count(self) -> Int[np.ndarray, " w"]:
        """Rows that each fit uses."""
        return np.asarray(self.use.sum(axis=1).astype(np.int64))

    @cached_property
    def hidden(self) -> Float[np.ndarray, "w s"]:
        """Infinity where a fit does not use a row, else 0."""
        return np.where(self.use > 0, 0.0, np.inf)

    def take(self, which: Int[np.ndarray, " v"]) -> "Lanes":
        """Return some of the fits."""
        if len(which) == len(self):
            return self
        return Lanes(self.use[which], self.usable, self.edges, self.member[which])

    def sums(
        self, left: Float[np.ndarray, "s p"], right: Float[np.ndarray, "s q"]
    ) -> Float[np.ndarray, "w p q"]:
        """Return leftᵀ right over the rows of each fit."""
        if not self.usable.all():
            left = left * self.usable[:, None]
        parts = np.stack(
            [
                left[start:end].T @ right[start:end]
                for start, end in zip(self.edges[:-1], self.edges[1:], strict=True)
            ]
        )
        found = self.member @ parts.reshape(len(parts), -1)
        shape = len(self), left.shape[1], right.shape[1]
        return np.asarray(found.reshape(shape))

    def all_rows(self) -> "Shares":
        """Return weights with which every row that is used counts in full."""
        return Shares(self.use, np.zeros(0, np.int64), np.zeros((len(self), 0)))

    def shares(self, full: Float[np.ndarray, "w s"]) -> "Shares":
        """Return weights given row by row; what a fit does not use must have none."""
        rows = np.flatnonzero((full != self.use).any(axis=0))
        return Shares(full, rows, self.use[:, rows] - full[:, rows])


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Shares:
    """How much each row counts in each fit.

    Attributes:
        full: 0 to 1.
        rows: Those that count in part somewhere, though they are used.
        lack: What they lack of 1.
    """

    full: Float[np.ndarray, "w s"]
    rows: Int[np.ndarray, " u"]
    lack: Float[np.ndarray, "w u"]

    def take(self, which: Int[np.ndarray, " v"]) -> "Shares":
        """Return those of some of the fits."""
        if len(which) == len(self.full):
            return self
        return Shares(self.full[which], self.rows, self.lack[which])

    def same(self, other: "Shares") -> bool:
        """Tell whether all rows of the same fits count as much."""
        return other is self or (
            np.array_equal(other.rows, self.rows)
            and np.array_equal(other.lack, self.lack)
        )

    def sums(
        self,
        base: Float[np.ndarray, "w p q"],
        left: Float[np.ndarray, "s p"],
        right: Float[np.ndarray, "s q"],
    ) -> Float[np.ndarray, "w p q"]:
        """Return leftᵀ W right, given the sums of rows that count in full."""
        if not len(self.rows):
            return base
        if 2 * len(self.rows) < len(left):
            some = left[self.rows].T
            lost = (some * self.lack[:, None, :]) @ right[self.rows]
            return np.asarray(base - lost)
        return np.stack([(left.T * share) @ right for share in self.full])


def lanes_of(
    usable: Bool[np.ndarray, " s"], keep: Bool[np.ndarray, "w s"] | None = None
) -> Lanes:
    """Return fits that use some of the usable rows each; all of them where left out."""
    if keep is None:
        keep = np.ones((1, len(usable)), bool)
    turns = 1 + np.flatnonzero((keep[:, 1:] != keep[:, :-1]).any(axis=0))
    edges = np.concatenate([[0], turns, [len(usable)]]).astype(np.int64)
    return Lanes(
        (keep & usable).astype(float), usable, edges, keep[:, edges[:-1]] * 1.0
    )

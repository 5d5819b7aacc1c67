"""Fits of recordings without some of their rows, side by side: which rows, and sums over them.

A law fitted without a window shares nine tenths of its rows with the others. Sums over the
stretches between the windows' edges are made once and added up per fit; only rows that count
neither in full nor not at all are looked at fit by fit. Recordings of equal shape stand side
by side too: what costs is the number of calls more than that of rows.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Lanes:
    """Which rows of an equation each of several fits uses.

    Attributes:
        use: 1 where a fit uses a row, else 0.
        usable: Rows of each recording that may be used at all.
        of: Recording that each fit is of, ascending.
        edges: Per recording, where stretches of rows begin that all its fits treat alike,
            and the end.
        member: 1 where a fit uses a stretch (as far as its rows are usable), else 0.
    """

    use: Float[np.ndarray, "w s"]
    usable: Bool[np.ndarray, "r s"]
    of: Int[np.ndarray, " w"]
    edges: tuple[Int[np.ndarray, " _"], ...]
    member: Float[np.ndarray, "w g"]

    def __len__(self) -> int:
        return len(self.use)

    @cached_property
    def count(self) -> Int[np.ndarray, " w"]:
        """Rows that each fit uses."""
        return np.asarray(self.use.sum(axis=1).astype(np.int64))

    @cached_property
    def own(self) -> list[tuple[int, slice]]:
        """Recordings with any fits, and which these are."""
        ends = np.searchsorted(self.of, np.arange(len(self.usable) + 1)).tolist()
        return [(k, slice(a, b)) for k, (a, b) in enumerate(pairwise(ends)) if a < b]

    @cached_property
    def stretches(
        self,
    ) -> tuple[Int[np.ndarray, " g"], Int[np.ndarray, " g"], Int[np.ndarray, " g"]]:
        """Of all stretches, recording by recording: the recording, first row and end."""
        parts = [
            np.stack([np.full(len(edges) - 1, k), edges[:-1], edges[1:]])
            for k, edges in enumerate(self.edges)
            if self.fits[k]
        ]
        of, first, end = np.concatenate(parts, axis=1)
        return of, first, end

    @property
    def fits(self) -> Int[np.ndarray, " r"]:
        """How many fits each recording has."""
        return np.bincount(self.of, minlength=len(self.usable))

    @property
    def last(self) -> Int[np.ndarray, " v"]:
        """The last fit of each recording with any."""
        return np.cumsum(self.fits)[self.fits > 0] - 1

    @cached_property
    def each(self) -> int:
        """How many fits every recording has; 0 where they differ."""
        many = len(self) // len(self.usable)
        even = np.array_equal(self.of, np.repeat(np.arange(len(self.usable)), many))
        return many if even else 0

    def take(self, which: Int[np.ndarray, " v"]) -> "Lanes":
        """Return some of the fits."""
        if len(which) == len(self):
            return self
        # The same fits are taken of the equation, of weights, and of what was solved.
        if self._taken and np.array_equal(self._taken[0][0], which):
            return self._taken[0][1]
        found = Lanes(
            self.use[which],
            self.usable,
            self.of[which],
            self.edges,
            self.member[which],
        )
        self._taken[:] = [(which, found)]
        return found

    @cached_property
    def _taken(self) -> "list[tuple[Int[np.ndarray, ' v'], Lanes]]":
        """The fits that were taken last, and which they are."""
        return []

    def thinned(self, step: int) -> "Lanes":
        """Return the fits with every so-manieth row only."""
        return Lanes(
            self.use[:, ::step],
            self.usable[:, ::step],
            self.of,
            tuple(-(-edges // step) for edges in self.edges),
            self.member,
        )

    def sums(
        self, left: Float[np.ndarray, "r s p"], right: Float[np.ndarray, "r s q"]
    ) -> Float[np.ndarray, "w p q"]:
        """Return leftᵀ right over the rows of each fit.

        Rows that may not be used must be zero on one side.
        """
        found = np.empty((len(self), left.shape[2], right.shape[2]))
        flat = found.reshape(len(found), -1)
        for k, fits in self.own:
            edges = self.edges[k].tolist()
            parts = np.empty((len(edges) - 1, *found.shape[1:]))
            for (start, end), part in zip(pairwise(edges), parts, strict=True):
                np.matmul(left[k, start:end].T, right[k, start:end], out=part)
            member = self.member[fits, : len(parts)]
            np.dot(member, parts.reshape(len(parts), -1), out=flat[fits])
        return found

    def times(
        self, rows: Float[np.ndarray, "w s"], columns: Float[np.ndarray, "r s q"]
    ) -> Float[np.ndarray, "w q"]:
        """Return rows @ columns, each fit with the columns of its recording."""
        if self.each:
            stacked = rows.reshape(len(columns), self.each, -1)
            return np.asarray((stacked @ columns).reshape(len(rows), -1))
        return self._by_recording(
            [rows[fits] @ columns[k] for k, fits in self.own], columns.shape[2]
        )

    def along(
        self, factors: Float[np.ndarray, "w k"], columns: Float[np.ndarray, "r s k"]
    ) -> Float[np.ndarray, "w s"]:
        """Return columns @ factors per row, each fit with the columns of its recording."""
        columns = np.swapaxes(columns, 1, 2)
        if self.each:
            stacked = factors.reshape(len(columns), self.each, -1)
            return np.asarray((stacked @ columns).reshape(len(factors), -1))
        return self._by_recording(
            [factors[fits] @ columns[k] for k, fits in self.own], columns.shape[2]
        )

    @staticmethod
    def _by_recording(parts: list[np.ndarray], width: int) -> np.ndarray:
        return np.concatenate(parts) if parts else np.zeros((0, width))

    def all_rows(self) -> "Shares":
        """Return weights with which every row that is used counts in full."""
        return Shares(self, self.use)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Shares:
    """How much each row counts in each fit.

    Attributes:
        lanes: The fits.
        full: 0 to 1; what a fit does not use must have 0.
    """

    lanes: Lanes
    full: Float[np.ndarray, "w s"]

    @cached_property
    def plain(self) -> bool:
        """Whether every row that is used counts in full."""
        return self.full is self.lanes.use or np.array_equal(self.full, self.lanes.use)

    @cached_property
    def lack(
        self,
    ) -> dict[int, tuple[Int[np.ndarray, " _"], Float[np.ndarray, "_ _"]]]:
        """By recording, rows that count in part in some of its fits though they are used.

        And what they lack of 1 in each.
        """
        found: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        use = self.lanes.use
        if self.plain:
            return found
        partly = self.full != use
        some = partly.any(axis=1)
        for k, fits in self.lanes.own:
            if some[fits].any():
                rows = np.flatnonzero(partly[fits].any(axis=0))
                found[k] = rows, use[fits][:, rows] - self.full[fits][:, rows]
        return found

    def take(self, which: Int[np.ndarray, " v"]) -> "Shares":
        """Return those of some of the fits."""
        if len(which) == len(self.lanes):
            return self
        lanes = self.lanes.take(which)
        if self.full is self.lanes.use:
            return lanes.all_rows()
        return Shares(lanes, self.full[which])

    def same(self, other: "Shares", fits: slice) -> bool:
        """Tell whether all rows count as much in the same of the same fits."""
        return other is self or np.array_equal(self.full[fits], other.full[fits])

    def sums(
        self,
        base: Float[np.ndarray, "w p q"],
        left: Float[np.ndarray, "r s p"],
        right: Float[np.ndarray, "r s q"],
    ) -> Float[np.ndarray, "w p q"]:
        """Return leftᵀ W right, given the sums of rows that count in full."""
        if not self.lack:
            return base
        found = base.copy()
        for k, fits in self.lanes.own:
            if k not in self.lack:
                continue
            rows, lack = self.lack[k]
            if 2 * len(rows) < left.shape[1]:
                some = left[k, rows].T
                found[fits] -= (some * lack[:, None, :]) @ right[k, rows]
                continue
            turned = left[k].T
            found[fits] = np.stack(
                [(turned * share) @ right[k] for share in self.full[fits]]
            )
        return found


def lanes_of(
    usable: Bool[np.ndarray, " s"], keep: Bool[np.ndarray, "w s"] | None = None
) -> Lanes:
    """Return fits that use some of the usable rows each; all of them where left out."""
    if keep is None:
        keep = np.ones((1, len(usable)), bool)
    turns = 1 + np.flatnonzero((keep[:, 1:] != keep[:, :-1]).any(axis=0))
    edges = np.concatenate([[0], turns, [len(usable)]]).astype(np.int64)
    return Lanes(
        (keep & usable).astype(float),
        usable[None],
        np.zeros(len(keep), np.int64),
        (edges,),
        keep[:, edges[:-1]] * 1.0,
    )


def side_by_side(lanes: Sequence[Lanes], rows: int) -> Lanes:
    """Return the fits of one recording after those of another, rows filled up."""
    if len(lanes) == 1:
        return lanes[0]
    widest = max(each.member.shape[1] for each in lanes)
    return Lanes(
        _filled([each.use for each in lanes], rows),
        _filled([each.usable for each in lanes], rows),
        np.repeat(np.arange(len(lanes)), [len(each) for each in lanes]),
        tuple(edges for each in lanes for edges in each.edges),
        _filled([each.member for each in lanes], widest),
    )


def _filled(arrays: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Return the rows of arrays one after the other, filled up with zeros."""
    found = np.zeros((sum(map(len, arrays)), width), arrays[0].dtype)
    first = 0
    for each in arrays:
        found[first : first + len(each), : each.shape[1]] = each
        first += len(each)
    return found

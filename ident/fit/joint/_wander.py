"""What a reference does between the knots of its drift: a walk as long as the readings say.

A reference that wanders is where it was a moment ago, and a little further. Between the knots
of the stated drift such a walk is the straight line and, upon it, a bridge that begins and
ends at zero. Its variance per second is one weight beside those of the tables: by evidence,
and next to nothing where the noise is white. Bridges are noise, not an effect: they are held
by their own variance, so that nothing can be confused with them; they only make uncertain
what is as slow as they are.
"""

import dataclasses
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from ...core import Independent

MOST = 300
"""Steps of all bridges together, at most."""
FEWEST = 50
"""Readings per step, at least: fewer tell nothing of a walk beside their noise."""


@dataclasses.dataclass(frozen=True)
class Bridges:
    """Where the bridges of one axis stand.

    Attributes:
        run: Index of the run of each row.
        place: Of each row within its run, 0 to 1.
        length: Of each run in s.
        pieces: Of the stated drift of each run.
        steps: Of each bridge; fewer than two: there are none.
    """

    run: Int[np.ndarray, " t"]
    place: Float[np.ndarray, " t"]
    length: Float[np.ndarray, " r"]
    pieces: int
    steps: int

    @property
    def size(self) -> int:
        """Number of values."""
        if self.steps < 2:
            return 0
        return len(self.length) * self.pieces * (self.steps - 1)

    def columns(self) -> sp.csr_array:
        """Return the share of each value in each row."""
        count, inner = len(self.run), self.steps - 1
        at = np.clip(self.place, 0.0, 1.0) * self.pieces
        bridge = np.clip(np.floor(at).astype(np.int64), 0, self.pieces - 1)
        fine = (at - bridge) * self.steps
        cell = np.clip(np.floor(fine).astype(np.int64), 0, inner)
        right = fine - cell
        first = (self.run * self.pieces + bridge) * inner
        parts = []
        for node, weight in ((cell, 1.0 - right), (cell + 1, right)):
            # The first and the last node of a bridge are zero.
            own = (node >= 1) & (node <= inner) & (weight != 0.0)
            rows = np.flatnonzero(own)
            index = (rows, (first + node - 1)[own])
            shape = (count, self.size)
            parts.append(sp.coo_array((weight[own], index), shape=shape))
        return sp.csr_array(parts[0] + parts[1])

    @cached_property
    def prior(self) -> Independent:
        """The walk; a step of mean length has weight 1."""
        inner = self.steps - 1
        one = np.diff(np.eye(inner + 2), axis=0)[:, 1:-1]
        least = 1e-6 * float(self.length.max(initial=0.0))
        length = np.maximum(self.length, max(least, 1e-300))
        share = np.repeat(length.mean() / length, self.pieces)
        rows = sp.csr_array(sp.kron(sp.diags_array(np.sqrt(share)), one))
        # The determinant of tridiag(-1, 2, -1) is its size and one.
        constant = len(share) * np.log(self.steps) + inner * np.log(share).sum()
        return Independent(rows, float(constant))

    def between(
        self, run: int, values: Float[np.ndarray, " p"]
    ) -> Float[np.ndarray, " k"]:
        """Return what is added to the drift of a run, at the ends of all steps."""
        own = values.reshape(len(self.length), self.pieces, -1)[run]
        inside = np.pad(own, ((0, 0), (1, 0))).reshape(-1)
        return np.append(inside, 0.0)


def steps_of(rows: int, runs: int, pieces: int) -> int:
    """Return the steps of each bridge for so many readings; 1 = no bridges."""
    if not pieces:
        return 1
    return max(min(MOST, rows // FEWEST) // (runs * pieces), 1)

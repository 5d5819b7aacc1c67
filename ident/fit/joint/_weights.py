"""The smoothness weights of all tables of an axis: matrices, logarithms, determinants."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from .._bands import lower_band
from .._logs import HIGH, LEAST, LOW, smoothness_of
from .._prior import Smoothness, TablePrior
from ._design import Component, Design
from ._wander import WalkPrior

_STEP = 1e-3
"""Step in a logarithm for the slope of a prior's determinant."""


@dataclasses.dataclass(frozen=True)
class Weight:
    """One smoothness weight.

    Attributes:
        table: Number of the table among those with a prior.
        kind: Place among the four of a table: second and fourth differences along the slow
            axis, then along the fast one.
        gram: Its penalty matrix over the (slow, fast) grid.
    """

    table: int
    kind: int
    gram: sp.csr_array

    @cached_property
    def band(self) -> Float[np.ndarray, "n w"]:
        """The penalty matrix as lower band."""
        return lower_band(self.gram)


@dataclasses.dataclass(frozen=True)
class Weights:
    """All smoothness weights of one axis.

    Attributes:
        tables: Components with a prior.
        parts: The weights.
        density: Mean information per reached node of each table.
    """

    tables: tuple[Component, ...]
    parts: tuple[Weight, ...]
    density: tuple[float, ...]

    def smoothness(self, logs: Float[np.ndarray, " k"]) -> list[Smoothness]:
        """Return the weights of each table from logarithms relative to its density."""
        result = []
        for number, density in enumerate(self.density):
            own = np.full(4, -np.inf)
            for log, part in zip(logs, self.parts, strict=True):
                if part.table == number:
                    own[part.kind] = log
            result.append(smoothness_of(own, density))
        return result

    def values(self, logs: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the weights themselves; fourth differences at their lower end are off."""
        tables = self.smoothness(logs)
        return np.array(
            [
                (*tables[part.table].slow, *tables[part.table].fast)[part.kind]
                for part in self.parts
            ]
        )

    def logdet(self, logs: Float[np.ndarray, " k"]) -> float:
        """Return the log of the product of the non-zero eigenvalues of the prior precision."""
        return sum(
            _prior(table).logdet(smooth)
            for table, smooth in zip(self.tables, self.smoothness(logs), strict=True)
        )

    def logdet_slopes(self, logs: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the slopes of `logdet` over the logarithms."""
        result = np.zeros(len(logs))
        for k, part in enumerate(self.parts):
            prior = _prior(self.tables[part.table])
            ends = []
            for step in (_STEP, -_STEP):
                moved = logs.copy()
                moved[k] += step
                if part.kind % 2 and logs[k] <= LOW + 1e-9:
                    break
                ends.append(prior.logdet(self.smoothness(moved)[part.table]))
            if ends:
                result[k] = (ends[0] - ends[1]) / (2.0 * _STEP)
        return result

    def apply(
        self, values: Float[np.ndarray, " k"], theta: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Return prior precision × values."""
        result = np.zeros(len(theta))
        for value, part in zip(values, self.parts, strict=True):
            if value:
                where = self.tables[part.table].grid_places
                result[where] += value * (part.gram @ theta[where])
        return result

    def bends(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
        """Return the penalty of each weight 1, free of cancellation."""
        result = np.zeros(len(self.parts))
        for k, part in enumerate(self.parts):
            table = self.tables[part.table]
            prior = _prior(table)
            shape = (prior.slow.size, -1)
            values = theta[table.grid_places].reshape(shape)
            chain = prior.slow if part.kind < 2 else prior.fast
            assert chain is not None
            rows = chain.fourth if part.kind % 2 else chain.second
            columns = values if part.kind < 2 else values.T
            result[k] = float(np.square(rows @ columns).sum())
        return result

    @property
    def low(self) -> Float[np.ndarray, " k"]:
        """Lower ends of the logarithms."""
        return np.array([LEAST[part.kind] for part in self.parts])

    @property
    def high(self) -> Float[np.ndarray, " k"]:
        """Upper ends of the logarithms."""
        return np.array([HIGH[part.kind] for part in self.parts])

    def start(self, second: float) -> Float[np.ndarray, " k"]:
        """Return logarithms with one weight for all second differences, fourth ones off.

        A walk begins as wide as what the readings of one step tell of it.
        """
        return np.array(
            [
                0.0
                if self.walks[k]
                else (LOW if part.kind % 2 else float(np.log(second)))
                for k, part in enumerate(self.parts)
            ]
        )

    @property
    def walks(self) -> Bool[np.ndarray, " k"]:
        """Tell which weights belong to a walk, not to a table."""
        return np.array(
            [self.tables[part.table].kind == "wander" for part in self.parts], bool
        )

    def named(self, logs: Float[np.ndarray, " k"]) -> list[dict[str, float]]:
        """Return the weights of each table under the names that results carry."""
        result = []
        for table, smooth in zip(self.tables, self.smoothness(logs), strict=True):
            result.append(smooth.names(slow_column(table) + 1))
        return result

    def fixed(
        self, smoothness: float | Sequence[Mapping[str, float] | None]
    ) -> Float[np.ndarray, " k"]:
        """Return logarithms for a number, or for the weights of an earlier fit per table."""
        logs = self.low.copy()
        for k, part in enumerate(self.parts):
            if isinstance(smoothness, (int, float)):
                weight = 0.0 if part.kind % 2 else float(smoothness)
            else:
                table = self.tables[part.table]
                own = Smoothness.named(
                    smoothness[part.table] or {}, slow_column(table) + 1
                )
                weight = (*own.slow, *own.fast)[part.kind]
            if weight > 0:
                logs[k] = np.log(weight / self.density[part.table])
        return logs


def slow_column(table: Component) -> int:
    """Return the column of the positions that runs along the slow axis of a table."""
    prior = _prior(table)
    if prior.fast is None or table.order is None:
        return 0
    # In the order of the list master 1 runs fastest.
    return 1 if len(table.order) < 2 or table.order[1] == 1 else 0


def _prior(table: Component) -> TablePrior | WalkPrior:
    assert table.prior is not None
    return table.prior


def weights_of(design: Design, diagonal: Float[np.ndarray, " n"]) -> Weights:
    """Return the smoothness weights of an axis.

    Args:
        design: Columns.
        diagonal: Information on each unknown alone.
    """
    tables = tuple(c for c in design.components if c.prior is not None)
    parts, density = [], []
    for number, table in enumerate(tables):
        prior = _prior(table)
        own = diagonal[table.places]
        reached = own[own > 0]
        density.append(float(reached.mean()) if len(reached) else 1.0)
        other = prior.branches if prior.fast is None else prior.fast.size
        for kind, rows in enumerate((prior.slow.second, prior.slow.fourth)):
            if rows.count_nonzero():
                gram = sp.kron(rows.T @ rows, sp.eye_array(other), format="csr")
                parts.append(Weight(number, kind, sp.csr_array(gram)))
        if prior.fast is None:
            continue
        for kind, rows in enumerate((prior.fast.second, prior.fast.fourth), 2):
            if rows.count_nonzero():
                gram = sp.kron(
                    sp.eye_array(prior.slow.size), rows.T @ rows, format="csr"
                )
                parts.append(Weight(number, kind, sp.csr_array(gram)))
    return Weights(tables, tuple(parts), tuple(density))

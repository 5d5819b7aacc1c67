"""Table fits of equal shape side by side: axis 0 of every array counts the lanes.

Small tables spend their time in calls, not in sums. Stacked, one call serves hundreds of
fits; a lane's numbers do not depend on how many others stand beside it, so that a fit on its
own, a batch of one, gives the same bits as the same fit in a batch.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._chain import ChainPrior, chain_prior
from .._grid import Grid, Located
from .._runs import RunDesign, columns_of

_EVEN = 1e-9
"""Nodes count as equidistant when they lie on a straight line to this share of a cell."""


@dataclasses.dataclass(frozen=True)
class Lane:
    """One fit before it is stacked.

    Attributes:
        grid: Nodes of a 1-D table.
        located: Cell of every reading.
        error: Readings in mm or °.
        weight: Known weights.
        design: Run effects, None without them.
        apart: Runs that do not count in the mean of the runs.
    """

    grid: Grid
    located: Located
    error: Float[np.ndarray, " t"]
    weight: Float[np.ndarray, " t"]
    design: RunDesign | None
    apart: tuple[int, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """What lanes of one stack have in common."""
        grid = self.grid
        effects = 0 if self.design is None else self.design.count
        return grid.slow, grid.fast, grid.layout.periodic, len(self.error), effects


@dataclasses.dataclass(frozen=True)
class Bends:
    """Differences of the node values along a chain, dense; one lane or a stack of them.

    Attributes:
        second: Rows of second differences, shape ``(…, q, n)``; ``fourth`` likewise.
        fourth: See `second`.
        grams: Both penalty matrices, shape ``(…, 2, n, n)``.
        reduced: Definite matrices whose weighted sum has, up to ``constant``, the product of
            the non-zero eigenvalues as determinant, shape ``(…, 2, q, q)``.
        constant: Log of what that determinant lacks.
    """

    second: Float[np.ndarray, "*k q n"]
    fourth: Float[np.ndarray, "*k p n"]
    grams: Float[np.ndarray, "*k 2 n n"]
    reduced: Float[np.ndarray, "*k 2 q2 q2"]
    constant: Float[np.ndarray, "*k"]

    def take(self, lanes: Int[np.ndarray, " k"]) -> "Bends":
        """Return some lanes of a stack."""
        parts = [getattr(self, field.name) for field in dataclasses.fields(self)]
        if self.second.strides[0] == 0:  # all lanes have the same ones
            return Bends(*(part[: len(lanes)] for part in parts))
        return Bends(*(part[lanes] for part in parts))


def bends_of(nodes: Float[np.ndarray, "k n"], ring: bool) -> Bends:
    """Return the differences along chains, the same ones for all equidistant nodes."""
    count = nodes.shape[1]
    even = np.linspace(nodes[:, 0], nodes[:, -1], count, axis=1)
    step = (nodes[:, -1] - nodes[:, 0]) / (count - 1)
    regular = np.abs(nodes - even).max(axis=1) <= _EVEN * step
    # Differences are per node distance: neither its length nor the start matters.
    plain = np.arange(count, dtype=float)
    if regular.all():
        shared = vars(_bends(chain_prior(plain, ring)))
        repeated = {
            name: np.broadcast_to(part, (len(nodes), *part.shape))
            for name, part in shared.items()
        }
        return Bends(**repeated)
    own = [
        vars(_bends(chain_prior(plain if same else row, ring)))
        for row, same in zip(nodes, regular, strict=True)
    ]
    return Bends(**{name: np.stack([one[name] for one in own]) for name in own[0]})


@functools.lru_cache(maxsize=256)
def _bends(chain: ChainPrior) -> Bends:
    reduced, constant = chain.reduced
    return Bends(
        chain.second.toarray(),
        chain.fourth.toarray(),
        np.stack([gram.toarray() for gram in chain.grams]),
        np.stack(reduced),
        np.asarray(constant),
    )


@dataclasses.dataclass(frozen=True)
class Stack:
    """Fits of equal shape, ready for lockstep.

    Attributes:
        lanes: Where each came from.
        columns: Stencil over (branch, node), then the run effects, shape ``(k, t, m)``.
        error: Readings, shape ``(k, t)``.
        weight: Known weights, shape ``(k, t)``.
        bends: Differences of the nodes.
        floor: Smallest scatter of each lane in mm or °.
    """

    lanes: tuple[Lane, ...]
    columns: Float[np.ndarray, "k t m"]
    error: Float[np.ndarray, "k t"]
    weight: Float[np.ndarray, "k t"]
    bends: Bends
    floor: Float[np.ndarray, " k"]

    @property
    def nodes(self) -> int:
        """Number of different nodes along the chain."""
        return self.lanes[0].grid.slow

    @property
    def branches(self) -> int:
        """Number of chains side by side."""
        return self.lanes[0].grid.fast

    @property
    def size(self) -> int:
        """Number of unknown node values."""
        return self.nodes * self.branches

    @property
    def null(self) -> int:
        """Dimension of what the prior leaves alone."""
        return self.branches * (1 if self.lanes[0].grid.layout.periodic else 2)

    @property
    def effects(self) -> int:
        """Number of run effects."""
        return int(self.columns.shape[2]) - self.size

    def take(self, lanes: Int[np.ndarray, " k"]) -> "Stack":
        """Return some of the lanes; all of them without a copy."""
        if len(lanes) == len(self.lanes):
            return self
        return Stack(
            tuple(self.lanes[k] for k in lanes),
            self.columns[lanes],
            self.error[lanes],
            self.weight[lanes],
            self.bends.take(lanes),
            self.floor[lanes],
        )

    def residual(self, unknowns: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k t"]:
        """Return reading − table − run effects."""
        return np.asarray(self.error - times(self.columns, unknowns))

    def sums(self, weighted: Float[np.ndarray, "k t"]) -> Float[np.ndarray, "k m"]:
        """Return Σ x y over the readings for weighted values y."""
        return np.asarray(np.matmul(weighted[:, None, :], self.columns)[:, 0])

    @functools.cached_property
    def whole(self) -> Float[np.ndarray, "k m m"]:
        """`normal` of all readings; not to be written to."""
        return self.normal(np.ones(self.error.shape, bool))

    def normal(self, active: Bool[np.ndarray, "k t"]) -> Float[np.ndarray, "k m m"]:
        """Return Σ w x xᵀ over the active readings, idle run effects held at zero."""
        weight = np.where(active, self.weight, 0.0)
        result = np.matmul(
            self.columns.transpose(0, 2, 1), weight[..., None] * self.columns
        )
        effects = np.arange(self.size, self.columns.shape[2])
        if len(effects):
            result[:, effects, effects] += self.hold(result)[:, None]
        return np.asarray(result)

    def hold(self, normal: Float[np.ndarray, "k m m"]) -> Float[np.ndarray, " k"]:
        """Return the weight that holds at zero the effect of a run nobody believes."""
        own = np.diagonal(normal, axis1=1, axis2=2)[:, self.size :]
        return np.asarray(_RIDGE * own.mean(axis=1) if own.shape[1] else own.sum(1))

    def density(self, normal: Float[np.ndarray, "k m m"]) -> Float[np.ndarray, " k"]:
        """Return the mean information per node that any reading reaches."""
        own = np.diagonal(normal, axis1=1, axis2=2)[:, : self.size]
        return np.asarray(own.sum(axis=1) / np.maximum((own > 0).sum(axis=1), 1))

    def pull(self, weights: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k n n"]:
        """Return the penalty matrix of one chain for weights of both differences."""
        grams = self.bends.grams
        return np.asarray(
            weights[:, 0, None, None] * grams[:, 0]
            + weights[:, 1, None, None] * grams[:, 1]
        )

    def tables(self, unknowns: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k s n"]:
        """Return the node values over (branch, node)."""
        values = unknowns[:, : self.size]
        return values.reshape(len(values), self.branches, self.nodes)


_RIDGE = 1e-9
"""Weight, relative to the mean information on a run effect, that holds it at zero."""
_EXACT = 1e-5
"""Smallest scatter relative to the spread of the readings."""


def stacked(lanes: Sequence[Lane]) -> Stack:
    """Return lanes of equal shape as one stack."""
    grid = lanes[0].grid
    error = np.stack([lane.error for lane in lanes])
    spread = np.ptp(np.quantile(error, (0.05, 0.95), axis=1), axis=0)
    return Stack(
        lanes=tuple(lanes),
        columns=_columns(lanes),
        error=error,
        weight=np.stack([lane.weight for lane in lanes]),
        bends=bends_of(
            np.stack([lane.grid.slow_nodes for lane in lanes]), grid.layout.periodic
        ),
        # Without any noise the prior's own pull would make readings wild.
        floor=np.maximum(_EXACT * spread, 1e-12),
    )


def _columns(lanes: Sequence[Lane]) -> Float[np.ndarray, "k t m"]:
    # Lanes of a stack differ in where their nodes lie, not in how they are counted.
    grid, (count, effects) = lanes[0].grid, lanes[0].shape[-2:]
    result = np.zeros((len(lanes), count, grid.size + effects))
    place = located(lanes)
    rows = result.reshape(len(lanes) * count, -1)
    row, base = np.arange(len(rows)), place.s * grid.slow
    rows[row, base + place.l] = 1.0 - place.u
    # A reading at a ring of few nodes may touch the same node from both sides.
    rows[row, base + grid.neighbour(place.l)] += place.u
    for own, designs in with_equal_runs(lanes):
        result[own, :, grid.size :] = columns_of(designs)
    return result


def located(lanes: Sequence[Lane]) -> Located:
    """Return the cells of the readings of all lanes, one lane after the other."""
    return Located(
        *(
            np.concatenate([getattr(lane.located, field.name) for lane in lanes])
            for field in dataclasses.fields(Located)
        )
    )


def with_equal_runs(
    lanes: Sequence[Lane],
) -> list[tuple[list[int], list[RunDesign]]]:
    """Return which lanes have as many runs, all or the same ones believed, with designs."""
    alike: dict[int, tuple[list[int], list[RunDesign]]] = {}
    for k, lane in enumerate(lanes):
        if lane.design is not None:
            rows, designs = alike.setdefault(id(lane.design.contrast), ([], []))
            rows.append(k)
            designs.append(lane.design)
    return list(alike.values())


def times(
    matrix: Float[np.ndarray, "k a b"], vector: Float[np.ndarray, "k b"]
) -> Float[np.ndarray, "k a"]:
    """Return matrix × vector, lane by lane."""
    return np.asarray(np.matmul(matrix, vector[..., None])[..., 0])


def dot(
    first: Float[np.ndarray, "*#k n"], second: Float[np.ndarray, "*#k n"]
) -> Float[np.ndarray, "..."]:
    """Return the scalar products, lane by lane."""
    return np.asarray((first * second).sum(axis=-1))

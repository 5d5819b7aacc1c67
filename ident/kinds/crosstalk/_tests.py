"""Where the tests stand: how many along which axis, chosen by events held out."""

import dataclasses
import itertools
import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import FitError, Regression, node_shares, regress, simplest
from ._events import Events

_CELLS, _FOLDS = 8, 8
_TOUCHED = 1e-9
"""Weight of a test in an event from which on the event touches it."""

Axes = tuple[int, ...]
Nodes = tuple[Float[np.ndarray, " _n"], ...]


@dataclasses.dataclass(frozen=True)
class Table:
    """Events as readings of the values of tests.

    Attributes:
        group: Branches that share their values, 0 … g − 1.
        positions: In mm.
        amount: Value in mm.
        weight: Relative, median 1.
        own_noise: Scatter of an event of weight 1 as the events tell themselves, in mm.
    """

    group: Int[np.ndarray, " n"]
    positions: Float[np.ndarray, "n k"]
    amount: Float[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]
    own_noise: float

    @classmethod
    def of(cls, events: Events, groups: tuple[int, ...]) -> "Table":
        """Return events as readings; ``groups`` maps branches to values that they share."""
        deviation = events.standard_deviation
        middle = float(np.median(deviation))
        # No event is so sure of itself that it outvotes all others.
        weight = (middle / np.maximum(deviation, 0.3 * middle)) ** 2
        group = np.array(groups)[events.branch]
        return cls(group, events.positions, events.value, weight, middle)

    def take(self, keep: Bool[np.ndarray, " n"]) -> "Table":
        """Return the events for which ``keep`` is true."""
        group, positions = self.group[keep], self.positions[keep]
        amount, weight = self.amount[keep], self.weight[keep]
        return Table(group, positions, amount, weight, self.own_noise)

    def each(
        self, columns: Float[np.ndarray, "n p"], loss: str
    ) -> Iterator[tuple[int, Bool[np.ndarray, " n"], Regression]]:
        """Yield number and events of each group, and the values of tests over them."""
        for group in np.unique(self.group).tolist():
            mine = self.group == group
            yield group, mine, self.take(mine)._fit(columns[mine], loss)

    def _fit(self, columns: Float[np.ndarray, "n p"], loss: str) -> Regression:
        """Return the values of tests over events of one group.

        Each rests on the events around it. The scatter within events counts beside that
        between them where these are few, and wild ones need spare ones to be found.
        """
        spare = len(columns) - int((columns > _TOUCHED).any(axis=0).sum())
        return regress(
            columns,
            self.amount,
            weight=self.weight,
            loss=loss if spare >= max(4, columns.shape[1]) else "gauss",
            noise=self.own_noise,
        )

    def by_grid(self, axes: Axes, nodes: Nodes) -> Float[np.ndarray, "n p"]:
        """Return the weight of each test of a grid in each event, the last axis fastest.

        What the controller's surface gives for the same tests, as products of what each axis
        gives: the search looks at hundreds of grids, and nothing is compiled for each shape.
        """
        result = np.ones((len(self.amount), 1))
        for axis, line in zip(axes, nodes, strict=True):
            share = node_shares(self.positions[:, axis], line)
            result = (result[:, :, None] * share[:, None, :]).reshape(len(result), -1)
        return result

    def even_nodes(self, axes: Axes, counts: tuple[int, ...]) -> Nodes:
        """Return evenly spaced nodes from the first to the last event along each axis."""
        ends = [(column.min(), column.max()) for column in self.positions.T]
        return tuple(
            _rounded(np.linspace(*ends[axis], count))
            for axis, count in zip(axes, counts, strict=True)
        )

    def held_out(
        self,
        columns: Float[np.ndarray, "n p"],
        place: Int[np.ndarray, " n"],
        wild: Bool[np.ndarray, " n"],
    ) -> Float[np.ndarray, " n"]:
        """Return what values fitted to other events leave of each, in mm.

        Of all values that fit, those nearest to the median: it is that of a test that no event
        tells.

        Args:
            columns: Weight of each test in each event.
            place: Of each event; those of one are held out together.
            wild: Events to which no values are fitted.
        """
        left, root = np.zeros(len(self.amount)), np.sqrt(self.weight)
        turns = np.arange(int(place.max()) + 1) % _FOLDS
        turn = np.random.default_rng(0).permutation(turns)[place]
        for each, group in itertools.product(range(_FOLDS), np.unique(self.group)):
            out = (turn == each) & (self.group == group)
            others = ~wild & (turn != each) & (self.group == group)
            known = self.amount[others]
            centre = float(np.median(known)) if known.size else 0.0
            design = columns[others] * root[others, None]
            aim = (known - centre) * root[others]
            value = np.linalg.lstsq(design, aim, rcond=1e-6)[0]
            left[out] = self.amount[out] - centre - columns[out] @ value
        return left

    @property
    def cell(self) -> Int[np.ndarray, " n"]:
        """Number of the place of each event, among about as many as can be held out."""
        if not self.positions.shape[1]:
            return np.arange(len(self.positions)) % _FOLDS
        parts = []
        for column in self.positions.T:
            edges = np.quantile(column, np.linspace(0.0, 1.0, _CELLS + 1)[1:-1])
            parts.append(np.searchsorted(np.unique(edges), column, side="right"))
        _, index = np.unique(np.column_stack(parts), axis=0, return_inverse=True)
        return np.asarray(index.reshape(-1))


def choose_tests(
    table: Table, modes: tuple[int, ...], most: int
) -> tuple[Axes, Float[np.ndarray, "p k"]]:
    """Return adaptation axes and places of tests that predict held-out events best.

    The fewest tests whose loss is not above the least by more than chance over the turns.
    They stand on a grid, evenly spaced over the events, the last axis fastest.

    Raises:
        FitError: If no choice can be fitted.
    """
    candidates = _candidates(table, modes, most)
    if not candidates:
        wanted = " or ".join(str(mode) for mode in modes)
        msg = (
            f"mode {wanted} cannot be fitted: the events do not spread over the adaptation "
            "axes that it needs."
        )
        raise FitError(msg)
    if len(candidates) == 1:
        return candidates[0][0], _grid(table.even_nodes(*candidates[0]))
    sizes = [math.prod(counts) for _, counts in candidates]
    grids = [table.even_nodes(*candidate) for candidate in candidates]
    # What the finest choice rejects has no part in the search.
    finest = int(np.argmax(sizes))
    columns = table.by_grid(candidates[finest][0], grids[finest])
    sound = np.ones(len(table.amount), bool)
    for _, mine, found in table.each(columns, "student"):
        sound[mine] = ~found.wild
    table = table.take(sound)
    root, cell, none = (
        np.sqrt(table.weight),
        table.cell,
        np.zeros(int(sound.sum()), bool),
    )
    tried = [
        table.held_out(table.by_grid(axes, grid), cell, none) * root
        for (axes, _), grid in zip(candidates, grids, strict=True)
    ]
    scale = min(max(1.4826 * float(np.median(np.abs(left))), 1e-9) for left in tried)
    chosen, _ = simplest(tried, sizes, scale, cell)
    return candidates[chosen][0], _grid(grids[chosen])


def _grid(nodes: Nodes) -> Float[np.ndarray, "p k"]:
    shape = math.prod(map(len, nodes)), len(nodes)
    return np.array([*itertools.product(*nodes)]).reshape(shape)


def _candidates(
    table: Table, modes: tuple[int, ...], most: int
) -> list[tuple[Axes, tuple[int, ...]]]:
    """Return axes and number of tests along each, as many as the events bear.

    Over one axis at least three where they bear it: one statement of the manuals has
    exactly three tests in mode 2 (S-37), which the check of lists warns of else.
    """
    moving = np.flatnonzero(np.ptp(table.positions, axis=0) > 0).tolist()
    most = min(most, int(np.unique(table.group, return_counts=True)[1].min()))
    return [
        (axes, counts)
        for mode in modes
        for axes in itertools.combinations(moving, mode - 1)
        for counts in itertools.product(
            range(min(3, most) if len(axes) == 1 else 2, most + 1), repeat=len(axes)
        )
        if math.prod(counts) <= most
    ]


def _rounded(places: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return places that can be read aloud: whole steps of about a hundredth of the span."""
    step = 10.0 ** math.floor(math.log10(np.ptp(places) / 50.0))
    return np.asarray(np.round(places / step) * step)

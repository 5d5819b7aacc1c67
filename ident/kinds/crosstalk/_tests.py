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
class ModeScore:
    """How well a choice of tests predicts events that it has not seen.

    Attributes:
        mode: 1, 2 or 3.
        axes: Adaptation axes, columns of the positions.
        counts: Number of tests along each.
        held_out: Root mean square of the held-out events in mm, wild ones limited.
        chosen: Whether this is the one.
    """

    mode: int
    axes: Axes
    counts: tuple[int, ...]
    held_out: float
    chosen: bool


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

    def left(
        self, columns: Float[np.ndarray, "n p"], others: Bool[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Return (event − value) · √weight of each event under the values of the others.

        Of all values that fit, those nearest to the median: it is that of a test that no event
        tells.
        """
        result, root = np.zeros(len(self.amount)), np.sqrt(self.weight)
        for group in np.unique(self.group):
            mine = self.group == group
            use = mine & others
            centre = float(np.median(self.amount[use])) if use.any() else 0.0
            aim, design = (self.amount[use] - centre) * root[use], columns[use]
            value = np.linalg.lstsq(design * root[use, None], aim, rcond=1e-6)[0]
            result[mine] = self.amount[mine] - centre - columns[mine] @ value
        return np.asarray(result * root)


def choose_tests(
    table: Table, modes: tuple[int, ...], most: int
) -> tuple[Axes, Float[np.ndarray, "p k"], tuple[ModeScore, ...]]:
    """Return adaptation axes and places of tests that predict held-out events best.

    The fewest tests whose loss is not above the least by more than chance over the cells.
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
    sizes = [math.prod(counts) for _, counts in candidates]
    # What the finest choice rejects has no part in the search.
    finest = candidates[int(np.argmax(sizes))]
    columns = table.by_grid(finest[0], table.even_nodes(*finest))
    sound = np.ones(len(table.amount), bool)
    for _, mine, found in table.each(columns, "student"):
        sound[mine] = ~found.wild
    table = table.take(sound)
    cells = _cells(table.positions)
    rng = np.random.default_rng(0)
    fold = rng.permutation(np.arange(int(cells.max()) + 1) % _FOLDS)[cells]
    tried = np.zeros((len(candidates), len(cells)))
    for left, (axes, counts) in zip(tried, candidates, strict=True):
        columns = table.by_grid(axes, table.even_nodes(axes, counts))
        for number in np.unique(fold) if np.ptp(fold) else ():
            out = fold == number
            left[out] = table.left(columns, ~out)[out]
    scale = min(max(1.4826 * float(np.median(np.abs(left))), 1e-9) for left in tried)
    chosen, held_out = simplest(list(tried), sizes, scale, cells)
    scores = tuple(
        ModeScore(1 + len(axes), axes, counts, float(held_out[k]), k == chosen)
        for k, (axes, counts) in enumerate(candidates)
    )
    nodes = table.even_nodes(*candidates[chosen])
    return candidates[chosen][0], np.array(list(itertools.product(*nodes))), scores


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


def _cells(positions: Float[np.ndarray, "n k"]) -> Int[np.ndarray, " n"]:
    """Return the cell of each event: events at the same place are held out together."""
    if positions.shape[1] == 0:
        return np.arange(len(positions)) % _FOLDS
    parts = []
    for column in positions.T:
        edges = np.quantile(column, np.linspace(0.0, 1.0, _CELLS + 1)[1:-1])
        parts.append(np.searchsorted(np.unique(edges), column, side="right"))
    _, index = np.unique(np.column_stack(parts), axis=0, return_inverse=True)
    return np.asarray(index.reshape(-1))


def _rounded(places: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return places that can be read aloud: whole steps of about a hundredth of the span."""
    step = 10.0 ** math.floor(math.log10(np.ptp(places) / 50.0))
    return np.asarray(np.round(places / step) * step)

"""Where the tests stand: how many along which axis, chosen by events held out."""

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Bool, Float, Int

from ....models import surface_through
from ...core import FitError, Regression, filled, node_shares, regress
from ._types import Event, ModeScore

_CELLS, _FOLDS = 8, 8
_LIMIT = 5.0
"""Residuals in scales beyond which a held-out event counts no more."""
_CANDIDATES = 15
"""Places along an axis at which a test is tried."""
_GAIN = 0.05
"""Relative gain of the residual for which a test is moved off the even spacing."""
_TOUCHED = 1e-9
"""Weight of a test in an event from which on the event touches it."""

Nodes = tuple[Float[np.ndarray, " _n"], ...]


@dataclasses.dataclass(frozen=True)
class Table:
    """Events as arrays.

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
    def of(cls, events: tuple[Event, ...], groups: tuple[int, ...]) -> "Table":
        """Return events as arrays; ``groups`` maps branches to values that they share."""
        deviation = np.array([event.standard_deviation for event in events])
        middle = float(np.median(deviation))
        return cls(
            np.array([groups[event.branch] for event in events]),
            np.array([event.positions for event in events]).reshape(len(events), -1),
            np.array([event.value for event in events]),
            # No event is so sure of itself that it outvotes all others.
            (middle / np.maximum(deviation, 0.3 * middle)) ** 2,
            middle,
        )

    def take(self, keep: Bool[np.ndarray, " n"]) -> "Table":
        """Return the events for which ``keep`` is true."""
        return Table(
            self.group[keep],
            self.positions[keep],
            self.amount[keep],
            self.weight[keep],
            self.own_noise,
        )


def surface_columns(
    points: Float[np.ndarray, "p k"], positions: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "n p"]:
    """Return the weight of each test in each event, from the controller's own surface."""
    stencil = surface_through(points).stencil(filled(positions))
    return np.array(stencil.matrix())[: len(positions)]


def grid_columns(
    positions: Float[np.ndarray, "n k"], nodes: Nodes
) -> Float[np.ndarray, "n p"]:
    """Return the weight of each test of a grid in each event, the last axis fastest.

    What `surface_columns` gives for the same tests, as products of what each axis gives: the
    search looks at hundreds of grids, and nothing is compiled for the shape of each.
    """
    result = np.ones((len(positions), 1))
    for column, line in zip(positions.T, nodes, strict=True):
        share = node_shares(column, line)
        result = (result[:, :, None] * share[:, None, :]).reshape(len(column), -1)
    return result


def fit_values(
    columns: Float[np.ndarray, "n p"], events: Table, loss: str = "student"
) -> Regression:
    """Return the values of tests that explain the events of one group best.

    Each rests on the events around it. The scatter within events counts beside that between
    them where these are few, and wild ones need spare ones to be found.
    """
    spare = len(columns) - int((columns > _TOUCHED).any(axis=0).sum())
    return regress(
        columns,
        events.amount,
        weight=events.weight,
        loss=loss if spare >= max(4, columns.shape[1]) else "gauss",
        drifting=False,
        noise=events.own_noise,
        refuse=False,
    )


def points_of(nodes: Nodes) -> Float[np.ndarray, "p k"]:
    """Return the positions of the tests of a grid in mm, the last axis fastest."""
    if not nodes:
        return np.zeros((1, 0))
    grid = np.meshgrid(*nodes, indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, len(nodes))


def choose_tests(
    table: Table, modes: tuple[int, ...], most: int
) -> tuple[tuple[int, ...], Nodes, tuple[ModeScore, ...]]:
    """Return adaptation axes and nodes that predict held-out events best.

    The fewest tests whose loss is not above the least by more than chance over the cells.
    Nodes are evenly spaced over the events, then moved where that fits clearly better.

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
    table = _believable(table, candidates)
    cells = _cells(table.positions)
    rng = np.random.default_rng(0)
    fold = rng.permutation(np.arange(int(cells.max()) + 1) % _FOLDS)[cells]
    tried = []
    for axes, counts in candidates:
        nodes = _even_nodes(table, axes, counts)
        columns = grid_columns(table.positions[:, list(axes)], nodes)
        left = np.zeros(len(table.amount))
        for number in np.unique(fold):
            out = fold == number
            if not out.all():
                left[out] = _residual(table, columns, ~out, out)
        tried.append(left)
    scale = min(max(1.4826 * float(np.median(np.abs(left))), 1e-9) for left in tried)
    losses = [np.minimum((left / scale) ** 2, _LIMIT**2) for left in tried]
    best = losses[int(np.argmin([loss.mean() for loss in losses]))]
    good = [k for k, loss in enumerate(losses) if not _worse(loss, best, cells)]
    chosen = min(
        good, key=lambda k: (math.prod(candidates[k][1]), float(losses[k].mean()))
    )
    axes, counts = candidates[chosen]
    scores = tuple(
        ModeScore(
            1 + len(each),
            each,
            number,
            scale * float(np.sqrt(loss.mean())),
            k == chosen,
        )
        for k, ((each, number), loss) in enumerate(zip(candidates, losses, strict=True))
    )
    return axes, _moved_nodes(table, axes, _even_nodes(table, axes, counts)), scores


def _candidates(
    table: Table, modes: tuple[int, ...], most: int
) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Return axes and number of tests along each, as many as the events bear."""
    columns = range(table.positions.shape[1])
    moving = [k for k in columns if np.ptp(table.positions[:, k]) > 0]
    smallest = min(np.bincount(table.group)[np.unique(table.group)])
    most = int(min(most, smallest))
    result: list[tuple[tuple[int, ...], tuple[int, ...]]] = []
    if 1 in modes:
        result.append(((), ()))
    if 2 in modes:
        result += [((k,), (n,)) for k in moving for n in range(2, most + 1)]
    if 3 in modes:
        result += [
            (pair, (n, m))
            for pair in itertools.combinations(moving, 2)
            for n in range(2, most + 1)
            for m in range(2, most // n + 1)
        ]
    return result


def _believable(
    table: Table, candidates: list[tuple[tuple[int, ...], tuple[int, ...]]]
) -> Table:
    """Return the events that the finest choice of tests does not reject: for the search only."""
    axes, counts = max(candidates, key=lambda each: math.prod(each[1]))
    columns = grid_columns(
        table.positions[:, list(axes)], _even_nodes(table, axes, counts)
    )
    wild = np.zeros(len(table.amount), bool)
    for group in np.unique(table.group):
        mine = table.group == group
        wild[mine] = fit_values(columns[mine], table.take(mine)).wild
    return table.take(~wild)


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


def _residual(
    table: Table,
    columns: Float[np.ndarray, "n p"],
    train: Bool[np.ndarray, " n"],
    test: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, " m"]:
    """Return (event − value) · √weight of the tested events under the values of the others.

    A test without events has the median of all.
    """
    result, root = np.zeros(len(table.amount)), np.sqrt(table.weight)
    for group in np.unique(table.group[test]):
        rows, mine = test & (table.group == group), train & (table.group == group)
        centre = float(np.median(table.amount[mine])) if mine.any() else 0.0
        aim = (table.amount[mine] - centre) * root[mine]
        # Of all values that fit, those nearest to the median.
        value = np.linalg.lstsq(columns[mine] * root[mine, None], aim, rcond=1e-6)[0]
        result[rows] = table.amount[rows] - centre - columns[rows] @ value
    return np.asarray((result * root)[test])


def _worse(
    loss: Float[np.ndarray, " n"],
    best: Float[np.ndarray, " n"],
    cells: Int[np.ndarray, " n"],
) -> bool:
    """Tell whether a choice predicts worse by more than chance over the cells."""
    sums = np.bincount(cells, loss - best)
    spread = float(np.std(sums, ddof=1) * np.sqrt(len(sums))) if len(sums) > 1 else 0.0
    return float(sums.sum()) > spread


def _even_nodes(table: Table, axes: tuple[int, ...], counts: tuple[int, ...]) -> Nodes:
    """Return evenly spaced nodes from the first to the last event along each axis."""
    nodes = []
    for axis, count in zip(axes, counts, strict=True):
        column = table.positions[:, axis]
        low, high = float(column.min()), float(column.max())
        nodes.append(_rounded(np.linspace(low, high, count), high - low))
    return tuple(nodes)


def _rounded(places: Float[np.ndarray, " n"], span: float) -> Float[np.ndarray, " n"]:
    """Return places that can be read aloud: whole steps of about a hundredth of the span."""
    step = 10.0 ** math.floor(math.log10(span / 50.0))
    return np.asarray(np.round(places / step) * step)


def _moved_nodes(table: Table, axes: tuple[int, ...], nodes: Nodes) -> Nodes:
    """Return nodes with inner ones moved to where they fit the events best."""
    current = list(nodes)
    every = np.ones(len(table.amount), bool)

    def cost(trial: list[Float[np.ndarray, " _n"]]) -> float:
        columns = grid_columns(table.positions[:, list(axes)], tuple(trial))
        left = _residual(table, columns, every, every)
        scale = max(1.4826 * float(np.median(np.abs(left))), table.own_noise, 1e-12)
        return float(np.minimum(left**2, (_LIMIT * scale) ** 2).sum())

    start = best = cost(current)
    for k, line in enumerate(nodes):
        span = float(line[-1] - line[0])
        places = _rounded(np.linspace(line[0], line[-1], _CANDIDATES), span)
        for inner in range(1, len(line) - 1):
            for place in places:
                low, high = current[k][inner - 1], current[k][inner + 1]
                if not low + 1e-6 < place < high - 1e-6:
                    continue
                trial = list(current)
                trial[k] = current[k].copy()
                trial[k][inner] = place
                value = cost(trial)
                if value < best:
                    best, current = value, trial
    return tuple(current) if best < (1.0 - _GAIN) * start else nodes

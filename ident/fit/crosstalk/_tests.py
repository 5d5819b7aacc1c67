"""Where the tests stand: how many along which axis, chosen by events held out."""

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._errors import FitError
from ._own import own_values
from ._types import Event, ModeScore

_CELLS, _FOLDS = 8, 8
_LIMIT = 5.0
"""Residuals in scales beyond which a held-out event counts no more."""
_CANDIDATES = 15
"""Places along an axis at which a test is tried."""
_GAIN = 0.05
"""Relative gain of the residual for which a test is moved off the even spacing."""


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


def event_table(events: tuple[Event, ...], groups: tuple[int, ...]) -> Table:
    """Return events as arrays; ``groups`` maps branches to values that they share."""
    deviation = np.array([event.standard_deviation for event in events])
    middle = float(np.median(deviation))
    # No event is so sure of itself that it outvotes all others.
    weight = (middle / np.maximum(deviation, 0.3 * middle)) ** 2
    return Table(
        np.array([groups[event.branch] for event in events]),
        np.array([event.positions for event in events]).reshape(len(events), -1),
        np.array([event.value for event in events]),
        weight,
        middle,
    )


Nodes = tuple[Float[np.ndarray, " _n"], ...]


def points_of(nodes: Nodes) -> Float[np.ndarray, "p k"]:
    """Return the positions of the tests of a grid in mm, the last axis fastest."""
    if not nodes:
        return np.zeros((1, 0))
    grid = np.meshgrid(*nodes, indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, len(nodes))


def grid_columns(
    positions: Float[np.ndarray, "n k"], nodes: Nodes
) -> Float[np.ndarray, "n p"]:
    """Return the weight of each test of a grid in each event.

    What `stencil_columns` gives for the surface of the same tests, without compiling
    anything: the search looks at hundreds of grids.
    """
    result = np.ones((len(positions), 1))
    for column, line in zip(positions.T, nodes, strict=True):
        unit = np.eye(len(line))
        share = np.column_stack([np.interp(column, line, each) for each in unit])
        result = (result[:, :, None] * share[:, None, :]).reshape(len(column), -1)
    return result


def _residual(
    table: Table,
    columns: Float[np.ndarray, "n p"],
    train: Bool[np.ndarray, " n"],
    test: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, " m"]:
    """Return (event − value) · √weight of the tested events under the values of the others."""
    result = np.zeros(len(table.amount))
    for group in np.unique(table.group[test]):
        rows, mine = test & (table.group == group), train & (table.group == group)
        value = np.zeros(columns.shape[1])
        if mine.any():
            value = own_values(
                columns[mine],
                table.amount[mine],
                table.weight[mine],
                table.own_noise,
                "gauss",
            ).value
        left = table.amount[rows] - columns[rows] @ value
        result[rows] = left * np.sqrt(table.weight[rows])
    return np.asarray(result[test])


def _believable(
    table: Table, candidates: list[tuple[tuple[int, ...], tuple[int, ...]]]
) -> Table:
    """Return the events that the finest choice of tests does not reject: for the search only."""
    if not candidates:
        return table
    axes, counts = max(candidates, key=lambda each: math.prod(each[1]))
    columns = grid_columns(
        table.positions[:, list(axes)], even_nodes(table, axes, counts)
    )
    wild = np.zeros(len(table.amount), bool)
    for group in np.unique(table.group):
        rows = np.flatnonzero(table.group == group)
        values = own_values(
            columns[rows], table.amount[rows], table.weight[rows], table.own_noise
        )
        wild[rows] = values.wild
    return Table(
        table.group[~wild],
        table.positions[~wild],
        table.amount[~wild],
        table.weight[~wild],
        table.own_noise,
    )


def cells_of(positions: Float[np.ndarray, "n k"]) -> Int[np.ndarray, " n"]:
    """Return the cell of each event: events at the same place are held out together."""
    if positions.shape[1] == 0:
        return np.arange(len(positions)) % _FOLDS
    parts = []
    for column in positions.T:
        edges = np.quantile(column, np.linspace(0.0, 1.0, _CELLS + 1)[1:-1])
        parts.append(np.searchsorted(np.unique(edges), column, side="right"))
    _, index = np.unique(np.column_stack(parts), axis=0, return_inverse=True)
    return np.asarray(index.reshape(-1))


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
    table = _believable(table, candidates)
    cells = cells_of(table.positions)
    rng = np.random.default_rng(0)
    fold = rng.permutation(np.arange(int(cells.max()) + 1) % _FOLDS)[cells]
    tried: list[tuple[tuple[int, ...], tuple[int, ...], np.ndarray]] = []
    for axes, counts in candidates:
        nodes = even_nodes(table, axes, counts)
        columns = grid_columns(table.positions[:, list(axes)], nodes)
        left = np.zeros(len(table.amount))
        for number in np.unique(fold):
            out = fold == number
            if out.all():
                continue
            left[out] = _residual(table, columns, ~out, out)
        tried.append((axes, counts, left))
    if not tried:
        wanted = " or ".join(str(mode) for mode in modes)
        msg = (
            f"mode {wanted} cannot be fitted: the events do not spread over the adaptation "
            "axes that it needs."
        )
        raise FitError(msg)
    scale = min(
        max(1.4826 * float(np.median(np.abs(left))), 1e-9) for _, _, left in tried
    )
    losses = [np.minimum((left / scale) ** 2, _LIMIT**2) for _, _, left in tried]
    best = losses[int(np.argmin([loss.mean() for loss in losses]))]
    good = [
        number for number, loss in enumerate(losses) if not _worse(loss, best, cells)
    ]
    chosen = min(good, key=lambda k: (math.prod(tried[k][1]), float(losses[k].mean())))
    axes, counts, _ = tried[chosen]
    scores = tuple(
        ModeScore(
            1 + len(each),
            each,
            number,
            scale * float(np.sqrt(loss.mean())),
            k == chosen,
        )
        for k, ((each, number, _), loss) in enumerate(zip(tried, losses, strict=True))
    )
    return axes, moved_nodes(table, axes, even_nodes(table, axes, counts)), scores


def _worse(loss: np.ndarray, best: np.ndarray, cells: np.ndarray) -> bool:
    sums = np.bincount(cells, loss - best)
    spread = float(np.std(sums, ddof=1) * np.sqrt(len(sums))) if len(sums) > 1 else 0.0
    return float(sums.sum()) > spread


def _candidates(
    table: Table, modes: tuple[int, ...], most: int
) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
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
        for pair in itertools.combinations(moving, 2):
            result += [
                (pair, (n, m))
                for n in range(2, most + 1)
                for m in range(2, most + 1)
                if n * m <= most
            ]
    return result


def even_nodes(table: Table, axes: tuple[int, ...], counts: tuple[int, ...]) -> Nodes:
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


def moved_nodes(table: Table, axes: tuple[int, ...], nodes: Nodes) -> Nodes:
    """Return nodes with inner ones moved to where they fit the events best."""
    current = list(nodes)
    all_events = np.ones(len(table.amount), bool)

    def cost(trial: list[np.ndarray]) -> float:
        columns = grid_columns(table.positions[:, list(axes)], tuple(trial))
        left = _residual(table, columns, all_events, all_events)
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

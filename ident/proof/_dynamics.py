"""Slopes, steps and kinks of a table, and the motion that it adds."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

SMOOTHING = 0.010
"""Time in s over which a drive smooths a kink; the acceleration is judged over it."""


@dataclasses.dataclass(frozen=True)
class GateTable:
    """A table as the gate sees it.

    Attributes:
        names: Of the masters, for the words.
        nodes: Positions per master in mm or °.
        offset: What the controller adds at the nodes, one array per branch; 1-D or
            ``[j, i]`` for a plane.
        change: Offset − offset of the existing list, likewise, or None.
        closed: Per master: motion never leaves the table (software limits), so that its
            ends are no kinks.
        periodic: The last node is the first again (1-D).
        unit: ``mm`` or ``deg``.
        cycles: P-AXIS-00243 where the table has two branches.
        cycle_time: In s.
    """

    names: tuple[str, ...]
    nodes: tuple[Float[np.ndarray, " _"], ...]
    offset: Sequence[np.ndarray]
    change: Sequence[np.ndarray] | None
    closed: tuple[bool, ...]
    periodic: bool
    unit: str
    cycles: int
    cycle_time: float


def place_of(table: GateTable, index: Sequence[int]) -> str:
    """Return a node in words; an index runs like ``[j, i]``, master 2 first."""
    return ", ".join(
        f"{name} = {nodes[k]:g}"
        for name, nodes, k in zip(
            table.names, table.nodes, reversed(list(index)), strict=True
        )
    )


def _lines(table: GateTable) -> Iterator[tuple[int, np.ndarray]]:
    """Yield every branch with one master running along the last dimension."""
    for branch in table.offset:
        yield 0, np.atleast_2d(branch)
        if branch.ndim == 2:
            yield 1, branch.T


def _node_words(table: GateTable, way: int, row: int, k: int) -> str:
    index = [k] if len(table.nodes) == 1 else [[row, k], [k, row]][way]
    return f"at {place_of(table, index)}"


def _interval_words(table: GateTable, way: int, row: int, k: int) -> str:
    nodes = table.nodes[way]
    words = f"between {table.names[way]} = {nodes[k]:g} and {nodes[k + 1]:g}"
    if len(table.nodes) == 2:
        words += f" at {table.names[1 - way]} = {table.nodes[1 - way][row]:g}"
    return words


def _first_largest(values: np.ndarray) -> tuple[float, int, int]:
    row, k = np.unravel_index(np.argmax(values), values.shape)
    return float(values[row, k]), int(row), int(k)


def step(table: GateTable) -> tuple[float, str]:
    """Return the largest difference of neighbouring nodes in mm or °, and where."""
    found: list[tuple[float, str]] = []
    for way, rows in _lines(table):
        value, row, k = _first_largest(np.abs(np.diff(rows, axis=1)))
        found.append((value, _interval_words(table, way, row, k)))
    return max(found)


def slope(table: GateTable) -> tuple[float, str]:
    """Return the steepest slope along a master, as a pure number, and where."""
    found: list[tuple[float, str]] = []
    for way, rows in _lines(table):
        slopes = np.abs(np.diff(rows, axis=1)) / np.diff(table.nodes[way])
        value, row, k = _first_largest(slopes)
        found.append((value, _interval_words(table, way, row, k)))
    return max(found)


def gradient(table: GateTable) -> float:
    """Return the steepest gradient; of a plane at the corners of its cells."""
    steepest = 0.0
    for branch in table.offset:
        if branch.ndim == 1:
            slopes = np.diff(branch) / np.diff(table.nodes[0])
            steepest = max(steepest, float(np.max(np.abs(slopes))))
            continue
        along1 = np.diff(branch, axis=1) / np.diff(table.nodes[0])
        along2 = np.diff(branch, axis=0) / np.diff(table.nodes[1])[:, None]
        corners = itertools.product(
            (along1[:-1], along1[1:]), (along2[:, :-1], along2[:, 1:])
        )
        for first, second in corners:
            steepest = max(steepest, float(np.max(np.hypot(first, second))))
    return steepest


def _slopes_with_ends(table: GateTable, way: int, rows: np.ndarray) -> np.ndarray:
    """Return the slopes along the rows, with those beyond both ends at either side."""
    slopes = np.diff(rows, axis=1) / np.diff(table.nodes[way])
    if table.periodic:
        return np.concatenate([slopes[:, -1:], slopes, slopes[:, :1]], axis=1)
    if table.closed[way]:
        return np.concatenate([slopes[:, :1], slopes, slopes[:, -1:]], axis=1)
    # Outside the table the controller holds its edge: the slope there is 0.
    flat = np.zeros((len(slopes), 1))
    return np.concatenate([flat, slopes, flat], axis=1)


def kink(table: GateTable) -> tuple[float, str]:
    """Return the largest change of slope at a node, as a pure number, and where."""
    found: list[tuple[float, str]] = []
    for way, rows in _lines(table):
        change = np.abs(np.diff(_slopes_with_ends(table, way, rows), axis=1))
        value, row, k = _first_largest(change)
        found.append((value, _node_words(table, way, row, k)))
    return max(found)


def acceleration(table: GateTable, feed: float) -> tuple[float, str]:
    """Return the largest acceleration that a table adds, smoothed over `SMOOTHING`.

    Along a line this is the change of slope over the way that the master makes in that
    time; across a cell of a plane its twist adds an acceleration of its own.

    Args:
        table: The table.
        feed: In mm/s or °/s.

    Returns:
        mm/s² or °/s², and where.
    """
    made = feed * SMOOTHING
    found: list[tuple[float, str]] = []
    for way, rows in _lines(table):
        nodes = table.nodes[way]
        slopes = _slopes_with_ends(table, way, rows)
        if table.periodic:
            turn = nodes[-1] - nodes[0]
            nodes = np.concatenate([nodes[:-1] - turn, nodes, nodes[1:] + turn])
            inner = slopes[:, 1:-1]
            slopes = np.concatenate([inner[:, -1:], *[inner] * 3, inner[:, :1]], axis=1)
        # The slope is constant between nodes: its change over a fixed way is largest
        # where one end of the way has just passed a node.
        passed = np.arange(1, len(nodes) + 1)
        ahead = np.searchsorted(nodes, nodes + made, side="right")
        behind = np.searchsorted(nodes, nodes - made, side="right")
        for start, end in ((passed, ahead), (behind, passed)):
            value, row, k = _first_largest(np.abs(slopes[:, end] - slopes[:, start]))
            place = k % (len(table.nodes[way]) - 1) if table.periodic else k
            found.append(
                (value * feed / SMOOTHING, _node_words(table, way, row, place))
            )
    for branch in table.offset:
        if branch.ndim == 2:
            area = np.outer(np.diff(table.nodes[1]), np.diff(table.nodes[0]))
            twist = np.abs(np.diff(np.diff(branch, axis=0), axis=1) / area)
            value, row, k = _first_largest(twist)
            # Along the diagonal each master moves with feed/√2: 2 · v₁ · v₂ = feed².
            where = f"in the cell from {place_of(table, [row, k])}"
            found.append((value * feed**2, where))
    return max(found)

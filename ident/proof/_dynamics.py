"""Slopes, steps and kinks of a table, and the motion that it adds."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Sequence

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
        unit: mm or °.
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

    @functools.cached_property
    def lines(self) -> "tuple[_Lines, ...]":
        """Every branch with one master running along the last dimension."""
        offset = np.stack(self.offset)
        if len(self.nodes) == 1:
            return (_Lines(self, 0, offset[:, None]),)
        return _Lines(self, 0, offset), _Lines(self, 1, offset.swapaxes(1, 2))


def place_of(table: GateTable, index: Sequence[int]) -> str:
    """Return a node in words; an index runs like ``[j, i]``, master 2 first."""
    places = zip(table.names, table.nodes, reversed([*index]), strict=True)
    return ", ".join(f"{name} = {nodes[k]:g}" for name, nodes, k in places)


@dataclasses.dataclass(frozen=True)
class _Lines:
    """The branches of a table along one master; arrays over (branch, line, place).

    Attributes:
        table: The table.
        master: Its number, 0 or 1.
        offset: At its nodes.
    """

    table: GateTable
    master: int
    offset: Float[np.ndarray, "b r n"]

    @functools.cached_property
    def nodes(self) -> Float[np.ndarray, " n"]:
        """Positions of the master."""
        return self.table.nodes[self.master]

    @functools.cached_property
    def steps(self) -> Float[np.ndarray, "b r m"]:
        """From node to node, in mm or °."""
        return np.asarray(self.offset[..., 1:] - self.offset[..., :-1])

    @functools.cached_property
    def slopes(self) -> Float[np.ndarray, "b r m"]:
        """Between the nodes, as pure numbers."""
        return np.asarray(self.steps / (self.nodes[1:] - self.nodes[:-1]))

    @functools.cached_property
    def course(self) -> tuple[Float[np.ndarray, " l"], Float[np.ndarray, "b r k"]]:
        """Nodes, and the slopes between them and beyond both ends; a ring goes on a turn."""
        nodes, slopes = self.nodes, self.slopes
        if self.table.periodic:
            turn = nodes[-1] - nodes[0]
            nodes = np.concatenate([nodes[:-1] - turn, nodes, nodes[1:] + turn])
            ends, slopes = (slopes[..., -1:], slopes[..., :1]), np.tile(slopes, 3)
        elif self.table.closed[self.master]:
            ends = slopes[..., :1], slopes[..., -1:]
        else:
            # Outside the table the controller holds its edge: the slope there is 0.
            flat = np.zeros((*slopes.shape[:-1], 1))
            ends = flat, flat
        return nodes, np.concatenate([ends[0], slopes, ends[1]], axis=-1)

    def node(self, row: int, k: int) -> str:
        """Return a node of the course in words."""
        if self.table.periodic:
            k %= len(self.nodes) - 1
        index = [k] if len(self.table.nodes) == 1 else [[row, k], [k, row]][self.master]
        return f"at {place_of(self.table, index)}"

    def interval(self, row: int, k: int) -> str:
        """Return the interval after a node in words."""
        names, nodes = self.table.names, self.nodes
        words = f"between {names[self.master]} = {nodes[k]:g} and {nodes[k + 1]:g}"
        if len(names) == 2:
            crossing = 1 - self.master
            words += f" at {names[crossing]} = {self.table.nodes[crossing][row]:g}"
        return words


_Tried = tuple[Float[np.ndarray, "_b _r _m"], Callable[[int, int], str]]
"""Values by branch, line and place, and a function to words for the place of one on a line."""


def _largest(candidates: Iterable[_Tried]) -> tuple[float, str]:
    """Return the largest value, and in words where it is."""
    return max(
        (float(branch.max()), words(*divmod(int(branch.argmax()), branch.shape[1])))
        for values, words in candidates
        for branch in values
    )


def step(table: GateTable) -> tuple[float, str]:
    """Return the largest difference of neighbouring nodes in mm or °, and where."""
    return _largest((np.abs(lines.steps), lines.interval) for lines in table.lines)


def slope(table: GateTable) -> tuple[float, str]:
    """Return the steepest slope along a master, as a pure number, and where."""
    return _largest((np.abs(lines.slopes), lines.interval) for lines in table.lines)


def gradient(table: GateTable) -> float:
    """Return the steepest gradient; of a plane at the corners of its cells."""
    along1 = table.lines[0].slopes
    if len(table.nodes) == 1:
        return float(np.abs(along1).max())
    along2 = table.lines[1].slopes.swapaxes(1, 2)
    sides = (along1[:, :-1], along1[:, 1:]), (along2[..., :-1], along2[..., 1:])
    corners = itertools.product(*sides)
    return max(float(np.hypot(first, second).max()) for first, second in corners)


def kink(table: GateTable) -> tuple[float, str]:
    """Return the largest change of slope at a node, as a pure number, and where."""
    kinks = ((np.diff(lines.course[1]), lines.node) for lines in table.lines)
    return _largest((np.abs(change), words) for change, words in kinks)


def acceleration(table: GateTable, feed: float) -> tuple[float, str]:
    """Return the largest acceleration that a table adds, smoothed over `SMOOTHING`.

    Along a line this is the change of slope over the path of the master in that
    time; across a cell of a plane its twist adds an acceleration of its own. In mm/s² or °/s²,
    of a feed in mm/s or °/s, and where.
    """
    reach = feed * SMOOTHING
    candidates: list[_Tried] = []
    for lines in table.lines:
        nodes, slopes = lines.course
        # The slope is constant between nodes: its change over a fixed path is largest
        # where one end of the path has just passed a node.
        beginning = np.arange(1, len(nodes) + 1)
        ahead = np.searchsorted(nodes, nodes + reach, side="right")
        behind = np.searchsorted(nodes, nodes - reach, side="right")
        for start, end in ((beginning, ahead), (behind, beginning)):
            change = np.abs(slopes[..., end] - slopes[..., start])
            candidates.append((change * feed / SMOOTHING, lines.node))
    if len(table.nodes) == 2:
        area = np.outer(np.diff(table.nodes[1]), np.diff(table.nodes[0]))
        across = table.lines[1].steps.swapaxes(1, 2)
        twist = np.abs((across[..., 1:] - across[..., :-1]) / area)

        def cell(row: int, k: int) -> str:
            return f"in the cell from {place_of(table, [row, k])}"

        # Along the diagonal each master moves with feed/√2: 2 · v₁ · v₂ = feed².
        candidates.append((twist * feed**2, cell))
    return _largest(candidates)

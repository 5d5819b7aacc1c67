"""What may be moved between blocks, the rule that fixes it, and what points cannot tell.

Two questions to the design alone, never to what was measured. A *gauge* is a mixture of shapes
that no point anywhere shows (an offset of EXX, of EXY and a shift of the frame are the same):
of its members the one that gives way first is set to zero. What these points do not show beside
that is *undetermined*: to be measured, or to be left alone.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from ..core import Readings, Stack
from ..fit._identifiable import null_space, pivoted
from ._blocks import AbstractBlock, Modes
from ._points import readings_at

_LITTLE = 1e-3
"""Information on a mixture, relative to as many readings all over the volume, that is none."""
_PART, _MEMBER = 1e-4, 0.1
"""Part in a direction, relative to the largest, from which on a shape is a member: of a gauge,
of what is hidden, which is known less sharply."""
_MOVED = 0.1
"""Share of a typical reading by which what is hidden may move a sum that counts as shown."""
_VALUE = 1e-3
"""Part of a value in a hidden direction, relative to the largest of its block."""
_ROUNDING = 1e-10
"""Information, relative to a shape's own, that keeps ideal information invertible."""
_DEGREE = 4
"""Of the shapes by which a function is judged."""
_ROWS_PER_SHAPE, _MORE_ROWS = 8, 500
_SAME = 1e-3
"""Share of the range of an axis below which two positions count as one."""


@final
@dataclasses.dataclass(frozen=True)
class Gauge:
    """What no measurement tells apart, since only the sum acts: harmless.

    Attributes:
        zero: Block and shape that was set to zero.
        among: The same with all that it could be moved to.
    """

    zero: tuple[str, str]
    among: tuple[tuple[str, str], ...]


@final
@dataclasses.dataclass(frozen=True)
class Undetermined:
    """What the given points do not tell, whatever the errors are.

    Attributes:
        shapes: Shapes by name of the block: one block alone is not shown at all, of several
            only some sums.
        directions: Number of independent mixtures that no point shows.
        tools: Whether only tools of other offsets show it, wherever the points lie.
    """

    shapes: tuple[tuple[str, tuple[str, ...]], ...]
    directions: int
    tools: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the blocks."""
        return tuple(name for name, _ in self.shapes)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of all blocks side by side, each scaled to the readings.

    Attributes:
        basis: Over all unknowns.
        owner: Number of the block of each shape.
        labels: Its name.
        free: Whether no prior holds it.
        order: Numbers of the shapes, those that give way first in front.
    """

    basis: Float[np.ndarray, "n m"]
    owner: Int[np.ndarray, " m"]
    labels: tuple[str, ...]
    free: Bool[np.ndarray, " m"]
    order: Int[np.ndarray, " m"]

    @classmethod
    def of(cls, blocks: Sequence[AbstractBlock], most: Sequence[int]) -> "Shapes":
        """Return the shapes of blocks up to a degree along each axis."""
        modes: list[Modes] = [block.modes(most) for block in blocks]
        counts = [each.basis.shape[1] for each in modes]
        owner = np.repeat(np.arange(len(blocks)), counts)
        priority = np.array([block.priority for block in blocks])[owner]
        return cls(
            np.asarray(scipy.linalg.block_diag(*(each.basis for each in modes))),
            owner,
            tuple(label for each in modes for label in each.labels),
            np.concatenate([each.free for each in modes]),
            np.argsort(priority, kind="stable"),
        )

    def some(self, kept: Bool[np.ndarray, " m"]) -> "Shapes":
        """Return some of them."""
        place = np.cumsum(kept) - 1
        labels = tuple(self.labels[k] for k in np.flatnonzero(kept))
        order = place[self.order[kept[self.order]]]
        return Shapes(
            self.basis[:, kept], self.owner[kept], labels, self.free[kept], order
        )


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Freedoms:
    """Rules of the gauge, and what points leave open beside them.

    Attributes:
        null: Directions of the unknowns that neither points nor priors hold.
        fixed: Functionals that are zero under the rules, as many.
        pins: What is added to the diagonal of the information to hold these directions.
        hidden: Directions of the unknowns, under the rules, of which the points show next to
            nothing; each moves a reading somewhere in the volume by about 1.
        lost: Whether each unknown has a part in them.
        gauges: The rules.
        undetermined: What is hidden.
        free: Number of directions that no prior holds and the points tell.
    """

    null: Float[np.ndarray, "n g"]
    fixed: Float[np.ndarray, "g n"]
    pins: Float[np.ndarray, " n"]
    hidden: Float[np.ndarray, "n h"]
    lost: Bool[np.ndarray, " n"]
    gauges: tuple[Gauge, ...]
    undetermined: tuple[Undetermined, ...]
    free: int

    @cached_property
    def _gain(self) -> Float[np.ndarray, "g n"]:
        return np.asarray(np.linalg.solve(self.fixed @ self.null, self.fixed))

    def project(self, values: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return values, or columns of them, under the rules: what they sum up to stays."""
        return np.asarray(values - self.null @ (self._gain @ values))

    def shown(self, rows: Float[np.ndarray, "t n"]) -> Bool[np.ndarray, " t"]:
        """Return whether sums of the unknowns keep clear of all that is hidden."""
        return np.asarray(np.linalg.norm(rows @ self.hidden, axis=1) <= _MOVED)

    @classmethod
    def of(
        cls,
        blocks: Sequence[AbstractBlock],
        readings: Readings,
        volume: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    ) -> "Freedoms":
        """Return the freedoms of blocks at readings; the volume is where they could stand."""
        stack = Stack(tuple(blocks), banded=False)
        shapes = Shapes.of(blocks, _degrees(readings.inputs["position"]))
        varied = _varied(readings, volume, len(shapes.labels))
        actual, ideal = (_Seen.of(stack, shapes, rows) for rows in (readings, varied))
        straight = shapes.some(shapes.free)
        common, lost = ideal.null(shapes.free), actual.null(shapes.free)
        rules = _given_way(common, straight.order)
        held = _given_way(lost, np.array([*rules, *straight.order], np.int64))
        null = straight.basis @ (lost / actual.scale[shapes.free, None])
        gauges = _gauges(common, rules, straight, blocks)
        shared = np.flatnonzero(shapes.free)[[rule for rule, _ in gauges]]
        hidden = actual.hidden(ideal, np.delete(np.arange(len(shapes.labels)), shared))
        parts = _resolved(hidden)
        return cls(
            null=null,
            fixed=straight.basis[:, held].T,
            pins=_pins(null, actual.diagonal),
            hidden=shapes.basis @ (hidden / ideal.scale[:, None]),
            lost=_lost(shapes, parts),
            gauges=tuple(gauge for _, gauge in gauges),
            undetermined=_groups(parts, shapes, blocks),
            free=len(straight.labels) - len(held),
        )


@final
@dataclasses.dataclass(frozen=True, eq=False)
class _Seen:
    """What rows show of shapes.

    Attributes:
        matrix: Information on the shapes per row.
        diagonal: Information on each unknown.
    """

    matrix: Float[np.ndarray, "m m"]
    diagonal: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, stack: Stack, shapes: Shapes, readings: Readings) -> "_Seen":
        """Return what readings show of shapes."""
        rows = dense(stack, readings)
        columns = rows @ shapes.basis
        return cls(columns.T @ columns / len(rows), np.square(rows).sum(axis=0))

    @cached_property
    def scale(self) -> Float[np.ndarray, " m"]:
        """What each shape does to a row, root mean square; 1 where it does nothing."""
        size = np.sqrt(np.diag(self.matrix))
        return np.where(size > 0.0, size, 1.0)

    def null(self, kept: Bool[np.ndarray, " m"]) -> Float[np.ndarray, "f g"]:
        """Return mixtures of some shapes that no row shows, in their `scale`."""
        unit = self.matrix[np.ix_(kept, kept)] / np.outer(
            self.scale[kept], self.scale[kept]
        )
        return null_space(unit)

    def hidden(
        self, ideal: "_Seen", kept: Int[np.ndarray, " k"]
    ) -> Float[np.ndarray, "m h"]:
        """Return mixtures of which these rows show next to nothing beside ideal ones.

        In the scale of the ideal rows; each moves such a row by 1, root mean square, if it
        shows it at all.
        """
        here, unit = np.ix_(kept, kept), np.outer(ideal.scale[kept], ideal.scale[kept])
        whole = ideal.matrix[here] / unit
        # What not even ideal rows show counts as such a row as well.
        whole += np.diag(np.where(np.diag(whole) > 0.0, _ROUNDING, 1.0))
        share, modes = scipy.linalg.eigh(self.matrix[here] / unit, whole)
        result = np.zeros((len(self.matrix), int((share < _LITTLE).sum())))
        result[kept] = modes[:, share < _LITTLE]
        return result


def dense(stack: Stack, readings: Readings) -> Float[np.ndarray, "t n"]:
    """Return the rows of a stack with all their zeros."""
    nodes, shares = stack.design(readings)
    rows = np.zeros((len(readings), stack.size))
    np.add.at(rows, (np.arange(len(rows))[:, None], nodes), shares)
    return rows


def _degrees(place: Float[np.ndarray, "t 3"]) -> list[int]:
    """Return the degree of shapes along each axis that so many positions can show."""
    result = []
    for along in place.T:
        step = max(_SAME * float(np.ptp(along)), 1e-9)
        count = len(np.unique(np.round((along - along.min()) / step)))
        result.append(int(np.clip(count - 1, 1, _DEGREE)))
    return result


def _varied(
    readings: Readings,
    volume: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    shapes: int,
) -> Readings:
    """Return readings at random places of the volume, in all directions and set-ups.

    Tools vary where they varied.
    """
    rng = np.random.default_rng(0)
    count = _ROWS_PER_SHAPE * shapes + _MORE_ROWS
    tool, runs = readings.inputs["tool"], readings.inputs["run"]
    along = rng.normal(size=(count, 3))
    return readings_at(
        rng.uniform(*volume, (count, 3)),
        along / np.linalg.norm(along, axis=1)[:, None],
        tool.mean(axis=0) + tool.std(axis=0) * rng.normal(size=(count, 3)),
        rng.integers(0, runs.max() + 1, count),
    )


def _pins(
    null: Float[np.ndarray, "n g"], diagonal: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Return precisions of single unknowns that, held, hold all of some directions."""
    pins = np.zeros(len(null))
    if null.shape[1]:
        scale = np.where(diagonal > 0, np.sqrt(diagonal), 1.0)
        held = pivoted((null * scale[:, None]).T)[2][: null.shape[1]]
        typical = float(np.median(diagonal[diagonal > 0]))
        pins[held] = np.where(diagonal[held] > 0, diagonal[held], typical)
    return pins


def _given_way(
    null: Float[np.ndarray, "m g"], order: Int[np.ndarray, " k"]
) -> list[int]:
    """Return shapes that, zero, fix all directions: the first ones in an order."""
    left, found = null.copy(), list[int]()
    for k in order:
        part = float(np.linalg.norm(left[k]))
        if part > _PART and len(found) < null.shape[1]:
            left = left - np.outer(left @ left[k], left[k]) / part**2
            found.append(int(k))
    return found


def _resolved(directions: Float[np.ndarray, "m h"]) -> Float[np.ndarray, "m h"]:
    """Return mixtures of directions with as few members as may be, and these only."""
    if not directions.shape[1]:
        return directions
    own = pivoted(directions.T)[2][: directions.shape[1]]
    found = np.linalg.solve(directions[own].T, directions.T).T
    return np.where(np.abs(found) > _MEMBER * np.abs(found).max(axis=0), found, 0.0)


def _gauges(
    null: Float[np.ndarray, "m g"],
    rules: Sequence[int],
    shapes: Shapes,
    blocks: Sequence[AbstractBlock],
) -> list[tuple[int, Gauge]]:
    """Return the rules, each with what its direction moves; what nothing shows is none."""
    if not rules:
        return []
    # One direction per rule: along it the other rules stay at zero.
    along = np.linalg.solve(null[rules].T, null.T).T
    names = [
        (blocks[own].name, label)
        for own, label in zip(shapes.owner, shapes.labels, strict=True)
    ]
    result = []
    for k, rule in enumerate(rules):
        members = np.flatnonzero(
            np.abs(along[:, k]) > _PART * np.abs(along[:, k]).max()
        )
        if len(members) > 1:
            among = tuple(names[member] for member in members)
            result.append((rule, Gauge(names[rule], among)))
    return result


def _lost(shapes: Shapes, parts: Float[np.ndarray, "m h"]) -> Bool[np.ndarray, " n"]:
    """Return the unknowns with a part in directions, judged within their block."""
    result = np.zeros(len(shapes.basis), bool)
    for block in range(int(shapes.owner.max()) + 1):
        own = shapes.owner == block
        moves = np.abs(shapes.basis[:, own] @ parts[own])
        result |= (moves > _VALUE * moves.max(axis=0, initial=1e-300)).any(axis=1)
    return result


def _groups(
    parts: Float[np.ndarray, "m h"], shapes: Shapes, blocks: Sequence[AbstractBlock]
) -> tuple[Undetermined, ...]:
    """Return what is hidden, shapes that share a direction together."""
    part = (parts != 0.0).astype(float)
    directions: dict[tuple[int, ...], int] = {}
    members: dict[tuple[int, ...], list[int]] = {}
    count, group = connected_components(part @ part.T)
    for number in range(count):
        own = np.flatnonzero(group == number)
        along = int(part[own].any(axis=0).sum())
        owners = tuple(dict.fromkeys(shapes.owner[own].tolist()))
        if along:
            directions[owners] = directions.get(owners, 0) + along
            members[owners] = sorted([*members.get(owners, []), *own.tolist()])
    result = []
    for owners, shared in members.items():
        labels = [
            tuple(
                dict.fromkeys(
                    shapes.labels[k] for k in shared if shapes.owner[k] == one
                )
            )
            for one in owners
        ]
        named = zip((blocks[one].name for one in owners), labels, strict=True)
        tools = all(blocks[one].by_tools for one in owners)
        result.append(Undetermined(tuple(named), directions[owners], tools))
    return tuple(result)

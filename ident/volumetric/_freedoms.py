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
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from ..core import Readings, Stack, rooted
from ..fit._identifiable import pins_of, pivoted
from ..fit.joint._gauge import Rules
from ._blocks import FRAME_NAME, ZEROS_NAME, Block
from ._effects import SAME
from ._points import readings_at

_LITTLE = 1e-3
"""Information on a mixture, relative to as many readings all over the volume, that is none."""
_SHOWN = 10.0 * _LITTLE
"""The same, from which on other readings are a remedy: not by chance."""
_SHORT = 0.1
"""Share of a travel without points at an end from which on they do not reach to it."""
_PART, _MEMBER = 1e-4, 0.1
"""Part in a direction, relative to the largest, from which on a shape is a member: of a gauge,
of what is hidden, which is known less sharply."""
_MOVED = 0.1
"""Share of a typical reading by which what is hidden may move a sum that counts as shown."""
_VALUE = 1e-3
"""Part of a value in a hidden direction, relative to the largest of its block."""
_ROUNDING = 1e-10
"""Information, relative to a shape's own, that keeps ideal information invertible."""
_DEGREE = 2, 4
"""Of the shapes by which a function is judged: at least, at most."""
_ROWS_PER_SHAPE, _MORE_ROWS = 8, 500


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
        turned: Whether readings at these points in other directions would show it.
        ends: Axes out to whose ends one must measure; none: places between these points do.
    """

    shapes: tuple[tuple[str, tuple[str, ...]], ...]
    directions: int
    tools: bool
    turned: bool = False
    ends: tuple[str, ...] = ()

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
        names: Block and label of each shape.
        free: Whether no prior holds it.
        order: Numbers of the shapes, those that give way first in front.
    """

    basis: Float[np.ndarray, "n m"]
    names: tuple[tuple[str, str], ...]
    free: Bool[np.ndarray, " m"]
    order: Int[np.ndarray, " m"]

    def of_blocks(self, *names: str) -> Bool[np.ndarray, " m"]:
        """Return which shapes are those of some blocks."""
        return np.isin([name for name, _ in self.names], names)

    @classmethod
    def of(cls, blocks: Sequence[Block]) -> "Shapes":
        """Return the shapes of blocks."""
        priority = [block.priority for block in blocks for _ in block.labels]
        return cls(
            np.asarray(scipy.linalg.block_diag(*(block.basis for block in blocks))),
            tuple((block.name, label) for block in blocks for label in block.labels),
            np.concatenate([block.free for block in blocks]),
            np.argsort(priority, kind="stable"),
        )


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Freedoms:
    """Rules of the gauge, and what points leave open beside them.

    Attributes:
        rules: Directions that neither points nor priors hold, and what fixes them.
        pins: What is added to the diagonal of the information to hold these directions.
        hidden: Directions of the unknowns, under the rules, of which the points show next to
            nothing; each moves a reading somewhere in the volume by about 1.
        along: How far unknowns go along each of them, as far as it is the machine's.
        share: Information of the points on each, relative to as many all over the volume.
        confounded: Whether each unknown has a part in them.
        gauges: The rules.
        undetermined: What is hidden.
        free: Number of directions that no prior holds and the points tell.
    """

    rules: Rules
    pins: Float[np.ndarray, " n"]
    hidden: Float[np.ndarray, "n h"]
    along: Float[np.ndarray, "h n"]
    share: Float[np.ndarray, " h"]
    confounded: Bool[np.ndarray, " n"]
    gauges: tuple[Gauge, ...]
    undetermined: tuple[Undetermined, ...]
    free: int

    def shown(self, rows: sp.csr_array) -> Bool[np.ndarray, " t"]:
        """Return whether sums of the unknowns keep clear of all that is hidden."""
        return np.asarray(np.linalg.norm(rows @ self.hidden, axis=1) <= _MOVED)

    def held(
        self,
        values: Float[np.ndarray, " n"],
        noise: float,
        readings: Float[np.ndarray, " t"],
    ) -> Float[np.ndarray, " n"]:
        """Return unknowns with what is hidden only as far as the readings show it.

        Noise, and the zero of a set-up, move a direction far of which readings show next to
        nothing. Its mean is taken under what they show and that it is about their size.

        Args:
            values: Unknowns.
            noise: Standard deviation of a reading.
            readings: What was measured, less the zero of each set-up.
        """
        expected = float(np.mean(np.square(readings)))
        known = expected * len(readings) * np.maximum(self.share, 0.0)
        left = noise**2 / np.maximum(noise**2 + known, 1e-300)
        return np.asarray(values - self.hidden @ (left * (self.along @ values)))

    @classmethod
    def of(
        cls,
        stack: Stack,
        blocks: Sequence[Block],
        readings: Readings,
        volume: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    ) -> "Freedoms":
        """Return the freedoms of blocks at readings; the volume is where they could stand."""
        shapes = Shapes.of(blocks)
        count = _ROWS_PER_SHAPE * len(shapes.names) + _MORE_ROWS
        varied = _varied(readings, volume, count)
        place = readings.inputs["position"]
        box = place.min(axis=0), place.max(axis=0)
        beyond = np.abs(np.subtract(volume, box)).max(axis=0)
        lacking = beyond > _SHORT * np.subtract(*reversed(volume))
        short = tuple(axis for axis, lacks in zip("XYZ", lacking, strict=True) if lacks)
        actual, ideal = (_Seen.of(stack, shapes, rows) for rows in (readings, varied))
        common, unheld = ideal.null(shapes.free), actual.null(shapes.free)
        zero = _given_way(common, shapes.order)
        # Set-ups that stand anywhere take up the frame: no error of the machine either.
        frame, zeros = shapes.of_blocks(FRAME_NAME), shapes.of_blocks(ZEROS_NAME)
        if zeros.any():
            rigid = actual.null(frame | zeros) * (ideal.scale / actual.scale)[:, None]
            rigid /= np.linalg.norm(rigid, axis=0)
            common = scipy.linalg.orth(np.hstack([common, rigid]), _PART)
            order = [*zero, *np.flatnonzero(frame)]
            zero = _given_way(common, np.array(order, np.int64))
        held = _given_way(unheld, np.array([*zero, *shapes.order], np.int64))
        null = shapes.basis @ (unheld / actual.scale[:, None])
        gauges = _gauges(common, zero, shapes.names)
        kept = np.delete(np.arange(len(shapes.names)), [rule for rule, _ in gauges])
        hidden, share = actual.hidden(ideal, kept)
        # Of what is hidden as little as may be is the machine's; a set-up has any zero.
        machine = np.where(frame | zeros, 0.0, 1.0 / ideal.scale)
        metric = ideal.matrix * np.outer(machine, machine) @ hidden
        dual = metric @ np.linalg.pinv(hidden.T @ metric, _ROUNDING, hermitian=True)
        mixtures = _resolved(hidden)
        least = _MEMBER * np.abs(mixtures).max(axis=0, initial=0.0)
        parts = np.where(np.abs(mixtures) > least, mixtures, 0.0)
        turned, inside = (
            _Seen.of(stack, shapes, rows).shows(mixtures, ideal)
            for rows in (_turned(readings, varied), _varied(readings, box, count))
        )
        return cls(
            rules=Rules(null, shapes.basis[:, held].T),
            pins=pins_of(null, actual.diagonal),
            hidden=shapes.basis @ (hidden / ideal.scale[:, None]),
            along=(shapes.basis @ (dual * ideal.scale[:, None])).T,
            share=share,
            confounded=_confounded(shapes, parts),
            gauges=tuple(gauge for _, gauge in gauges),
            undetermined=_groups(
                parts, shapes, blocks, turned, [() if k else short for k in inside]
            ),
            free=int(shapes.free.sum()) - len(held),
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
        rows = rows_of(stack, readings)
        columns = rows @ shapes.basis
        return cls(columns.T @ columns / len(columns), (rows * rows).sum(axis=0))

    @cached_property
    def scale(self) -> Float[np.ndarray, " m"]:
        """What each shape does to a row, root mean square; 1 where it does nothing."""
        size = np.sqrt(np.diag(self.matrix))
        return np.where(size > 0.0, size, 1.0)

    def null(self, kept: Bool[np.ndarray, " m"]) -> Float[np.ndarray, "m g"]:
        """Return mixtures of some shapes that no row shows, in their `scale`."""
        unit = self.matrix / np.outer(self.scale, self.scale)
        _, some = rooted(unit[np.ix_(kept, kept)])
        result = np.zeros((len(kept), some.shape[1]))
        result[kept] = some
        return result

    def shows(
        self, mixtures: Float[np.ndarray, "m h"], ideal: "_Seen"
    ) -> Bool[np.ndarray, " h"]:
        """Return which mixtures, in the scale of ideal rows, these rows show well enough."""
        unit = mixtures / ideal.scale[:, None]
        here, there = (np.sum(unit * (o.matrix @ unit), axis=0) for o in (self, ideal))
        return np.asarray(here >= _SHOWN * there)

    def hidden(
        self, ideal: "_Seen", kept: Int[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "m h"], Float[np.ndarray, " h"]]:
        """Return mixtures of which these rows show next to nothing beside ideal ones.

        In the scale of the ideal rows; each moves such a row by 1, root mean square, if it
        shows it at all. With them the information on each, relative to ideal rows.
        """
        here, unit = np.ix_(kept, kept), np.outer(ideal.scale[kept], ideal.scale[kept])
        whole = ideal.matrix[here] / unit
        # What not even ideal rows show counts as such a row as well.
        whole += np.diag(np.where(np.diag(whole) > 0.0, _ROUNDING, 1.0))
        share, modes = scipy.linalg.eigh(self.matrix[here] / unit, whole)
        few = share < _LITTLE
        result = np.zeros((len(self.matrix), int(few.sum())))
        result[kept] = modes[:, few]
        return result, share[few]


def rows_of(stack: Stack, readings: Readings) -> sp.csr_array:
    """Return the rows of a stack without their zeros, few as they are."""
    return sp.csr_array(stack.matrix(readings))


def degrees_of(place: Float[np.ndarray, "t 3"]) -> list[int]:
    """Return the degree of shapes along each axis: what so many positions can show, and a curve."""
    result = []
    for along in place.T:
        step = max(SAME * float(np.ptp(along)), 1e-9)
        count = len(np.unique(np.round((along - along.min()) / step)))
        result.append(int(np.clip(count - 1, *_DEGREE)))
    return result


def _varied(
    readings: Readings,
    volume: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    count: int,
) -> Readings:
    """Return readings at random places of a volume, in all directions and set-ups.

    Tools vary where they varied.
    """
    rng = np.random.default_rng(0)
    tool, runs = readings.inputs["tool"], readings.inputs["run"]
    along = rng.normal(size=(count, 3))
    return readings_at(
        rng.uniform(*volume, (count, 3)),
        along / np.linalg.norm(along, axis=1)[:, None],
        tool.mean(axis=0) + tool.std(axis=0) * rng.normal(size=(count, 3)),
        rng.integers(0, runs.max() + 1, count),
    )


def _turned(readings: Readings, varied: Readings) -> Readings:
    """Return readings at the same points, in the directions of others."""
    rows = np.random.default_rng(0).integers(0, len(readings), len(varied))
    inputs = {**readings.take(rows).inputs, "along": varied.inputs["along"]}
    return readings_at(**inputs)


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
    """Return mixtures of directions with as few members as may be."""
    if not directions.shape[1]:
        return directions
    own = pivoted(directions.T)[2][: directions.shape[1]]
    return np.asarray(np.linalg.solve(directions[own].T, directions.T).T)


def _gauges(
    null: Float[np.ndarray, "m g"],
    rules: Sequence[int],
    names: Sequence[tuple[str, str]],
) -> list[tuple[int, Gauge]]:
    """Return the rules, each with what its direction moves; what nothing shows is none."""
    if not rules:
        return []
    # One direction per rule: along it the other rules stay at zero.
    along = np.linalg.solve(null[rules].T, null.T).T
    result = []
    for rule, moved in zip(rules, np.abs(along).T, strict=True):
        members = np.flatnonzero(moved > _PART * moved.max())
        if len(members) > 1:
            among = tuple(dict.fromkeys(names[member] for member in members.tolist()))
            result.append((rule, Gauge(names[rule], among)))
    return result


def _confounded(
    shapes: Shapes, parts: Float[np.ndarray, "m h"]
) -> Bool[np.ndarray, " n"]:
    """Return the unknowns with a part in directions, judged within their block."""
    result = np.zeros(len(shapes.basis), bool)
    owners = np.array([name for name, _ in shapes.names])
    for block in np.unique(owners):
        own = owners == block
        moves = np.abs(shapes.basis[:, own] @ parts[own])
        result |= (moves > _VALUE * moves.max(axis=0, initial=1e-300)).any(axis=1)
    return result


def _groups(
    parts: Float[np.ndarray, "m h"],
    shapes: Shapes,
    blocks: Sequence[Block],
    turned: Bool[np.ndarray, " h"],
    ends: Sequence[tuple[str, ...]],
) -> tuple[Undetermined, ...]:
    """Return what is hidden, shapes that share a direction together, and what shows it."""
    part = (parts != 0.0).astype(float)
    by_tools = {block.name for block in blocks if block.by_tools}
    members: dict[tuple[str, ...], list[int]] = {}
    count, group = connected_components(part @ part.T)
    for number in range(count):
        own = np.flatnonzero(group == number).tolist()
        owners = tuple(dict.fromkeys(shapes.names[k][0] for k in own))
        # Zeros that nothing else hangs on are no error of the machine.
        if part[own].any() and owners != (ZEROS_NAME,):
            members.setdefault(owners, []).extend(own)
    result = []
    for owners, shared in members.items():
        names = [shapes.names[k] for k in sorted(shared)]
        named = tuple(
            (one, tuple(dict.fromkeys(label for name, label in names if name == one)))
            for one in owners
        )
        along = np.flatnonzero(part[shared].any(axis=0)).tolist()
        result.append(
            Undetermined(
                shapes=named,
                directions=len(along),
                tools=by_tools >= {*owners},
                turned=bool(turned[along].all()),
                ends=max((ends[k] for k in along), key=len),
            )
        )
    return tuple(result)

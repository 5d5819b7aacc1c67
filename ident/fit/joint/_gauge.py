"""Freedoms of the sum, and the rules that fix them.

Freedoms are found from the information of rows in which everything varies by itself. The
effects give way in the order of `Rank`: by having mean zero over the readings along every shape
that a simpler one can carry; a temperature by correcting nothing at its reference temperature.

A large plane is represented by all curves over either master and by smooth surfaces: what it
can share with another effect is a curve or smooth.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float
from numpy.polynomial import legendre
from scipy.sparse.linalg import spsolve

from ..._recording import JointData
from ...core import AbstractPrior, rooted
from ...core._regression import SINGULAR
from .._identifiable import Shapes, pivoted
from ._design import Design, design_of
from ._effect import Rank

_NOTHING = 1e-7
"""Size of a direction, relative to all, below which a component has no part in it."""
_APART = float(np.sqrt(SINGULAR))
"""Size of what a direction that rows leave open has beside those of any data: less is what
rounding makes of weak information."""
_ANY_SIZE = -1.0, 1.0
"""Range of an input that makes a difference at any size."""
_DEGREE = 4
"""Of the smooth surfaces along each master."""
_ROWS_PER_VALUE, _MORE_ROWS = 8, 500
_MOVED = 0.1
"""Share of its tables over which an axis must have moved for its range to count."""


def shapes_of(design: Design, smooth: bool) -> Shapes:
    """Return the shapes of the stated components on the values that rows of a design reach.

    ``smooth`` adds smooth surfaces of large planes, and takes only what readings tell; else whole
    lines of nodes count as reached.
    """
    reached = design.reached if smooth else design.diagonal > 0
    basis = []
    for component in design.stated:
        inside = reached[component.places]
        basis.append(
            np.eye(len(inside))[:, inside]
            if component.table is None
            else _plane_shapes(component.table.nodes, inside, smooth)
        )
    ranks = [component.rank for component in design.stated]
    matrix = design.over(design.spread(basis))
    return Shapes(tuple(basis), matrix, ranks.index(Rank.DATUM))


def _plane_shapes(
    nodes: Sequence[np.ndarray], reached: Bool[np.ndarray, " p"], smooth: bool
) -> Float[np.ndarray, "p m"]:
    fast, slow = (len(line) for line in nodes)
    parts = [
        np.kron(np.eye(slow), np.ones((fast, 1))),
        np.kron(np.ones((slow, 1)), np.eye(fast)),
    ]
    if smooth:
        lines = (np.linspace(-1.0, 1.0, count) for count in (slow, fast))
        first, second = (legendre.legvander(line, _DEGREE)[:, 1:] for line in lines)
        parts.append(np.kron(first, second))
    else:
        grid = reached.reshape(slow, fast)
        reached = np.outer(grid.any(axis=1), grid.any(axis=0)).reshape(-1)
    basis, size, _ = pivoted(np.where(reached[:, None], np.hstack(parts), 0.0))
    return np.asarray(basis[:, size > 1e-9 * max(size.max(initial=0.0), 1e-300)])


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Rules:
    """Directions that may be moved, and what fixes them.

    Attributes:
        null: One direction per column, shape ``(n, g)``.
        functionals: Zero under the rule, shape ``(q, n)``.
    """

    null: Float[np.ndarray, "n g"]
    functionals: Float[np.ndarray, "q n"]

    @classmethod
    def of(cls, design: Design, ideal: Shapes) -> "Rules":
        """Return the freedoms of the sum in any data, and the rule that fixes them."""
        null = design.spread(ideal.basis) @ rooted(ideal.matrix)[1]
        for component, basis in zip(design.stated, ideal.basis, strict=True):
            prior, places = component.prior, component.places
            if prior is not None and null.shape[1]:
                reached = np.asarray(basis.any(axis=1))
                null[places] = _carried_on(prior, reached, null[places])
        return cls(null, _eliminated(design, null))

    @cached_property
    def gain(self) -> Float[np.ndarray, "g n"]:
        """How far each direction is moved, per unknown."""
        inverse = np.linalg.pinv(self.functionals @ self.null, rcond=1e-9)
        return np.asarray(inverse @ self.functionals)

    def project(self, theta: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return values, or columns of them, under the rule; their sum stays what it is."""
        return np.asarray(theta - self.null @ (self.gain @ theta))

    def beside(self, design: Design) -> "Rules":
        """Return the rules with directions beside them that rows of a design leave open."""
        unheld = design.unheld
        if not unheld.shape[1]:
            return self
        # Each unknown by what a reading sees of it: values may be lengths, rates, coefficients.
        scale = np.where(design.diagonal > 0, np.sqrt(design.diagonal), 1.0)[:, None]
        scale /= np.sqrt(max(len(design.rows), 1))
        known, new = self.null * scale, unheld * scale
        excess = new - known @ np.linalg.lstsq(known, new, rcond=None)[0]
        basis, sizes, _ = pivoted(excess / np.linalg.norm(new, axis=0))
        # The new ones begin where the rule so far puts them.
        free = self.project(basis[:, sizes > _APART] / scale)
        fixed = _eliminated(design, free)
        return Rules(np.hstack([self.null, free]), np.vstack([self.functionals, fixed]))


def _eliminated(
    design: Design, null: Float[np.ndarray, "n g"]
) -> Float[np.ndarray, "q n"]:
    """Return functionals that fix null directions, the least simple effect giving way first."""
    remaining = null / np.maximum(np.linalg.norm(null, axis=0), 1e-300)
    touched = np.asarray(abs(design.columns).sum(axis=0)) / len(design.rows)
    rows: list[Float[np.ndarray, "_ n"]] = [np.zeros((0, design.size))]
    for part in sorted(reversed(design.components), key=lambda part: part.rank):
        if not remaining.shape[1]:
            break
        block = remaining[part.places]
        # A plane has very many values: only the right side is ever wanted whole.
        full = block.shape[0] < block.shape[1]
        left, size, right = np.linalg.svd(block, full_matrices=full)
        most = float(size.max(initial=0.0))
        rank = int((size > _NOTHING * most).sum()) if most > _NOTHING else 0
        if not rank:
            continue
        weights = part.reference if rank == 1 else None
        if weights is None:
            seen = touched[part.places]
            if part.rank == Rank.RUNS:
                seen = design.counts_of_runs(seen)
            weights = left[:, :rank].T * seen
        functional = np.zeros((rank, design.size))
        functional[:, part.places] = weights
        rows.append(functional)
        remaining = remaining @ right[rank:].T
    return np.vstack(rows)


def _carried_on(
    prior: AbstractPrior,
    reached: Bool[np.ndarray, " p"],
    null: Float[np.ndarray, "p g"],
) -> Float[np.ndarray, "p g"]:
    """Return directions that go on beyond the values that rows reach, bent the least."""
    rows = [prior.rows[k] for k in np.flatnonzero(~prior.optional)]
    bent, result = sp.vstack(rows).tocsc(), null.copy()
    beyond, fixed = bent[:, ~reached], bent[:, reached] @ null[reached]
    if beyond.shape[1]:
        carried = spsolve((beyond.T @ beyond).tocsc(), -(beyond.T @ fixed))
        result[~reached] = carried.reshape(-1, null.shape[1])
    return result


def ideal_shapes(design: Design) -> Shapes:
    """Return the shapes with the information of rows in which everything varies by itself.

    Places, directions, accelerations, temperatures and runs are random. The axes move where they
    moved in the data: what is alike there may be exchanged there.
    """
    data, rng = design.data, np.random.default_rng(0)
    sizes = [
        len(part.places) if part.table is None else sum(map(len, part.table.nodes))
        for part in design.stated
    ]
    count = _ROWS_PER_VALUE * sum(sizes) + _MORE_ROWS
    channels: dict[str, dict[str, np.ndarray]] = {}
    for key in dict.fromkeys(key for each in design.effects for key in each.inputs):
        channel, name = key
        ranges = [each.ranges[key] for each in design.effects if key in each.ranges]
        lows, highs = zip(*(ranges or [_ANY_SIZE]), strict=True)
        low, high = min(lows), max(highs)
        if channel == "position" and name in data.position:
            place = data.position[name][design.rows]
            place = place[np.isfinite(place)]
            if len(place) and np.ptp(place) > _MOVED * (high - low):
                low, high = float(place.min()), float(place.max())
        values = rng.uniform(low, high, count)
        if channel == "direction":
            values = np.sign(values)
        channels.setdefault(channel, {})[name] = values
    clock = np.zeros(0) if data.time is None else data.time[np.isfinite(data.time)]
    began, ended = (clock.min(), clock.max()) if len(clock) else (0.0, 1.0)
    runs = design.course.runs
    time = rng.uniform(began, ended, count)
    run = rng.choice(np.array(runs), count) if runs else None
    varied = JointData(**channels, time=time, run=run, clock_number=None, own_zero=None)
    effects = [
        effect.lagging(dict.fromkeys(effect.sensor_names, 0.0))
        for effect in design.effects
    ]
    pieces = design.course.pieces
    ideal = design_of(design.axis, effects, varied, pieces, measured=False)
    return shapes_of(ideal, smooth=False)

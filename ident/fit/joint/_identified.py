"""What the rows of one axis identify: freedoms of the sum, and what they cannot tell apart.

Freedoms are there in any data, and fixed by rules (`_gauge`). Beyond them the actual rows may
confuse effects, or show one of them nowhere. All of it is numbers; `_words` says it.
"""

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from .._identifiable import Correlations, Shared
from ._data import JointData
from ._design import Component, Design
from ._gauge import Rules, Shapes, Unheld, ideal_shapes, priority

_SAME = 2e-7
"""Share of a shape left beside another below which they are one in any data."""
_HOPELESS = 1e-4
"""Share of a shape left beside another effect below which it is lost, however many readings."""
_ALIKE = 0.04
"""Share from which on nothing is called lost, however few readings."""
_SURE = 4.0
"""Readings × share below which the amount of a shape is not known to half the noise."""
_PART = 1e-2
"""Part of a value in a lost shape, relative to the largest, that makes it unknown."""
_MOSTLY = 0.3
"""The same for a node of a table in what no reading shows: neighbours fill the rest."""
_FEW, _LIGHT = 3.0, 1e-2
"""Readings per shape below which neighbours must help, and the weight of second differences,
relative to the density, with which they do."""
_SLOW = 1.0
"""That weight for the pieces of a drift, which is slow or no drift."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Freedom:
    """Shapes that may be moved between two components in any data.

    Attributes:
        simple: The component that carries them.
        other: The component that gives way.
        count: How many shapes.
    """

    simple: Component
    other: Component
    count: int


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Confused:
    """Components that share shapes in these rows; with the datum: that are constant.

    Attributes:
        parts: Two components or more, the simplest first.
        correlation: Of the shape that they share most, 0 to 1.
        values: Size of each unknown in these shapes, relative to the largest of its
            component, shape ``(n,)``.
        count: How many shapes.
    """

    parts: tuple[Component, ...]
    correlation: float
    values: Float[np.ndarray, " n"]
    count: int

    @property
    def lost(self) -> Bool[np.ndarray, " n"]:
        """Unknowns with a part in these shapes."""
        return np.asarray(self.values > _PART)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Identified:
    """One axis before its errors are looked at.

    Attributes:
        design: Columns.
        unheld: What nothing holds.
        ideal: Shapes of the components where everything varies by itself.
        structure: Freedoms of the sum with their rules.
        rules: Those, and what the rows leave open besides.
        share: Information left, relative to the effect alone, per stated component.
        hidden: Unknowns that no reading tells within their own component.
        confused: What these rows do not tell apart.
        nearly: Pairs of tables that would be as alike in any data, but for their nodes.
    """

    design: Design
    unheld: Unheld
    ideal: Shapes
    structure: Rules
    rules: Rules
    share: tuple[float, ...]
    hidden: Bool[np.ndarray, " n"]
    confused: tuple[Confused, ...]
    nearly: tuple[Confused, ...]

    def share_of(self, number: int) -> float:
        """Return the information left of an effect: of its weaker law for a temperature."""
        stated = zip(self.share, self.design.stated, strict=True)
        return min(share for share, part in stated if part.effect == number)

    @cached_property
    def lost(self) -> Bool[np.ndarray, " n"]:
        """Unknowns that readings reach and confuse."""
        design = self.design
        result = np.zeros(design.size, bool)
        for each in self.confused:
            result |= each.lost & design.reached
        for part in design.components:
            own = part.places
            if part.prior is None:
                # In a table neighbours bridge what no reading tells; a law has none.
                result[own] |= (self.hidden & design.reached)[own]
            if part.kind.startswith("temperature") and result[own].any():
                # What the rule put to zero is no more known than the rest of the law.
                result[own] = True
        return result

    @property
    def unknown(self) -> Bool[np.ndarray, " n"]:
        """Unknowns that are not known: confused, hidden or out of reach."""
        return np.asarray(self.lost | self.hidden | ~self.design.reached)

    @cached_property
    def freedoms(self) -> tuple[tuple[Component, ...], tuple[Freedom, ...]]:
        """Components that hold a constant, and what else pairs may exchange in any data.

        What a third, simpler one carries for both is stated with that one.
        """
        parts, design = self.ideal.parts, self.design
        found = _correlations(self.ideal, _SAME)
        level = tuple(parts[each.members[0]] for each in found.constants)
        pairs = {pair.members: pair for pair in found.pairs(_SAME)}
        rank = [priority(part, design) for part in parts]

        def carried(first: int, second: int) -> bool:
            return any(
                {(min(k, third), max(k, third)) for k in (first, second)} <= set(pairs)
                for third in range(len(parts))
                if rank[third] > max(rank[first], rank[second])
            )

        freedoms = []
        for (first, second), pair in pairs.items():
            if not carried(first, second):
                simple, other = sorted((first, second), key=lambda k: -rank[k])
                freedoms.append(Freedom(parts[simple], parts[other], pair.count))
        return level, tuple(freedoms)


def identified(
    design: Design, unheld: Unheld, data: JointData, drift: int
) -> Identified:
    """Return what the rows of an axis tell of its unknowns.

    Args:
        design: Columns.
        unheld: What neither rows nor smoothness hold.
        data: All rows.
        drift: Pieces of the drift of each run.
    """
    ideal = ideal_shapes(design, data, drift)
    structure = Rules.of(design, ideal)
    shapes = Shapes.of(design, smooth=True).limited(structure.functionals)
    matrix = shapes.matrix + _light(design, shapes)
    shapes = dataclasses.replace(shapes, matrix=matrix)
    limit = min(max(_HOPELESS, _SURE / len(design.rows)), _ALIKE)
    found = _correlations(shapes, limit, design.diagonal)

    def confused(each: Shared) -> Confused:
        values = np.zeros(design.size)
        for k, mixtures in zip(each.members, each.mixtures, strict=True):
            size = np.linalg.norm(shapes.basis[k] @ mixtures, axis=1)
            values[shapes.parts[k].places] = size / max(size.max(initial=0.0), 1e-300)
        parts = tuple(shapes.parts[k] for k in each.members)
        return Confused(parts, each.correlation, values, each.count)

    def alike_anyway(pair: Confused) -> bool:
        """Tell whether two tables are as alike where everything varies: by their nodes."""
        both = ideal.named([part.name for part in pair.parts])
        both = both.limited(structure.functionals)
        shared = _correlations(both, limit).pairs(limit)
        return sum(each.count for each in shared) >= pair.count

    pairs = found.pairs(limit) if found.weakest < limit else []
    nearly = {
        k: each for k, each in enumerate(map(confused, pairs)) if alike_anyway(each)
    }
    told = [each for k, each in enumerate(pairs) if k not in nearly]
    several = found.several(min(limit, _HOPELESS), pairs)
    return Identified(
        design=design,
        unheld=unheld,
        ideal=ideal,
        structure=structure,
        rules=structure.beside(design, unheld.null),
        share=_shares(found, shapes, design),
        hidden=_hidden(found, shapes, design.size),
        confused=tuple(map(confused, (*found.constants, *told, *several))),
        nearly=tuple(nearly.values()),
    )


def _correlations(
    shapes: Shapes, limit: float, diagonal: Float[np.ndarray, " n"] | None = None
) -> Correlations:
    typical = []
    if diagonal is not None:
        own = [diagonal[part.places] for part in shapes.parts]
        typical = [float(each.max(initial=0.0)) for each in own]
    return Correlations.of(shapes.matrix, shapes.slices, shapes.datum, limit, typical)


def _light(design: Design, shapes: Shapes) -> Float[np.ndarray, "m m"]:
    """Return what is taken as known: a drift is slow, and neighbours help where data are few."""
    few = len(design.rows) < _FEW * len(shapes.matrix)
    result = np.zeros_like(shapes.matrix)
    for part, basis, own in zip(shapes.parts, shapes.basis, shapes.slices, strict=True):
        amount = _SLOW if part.kind == "runs" else _LIGHT * few
        if part.prior is None or not amount:
            continue
        diagonal = design.diagonal[part.places]
        density = float(diagonal[diagonal > 0].mean()) if diagonal.any() else 1.0
        for rows in (part.prior.rows[k] for k in np.flatnonzero(~part.prior.optional)):
            bent = rows @ basis
            result[own, own] += amount * density * (bent.T @ bent)
    return result


def _hidden(found: Correlations, shapes: Shapes, size: int) -> Bool[np.ndarray, " n"]:
    """Return the unknowns with a part in shapes of one component that no reading shows."""
    result = np.zeros(size, bool)
    for part, basis, own, each in zip(
        shapes.parts, shapes.basis, shapes.slices, found.alone, strict=True
    ):
        if each.shape[1] == basis.shape[1]:
            continue
        # What is left of every value when all visible shapes are taken off.
        visible = each @ (each.T @ shapes.matrix[own, own])
        left = np.linalg.norm(basis - basis @ visible, axis=1)
        whole = np.linalg.norm(basis, axis=1)
        limit = _PART if part.prior is None else _MOSTLY
        result[part.places] = left > limit * np.maximum(whole, 1e-300)
    return result


def _shares(found: Correlations, shapes: Shapes, design: Design) -> tuple[float, ...]:
    """Return the mean information left; what no reading reaches counts as none."""
    result = []
    for part, basis, left in zip(shapes.parts, shapes.basis, found.left(), strict=True):
        reached, count = design.reached[part.places], basis.shape[1]
        # Without a shape of its own, all that it can do is carried by a simpler effect.
        mean = min(left / count, 1.0) if count else float(reached.any())
        result.append(mean * (float(reached.mean()) if count else 1.0))
    return tuple(result)

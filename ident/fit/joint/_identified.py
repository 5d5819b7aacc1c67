"""What the rows of one axis identify: freedoms of the sum, and what they cannot tell apart.

Beyond the freedoms (`_gauge`) the rows may confuse effects, or show one of them nowhere. All of
it is numbers; `_words` says it.
"""

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from ...core import Posterior
from .._identifiable import Correlations, Shapes, Shared
from ._design import Design
from ._effect import Rank
from ._gauge import Rules, ideal_shapes, shapes_of

_SAME = 2e-7
"""Share of a shape left beside another below which they are one in any data."""
_HOPELESS = 1e-4
"""Share of a shape left beside another effect below which it is confounded with that."""
_ALIKE = 0.04
"""Share from which on nothing counts as confounded, however few readings."""
_SURE = 4.0
"""Readings × share below which the amount of a shape is not known to half the noise."""
PART = 1e-2
"""Part of a value in a confounded shape, relative to the largest, that makes it unknown."""
_MOSTLY = 0.3
"""The same for a node of a table in what no reading shows: neighbours fill the rest."""
_FEW, _LIGHT = 3.0, 1e-2
"""Readings per shape below which neighbours must help, and the weight of second differences,
relative to the density, with which they do."""
_SLOW = 1.0
"""That weight for the pieces of a drift, which is slow or no drift."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Identified:
    """One axis before its errors are looked at.

    Attributes:
        design: Columns.
        ideal: Shapes of the components where everything varies by itself.
        rules: Freedoms of the sum with their rules, and what the rows leave open besides.
        share: Information left, relative to the effect alone, per stated component.
        hidden: Unknowns that no reading tells within their own component.
        confused: What these rows do not tell apart; members are stated components.
        nearly: Pairs of tables that would be as alike in any data, but for their nodes.
    """

    design: Design
    ideal: Shapes
    rules: Rules
    share: tuple[float, ...]
    hidden: Bool[np.ndarray, " n"]
    confused: tuple[Shared, ...]
    nearly: tuple[Shared, ...]

    def variances(self, post: Posterior) -> Float[np.ndarray, " n"]:
        """Return the variance of each unknown under the rules, per variance of one reading."""
        plain, rules = post.inverse_diagonal, self.rules
        spread = post.factor.solve(np.ascontiguousarray(rules.gain.T))
        inner = rules.gain @ spread
        result = plain - 2.0 * (spread * rules.null).sum(axis=1)
        result += ((rules.null @ inner) * rules.null).sum(axis=1)
        return np.asarray(np.maximum(result, 0.0))

    def covariance(
        self, post: Posterior, functionals: Float[np.ndarray, "n k"]
    ) -> Float[np.ndarray, "k k"]:
        """Return the covariance of functionals of the values, per variance of one reading."""
        rules = self.rules
        # Functionals of the values under the rule, as functionals of the values as solved.
        before = functionals - rules.gain.T @ (rules.null.T @ functionals)
        return np.asarray(before.T @ post.factor.solve(before))

    @cached_property
    def confounded(self) -> Bool[np.ndarray, " n"]:
        """Unknowns that readings confuse, and those of laws that none tells."""
        design = self.design
        result = np.zeros(design.size, bool)
        for shared in self.confused:
            for k, size in zip(shared.members, shared.sizes, strict=True):
                result[design.stated[k].places] |= size > PART
        result &= design.reached
        for component in design.components:
            places = component.places
            if component.prior is None:
                # In a table neighbours bridge what no reading tells; a law has none.
                result[places] |= (self.hidden | ~design.reached)[places]
            if component.reference is not None and result[places].any():
                # What the rule put to zero is no more known than the rest of the law.
                result[places] = True
        return result

    @cached_property
    def freedoms(self) -> tuple[tuple[int, ...], tuple[Shared, ...]]:
        """Components that hold a constant, and what else pairs may exchange in any data.

        The simpler one of a pair, that carries what they share, comes first; pairs for which a
        third, still simpler one carries it are left out.
        """
        correlations = Correlations.of(self.ideal, _SAME)
        pairs = correlations.pairs(_SAME)
        rank = [component.rank for component in self.design.stated]

        def carried(pair: tuple[int, int]) -> bool:
            return any(
                all((min(k, third), max(k, third)) in pairs for k in pair)
                for third in range(len(rank))
                if rank[third] > max(rank[k] for k in pair)
            )

        level = tuple(shared.members[0] for shared in correlations.constants)
        direct = [shared for pair, shared in pairs.items() if not carried(pair)]
        return level, tuple(
            dataclasses.replace(
                shared, members=tuple(sorted(shared.members, key=lambda k: -rank[k]))
            )
            for shared in direct
        )


def identified(design: Design) -> Identified:
    """Return what the rows of an axis tell of its unknowns."""
    ideal = ideal_shapes(design)
    structure = Rules.of(design, ideal)
    functionals = [structure.functionals[:, part.places] for part in design.stated]
    shapes = shapes_of(design, smooth=True).limited(functionals)
    matrix = shapes.matrix + _light(design, shapes)
    limit = min(max(_HOPELESS, _SURE / len(design.rows)), _ALIKE)
    correlations = Correlations.of(dataclasses.replace(shapes, matrix=matrix), limit)
    pairs = correlations.pairs(limit)
    # Two tables that are as alike where everything varies differ by their nodes only.
    ideal_pairs = {}
    if pairs:
        ideal_pairs = Correlations.of(ideal.limited(functionals), limit).pairs(limit)
    nearly = [
        pair
        for pair, shared in pairs.items()
        if pair in ideal_pairs and ideal_pairs[pair].count >= shared.count
    ]
    clear = [shared for pair, shared in pairs.items() if pair not in nearly]
    several = correlations.several(min(limit, _HOPELESS), tuple(pairs))
    hidden = np.zeros(design.size, bool)
    for k, component in enumerate(design.stated):
        least = PART if component.prior is None else _MOSTLY
        hidden[component.places] = correlations.hidden(k) > least
    return Identified(
        design=design,
        ideal=ideal,
        rules=structure.beside(design),
        share=_shares(correlations, design),
        hidden=hidden,
        confused=(*correlations.constants, *clear, *several),
        nearly=tuple(pairs[pair] for pair in nearly),
    )


def _light(design: Design, shapes: Shapes) -> Float[np.ndarray, "m m"]:
    """Return what is taken as known: a drift is slow, and neighbours help where data are few."""
    few = len(design.rows) < _FEW * len(shapes.matrix)
    result = np.zeros_like(shapes.matrix)
    components = zip(design.stated, shapes.basis, shapes.slices, strict=True)
    for component, basis, places in components:
        amount = _SLOW if component.rank == Rank.RUNS else _LIGHT * few
        prior = component.prior
        if prior is None or not amount:
            continue
        diagonal = design.diagonal[component.places]
        density = float(diagonal[diagonal > 0].mean()) if diagonal.any() else 1.0
        for rows in (prior.rows[k] for k in np.flatnonzero(~prior.optional)):
            bent = rows @ basis
            result[places, places] += amount * density * (bent.T @ bent)
    return result


def _shares(correlations: Correlations, design: Design) -> tuple[float, ...]:
    """Return the mean information left; what no reading reaches counts as none."""
    result = []
    shapes = zip(correlations.shapes.basis, correlations.remaining(), strict=True)
    for component, (basis, remaining) in zip(design.stated, shapes, strict=True):
        reached, count = design.reached[component.places], basis.shape[1]
        # Without a shape of its own, all that it can do is carried by a simpler effect.
        mean = min(remaining / count, 1.0) if count else float(reached.any())
        result.append(mean * (float(reached.mean()) if count else 1.0))
    return tuple(result)

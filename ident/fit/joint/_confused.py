"""What the actual data cannot tell apart, beyond the freedoms that the sum always has."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ._almost import almost_alike
from ._design import Component
from ._families import Family, families, information
from ._gauges import _whitener
from ._rules import Rules
from ._sums import Information

HOPELESS = 1e-4
"""Share of a shape left beside another effect below which it is lost, however many readings."""
_ALIKE = 0.04
"""Share from which on nothing is called lost, however few readings."""
_SURE = 4.0
"""Readings × share below which the amount of a shape is not known to half the noise."""
_PART = 1e-2
"""Part of a value in a lost shape, relative to the largest, that makes it unknown."""
_MOSTLY = 0.3
"""The same for a node of a table in what no reading shows: neighbours fill the rest."""
_FEW = 3.0
"""Readings per shape below which neighbours must help: nothing would be known otherwise."""
_LIGHT = 1e-2
"""Weight of second differences, relative to the density, with which they do."""
_SLOW = 1.0
"""The same for the pieces of a drift, which is slow or no drift."""


@dataclasses.dataclass(frozen=True, eq=False)
class LostPair:
    """Two components (or more) that share shapes, or one alone that no reading shows.

    Attributes:
        parts: Components, the simplest first.
        correlation: The largest.
        shapes: How many shapes.
        values: Size of each unknown in the lost shapes, relative to the largest of its
            component, shape ``(n,)``.
    """

    parts: tuple[Component, ...]
    correlation: float
    values: Float[np.ndarray, " n"]
    shapes: int = 1


@dataclasses.dataclass(frozen=True)
class Told:
    """What data tell.

    Attributes:
        lost: What they do not.
        share: Information left, relative to the effect alone, by component.
        inner: Unknowns that no reading tells within their own component.
        nearly: Pairs that would be alike in any data, but for their nodes: a freedom.
    """

    lost: tuple[LostPair, ...]
    share: tuple[float, ...]
    inner: Bool[np.ndarray, " n"]
    nearly: tuple[LostPair, ...] = ()


def told_by(sums: Information, rules: Rules) -> Told:
    """Return what readings tell of the effects under the rule, whatever they measured.

    Args:
        sums: Information of the readings.
        rules: Freedoms of the sum and what fixes them.
    """
    design = sums.design
    reached = sums.reached
    shapes = [
        family.limited(rules.functionals[:, family.component.places])
        for family in families(design, reached, smooth=True)
    ]
    matrix, slices = information(sums, shapes)
    few = sums.count < _FEW * len(matrix)
    matrix = matrix + _light(sums, shapes, slices, few)
    plain = [
        _whitener(
            matrix[own, own],
            float(sums.diagonal[family.component.places].max(initial=0.0)),
        )
        for family, own in zip(shapes, slices, strict=True)
    ]
    inner = _inner(design.size, shapes, plain, matrix, slices)
    limit = lost_below(sums.count)
    beside = _beside_the_datum(design.size, matrix, shapes, slices, plain, limit)
    places, first = [], 0
    for each in beside.white:
        places.append(slice(first, first + each.shape[1]))
        first += each.shape[1]
    overall = np.zeros((len(matrix), first))
    for each, own, place in zip(beside.white, slices, places, strict=True):
        overall[own, place] = each
    small = overall.T @ beside.matrix @ overall
    values, vectors = np.linalg.eigh(small)
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    share = tuple(
        _share(inverse[place, place], family, reached)
        for place, family in zip(places, shapes, strict=True)
    )
    lost, nearly = list(beside.lost), list[LostPair]()
    if values.size and values[0] < limit:
        pairs = _pairs(design.size, small, places, beside.white, shapes, limit)
        weak = vectors[:, values < min(limit, HOPELESS)]
        more = _several(design.size, weak, pairs, places, beside.white, shapes)
        nearly = [pair for pair in pairs if _by_nodes(pair, rules, limit)]
        lost += [*(pair for pair in pairs if pair not in nearly), *more]
    return Told(tuple(lost), share, inner, tuple(nearly))


@dataclasses.dataclass(frozen=True)
class _Beside:
    """Shapes with the datum projected out."""

    matrix: Float[np.ndarray, "m m"]
    white: list[np.ndarray]
    lost: tuple[LostPair, ...]


def _beside_the_datum(
    size: int,
    matrix: Float[np.ndarray, "m m"],
    shapes: list[Family],
    slices: list[slice],
    plain: list[np.ndarray],
    limit: float,
) -> _Beside:
    """Project the datum out: a constant is in every effect, and lost in none but a constant.

    Returns:
        Information beside the datum, columns that make it a unit matrix per component, and
        what is nothing but a constant.
    """
    number = next(k for k, each in enumerate(shapes) if each.component.kind == "datum")
    constant = matrix[:, slices[number]][:, 0]
    total = float(constant[slices[number]][0])
    white, lost = [], []
    for k, (family, own, each) in enumerate(zip(shapes, slices, plain, strict=True)):
        if k == number:
            white.append(each[:, :0])
            continue
        along = each.T @ constant[own] / np.sqrt(total)
        length = float(along @ along)
        if length == 0.0:
            white.append(each)
            continue
        unit = along / np.sqrt(length)
        left = 1.0 - length
        if left < limit:
            values = np.zeros(size)
            moved = family.shapes @ (each @ unit[:, None])
            values[family.component.places] = _relative(moved)
            parts = (family.component, shapes[number].component)
            lost.append(LostPair(parts, float(np.sqrt(min(length, 1.0))), values))
            stretch = np.eye(len(unit)) - np.outer(unit, unit)
            basis = np.linalg.eigh(stretch)[1][:, 1:]
            white.append(each @ basis)
            continue
        stretch = (1.0 / np.sqrt(left) - 1.0) * np.outer(unit, unit)
        white.append(each + each @ stretch)
    rest = matrix - np.outer(constant, constant) / total
    return _Beside(rest, white, tuple(lost))


def lost_below(count: int) -> float:
    """Return the share below which a shape is lost, for so many readings."""
    return min(max(HOPELESS, _SURE / count), _ALIKE)


def _share(
    inverse: Float[np.ndarray, "r r"], family: Family, reached: Bool[np.ndarray, " n"]
) -> float:
    """Return the mean information left; what no reading reaches counts as none."""
    own = reached[family.component.places]
    if not own.any():
        return 0.0
    if not family.count:
        return 1.0  # all that it can do is carried by a simpler effect
    left = float(np.trace(np.linalg.inv(inverse))) if len(inverse) else 0.0
    return min(left / family.count, 1.0) * float(own.mean())


def _light(
    sums: Information, shapes: list[Family], slices: list[slice], few: bool
) -> Float[np.ndarray, "m m"]:
    """Return what is taken as known: a drift is slow, and neighbours help where data are few."""
    result = np.zeros((slices[-1].stop, slices[-1].stop))
    for family, own in zip(shapes, slices, strict=True):
        prior = family.component.prior
        amount = _SLOW if family.component.kind == "runs" else _LIGHT * few
        if prior is None or not amount:
            continue
        diagonal = sums.diagonal[family.component.places]
        reached = diagonal[diagonal > 0]
        density = float(reached.mean()) if len(reached) else 1.0
        for rows in (prior.rows[k] for k in np.flatnonzero(~prior.optional)):
            over = rows @ family.shapes
            result[own, own] += amount * density * (over.T @ over)
    return result


def _inner(
    size: int,
    shapes: list[Family],
    white: list[np.ndarray],
    matrix: Float[np.ndarray, "m m"],
    slices: list[slice],
) -> Bool[np.ndarray, " n"]:
    """Return the unknowns with a part in shapes of one component that no reading shows."""
    result = np.zeros(size, bool)
    for family, each, own in zip(shapes, white, slices, strict=True):
        if each.shape[1] == family.count:
            continue
        # What is left of every value when all visible shapes are taken off.
        visible = each @ (each.T @ matrix[own, own])
        hidden = family.shapes @ (np.eye(family.count) - visible)
        part = np.sqrt(np.square(hidden).sum(axis=1))
        whole = np.sqrt(np.square(family.shapes).sum(axis=1))
        limit = _PART if family.component.prior is None else _MOSTLY
        result[family.component.places] = part > limit * np.maximum(whole, 1e-300)
    return result


def _pairs(
    size: int,
    small: Float[np.ndarray, "r r"],
    places: list[slice],
    white: list[np.ndarray],
    shapes: list[Family],
    limit: float,
) -> list[LostPair]:
    result = []
    for second in range(len(shapes)):
        for first in range(second):
            block = small[places[first], places[second]]
            if not block.size:
                continue
            left, strength, right = np.linalg.svd(block, full_matrices=False)
            alike = 1.0 - np.square(np.minimum(strength, 1.0)) < limit
            if not alike.any():
                continue
            values = np.zeros(size)
            for k, side in ((first, left[:, alike]), (second, right[alike].T)):
                moved = shapes[k].shapes @ (white[k] @ side)
                values[shapes[k].component.places] = _relative(moved)
            parts = (shapes[first].component, shapes[second].component)
            result.append(LostPair(parts, float(strength[0]), values, int(alike.sum())))
    return result


def _by_nodes(pair: LostPair, rules: Rules, limit: float) -> bool:
    """Tell whether two tables are as alike where everything varies: then by their nodes."""
    return almost_alike(rules, pair.parts[0], pair.parts[1], limit) >= pair.shapes


def _several(
    size: int,
    weak: Float[np.ndarray, "r w"],
    pairs: list[LostPair],
    places: list[slice],
    white: list[np.ndarray],
    shapes: list[Family],
) -> list[LostPair]:
    """Return what three or more effects share and no two of them explain."""
    known = np.zeros(size, bool)
    for pair in pairs:
        known |= pair.values > _PART
    moved = np.zeros((size, weak.shape[1]))
    for k, family in enumerate(shapes):
        moved[family.component.places] = family.shapes @ (white[k] @ weak[places[k]])
    result = []
    for column in range(weak.shape[1]):
        strength = np.array(
            [float(np.square(weak[place, column]).sum()) for place in places]
        )
        members = np.flatnonzero(strength > 0.05 * strength.max())
        own = np.concatenate([shapes[k].component.places for k in members])
        if len(members) < 3 or known[own].any():
            continue
        values = np.zeros(size)
        for k in members.tolist():
            places_k = shapes[k].component.places
            values[places_k] = _relative(moved[places_k, column : column + 1])
        known |= values > _PART
        parts = tuple(shapes[k].component for k in members)
        result.append(LostPair(parts, 1.0, values))
    return result


def _relative(moved: Float[np.ndarray, "p a"]) -> Float[np.ndarray, " p"]:
    result = np.sqrt(np.square(moved).sum(axis=1))
    return np.asarray(result / max(float(result.max(initial=0.0)), 1e-300))

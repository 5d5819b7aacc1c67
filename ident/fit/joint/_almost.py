"""Tables that can nearly follow each other in any data, because only their nodes differ."""

import numpy as np
from jaxtyping import Float

from ._design import Component
from ._gauges import _whitener
from ._rules import Rules


def almost_alike(
    rules: Rules, first: Component, second: Component, limit: float
) -> int:
    """Return how many shapes two components share but for a little, beyond the rules.

    Tables over the same master with different nodes can nearly follow each other.
    """
    found = {}
    for family, own in zip(rules.shapes, rules.slices, strict=True):
        component = family.component
        if component.name in (first.name, second.name) or component.kind == "datum":
            functionals = rules.functionals[:, component.places]
            found[component.name] = own, family.kernel(functionals)
            if component.kind == "datum":
                found["datum"] = found[component.name]

    def block(one: str, other: str) -> Float[np.ndarray, "_ _"]:
        (rows, left), (columns, right) = found[one], found[other]
        whole = left.T @ rules.matrix[rows, columns] @ right
        return np.asarray(whole)

    total = float(block("datum", "datum")[0, 0])
    names = (first.name, second.name)
    inside = []
    for name in names:
        constant = block(name, "datum")
        white = _whitener(block(name, name) - constant @ constant.T / total)
        inside.append((white, constant))
    (one, low), (other, high) = inside
    across = one.T @ (block(*names) - low @ high.T / total) @ other
    if not across.size:
        return 0
    strength = np.minimum(np.linalg.svd(across, compute_uv=False), 1.0)
    return int((1.0 - np.square(strength) < limit).sum())

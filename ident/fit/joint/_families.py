"""Few shapes of each effect among which freedoms and confusions are looked for.

A curve stands for itself. A large plane is represented by all curves over either master and
by smooth surfaces: what it can share with another effect is a curve or smooth.
"""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float
from numpy.polynomial import legendre

from ...core import Smooth
from ._design import Component, Design
from ._null import pivoted
from ._sums import Information

_DEGREE = 4
"""Of the smooth surfaces along each master."""


@dataclasses.dataclass(frozen=True)
class Family:
    """Shapes of one component.

    Attributes:
        component: Whose.
        shapes: Over its values, one per column.
    """

    component: Component
    shapes: Float[np.ndarray, "p m"]

    @property
    def count(self) -> int:
        """Number of shapes."""
        return int(self.shapes.shape[1])

    def kernel(self, functionals: Float[np.ndarray, "q p"]) -> Float[np.ndarray, "m z"]:
        """Return the mixtures of the shapes that these functionals map to zero."""
        return _kernel(functionals @ self.shapes)

    def limited(self, functionals: Float[np.ndarray, "q p"]) -> "Family":
        """Return the shapes that these functionals map to zero."""
        shapes = self.shapes @ self.kernel(functionals)
        return dataclasses.replace(self, shapes=shapes)


def families(
    design: Design, reached: Bool[np.ndarray, " n"], smooth: bool
) -> list[Family]:
    """Return the shapes of each component on the values that readings reach.

    Args:
        design: Columns.
        reached: Unknowns that any reading touches.
        smooth: Smooth surfaces of large planes as well; without, whole lines of their nodes
            count as reached, however few rows there are.
    """
    result = []
    for component in design.stated:
        own = reached[component.places]
        if design.banded and int(component.places.min()) < design.banded:
            if not smooth:
                own = _lines_reached(component, own)
            shapes = _plane_shapes(component, own, smooth)
        else:
            shapes = np.eye(len(own))[:, own]
        result.append(Family(component, shapes))
    return result


def information(
    sums: Information, shapes: list[Family]
) -> tuple[Float[np.ndarray, "m m"], list[slice]]:
    """Return the information on all shapes, and where those of each component stand."""
    slices, first = [], 0
    for family in shapes:
        slices.append(slice(first, first + family.count))
        first += family.count
    whole = np.zeros((sums.design.size, first))
    for family, own in zip(shapes, slices, strict=True):
        whole[family.component.places, own] = family.shapes
    return sums.over(whole), slices


def _lines_reached(
    component: Component, reached: Bool[np.ndarray, " p"]
) -> Bool[np.ndarray, " p"]:
    """Return the nodes of a plane both of whose lines are reached somewhere."""
    prior = component.prior
    assert isinstance(prior, Smooth)
    assert prior.fast is not None
    order = prior.order
    grid = reached[order].reshape(prior.slow.size, prior.fast.size)
    result = np.zeros(len(reached), bool)
    result[order] = np.outer(grid.any(axis=1), grid.any(axis=0)).reshape(-1)
    return result


def _plane_shapes(
    component: Component, reached: Bool[np.ndarray, " p"], smooth: bool
) -> Float[np.ndarray, "p m"]:
    prior = component.prior
    assert isinstance(prior, Smooth)
    assert prior.fast is not None
    slow, fast = prior.slow.size, prior.fast.size
    parts = [
        np.kron(np.eye(slow), np.ones((fast, 1))),
        np.kron(np.ones((slow, 1)), np.eye(fast)),
    ]
    if smooth:
        first, second = (
            legendre.legvander(np.linspace(-1.0, 1.0, count), _DEGREE)[:, 1:]
            for count in (slow, fast)
        )
        parts.append(np.kron(first, second))
    shapes = np.zeros((slow * fast, sum(part.shape[1] for part in parts)))
    shapes[prior.order] = np.hstack(parts)
    shapes[~reached] = 0.0
    basis, size, _ = pivoted(shapes)
    return np.asarray(basis[:, size > 1e-9 * max(size.max(initial=0.0), 1e-300)])


def _kernel(matrix: Float[np.ndarray, "q m"]) -> Float[np.ndarray, "m z"]:
    """Return orthonormal columns that a matrix maps to zero."""
    count = matrix.shape[1]
    size = float(np.abs(matrix).max(initial=0.0))
    if not len(matrix) or size == 0.0:
        return np.eye(count)
    return np.asarray(scipy.linalg.null_space(matrix / size, rcond=1e-9))

"""Which kind of equation serves a law and its recordings."""

from ._equation import AbstractEquation
from ._lanes import Lanes
from ._matrices import MatrixEquation
from ._pairs import PairEquation
from ._stack import Stack


def equation_of(stack: Stack, lanes: Lanes, *, plain: bool = False) -> AbstractEquation:
    """Return the equation of a law for several choices of rows, without a prior.

    Args:
        stack: The recordings with their laws.
        lanes: Rows that each fit uses.
        plain: Least squares, though there may be instruments.
    """
    if stack.one.filtered or (stack.one.has_instrument and not plain):
        return MatrixEquation(stack, lanes, plain=plain)
    return PairEquation(stack, lanes)

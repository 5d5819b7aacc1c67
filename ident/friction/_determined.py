"""Which parameters the data determine, which they do not, and why."""

import numpy as np
from jaxtyping import Bool, Float

from ._equation import Equation
from ._separable import Solution
from ._structures import Stribeck

VAGUE = "its share of the current is not told apart from the others'"
_VAGUE = 0.3
"""Standard deviation of a column's contribution, as a share of the load, that says nothing."""
_DROP = 3.0
"""Standard deviations that a drop must show to be one."""
_TOO_FAST = 0.5
"""Stribeck velocity, as a share of the highest speed, that only a bend at speed can give."""
_VAGUE_LOG = 0.7
"""Standard deviation of the logarithm of a shape (a factor of two) that says nothing."""
_IN_NULL = 1e-3
"""Share of a parameter in a direction that no row tells, to be unknown with it."""


def drop_reason(equation: Equation, solution: Solution) -> str | None:
    """Return why the data show no Stribeck drop, or None where they do."""
    structure = equation.structure
    if not isinstance(structure, Stribeck):
        return None
    factors = solution.factors[len(equation.fixed_names) :].reshape(structure.ways, -1)
    drops, speeds = factors[:, -1], equation.speed
    sd = np.sqrt(np.diag(solution.covariance))
    count = len(solution.factors)
    drop_sd = sd[len(equation.fixed_names) : count].reshape(structure.ways, -1)[:, -1]
    velocity = float(np.exp(solution.shape[0]))
    slowest, fastest = float(speeds.min()), float(speeds.max())
    per = f"{equation.samples.unit}/s"
    if (drops <= 0).all():
        return (
            "friction does not fall from rest on: no Stribeck effect above "
            f"{slowest:.3g} {per}, the slowest motion recorded"
        )
    if velocity > _TOO_FAST * fastest or (factors[:, 0] < 0).any():
        return (
            f"friction bends up to the highest speeds recorded ({fastest:.3g} {per}): "
            "that is no drop from break-away, and says nothing of one"
        )
    if solution.at_bound[0] or sd[count] > _VAGUE_LOG:
        return (
            f"the recording has too little motion in the Stribeck range (slowest "
            f"{slowest:.3g} {per}, found {velocity:.3g} {per})"
        )
    if not (drops > _DROP * drop_sd).any():
        return "the drop from break-away to Coulomb friction is lost in the noise"
    return None


def shape_reason(equation: Equation, solution: Solution) -> str | None:
    """Return why the data do not tell the Stribeck exponent, or None where they do."""
    if "stribeck_shape" not in equation.structure.shapes:
        return None
    place = len(solution.factors) + 1
    vague = np.sqrt(solution.covariance[place, place]) > _VAGUE_LOG
    if solution.at_bound[1] or vague:
        return "the data do not tell how sharply friction falls; 2 is assumed"
    return None


def vague_columns(equation: Equation, solution: Solution) -> Bool[np.ndarray, " k"]:
    """Return whose contribution is unknown to a good part of the load, of linear factors."""
    many = len(solution.factors)
    size = float(np.sqrt(np.mean(equation.load[equation.usable] ** 2)))
    sd = np.sqrt(np.diag(solution.covariance)[:many])
    return np.asarray(sd * solution.column_size[:many] > _VAGUE * size)


def unseen(
    jacobian: Float[np.ndarray, "r p"], solution: Solution
) -> Bool[np.ndarray, " r"]:
    """Return which reported parameters move along directions that no row tells.

    Args:
        jacobian: Of the reported parameters with respect to factors and shape.
        solution: The fit.
    """
    null = np.zeros((jacobian.shape[1], solution.null.shape[1]))
    null[: len(solution.factors)] = solution.null
    if null.shape[1] == 0:
        return np.zeros(len(jacobian), bool)
    size = np.where(solution.column_size > 0, solution.column_size, 1.0)
    scaled = null / np.abs(null * size[:, None]).max(axis=0)
    reach = np.abs(jacobian @ scaled).max(axis=1)
    return np.asarray(reach > _IN_NULL * np.abs(jacobian / size).max(axis=1))

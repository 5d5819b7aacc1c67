"""Which parameters the data determine, which they do not, and why."""

import numpy as np
from jaxtyping import Bool, Float

from ...data.signals import median, quantile
from ._equation import Equation
from ._samples import saturated
from ._separable import Solution
from ._structures import Stribeck

VAGUE = "its share of the current is not told apart from the others'"
_DIRECTION = 0.01
"""Share of the samples in motion that a direction needs to count as recorded."""
_VAGUE = 0.3
"""Standard deviation of a column's contribution, as a share of the load, that says nothing."""
_DROP = 3.0
"""Standard deviations that a drop must show to be one."""
_TOO_FAST = 0.5
"""Stribeck velocity, as a share of the highest speed, that only a bend at speed can give."""
_VAGUE_LOG = 0.7
"""Standard deviation of the logarithm of a shape (a factor of two) that says nothing."""
_TOUCHES = 0.05
"""Smallest current, as a share of the median one, that counts as coming down to 0."""
_IN_NULL = 1e-3
"""Share of a parameter in a direction that no row tells, to be unknown with it."""


def directions_seen(velocity: Float[np.ndarray, " m"]) -> tuple[bool, bool]:
    """Return whether motion in positive and in negative direction was recorded."""
    share = float(np.mean(velocity > 0)) if len(velocity) else 0.0
    return share >= _DIRECTION, share <= 1 - _DIRECTION


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


def remarks_on(equation: Equation) -> tuple[str, ...]:
    """Return what is odd about the recording itself, in words."""
    samples, found = equation.samples, []
    moving = samples.in_motion
    ahead, back = directions_seen(samples.velocity[moving])
    if not (ahead and back):
        way = "positive" if ahead else "negative"
        found.append(
            f"Only motion in {way} direction was recorded: friction and constant load "
            "cannot be told apart, and nothing is known of the other direction."
        )
    current = samples.current[moving]
    if ahead and back and (quantile(current, 0.01) > 0 or quantile(current, 0.99) < 0):
        size = np.abs(current)
        if size.min() < _TOUCHES * median(size):
            found.append(
                "The current comes down to 0 in both directions but never changes sign: the "
                "recording seems to hold its magnitude only, which tells nothing of friction."
            )
        else:
            found.append(
                "The current keeps its sign in both directions: a constant load larger than "
                "friction (weight, tension) acts on the axis and is reported as offset."
            )
    standing = len(moving) - int(moving.sum())
    if standing:
        found.append(f"{standing} samples at rest were left out.")
    full = int(saturated(samples.current).sum())
    if full:
        found.append(
            f"The current is saturated at {np.abs(samples.current).max():.4g} in {full} "
            "samples; they were left out."
        )
    pieces = int(samples.piece[-1]) + 1
    if pieces > 1:
        found.append(
            f"The clock jumps {pieces - 1} time{'s' * (pieces > 2)}; the {pieces} pieces "
            "were filtered apart."
        )
    return tuple(found)

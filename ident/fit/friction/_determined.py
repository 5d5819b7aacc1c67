"""Which parameters the data determine, which they do not, and why."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ....data.signals import median, quantile
from ._problem import Problem
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
"""Share of a parameter in a direction that no sample moves, to be lost with it."""


def directions_seen(
    problem: Problem, moving: Bool[np.ndarray, " t"]
) -> tuple[bool, bool]:
    """Return whether motion in positive and in negative direction was recorded."""
    ahead = np.count_nonzero(moving & (problem.samples.velocity > 0))
    share = float(ahead / np.count_nonzero(moving))
    return share >= _DIRECTION, share <= 1 - _DIRECTION


def drop_reason(problem: Problem, solution: Solution) -> str | None:
    """Return why the data show no Stribeck drop, or None where they do."""
    structure = problem.structure
    if not isinstance(structure, Stribeck):
        return None
    start = len(problem.fixed_names)
    index = [
        start + place
        for place, name in enumerate(structure.names)
        if name.startswith("drop")
    ]
    sd = np.sqrt(np.diag(solution.covariance))
    speeds = problem.speed
    place = len(solution.factors)
    velocity = float(np.exp(solution.shape[0]))
    slowest = float(speeds.min())
    drops = solution.factors[index]
    if (drops <= 0).all():
        return (
            "friction does not fall from rest on: no Stribeck effect above "
            f"{slowest:.3g} mm/s, the slowest motion recorded"
        )
    coulomb = [
        where
        for where, name in enumerate(structure.names, start)
        if name.startswith("coulomb")
    ]
    if velocity > _TOO_FAST * speeds.max() or (solution.factors[coulomb] < 0).any():
        return (
            f"friction bends up to the highest speeds recorded ({speeds.max():.3g} mm/s): "
            "that is no drop from break-away, and says nothing of one"
        )
    if solution.at_bound[0] or sd[place] > _VAGUE_LOG:
        return (
            f"the recording has too little motion in the Stribeck range (slowest "
            f"{slowest:.3g} mm/s, found {velocity:.3g} mm/s)"
        )
    if not (drops > _DROP * sd[index]).any():
        return "the drop from break-away to Coulomb friction is lost in the noise"
    return None


def shape_reason(problem: Problem, solution: Solution) -> str | None:
    """Return why the data do not tell the Stribeck exponent, or None where they do."""
    structure = problem.structure
    if not isinstance(structure, Stribeck) or structure.shape is not None:
        return None
    place = len(solution.factors) + 1
    vague = np.sqrt(solution.covariance[place, place]) > _VAGUE_LOG
    if solution.at_bound[1] or vague:
        return "the data do not tell how sharply friction falls; 2 is assumed"
    return None


def vague_columns(
    problem: Problem, solutions: Sequence[Solution], load: Float[np.ndarray, " w"]
) -> Bool[np.ndarray, "w k"]:
    """Return whose contribution is unknown to a good part of the load, of linear factors.

    Args:
        problem: The equation.
        solutions: To some choices of its rows.
        load: Root mean square of the load over the rows of each.
    """
    many = len(problem.fixed_names + problem.structure.names)
    variance = np.stack([np.diag(each.covariance)[:many] for each in solutions])
    rms = np.stack([each.column_size[:many] for each in solutions])
    return np.asarray(np.sqrt(variance) * rms > _VAGUE * load[:, None])


def lost(
    jacobian: Float[np.ndarray, "r k"],
    null: Float[np.ndarray, "k z"],
    size: Float[np.ndarray, " k"],
) -> list[bool]:
    """Return which reported parameters move along directions that no sample sees.

    Args:
        jacobian: Of the reported parameters with respect to factors and shape.
        null: Directions of these that no sample sees.
        size: RMS of each column, which makes factors of different units comparable.
    """
    if null.shape[1] == 0:
        return [False] * len(jacobian)
    size = np.where(size > 0, size, 1.0)
    scaled = null / np.abs(null * size[:, None]).max(axis=0)
    reach = np.abs(jacobian @ scaled).max(axis=1)
    unit = np.abs(jacobian / size).max(axis=1)
    return [bool(r > _IN_NULL * u) for r, u in zip(reach, unit, strict=True)]


def sentences(problem: Problem) -> tuple[str, ...]:
    """Return what is odd about the recording itself, in words."""
    if not problem.said:
        problem.said.append(_sentences(problem))
    return problem.said[0]


def _sentences(problem: Problem) -> tuple[str, ...]:
    samples = problem.samples
    found = []
    ahead, back = directions_seen(problem, samples.in_motion)
    if not (ahead and back):
        way = "positive" if ahead else "negative"
        found.append(
            f"Only motion in {way} direction was recorded: friction and constant load "
            "cannot be told apart, and nothing is known of the other direction."
        )
    moving = samples.in_motion
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
    full = int(problem.saturated.sum())
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

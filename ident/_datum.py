"""The position where a table is zero: what it says there, and how sure the rest is of it."""

import numpy as np
from jaxtyping import Float

from .fit.joint import AbstractEffect, Part

_TOGETHER = 512
"""Values whose joint covariance is in memory at a time."""


def datum_row(
    effect: AbstractEffect, place: tuple[float, ...] | None
) -> Float[np.ndarray, " p"]:
    """Return the share of each value in what a table says at the datum, 0 without one.

    Of two directions that is the mean.
    """
    row = np.zeros(effect.size)
    if place is not None:
        ways = np.array([1.0, -1.0])
        columns = [np.full(len(ways), each) for each in place]
        several = len(effect.inputs) > len(place)
        values, shares = effect.rows([*columns, ways] if several else columns)
        np.add.at(row, values, shares / len(ways))
    return row


def zeroed(
    covariance: Float[np.ndarray, "p p"], row: Float[np.ndarray, " p"]
) -> Float[np.ndarray, "p p"]:
    """Return the covariance of values less what they say at the datum.

    What is not determined stays so: its variance is inf, and NaN stands beside it.
    """
    at = np.flatnonzero(row)
    shared = covariance[:, at] @ row[at]
    result = covariance - shared[:, None] - shared[None, :] + row[at] @ shared[at]
    lost = ~np.isfinite(np.diag(result))
    result[lost], result[:, lost] = np.nan, np.nan
    np.fill_diagonal(result, np.where(lost, np.inf, np.maximum(np.diag(result), 0.0)))
    return np.asarray(result)


def zeroed_deviations(
    part: Part, row: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"]:
    """Return the standard deviations of the values of a table less what it says at the datum."""
    at, found = np.flatnonzero(row), list[Float[np.ndarray, " _n"]]()
    for first in range(0, len(row), _TOGETHER):
        chunk = np.arange(len(row))[first : first + _TOGETHER]
        joint = part.fit.covariance(part.places[np.concatenate([at, chunk])])
        shares = np.concatenate([row[at], np.zeros(len(chunk))])
        found.append(np.sqrt(np.diag(zeroed(joint, shares))[len(at) :]))
    return np.concatenate(found)


def deviation_at_datum(part: Part, row: Float[np.ndarray, " p"]) -> float:
    """Return the standard deviation of the constant of an axis and its table at the datum."""
    at = np.flatnonzero(row)
    unknowns = np.append(part.places[at], part.fit.design.datum)
    weights = np.append(row[at], 1.0)
    variance = weights @ part.fit.covariance(unknowns) @ weights
    return float(np.sqrt(variance)) if variance >= 0.0 else np.inf

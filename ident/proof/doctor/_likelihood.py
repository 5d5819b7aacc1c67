"""How likely a change is under what a list may have done to it."""

import dataclasses

import numpy as np
from jaxtyping import Float

_FREEDOM = 6.0
"""Degrees of freedom of the noise: Student's t, so that wild readings count little."""

BAND = 0.1
"""Share by which the effect of a list may be off: machine and instrument drift."""

_FLOOR = 1e-5
"""mm: noise that is taken for granted."""

_STEPS = 25
_SETTLED = 1e-5
"""Change of the noise, as a share of it, at which the likelihood has settled."""


@dataclasses.dataclass(frozen=True)
class Fitted:
    """How well hypotheses explain a change.

    Attributes:
        likelihood: Logarithm, per hypothesis.
        factor: Of the column, as fitted.
        deviation: Standard deviation of that factor.
    """

    likelihood: Float[np.ndarray, " h"]
    factor: Float[np.ndarray, " h"]
    deviation: Float[np.ndarray, " h"]


def fit_changes(
    change: Float[np.ndarray, " g"],
    columns: Float[np.ndarray, "h g"],
    scales: Float[np.ndarray, " h"],
    free: Float[np.ndarray, "g f"],
    variance: Float[np.ndarray, " g"],
) -> Fitted:
    """Return how likely a change is under each hypothesis.

    Zero, noise and, within a tenth of it, the factor are fitted: the same for every
    hypothesis, so that none gains by it.

    Args:
        change: Error after − before, in mm or °.
        columns: What the list adds under each hypothesis, in mm or °.
        scales: Factor of it; NaN: whatever fits.
        free: Columns that may be in the change in any case.
        variance: Of each change, relative to that of one reading.
    """
    # Free columns of a like size keep the equations solvable.
    free = free / np.sqrt(np.mean(np.square(free), axis=0))
    weight = np.broadcast_to(1.0 / variance, columns.shape)
    low, high = scales - BAND * np.abs(scales), scales + BAND * np.abs(scales)
    noise = np.zeros(len(columns))
    factor, power = np.zeros(len(columns)), np.zeros(len(columns))
    squares = np.zeros(columns.shape)
    for step in range(_STEPS):
        clear = columns - _explained(columns, free, weight)
        power = np.sum(weight * clear * clear, axis=1)
        best = np.sum(weight * clear * change, axis=1) / np.maximum(power, 1e-30)
        factor = np.where(np.isnan(scales), best, np.clip(best, low, high))
        rest = change - factor[:, None] * columns
        rest = rest - _explained(rest, free, weight)
        squares = np.square(rest) / variance
        if step == 0:
            noise = np.maximum(np.sqrt(np.median(squares, axis=1)), _FLOOR)
        before = noise
        # The scale of Student's t that makes these squares most likely.
        for _ in range(2):
            mean = np.mean(_shares(squares, noise) * squares, axis=1)
            noise = np.maximum(np.sqrt(mean), _FLOOR)
        weight = _shares(squares, noise) / variance
        if np.max(np.abs(noise / before - 1.0)) < _SETTLED:
            break
    logs = np.log1p(squares / (_FREEDOM * noise[:, None] ** 2)).sum(axis=1)
    likelihood = -len(change) * np.log(noise) - 0.5 * (_FREEDOM + 1.0) * logs
    return Fitted(likelihood, factor, noise / np.sqrt(np.maximum(power, 1e-30)))


def _shares(
    squares: Float[np.ndarray, "h g"], noise: Float[np.ndarray, " h"]
) -> Float[np.ndarray, "h g"]:
    return np.asarray((_FREEDOM + 1.0) / (_FREEDOM + squares / noise[:, None] ** 2))


def _explained(
    values: Float[np.ndarray, "h g"],
    free: Float[np.ndarray, "g f"],
    weight: Float[np.ndarray, "h g"],
) -> Float[np.ndarray, "h g"]:
    """Return what of each row of values the free columns explain."""
    weighted = weight[:, :, None] * free
    normal = free.T @ weighted
    normal += (
        1e-12
        * np.trace(normal, axis1=1, axis2=2)[:, None, None]
        * np.eye(free.shape[1])
    )
    right = np.einsum("hgf,hg->hf", weighted, values)
    found = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    return np.asarray(found @ free.T)


def mean_likelihood(values: Float[np.ndarray, " h"]) -> float:
    """Return the log of the mean likelihood of equally likely cases."""
    return float(np.logaddexp.reduce(values) - np.log(len(values)))

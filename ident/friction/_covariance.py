"""Covariance of sums whose terms resemble their neighbours (HAC).

Source: D. W. K. Andrews, Heteroskedasticity and autocorrelation consistent covariance matrix
estimation, Econometrica 59(3), 1991.
"""

import numpy as np
from jaxtyping import Float, Int

_LARGEST_LAG = 0.1
"""Longest lag as a share of the rows."""
_STRONGEST = 0.97
"""Autocorrelation that a first-order model is taken to have at most."""


def lag_of(scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]) -> int:
    """Return over how many rows scores resemble each other (Andrews' rule, Bartlett weights).

    Args:
        scores: Per row, in order; rows left out have zeros.
        piece: Stretch of even time steps; no lag reaches from one to the next.
    """
    same = piece[1:] == piece[:-1]
    size = np.square(scores).sum(axis=0)
    beside = (scores[1:] * scores[:-1] * same[:, None]).sum(axis=0)
    used = size > 0
    rho = np.clip(beside / np.where(used, size, 1.0), 0.0, _STRONGEST)
    far = used / (1 - rho) ** 4
    alpha = (4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2) * far).sum()
    alpha /= max(float(far.sum()), 1.0)
    best = 1.1447 * (alpha * len(scores)) ** (1 / 3)
    return int(min(best, _LARGEST_LAG * len(scores)))


def score_covariance(
    scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, "k k"], int]:
    """Return the covariance of the sum of scores, and the lag up to which it looks.

    Arguments as of `lag_of`.
    """
    lag = lag_of(scores, piece)
    # Bartlett's weights are what sums over a sliding window give. Pieces are set apart by
    # as many empty rows as the window is long.
    edges = np.flatnonzero(np.diff(piece)) + 1
    gap = np.zeros((lag + 1, scores.shape[1]))
    parts = [each for part in np.split(scores, edges) for each in (part, gap)]
    total = np.cumsum(np.concatenate([gap, *parts]), axis=0)
    window = total[lag + 1 :] - total[: -lag - 1]
    return window.T @ window / (lag + 1), lag


def larger_covariance(
    robust: Float[np.ndarray, "k k"], plain: Float[np.ndarray, "k k"]
) -> Float[np.ndarray, "k k"]:
    """Return the robust covariance, no standard deviation in it below the plain one.

    A robust variance is itself uncertain, and errs more often downwards: where it claims to
    know more than independent noise would allow, it is not believed.
    """
    have, least = np.diag(robust), np.diag(plain)
    factor = np.sqrt(np.maximum(least / np.where(have > 0, have, np.inf), 1.0))
    return np.asarray(robust * np.outer(factor, factor))

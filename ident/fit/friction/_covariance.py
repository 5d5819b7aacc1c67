"""Standard deviations that hold where neighbouring residuals resemble each other.

Heteroscedasticity and autocorrelation consistent (HAC): the sum of scores over lags with
Bartlett weights, lag chosen by Andrews' rule from first-order autoregressions; residuals are
divided by 1 − leverage (HC3), which makes few samples at the edge count as few.

Source: D. W. K. Andrews, Heteroskedasticity and autocorrelation consistent covariance matrix
estimation, Econometrica 59(3), 1991; J. G. MacKinnon, H. White, J. Econometrics 29, 1985.
"""

import numpy as np
from jaxtyping import Float, Int

_LARGEST_LAG = 0.1
"""Longest lag as a share of the samples."""
_STRONGEST = 0.97
"""Autocorrelation that a first-order model is taken to have at most."""


def score_covariance(
    scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, "k k"], int]:
    """Return the covariance of the sum of scores, and the lag up to which it looks.

    Args:
        scores: Per sample, in order; samples left out have zeros.
        piece: Stretch of even time steps; no lag reaches from one to the next.
    """
    from . import _noise_kernel

    scores, piece = np.ascontiguousarray(scores), np.ascontiguousarray(piece)
    lag = _lag_of(scores, piece)
    # Bartlett's weights are what sums over a sliding window give: one product for all lags.
    total = np.empty((scores.shape[1],) * 2)
    _noise_kernel.slide(scores, piece, lag, total)
    return total / (lag + 1), lag


def lag_of(scores: Float[np.ndarray, " t"], piece: Int[np.ndarray, " t"]) -> int:
    """Return over how many samples scores resemble each other (Andrews' rule)."""
    return _lag_of(np.ascontiguousarray(scores)[:, None], np.ascontiguousarray(piece))


def _lag_of(scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]) -> int:
    from . import _noise_kernel

    count, width = scores.shape
    size, beside = np.empty((2, width))
    _noise_kernel.resemblance(scores, piece, size, beside)
    used = size > 0
    if not used.any():
        return 0
    rho = np.minimum(np.maximum(beside[used] / size[used], 0.0), _STRONGEST)
    alpha = (4 * rho**2 / ((1 - rho) ** 6 * (1 + rho) ** 2)).sum()
    alpha /= (1 / (1 - rho) ** 4).sum()
    best = 1.1447 * (alpha * count) ** (1 / 3)
    return int(min(best, _LARGEST_LAG * count))


def larger_covariance(
    robust: Float[np.ndarray, "k k"], plain: Float[np.ndarray, "k k"]
) -> Float[np.ndarray, "k k"]:
    """Return the robust covariance, no standard deviation in it below the plain one.

    A robust variance is itself uncertain, and errs more often downwards: where it claims to
    know more than independent noise would allow, it is not believed.
    """
    have, least = np.diag(robust), np.diag(plain)
    factor = np.sqrt(np.maximum(least / np.where(have > 0, have, np.inf), 1.0))
    return np.asarray(robust * factor * factor[:, None])

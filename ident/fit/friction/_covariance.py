"""Standard deviations that hold where neighbouring residuals resemble each other.

Heteroscedasticity and autocorrelation consistent (HAC): the sum of scores over lags with
Bartlett weights, lag chosen by Andrews' rule from first-order autoregressions; residuals are
divided by 1 − leverage (HC3), which makes few samples at the edge count as few.

Source: D. W. K. Andrews, Heteroskedasticity and autocorrelation consistent covariance matrix
estimation, Econometrica 59(3), 1991; J. G. MacKinnon, H. White, J. Econometrics 29, 1985.
"""

from collections.abc import Sequence

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
    found, lags = score_covariances([np.ascontiguousarray(scores)], [piece])
    return found[0], int(lags[0])


def score_covariances(
    scores: Sequence[Float[np.ndarray, "_ k"]], pieces: Sequence[Int[np.ndarray, " _"]]
) -> tuple[Float[np.ndarray, "w k k"], Int[np.ndarray, " w"]]:
    """Return what `score_covariance` does for the scores of several fits, one after the other.

    Args:
        scores: Fit by fit.
        pieces: Likewise.
    """
    from . import _noise_kernel

    pieces = [np.ascontiguousarray(each) for each in pieces]
    lags, width = lags_of(scores, pieces), scores[0].shape[1]
    found = np.empty((len(lags), width, width))
    # Bartlett's weights are what sums over a sliding window give: one product for all lags.
    for own, piece, lag, total in zip(scores, pieces, lags, found, strict=True):
        _noise_kernel.slide(own, piece, lag, total)
    return found / (lags + 1)[:, None, None], lags


def lag_of(scores: Float[np.ndarray, " t"], piece: Int[np.ndarray, " t"]) -> int:
    """Return over how many samples scores resemble each other (Andrews' rule)."""
    one = np.ascontiguousarray(scores)[:, None], np.ascontiguousarray(piece)
    return int(lags_of([one[0]], [one[1]])[0])


def lags_of(
    scores: Sequence[Float[np.ndarray, "_ k"]], pieces: Sequence[Int[np.ndarray, " _"]]
) -> Int[np.ndarray, " w"]:
    """Return over how many samples the scores of several fits resemble each other.

    Args:
        scores: Fit by fit; they and the pieces must lie as they follow in memory.
        pieces: See `score_covariance`.
    """
    from . import _noise_kernel

    size, beside = np.empty((2, len(scores), scores[0].shape[1]))
    for own, piece, squares, products in zip(scores, pieces, size, beside, strict=True):
        _noise_kernel.resemblance(own, piece, squares, products)
    used = size > 0
    rho = beside / np.where(used, size, 1.0)
    rho = np.minimum(np.maximum(rho, 0.0), _STRONGEST)
    far = used / (1 - rho) ** 4
    alpha = (4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2) * far).sum(axis=1)
    alpha /= np.maximum(far.sum(axis=1), 1.0)
    count = np.array([len(each) for each in scores])
    best = 1.1447 * (alpha * count) ** (1 / 3)
    return np.asarray(np.minimum(best, _LARGEST_LAG * count).astype(np.int64))


def larger_covariance(
    robust: Float[np.ndarray, "*w k k"], plain: Float[np.ndarray, "*w k k"]
) -> Float[np.ndarray, "*w k k"]:
    """Return the robust covariance, no standard deviation in it below the plain one.

    A robust variance is itself uncertain, and errs more often downwards: where it claims to
    know more than independent noise would allow, it is not believed.
    """
    have, least = np.einsum("...kk->...k", robust), np.einsum("...kk->...k", plain)
    factor = np.sqrt(np.maximum(least / np.where(have > 0, have, np.inf), 1.0))
    return np.asarray(robust * factor[..., None, :] * factor[..., :, None])

"""Sparse selection of whole terms, on one half of the recording with shapes of the other.

The shape of every term (the coefficients of its functions) is estimated on one half of the
pieces; its course over the other half, scaled to an rms of one, is one normalised feature.
So a term is one coefficient, in mm rms, and `pysindy` selects among them by sequentially
thresholded least squares: a term that is not there has a shape by chance, which does not
come back in the other half. Halves are drawn many times over, in complementary pairs: N.
Meinshausen, P. Bühlmann, J. R. Stat. Soc. B 72(4), 2010; R. D. Shah, R. J. Samworth, same
journal 75(1), 2013.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve

from ._evidence import Variances, posterior
from ._sums import BlockSums, Sums

_PAIRS = 25
_FOLLOWS = 0.5
"""Share of its shape that a term must keep in the other half."""


def selection_frequency(
    blocks: BlockSums,
    slices: Sequence[slice],
    variances: Variances,
    terms: int,
    least: float,
    seed: int = 0,
) -> Float[np.ndarray, " g"]:
    """Return how often each term was selected, 0 to 1.

    Args:
        blocks: Sums of each piece of the recording.
        slices: Columns of each term, then of the nuisance.
        variances: Of all of them.
        terms: How many of the groups are terms.
        least: Contribution in mm or ° rms below which a term does not count.
        seed: Of the halves.
    """
    count = len(blocks.square)
    rng = np.random.default_rng(seed)
    hits, draws = np.zeros(terms), 0
    every = np.ones(len(slices), dtype=bool)
    for _ in range(_PAIRS):
        order = rng.permutation(count)
        halves = order[: count // 2], order[count // 2 :]
        parts = [blocks.total(np.sort(half)) for half in halves]
        for shape, proof in (parts, parts[::-1]):
            values, _ = posterior(shape, slices, variances, every)
            hits += _selected(proof, values, slices, variances, terms, least)
            draws += 1
    return hits / draws


def _selected(
    sums: Sums,
    values: Float[np.ndarray, " p"],
    slices: Sequence[slice],
    variances: Variances,
    terms: int,
    least: float,
) -> Bool[np.ndarray, " g"]:
    """Return which terms one half selects with the shapes of the other."""
    import pysindy

    chosen = np.zeros(terms, dtype=bool)
    alive = np.flatnonzero(variances.group[:terms] > 0)
    if not alive.size:
        return chosen
    shapes = np.zeros((len(values), len(alive)))
    for k, g in enumerate(alive.tolist()):
        shapes[slices[g], k] = values[slices[g]]
    matrix = shapes.T @ sums.products @ shapes
    # Scaled by what a term does in all, not by what the drift leaves of a slow one.
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0) / sums.weight)
    right = shapes.T @ sums.right
    rest = [g for g in range(terms, len(slices)) if variances.group[g] > 0]
    if rest:
        index = np.concatenate(
            [np.arange(slices[g].start, slices[g].stop) for g in rest]
        )
        prior = np.concatenate(
            [
                np.full(slices[g].stop - slices[g].start, variances.group[g])
                for g in rest
            ]
        )
        inner = sums.products[np.ix_(index, index)].copy()
        inner[np.diag_indices(len(index))] += variances.noise**2 / prior
        cross = sums.products[index] @ shapes
        solved = cho_solve(cho_factor(inner, lower=True), cross)
        matrix = matrix - cross.T @ solved
        right = right - solved.T @ sums.right[index]
    known = size > 1e-3 * least
    if not known.any():
        return chosen
    alive, size = alive[known], size[known]
    scale = size * np.sqrt(sums.weight)
    correlation = matrix[np.ix_(known, known)] / np.outer(scale, scale)
    # A square root of the sums gives the same regression as the rows, at any length.
    weights, axes = np.linalg.eigh(correlation)
    root = np.sqrt(np.maximum(weights, 1e-12))
    features = (axes * root).T
    target = (axes.T @ (right[known] / scale)) / root / np.sqrt(sums.weight) / least
    optimizer = pysindy.STLSQ(threshold=1.0, alpha=1e-6, max_iter=40)
    with warnings.catch_warnings():
        # It warns where nothing is left, which is an answer.
        warnings.simplefilter("ignore")
        optimizer.fit(features, target[:, None])
    found = np.asarray(optimizer.coef_)[0]
    chosen[alive] = (found >= 1.0) & (found * least > _FOLLOWS * size)
    return chosen

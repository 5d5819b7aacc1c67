"""Shorter ways to NumPy's numbers: the same to the bit."""

import numpy as np
import pytest

from axcomp.data.signals import find_polarity, median, quantile


@pytest.mark.parametrize("seed", range(60))
def test_median_and_quantiles_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=1 + seed)
    if seed % 3 == 0:
        values = np.round(values, 1)  # many equal ones
    if seed % 7 == 0:
        values[seed // 2] = np.nan
    assert np.array_equal(median(values), np.median(values), equal_nan=True)
    for share in (0.0, 0.001, 0.3, 0.5, 0.99, 1.0, rng.uniform()):
        found, wanted = quantile(values, share), np.quantile(values, share)
        assert np.array_equal(found, wanted, equal_nan=True)


def test_the_sign_is_as_sure_as_a_correlated_remainder_lets_it_be() -> None:
    rng = np.random.default_rng(3)
    count, lag = 600, 50
    side = np.where(np.sin(np.arange(count) / 20.0) >= 0.0, 1, -1)
    noise = np.convolve(rng.normal(size=count + 30), np.ones(31), mode="valid")
    current = 0.8 * side + noise
    found = find_polarity(current, side, correlated=lag)
    # The same as Newey and West define it, term by term.
    own = side - side.mean()
    fit = own @ current / (own @ own)
    score = own * (current - current.mean() - fit * own)
    terms = [score[k:] @ score[: count - k] for k in range(lag + 1)]
    weights = [1.0] + [2.0 * (1.0 - k / (lag + 1.0)) for k in range(1, lag + 1)]
    ratio = fit * (own @ own) / np.sqrt(np.dot(weights, terms))
    assert f"friction is {abs(ratio):.1f} standard deviations" in found.statement
    assert 0.5 < found.confidence < 1.0

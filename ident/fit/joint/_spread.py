"""Standard deviations of all unknowns under the stated rule."""

import numpy as np
from jaxtyping import Float

from ._problem import Solution
from ._rules import Rules


def variances(solution: Solution, rules: Rules) -> Float[np.ndarray, " n"]:
    """Return the variance of each unknown per variance of one reading.

    Moving to the rule changes what is unknown: from the spread of the values as solved it
    takes what may be moved between effects, which says nothing about either.
    """
    plain = solution.arrow.variances
    if not rules.null.shape[1]:
        return plain
    gain = rules.gain
    spread = solution.arrow.solve(np.ascontiguousarray(gain.T))
    inner = gain @ spread
    result = plain - 2.0 * (spread * rules.null).sum(axis=1)
    result += ((rules.null @ inner) * rules.null).sum(axis=1)
    return np.asarray(np.maximum(result, 0.0))

"""Values of a grid of tests through the table estimator: a Gaussian field with evidence."""

import numpy as np
from jaxtyping import Float

from .._table import fit_table
from .._types import Samples, TableLayout
from ._own import Values

PLENTY = 3
"""Events per test from which on the evidence can judge the smoothness."""


def smooth_values(
    nodes: tuple[Float[np.ndarray, " _n"], ...],
    positions: Float[np.ndarray, "n k"],
    amount: Float[np.ndarray, " n"],
    weight: Float[np.ndarray, " n"],
    loss: str,
) -> Values:
    """Return the values over a grid of tests from the events of one branch.

    An event of share a < 1 has value e/a and weight a²: so the stencil of the table is that
    of the controller, and `fit_table` does the rest (loss, evidence, deviations, support).

    Args:
        nodes: Of each adaptation axis in mm, ascending; none = one test.
        positions: Of the events.
        amount: Value of each event in mm.
        weight: Relative weight of each event.
        loss: As for `fit_table`.
    """
    layout = TableLayout(nodes if nodes else (np.zeros(1),))
    places = positions if nodes else np.zeros((len(amount), 1))
    fit = fit_table(
        layout, Samples(places, amount, weight=weight), loss=loss, allow_gaps=True
    )
    # A plane has its second axis first; in the order of the tests that runs fastest.
    value, spread, support = (
        each.T.reshape(-1) for each in (fit.values, fit.standard_deviation, fit.support)
    )
    spread = np.where(support > 0, spread, np.inf)
    return Values(value, spread, support.astype(np.int64), fit.noise, fit.wild)

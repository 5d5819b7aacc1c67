"""Noise with a memory: what is left in time makes slow effects less certain.

The model has white noise beside a drift that wanders (where one is stated at all). What a
reference does that is no such walk stays in the residual, and looks to a slow effect (a
temperature, above all) like its own. The scores of stretches of the recording tell how much:
their scatter, through the solution, is the variance that the values really have (the
"sandwich" of robust statistics, clustered in
time). It is compared per effect with that of the same residual in another order, so that
values which few stretches touch are judged together.
"""

import numpy as np
from jaxtyping import Float, Int

from ...core import ArrowFactor
from ._design import Design
from ._rules import Rules

_STRETCHES = 24
"""Of the recording: long against the memory of the noise, and enough to scatter."""
_FEWEST = 20
"""Readings of a stretch below which nothing is judged."""
_DRAWS = 4
"""Other orders of the residual."""
_CHANCE = 1.8
"""Ratio of variances up to which 24 stretches differ by chance, at two deviations."""


def memory_along(
    direction: Float[np.ndarray, " r"],
    pseudo: Float[np.ndarray, " r"],
    order: Int[np.ndarray, " r"],
) -> float:
    """Return the factor of the variance of one value that moves the readings like this, ≥ 1.

    Args:
        direction: Change of every reading with the value, all else following.
        pseudo: Residual as the loss takes it, 0 where a reading is not believed.
        order: Rows in the order of time.
    """
    active = order[pseudo[order] != 0.0]
    if len(active) < _FEWEST * _STRETCHES:
        return 1.0
    rows = np.array_split(active, _STRETCHES)
    seen = np.var([direction[own] @ pseudo[own] for own in rows])
    white = float(np.var(pseudo[active]) * np.square(direction[active]).mean())
    white *= len(active) / _STRETCHES
    ratio = float(seen) / white if white > 0.0 else 1.0
    return ratio if ratio > _CHANCE else 1.0


def memory_of_noise(
    design: Design,
    factor: ArrowFactor,
    rules: Rules,
    pseudo: Float[np.ndarray, " r"],
    order: Int[np.ndarray, " r"],
) -> Float[np.ndarray, " n"]:
    """Return the factor of each unknown's variance that the noise's memory asks for, ≥ 1.

    Args:
        design: Columns.
        factor: Of the fit.
        rules: Under which deviations are stated.
        pseudo: Residual as the loss takes it, 0 where a reading is not believed.
        order: Rows in the order of time.
    """
    swell = np.ones(design.size)
    active = order[pseudo[order] != 0.0]
    if len(active) < _FEWEST * _STRETCHES:
        return swell
    rng = np.random.default_rng(0)
    orders = [pseudo[active], *(rng.permutation(pseudo[active]) for _ in range(_DRAWS))]
    places = np.array_split(np.arange(len(active)), _STRETCHES)
    scores = np.empty((design.size, len(orders) * _STRETCHES))
    for stretch, where in enumerate(places):
        own = design.columns[active[where]].T
        for number, residual in enumerate(orders):
            scores[:, number * _STRETCHES + stretch] = own @ residual[where]
    moved = rules.project(factor.solve(scores))
    moved = moved.reshape(design.size, len(orders), _STRETCHES)
    # The prior holds the sum of the scores away from zero: that is no scatter.
    spread = moved.var(axis=2)
    for component in design.components:
        seen, white = spread[component.places, 0], spread[component.places, 1:]
        typical = float(white.mean())
        ratio = float(seen.mean()) / typical if typical > 0.0 else 1.0
        if ratio > _CHANCE:
            swell[component.places] = ratio
    return swell

"""What a fitted table is worth: the sentence on it, and when it must be refused."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ._types import Samples

_HOPELESS = 1e3
"""Uncertainty of a node, in ranges of the readings, that no extrapolation explains."""
WILD_SHARE = 0.1
"""Share of wild readings from which on not the readings are at fault but the table."""
_GARBAGE = 0.5
"""Share of wild readings from which on a run is at fault."""

FOLLOWS = (
    "The table follows every reading; the noise was judged by the smoothness that the "
    "readings suggest."
)
NONE_LEFT_OUT = (
    "Readings that agree with each other contradict a table of these nodes: none of them "
    "was left out."
)


def too_many_wild(
    wild: Bool[np.ndarray, " t"], samples: Samples, suspect_runs: tuple[int, ...]
) -> bool:
    """Tell whether so many readings are wild that it must be the table that is wrong."""
    if not wild.any():
        return False
    if samples.run is not None:
        labels, index = np.unique(samples.run, return_inverse=True)
        lost = np.bincount(index.reshape(-1), wild) / np.bincount(index.reshape(-1))
        # A run of garbage is at fault itself.
        garbage = (lost > _GARBAGE) | np.isin(labels, suspect_runs)
        wild = wild[~garbage[index.reshape(-1)]]
    return bool(len(wild) and wild.mean() > WILD_SHARE)


def uncertain(
    deviation: Float[np.ndarray, "l s"],
    support: Int[np.ndarray, "l s"],
    spread: float,
    noise: float,
) -> float:
    """Return the deviation of the least known node where it is beyond hope, else 0.

    Rounding can leave a singular matrix just definite.

    Args:
        deviation: Standard deviations of the nodes in mm or °.
        support: Readings that reach them.
        spread: Range of the readings.
        noise: Standard deviation of one of them.
    """
    worst = float(deviation[support > 0].max(initial=0.0))
    return worst if worst > _HOPELESS * max(spread, noise) else 0.0


def fit_message(count: int, used: float, rejected: int, converged: bool) -> str:
    """Return one sentence or more on how a fit went, for the report."""
    message = f"{count} readings, {used:.1f} effective parameters."
    return message + fit_remarks(rejected, converged)


def fit_remarks(rejected: int, converged: bool) -> str:
    """Return what else there is to say, each sentence after a blank."""
    message = ""
    if rejected:
        message += f" {rejected} wild readings were left out."
    if not converged:
        message += " The iterations did not settle; treat the result with care."
    return message

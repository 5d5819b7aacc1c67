"""Readings left out: the posterior without them, and the choice that predicts them.

The posterior is that of the sums of all others, with weights of the prior and influences kept
from the fit of all. A run without any reading left counts as zero: those that are left sum to zero,
so that a table keeps their mean.
"""

import dataclasses
import functools
import operator
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ._posterior import Posterior, Problem
from ._readings import NOT_LEFT_OUT, FitError, Readings
from ._robust import Estimate
from ._stack import Matrix
from ._sums import Sums, sums_of

_LIMIT = 5.0
"""Residuals in scales beyond which a held-out reading counts no more."""


def simplest(
    residuals: Sequence[Float[np.ndarray, " t"]],
    sizes: Sequence[int],
    scale: float,
    blocks: Int[np.ndarray, " t"],
    matters: float = 0.0,
) -> int:
    """Return the number of the simplest choice that predicts no worse than the best.

    Worse is more than one standard error over the blocks; a real gain may sit in a single one
    (a transient), so that more cannot be asked.

    Args:
        residuals: Residuals of held-out readings under each choice.
        sizes: Number of parameters of each choice.
        scale: Of the residuals.
        blocks: Of readings that share their drift, one number each.
        matters: Share of the sum of squares below which a choice is not worse.
    """
    losses = np.minimum((np.asarray(residuals) / scale) ** 2, _LIMIT**2)
    mean = losses.mean(axis=1)
    best = losses[int(np.argmin(mean))]
    good = []
    for number, loss in enumerate(losses):
        sums = np.bincount(blocks, loss - best)[np.bincount(blocks) > 0]
        deviation = np.std(sums, ddof=1) * np.sqrt(len(sums)) if len(sums) > 1 else 0.0
        if not sums.sum() > max(float(deviation), matters * float(best.sum())):
            good.append(number)
    return min(good, key=lambda choice: (sizes[choice], float(mean[choice])))


def sums_by_group(
    estimate: Estimate,
    readings: Readings,
    design: Matrix,
    groups: Int[np.ndarray, " t"],
) -> dict[int, Sums]:
    """Return the sums of each group about `Estimate.about` of all, by `Estimate.loss`."""
    stack, sums = estimate.posterior.problem.stack, {}
    about, loss = estimate.about, estimate.loss
    for label in np.unique(groups).tolist():
        mask = groups == label
        group = readings.take(mask)
        sums[label], _ = sums_of(stack, group, about, loss, design=design[mask])
    return sums


def leave_one_out(
    estimate: Estimate,
    groups: Mapping[int, Sums],
    zeros: Mapping[int, Float[np.ndarray, "q m"]],
    pins: Mapping[int, Float[np.ndarray, " u"]],
) -> dict[int, Posterior]:
    """Return the posterior without each group of readings.

    Args:
        estimate: Of all readings.
        groups: Sums of each group, by `sums_by_group`.
        zeros: Effects that no reading shows beside each group, by unknowns of the border: they
            count as zero.
        pins: Precision by which unknowns are held that nothing else determines beside a group.

    Raises:
        FitError: If there are fewer than two groups, or the others do not determine it.
    """
    if len(groups) < 2:
        msg = "leaving out needs at least two groups of readings, found one."
        raise FitError(msg)
    posteriors = {}
    for label in groups:
        # What is left out has no say: the others are added up, nothing is taken off.
        others = [sums for other, sums in groups.items() if other != label]
        total, theta = functools.reduce(operator.add, others), estimate.about
        gain = max(float(total.tally[1] / max(total.tally[0], 1.0)), 0.1)
        problem = Problem.of(total, theta, gain, pins.get(label))
        if label in zeros:
            sums, theta = total.zeroed(theta, zeros[label], gain)
            pinned = len(zeros[label])
            problem = dataclasses.replace(
                problem, sums=sums, theta=theta, pinned=pinned
            )
        times = estimate.posterior.problem.times
        post = dataclasses.replace(problem, times=times).at(estimate.posterior.weights)
        if post is None:
            raise FitError(NOT_LEFT_OUT)
        posteriors[label] = post
    return posteriors

"""Robust passes and smoothness in turn, for given lags, until both stay as they are."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from ...core._errors import FitError
from ...core._loss import AbstractLoss
from .._estimate import ROUGHLY, SAME
from ._alone import logs_alone
from ._choice import best_of, choose_weights, scanned_starts
from ._data import JointData
from ._passes import Stand, robust_passes
from ._prepare import Ground
from ._problem import Solution, solve_joint
from ._rules import Rules

_ROUNDS = 6
"""Rounds of smoothness and passes at most."""
_LIGHT = 1e-2
"""Weight of second differences, relative to the density, to begin with."""

Smoothness = str | float | Mapping[str, Mapping[str, float]]
"""``"auto"``, a number, or weights by name of the table."""


@dataclasses.dataclass(frozen=True)
class Known:
    """A fit of nearly the same, to begin with.

    Attributes:
        logs: Of the smoothness weights.
        theta: Values.
        active: Readings that were believed; None = all are to be tried.
        used: Effective number of parameters.
        tails: Loss.
    """

    logs: Float[np.ndarray, " k"]
    theta: Float[np.ndarray, " n"]
    active: Bool[np.ndarray, " r"] | None
    used: float
    tails: AbstractLoss | None

    @classmethod
    def of(cls, stand: Stand) -> "Known":
        """Return what a fit of the same readings knows."""
        solution = stand.solution
        used = stand.used or solution.used
        return cls(solution.logs, solution.theta, stand.active, used, stand.loss)


def roughly(ground: Ground, data: JointData, loss: str) -> Stand:
    """Return a fit with little smoothness, as it is before anything is chosen.

    Raises:
        FitError: If the readings do not determine the effects.
    """
    error, theta = _errors(ground, data)
    logs = ground.weights.start(_LIGHT)
    parts = (ground.weights, ground.pinned, error, loss)
    return robust_passes(
        ground.sums, *parts, logs, theta, near=False, tolerance=ROUGHLY
    )


def nearly(ground: Ground, data: JointData, loss: str, known: Known) -> Stand:
    """Return a fit with the smoothness of another that is nearly the same.

    Raises:
        FitError: If the readings do not determine the effects.
    """
    error, _ = _errors(ground, data)
    sums = ground.sums
    if known.active is not None:
        sums = sums.changed(known.active)
    parts = (ground.weights, ground.pinned, error, loss, known.logs, known.theta)
    return robust_passes(
        sums, *parts, near=True, tolerance=ROUGHLY, used=known.used, tails=known.tails
    )


def settled_on(
    ground: Ground,
    data: JointData,
    loss: str,
    smoothness: Smoothness,
    known: Known | None = None,
    rules: Rules | None = None,
) -> Stand:
    """Return the fit for given lags.

    Args:
        ground: Numbers of the axis.
        data: Readings.
        loss: As for `fit_joint`.
        smoothness: By evidence, or given.
        known: A fit of nearly the same.
        rules: What fixes the freedoms; only where nothing is known, and the plane is large.

    Raises:
        FitError: If the readings do not determine the effects or an option is unknown.
    """
    error, theta = _errors(ground, data)
    parts = (ground.weights, ground.pinned, error, loss)
    if not isinstance(smoothness, str):
        logs = _fixed(ground, smoothness)
        return robust_passes(ground.sums, *parts, logs, theta, near=False)
    if smoothness != "auto":
        msg = f"smoothness: found {smoothness!r}, expected 'auto', a number or weights."
        raise FitError(msg)
    if not ground.weights.parts:
        logs = ground.weights.start(_LIGHT)
        return robust_passes(ground.sums, *parts, logs, theta, near=False)
    if known is None:
        stand = roughly(ground, data, loss)
        logs = stand.solution.logs
    else:
        logs = known.logs
        stand = nearly(ground, data, loss, known)
    for turn in range(_ROUNDS):
        problem = stand.solution.problem
        if turn or known is not None:
            found = choose_weights(problem, logs)
        elif ground.design.banded:
            found = choose_weights(problem, _start_large(rules, stand.solution))
        else:
            found = best_of(problem, scanned_starts(problem))
        if found is None:
            msg = (
                f"axis {ground.design.axis}: no smoothness gives a fit, the readings are "
                "degenerate."
            )
            raise FitError(msg)
        logs = found.logs
        near = (logs, found.theta, True)
        stand = robust_passes(
            problem.sums, *parts, *near, used=found.used, tails=stand.loss
        )
        if loss == "gauss" or _same(found, stand.solution):
            return stand
    return dataclasses.replace(stand, settled=False)


def _errors(
    ground: Ground, data: JointData
) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, " n"]]:
    """Return the readings, and values that are nothing but a constant."""
    design = ground.design
    error = np.asarray(data.error[design.axis], float)[design.rows]
    theta = np.zeros(design.size)
    theta[design.datum] = float(np.median(error))
    if ground.sums.count - ground.pinned.free < 1:
        msg = (
            f"axis {design.axis}: {ground.sums.count} readings leave nothing to judge the "
            f"noise by; expected more than {ground.pinned.free}."
        )
        raise FitError(msg)
    return error, theta


def _start_large(rules: Rules | None, solution: Solution) -> Float[np.ndarray, " k"]:
    """Return where to begin with many unknowns: twice each table alone.

    The first time the others are still rough and leave much of their noise to each table.
    """
    logs = solution.logs
    for _ in range(2):
        placed = solution.theta if rules is None else rules.project(solution.theta)
        logs = logs_alone(dataclasses.replace(solution, theta=placed))
        again = solve_joint(solution.problem, logs)
        if again is None:
            break
        solution = again
    return logs


def _same(one: Solution, other: Solution) -> bool:
    """Tell whether two solutions predict alike, so that no new smoothness is asked for."""
    sums = other.problem.sums
    shift = float(np.std(sums.design.columns @ (other.theta - one.theta)))
    spread = np.sqrt(other.variance * min(1.0, sums.design.size / max(sums.count, 1)))
    return shift <= SAME * float(spread)


def _fixed(
    ground: Ground, smoothness: float | Mapping[str, Mapping[str, float]]
) -> Float[np.ndarray, " k"]:
    if isinstance(smoothness, (int, float)):
        if not 0 <= smoothness < np.inf:
            msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0."
            raise FitError(msg)
        return ground.weights.fixed(float(smoothness))
    return ground.weights.fixed(
        [smoothness.get(table.name) for table in ground.weights.tables]
    )

"""Robust passes of a joint fit and the choice of its smoothness, one axis."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ...core._errors import FitError
from ...core._loss import AbstractLoss, StudentLoss, choose_loss
from .._estimate import PASSES, SETTLED, THIN
from .._readings import pseudo_readings
from ._arrow import Arrow
from ._null import Pinned
from ._problem import JointProblem, Solution, solve_joint
from ._sums import Sums
from ._weights import Weights

_EXACT = 1e-5
"""Smallest scatter relative to the spread of the readings."""
_TRIED = 4
"""Passes after which tails stay as they are: between two that suit alike there is no end."""


@dataclasses.dataclass(frozen=True)
class Stand:
    """Where the iterations stand.

    Attributes:
        solution: Of the last pass.
        loss: With its scale.
        pseudo: Pseudo-readings of the last pass about the estimate before it.
        settled: Whether the passes died out.
        used: Effective number of parameters, about; 0 = not asked for yet.
    """

    solution: Solution
    loss: AbstractLoss
    pseudo: Float[np.ndarray, " r"]
    settled: bool
    used: float

    @property
    def active(self) -> Bool[np.ndarray, " r"]:
        """Readings that are believed at all."""
        return self.solution.problem.sums.active


def robust_passes(
    sums: Sums,
    weights: Weights,
    pinned: Pinned,
    error: Float[np.ndarray, " r"],
    loss: str,
    logs: Float[np.ndarray, " k"],
    theta: Float[np.ndarray, " n"],
    near: bool,
    tolerance: float = SETTLED,
    used: float | None = None,
    tails: AbstractLoss | None = None,
) -> Stand:
    """Iterate pseudo-readings and solution at fixed smoothness.

    Args:
        sums: Information of the readings believed so far.
        weights: Smoothness weights.
        pinned: What nothing else holds.
        error: Readings.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.
        logs: Of the weights.
        theta: Start.
        near: Whether the start is near: else large residuals are believed once.
        tolerance: Last move, in typical deviations of a prediction, at which the passes end.
        used: Effective number of parameters, where it is about known.
        tails: Loss of a fit of the same readings: it keeps its tails, not its scale.

    Raises:
        FitError: If the readings do not determine the effects.
    """
    columns = sums.design.columns
    thin = max(1, len(error) // THIN)
    floor = max(_EXACT * float(np.ptp(np.quantile(error[::thin], (0.05, 0.95)))), 1e-12)
    inflation = 1.0 if used is None else _inflation(sums, used)
    arrow: Arrow | None = None
    tried = 0 if tails is not None else _TRIED
    stand: Stand | None = None
    for step in range(PASSES):
        residual = error - columns @ theta
        chosen = choose_loss(loss, residual[::thin], inflation, floor)
        if tails is not None and step >= tried and _other_tails(chosen, tails):
            chosen = tails
        ratio = residual / chosen.scale
        now = ~chosen.wild(ratio)
        if step <= 8 and int((now != sums.active).sum()) > 1e-4 * len(now):
            sums, arrow = sums.changed(now), None
        active = sums.active
        if step == 0 and not near:
            limit = np.inf if loss == "gauss" else chosen.limit * chosen.scale
            pseudo = np.where(active, np.clip(residual, -limit, limit), 0.0)
        else:
            pseudo = pseudo_readings(chosen, residual, ratio, active)
        problem = JointProblem(
            sums,
            weights,
            pinned.pins,
            theta,
            np.asarray(columns.T @ pseudo),
            float(pseudo @ pseudo),
            max(sums.count - pinned.free, 1),
        )
        solution = solve_joint(problem, logs, arrow)
        if solution is None:
            msg = (
                f"axis {sums.design.axis}: the readings do not determine the effects, "
                "the matrix is singular."
            )
            raise FitError(msg)
        arrow = solution.arrow
        move = float(np.abs(columns @ (solution.theta - theta)).max())
        theta = solution.theta
        # The noise of a prediction, typically: what is small beside that does not matter.
        spread = np.sqrt(max(solution.variance, floor**2))
        spread *= np.sqrt(min(1.0, sums.design.size / max(sums.count, 1)))
        settled = (step > 0 or near) and move <= tolerance * spread
        done = bool(settled) or loss == "gauss"
        stand = Stand(solution, chosen, pseudo, done, used or 0.0)
        tails = chosen
        if stand.settled:
            break
        if step == 0 and used is None:
            plenty = sums.count >= 20 * sums.design.size
            used = float(sums.design.size if plenty else solution.used)
            inflation = _inflation(sums, used)
    assert stand is not None
    return stand


def _other_tails(one: AbstractLoss, other: AbstractLoss) -> bool:
    """Tell whether two losses differ in more than their scale."""
    if isinstance(one, StudentLoss) and isinstance(other, StudentLoss):
        return one.freedom != other.freedom
    return False


def _inflation(sums: Sums, used: float) -> float:
    """Return the factor that undoes the shrinkage of residuals by the fitted parameters."""
    free = max(sums.count - used, 0.05 * sums.count)
    return float(np.sqrt(sums.count / free))

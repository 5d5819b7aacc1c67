"""A law fitted to choices of rows, a simpler one where the data do not carry the asked one."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ._determined import drop_reason, shape_reason
from ._equation import Equation
from ._lanes import Lanes
from ._problem import Problem
from ._separable import Solution, scout, separable
from ._smoothing import choose_weights
from ._structures import CoulombViscous, Stribeck


@dataclasses.dataclass(frozen=True)
class Solved:
    """What was found for one choice of rows, before it is put into words.

    Attributes:
        problem: The equation, of a simpler law where the data do not carry the asked one.
        solution: Its solution.
        missing: What the data do not carry, and why.
        certain: Whether the solution has its covariance.
    """

    problem: Problem
    solution: Solution
    missing: dict[str, str]
    certain: bool


def solve_problem(
    problem: Problem,
    loss: str,
    lanes: Lanes,
    smoothness: float | None = None,
    certain: Sequence[bool] | None = None,
) -> list[Solved]:
    """Return what `fit_problem` finds before it is put into words, per choice of rows.

    Args:
        problem: The equation.
        loss: As for `fit_inverse`.
        lanes: Rows that each fit uses.
        smoothness: As for `fit_inverse`.
        certain: For which the covariance is wanted; all where left out. It is there as well
            where the choice of the law needs it.
    """
    certain = [True] * len(lanes) if certain is None else list(certain)
    structure = problem.structure
    # Whether a drop from break-away is one is judged by its standard deviation.
    judged = [each or bool(structure.shapes) for each in certain]
    solutions = _solutions(problem, loss, lanes, smoothness, judged)
    found = [
        Solved(problem, solution, {}, sure)
        for solution, sure in zip(solutions, judged, strict=True)
    ]
    if isinstance(structure, Stribeck):
        found = _simpler(found, loss, lanes, certain)
    return found


def _simpler(
    found: list[Solved], loss: str, lanes: Lanes, certain: Sequence[bool]
) -> list[Solved]:
    """Return the solutions, of simpler laws where the data do not carry a Stribeck drop."""
    found = list(found)
    problem = found[0].problem
    directional = problem.structure.directional
    vague = {
        lane: reason
        for lane, each in enumerate(found)
        if (reason := shape_reason(problem, each.solution)) is not None
        and drop_reason(problem, each.solution) is None
    }
    if vague:
        usual = problem.with_structure(Stribeck(directional, 2.0))
        some = lanes.take(np.array(list(vague)))
        again = _solutions(usual, loss, some, None, [True] * len(vague))
        for (lane, reason), each in zip(vague.items(), again, strict=True):
            found[lane] = Solved(usual, each, {"stribeck_shape": reason}, True)
    none = {
        lane: reason
        for lane, each in enumerate(found)
        if (reason := drop_reason(each.problem, each.solution)) is not None
    }
    if none:
        ways = ("_positive", "_negative") if directional else ("",)
        names = [f"breakaway{way}" for way in ways] + list(problem.structure.shapes)
        plain = problem.with_structure(CoulombViscous(directional))
        some = lanes.take(np.array(list(none)))
        wanted = [certain[lane] for lane in none]
        again = _solutions(plain, loss, some, None, wanted)
        for (lane, reason), each in zip(none.items(), again, strict=True):
            missing = found[lane].missing | dict.fromkeys(names, reason)
            found[lane] = Solved(plain, each, missing, certain[lane])
    return found


def _solutions(
    problem: Problem,
    loss: str,
    lanes: Lanes,
    smoothness: float | None,
    certain: Sequence[bool],
) -> list[Solution]:
    equation = Equation(problem, lanes)
    if problem.structure.bends() is not None:
        if smoothness is None:
            weights = choose_weights(equation, scout(problem, lanes, loss))
        else:
            weights = np.full(len(lanes), float(smoothness))
        equation = equation.smoothed(weights)
    return separable(equation, loss, certain)

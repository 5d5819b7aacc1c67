"""A law fitted to choices of rows, a simpler one where the data do not carry the asked one."""

import dataclasses

import numpy as np

from ._determined import drop_reason, shape_reason
from ._equation import Equation
from ._lanes import Lanes
from ._problem import Problem
from ._scout import scout
from ._separable import Solution, separable
from ._smoothing import choose_weights
from ._stack import Stack
from ._structures import CoulombViscous, Stribeck


@dataclasses.dataclass(frozen=True)
class Solved:
    """What was found for one choice of rows, before it is put into words.

    Attributes:
        problem: The equation, of a simpler law where the data do not carry the asked one.
        solution: Its solution.
        missing: What the data do not carry, and why.
    """

    problem: Problem
    solution: Solution
    missing: dict[str, str]


def solve_stack(
    stack: Stack,
    loss: str,
    lanes: Lanes,
    smoothness: float | None = None,
    *,
    certain: bool = True,
) -> list[Solved]:
    """Return what `fit_problem` finds before it is put into words, per choice of rows.

    Args:
        stack: The equations.
        loss: As for `fit_inverse`.
        lanes: Rows that each fit uses.
        smoothness: As for `fit_inverse`.
        certain: Whether covariances must hold. They do as well where the choice of the law
            needs it.
    """
    # Whether a drop from break-away is one is judged by its standard deviation.
    judged = certain or bool(stack.structure.shapes)
    found = _solved(stack, loss, lanes, smoothness, judged)
    if isinstance(stack.structure, Stribeck):
        found = _simpler(stack, found, loss, lanes, certain)
    return found


def _simpler(
    stack: Stack, found: list[Solved], loss: str, lanes: Lanes, certain: bool
) -> list[Solved]:
    """Return the solutions, of simpler laws where the data do not carry a Stribeck drop."""
    directional = stack.structure.directional
    vague = {
        lane: reason
        for lane, each in enumerate(found)
        if (reason := shape_reason(each.problem, each.solution)) is not None
        and drop_reason(each.problem, each.solution) is None
    }
    if vague:
        usual = stack.with_structures(
            [Stribeck(directional, 2.0)] * len(stack.problems)
        )
        some = lanes.take(np.array(list(vague)))
        again = _solved(usual, loss, some, None, True)
        for (lane, reason), each in zip(vague.items(), again, strict=True):
            missing = {"stribeck_shape": reason}
            found[lane] = dataclasses.replace(each, missing=missing)
    none = {
        lane: reason
        for lane, each in enumerate(found)
        if (reason := drop_reason(each.problem, each.solution)) is not None
    }
    if none:
        ways = ("_positive", "_negative") if directional else ("",)
        names = [f"breakaway{way}" for way in ways] + list(stack.structure.shapes)
        law = CoulombViscous(directional)
        plain = stack.with_structures([law] * len(stack.problems))
        some = lanes.take(np.array(list(none)))
        again = _solved(plain, loss, some, None, certain)
        for (lane, reason), each in zip(none.items(), again, strict=True):
            missing = found[lane].missing | dict.fromkeys(names, reason)
            found[lane] = dataclasses.replace(each, missing=missing)
    return found


def _solved(
    stack: Stack, loss: str, lanes: Lanes, smoothness: float | None, certain: bool
) -> list[Solved]:
    equation = Equation(stack, lanes)
    if stack.structure.bends() is not None:
        if smoothness is None:
            weights = choose_weights(equation, scout(stack, lanes, loss))
        else:
            weights = np.full(len(lanes), float(smoothness))
        equation = equation.smoothed(weights)
    solutions = separable(equation, loss, [certain] * len(lanes))
    return [
        Solved(stack.problems[recording], solution, {})
        for recording, solution in zip(lanes.of, solutions, strict=True)
    ]

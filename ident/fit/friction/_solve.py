"""A law fitted to choices of rows, a simpler one where the data do not carry the asked one."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ._determined import drop_reason, shape_reason
from ._equations import equation_of
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
    stack: Stack, loss: str, lanes: Lanes, smoothness: float | None = None
) -> list[Solved]:
    """Return what `fit_problem` finds before it is put into words, per choice of rows.

    Args:
        stack: The equations.
        loss: As for `fit_inverse`.
        lanes: Rows that each fit uses.
        smoothness: As for `fit_inverse`.
    """
    found = solve_as_asked(stack, loss, lanes, smoothness)
    if isinstance(stack.structure, Stribeck):
        found = _simpler(stack, found, loss, lanes)
    return found


def _simpler(
    stack: Stack, found: list[Solved], loss: str, lanes: Lanes
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
        again = solve_as_asked(usual, loss, some)
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
        again = solve_as_asked(plain, loss, some)
        for (lane, reason), each in zip(none.items(), again, strict=True):
            missing = found[lane].missing | dict.fromkeys(names, reason)
            found[lane] = dataclasses.replace(each, missing=missing)
    return found


def solve_as_asked(
    stack: Stack,
    loss: str,
    lanes: Lanes,
    smoothness: float | None = None,
    *,
    certain: bool = True,
    about: Float[np.ndarray, "r h"] | None = None,
) -> list[Solved]:
    """Return what `solve_stack` does, not asked whether the data carry the law.

    Args:
        stack: The equations.
        loss: As for `fit_inverse`.
        lanes: Rows that each fit uses.
        smoothness: As for `fit_inverse`.
        certain: Whether covariances must hold; if not, they are those of independent noise.
        about: As for `separable`.
    """
    equation = equation_of(stack, lanes)
    if stack.structure.bends() is not None:
        if smoothness is None:
            weights = choose_weights(equation, scout(stack, lanes, loss))
        else:
            weights = np.full(len(lanes), float(smoothness))
        equation = equation.smoothed(weights)
    solutions = separable(equation, loss, certain, about)
    return [
        Solved(stack.problems[recording], solution, {})
        for recording, solution in zip(lanes.of, solutions, strict=True)
    ]

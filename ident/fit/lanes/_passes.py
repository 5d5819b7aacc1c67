"""Robust passes and the choice of the smoothness, many small tables in lockstep.

The same steps as `.._estimate`, which fits one table of any size; what goes beyond a first
look at the readings (second thoughts about wild ones) is left to it.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from .._estimate import PASSES, ROUGHLY, SAME, SETTLED
from .._runs import row_medians
from ._scale import Scale, choose_scale
from ._search import choose_weights
from ._solve import Factors, Problems, Solutions, factors_of, solve_lanes
from ._stack import Stack, times


@dataclasses.dataclass
class State:
    """Where the iterations of every lane stand; ``sound`` is false where one broke down."""

    problems: Problems
    factors: Factors
    solutions: Solutions
    scale: Scale
    weights: Float[np.ndarray, "k 2"]
    active: Bool[np.ndarray, "k t"]
    converged: Bool[np.ndarray, " k"]
    sound: Bool[np.ndarray, " k"]


def estimate_lanes(
    stack: Stack,
    loss: str,
    weights: Float[np.ndarray, "k 2"] | None,
    start: Float[np.ndarray, "k m"],
) -> State:
    """Fit all lanes, at given weights or at those that the readings suggest.

    Args:
        stack: The fits.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.
        weights: Of second and fourth differences, None to choose them.
        start: Node values and run effects to begin with.
    """
    if weights is not None:
        return _robust(stack, loss, weights, start, False, SETTLED)
    density = stack.density(stack.whole)
    # Plenty of readings per node judge each other; few need their neighbours.
    plenty = stack.error.shape[1] >= 10 * stack.size
    first = np.zeros((len(density), 2))
    first[:, 0] = density * (1e-2 if plenty else 1.0)
    state = _robust(stack, loss, first, start, False, ROUGHLY)
    return _refined(state, loss)


def _refined(state: State, loss: str) -> State:
    stack = state.problems.stack
    density = stack.density(state.problems.normal)
    going = np.flatnonzero(state.sound)
    state.converged[:] = False
    for again in range(8):
        if not len(going):
            break
        part = state.problems.take(going)
        weights, found = choose_weights(part, state.weights[going] if again else None)
        factors = factors_of(part.stack, part.normal, weights)
        choice = solve_lanes(part, weights, factors)
        fresh = _robust(part.stack, loss, weights, choice.unknowns, True, SETTLED)
        fresh.sound &= found
        if len(going) == len(state.sound):
            state = fresh
        else:
            _put(state, going, fresh)
        size = stack.size
        moved = fresh.solutions.unknowns[:, :size] - choice.unknowns[:, :size]
        spread = np.sqrt(fresh.solutions.variance / density[going])
        done = ~fresh.sound | (loss == "gauss") | (moved.std(axis=1) <= SAME * spread)
        state.converged[going] = done & fresh.converged
        going = going[~done]
    return state


def _robust(
    stack: Stack,
    loss: str,
    weights: Float[np.ndarray, "k 2"],
    unknowns: Float[np.ndarray, "k m"],
    near: bool,
    tolerance: float,
) -> State:
    """Iterate pseudo-readings and solutions at fixed weights, from starts near or far."""
    count = stack.error.shape[1]
    active = np.ones(stack.error.shape, bool)
    normal = stack.whole.copy()
    factors = factors_of(stack, normal, weights)
    inflation = np.ones(len(normal))
    going, part = np.arange(len(normal)), stack
    every, inverses, given = normal, factors, weights
    ended: list[_Ended] = []
    for step in range(PASSES):
        root = np.sqrt(part.weight)
        residual = part.residual(unknowns)
        scaled = residual * root
        scale = choose_scale(loss, scaled, inflation, part.floor)
        ratio = scaled / scale.scale
        now = ~scale.wild(ratio)
        if step <= 8:
            other = np.flatnonzero((now != active).sum(axis=1) > 1e-4 * count)
            if len(other):
                active[other] = now[other]
                own = part.take(other)
                fresh = own.normal(active[other])
                inverted = factors_of(own, fresh, weights[other])
                normal[other] = fresh
                factors.put(other, inverted)
                if part is not stack:
                    every[going[other]] = fresh
                    inverses.put(going[other], inverted)
        pseudo = _pseudo(scale, residual, scaled, active, step == 0 and not near, root)
        problems = _problems(part, normal, unknowns, pseudo, active)
        solutions = solve_lanes(problems, weights, factors)
        move = np.abs(solutions.unknowns - unknowns)[:, : part.size].max(axis=1)
        spread = np.maximum(solutions.variance, part.floor**2) / part.density(normal)
        settled = move <= tolerance * np.sqrt(spread)
        settled &= step > 0 or near
        done = settled | (loss == "gauss") | ~factors.sound
        state = State(
            problems, factors, solutions, scale, weights, active, done, factors.sound
        )
        if done.all() or step == PASSES - 1:
            ended.append(_Ended(going, np.arange(len(going)), state))
            break
        going_on = np.flatnonzero(~done)
        plenty = problems.count >= 20 * part.size
        used = np.where(plenty, part.size, factors.used)
        free = np.maximum(problems.count - used, 0.05 * problems.count)
        inflation = np.sqrt(problems.count / free)
        unknowns = solutions.unknowns
        if done.any():
            # From here on nothing changes these arrays: the others go on with copies.
            ready = np.flatnonzero(done)
            ended.append(_Ended(going[ready], ready, state))
            going, part = going[going_on], part.take(going_on)
            factors = factors.take(going_on)
            normal, weights, unknowns, inflation, active = (
                each[going_on]
                for each in (normal, weights, unknowns, inflation, active)
            )
    kept = {"stack": stack, "weights": given, "normal": every, "factors": inverses}
    return _joined(ended, kept)


@dataclasses.dataclass(frozen=True)
class _Ended:
    """Lanes that came to their end together: which ones, and their rows in a state."""

    lanes: Int[np.ndarray, " k"]
    rows: Int[np.ndarray, " k"]
    state: State


def _joined(ended: Sequence[_Ended], kept: Mapping[str, Any]) -> State:
    """Return the ends of all lanes of a stack as one state.

    Args:
        ended: The ends.
        kept: Fields, by name, of which all lanes have theirs together already.
    """
    if len(ended) == 1:
        return ended[0].state
    count = sum(len(one.lanes) for one in ended)

    def joined(values: Sequence[Any]) -> Any:
        first = values[0]
        if isinstance(first, str):
            return first
        if isinstance(first, np.ndarray):
            result = np.empty((count, *first.shape[1:]), first.dtype)
            for one, value in zip(ended, values, strict=True):
                result[one.lanes] = value[one.rows]
            return result
        names = [field.name for field in dataclasses.fields(first)]
        parts = {
            name: kept[name]
            if name in kept
            else joined([getattr(value, name) for value in values])
            for name in names
        }
        return dataclasses.replace(first, **parts)

    found: State = joined([one.state for one in ended])
    return found


def _pseudo(
    scale: Scale,
    residual: Float[np.ndarray, "k t"],
    scaled: Float[np.ndarray, "k t"],
    active: Bool[np.ndarray, "k t"],
    far: bool,
    root: Float[np.ndarray, "k t"],
) -> Float[np.ndarray, "k t"]:
    """Return ψ(residual) / mean ψ', and zero for readings that are left out."""
    if far:
        # Far from the table every residual is large: believe all but the hopeless ones.
        limit = np.inf if scale.name == "gauss" else scale.limit * scale.scale
        return np.where(active, np.clip(scaled, -limit, limit) / root, 0.0)
    ratio = scaled / scale.scale
    slope = np.where(active, scale.slope(ratio), 0.0).sum(axis=1)
    steep = np.maximum(slope / np.maximum(active.sum(axis=1), 1), 0.1)
    return np.where(active, residual * scale.share(ratio) / steep[:, None], 0.0)


def _problems(
    stack: Stack,
    normal: Float[np.ndarray, "k m m"],
    unknowns: Float[np.ndarray, "k m"],
    pseudo: Float[np.ndarray, "k t"],
    active: Bool[np.ndarray, "k t"],
) -> Problems:
    weighted = stack.weight * pseudo
    vector = stack.sums(weighted)
    if stack.effects:
        hold = stack.hold(normal)[:, None]
        vector[:, stack.size :] -= hold * unknowns[:, stack.size :]
    return Problems(
        stack=stack,
        normal=normal,
        vector=vector,
        square=np.asarray((weighted * pseudo).sum(axis=1)),
        count=active.sum(axis=1).astype(float),
        unknowns=unknowns,
    )


def _put(state: Any, lanes: Int[np.ndarray, " k"], other: Any) -> None:
    """Replace some lanes of a state, or of a value that it holds, by those of another."""
    for field in dataclasses.fields(state):
        own, new = getattr(state, field.name), getattr(other, field.name)
        if isinstance(own, np.ndarray):
            own[lanes] = new
        elif not isinstance(own, Stack | str):
            _put(own, lanes, new)


def start_of(
    stack: Stack, effects: Float[np.ndarray, "k r"]
) -> Float[np.ndarray, "k m"]:
    """Return flat tables at the median of the readings, with given run effects."""
    left = stack.error
    if stack.effects:
        left = left - times(stack.columns[:, :, stack.size :], effects)
    centre = row_medians(left)
    return np.hstack([np.repeat(centre[:, None], stack.size, axis=1), effects])

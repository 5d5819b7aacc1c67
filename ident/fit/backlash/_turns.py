"""Reversals in a trace: where the axis turns, and the stretch around each turn."""

import dataclasses

import numpy as np
from jaxtyping import Float


@dataclasses.dataclass(frozen=True)
class Turn:
    """One turning point with the stretch around it that runs in one direction each.

    Attributes:
        start: First row of the stretch before.
        turn: Row of the turning point, which belongs to neither direction.
        stop: Row after the stretch behind.
        direction: Of the motion after it, ±1.
    """

    start: int
    turn: int
    stop: int
    direction: int


def find_turns(
    position: Float[np.ndarray, " t"], swing: float, reach: float
) -> tuple[Turn, ...]:
    """Return the turning points of a motion, jitter left out.

    Args:
        position: In mm or °.
        swing: Smallest way back that is a reversal, in mm or °.
        reach: Travel on both sides that is kept, in mm or °.
    """
    turns: list[int] = []
    way, extreme = 0, 0
    for row in range(1, len(position)):
        step = position[row] - position[extreme]
        if way == 0:
            if abs(position[row] - position[0]) > swing:
                way, extreme = (1 if position[row] > position[0] else -1), row
        elif step * way >= 0:
            extreme = row
        elif -step * way > swing:
            turns.append(extreme)
            way, extreme = -way, row
    result = []
    for number, turn in enumerate(turns):
        before = turns[number - 1] if number else 0
        after = turns[number + 1] if number + 1 < len(turns) else len(position) - 1
        away = np.abs(position - position[turn])
        left = np.flatnonzero(away[before:turn] > reach)
        right = np.flatnonzero(away[turn : after + 1] > reach)
        start = before + int(left[-1]) + 1 if len(left) else before
        stop = turn + int(right[0]) if len(right) else after + 1
        way = 1 if position[stop - 1] > position[turn] else -1
        result.append(Turn(start, turn, stop, way))
    return tuple(result)

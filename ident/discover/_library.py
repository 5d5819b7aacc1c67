"""Every term that a recording could show, and what it cannot tell of."""

import dataclasses
import itertools
from collections.abc import Iterator

from ._terms import Kind, Term
from ._view import AxisView, moving


@dataclasses.dataclass(frozen=True)
class Library:
    """Terms that are looked for in the error of one axis.

    Attributes:
        terms: Candidates, of compensations and of what the controller has none for.
        heat: Temperature terms, of which one sensor and lag is chosen each.
        absent: Compensations that nothing recorded could show, each with the reason.
    """

    terms: tuple[Term, ...]
    heat: tuple[Term, ...]
    absent: tuple[tuple[str, tuple[str, ...], str], ...]


_NEAR = 100
"""Readings shortly after reversals, from which on their course can be seen."""
_CLOSE = 0.05
_LAGS = (0.0, 60.0, 180.0, 600.0, 1800.0)
"""Seconds by which a structure may lag behind its sensor."""


def library_of(view: AxisView, axes: tuple[str, ...]) -> Library:
    """Return what the recording of an axis could show.

    Args:
        view: The readings.
        axes: All axes of the machine, moved or not.
    """
    terms: list[Term] = []
    absent: list[tuple[str, tuple[str, ...], str]] = []
    axis, data = view.axis, view.data
    others = [name for name in axes if name != axis]
    moved = [name for name in others if view.moves(name)]
    turning = moving(data.direction.get(axis))
    terms += _along_itself(view, turning)
    if not view.moves(axis):
        absent.append(("leadscrew", (), _unmoved(view, axis)))
    if not turning:
        why = f"{axis} was read from one direction only"
        if axis not in data.direction:
            why = f"the direction of {axis} is not known"
        absent.append(("backlash", (), why))
    terms += [Term(Kind.LINE, axis, (name,)) for name in moved]
    absent += [
        ("cross", (name,), _unmoved(view, name)) for name in others if name not in moved
    ]
    for pair in itertools.combinations(moved, 2):
        turns = [name for name in pair if name in data.modulo]
        if turns:
            why = (
                f"{turns[0]} goes round, and planes are fitted over axes with two ends"
            )
            absent.append(("plane", pair, why))
        else:
            terms.append(Term(Kind.SURFACE, axis, pair))
    for name in others:
        if moving(data.acceleration.get(name)):
            terms += _pushes(view, name)
        else:
            why = f"no acceleration of {name} was recorded, nor time to derive it from"
            if name in data.acceleration:
                why = f"{name} did not accelerate"
            absent.append(("crosstalk", (name,), why))
    heat = tuple(_heat(view)) if axis not in data.rotary else ()
    if not heat:
        why = "no temperature was recorded"
        if data.temperature:
            why = "no temperature changed"
        if axis in data.rotary:
            why = f"{axis} is rotary, and the unit of its coefficient is not defined"
        absent.append(("temperature", (), why))
    terms += _foreign(view, moved)
    return Library(tuple(terms), heat, tuple(absent))


def _unmoved(view: AxisView, axis: str) -> str:
    if axis not in view.data.position:
        return f"the position of {axis} was not recorded"
    return f"{axis} did not move"


def _along_itself(view: AxisView, turning: bool) -> Iterator[Term]:
    axis = view.axis
    if view.moves(axis):
        yield Term(Kind.OWN, axis)
    if turning:
        yield Term(Kind.REVERSAL, axis)
        if view.moves(axis) and view.places(axis) > 2:
            yield Term(Kind.OWN_REVERSAL, axis)


def _pushes(view: AxisView, master: str) -> Iterator[Term]:
    axis = view.axis
    yield Term(Kind.PUSH, axis, (master,))
    if moving(view.data.velocity.get(master)):
        yield Term(Kind.PUSH_WAY, axis, (master,))
    for name in view.span:
        yield Term(Kind.PUSH_PLACE, axis, (master, name))


def adapted_twice(view: AxisView, master: str) -> tuple[Term, ...]:
    """Return the terms of a crosstalk that two positions adapt."""
    return tuple(
        Term(Kind.PUSH_PLACES, view.axis, (master, *pair))
        for pair in itertools.combinations(view.span, 2)
    )


def _heat(view: AxisView) -> Iterator[Term]:
    data, axis = view.data, view.axis
    span = float(data.time[-1] - data.time[0]) if data.time is not None else 0.0
    for sensor, values in data.temperature.items():
        if not moving(values):
            continue
        for lag in _LAGS:
            if lag > 0.25 * span:
                continue
            yield Term(Kind.HEAT_OFFSET, axis, (), sensor, lag)
            if view.moves(axis):
                yield Term(Kind.HEAT_SLOPE, axis, (), sensor, lag)


def _foreign(view: AxisView, moved: list[str]) -> Iterator[Term]:
    data, axis = view.data, view.axis
    if moving(data.velocity.get(axis)):
        yield Term(Kind.SPEED, axis)
    if moving(data.acceleration.get(axis)):
        yield Term(Kind.PULL, axis)
    if moving(data.direction.get(axis)) and _near_reversals(view) >= _NEAR:
        yield Term(Kind.MEMORY, axis)
    for name in moved:
        if moving(data.velocity.get(name)):
            yield Term(Kind.SPEED_OTHER, axis, (name,))
        if moving(data.direction.get(name)):
            yield Term(Kind.REVERSAL_OTHER, axis, (name,))
        if view.moves(axis):
            yield Term(Kind.OWN_LINE, axis, (name,))


def _near_reversals(view: AxisView) -> int:
    """Return how many readings tell how an error builds up after a reversal."""
    if view.distance is None or not view.moves(view.axis):
        return 0
    low, high = view.span[view.axis]
    near = (view.distance > 0) & (view.distance < _CLOSE * (high - low))
    return int(near.sum())


def late_terms(
    view: AxisView, axes: tuple[str, ...], heat: Term | None
) -> Iterator[Term]:
    """Yield what is looked for once the rest is known: growth without or across heat."""
    if view.moves(view.axis):
        yield Term(Kind.GROWTH, view.axis)
    if heat is None:
        return
    for name in axes:
        if name != view.axis and view.moves(name):
            yield Term(Kind.HEAT_LINE, view.axis, (name,), heat.sensor, heat.lag)

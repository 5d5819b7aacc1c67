"""Arguments of `axcomp.fit`, checked at the door, and what they say of the effects."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np

from ..models import AbstractLookup
from ._readings import Friction
from .core import FitError
from .fit import Constraint
from .fit.joint import AbstractEffect, Part, is_number, numbers_of

Datum = float | Sequence[float]
"""A position, one per master."""


def check_options(
    loss: Any, remove: Any, solver: Any, smoothness: Any, drift: Any
) -> None:
    """Check options of `axcomp.fit`.

    Raises:
        FitError: If one is none that it knows.
    """
    for option, word, words in (
        ("loss", loss, ("student", "huber", "gauss")),
        ("remove", remove, ("none", "offset", "line")),
        ("solver", solver, ("factor", "ipopt", None)),
    ):
        if not isinstance(word, str | None) or word not in words:
            known = ", ".join(repr(each) for each in words if each)
            msg = f"{option}: found {word!r}, expected one of {known}."
            raise FitError(msg)
    if not isinstance(smoothness, str) and not is_number(smoothness):
        msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0"
        raise FitError(msg)
    if not isinstance(drift, int | np.integer) or drift < 0:
        msg = f"drift: found {drift!r}, expected a whole number of 0 or more"
        raise FitError(msg)


def check_friction(**options: Any) -> None:
    """Check that options of tables are left out where there is a friction alone.

    Raises:
        FitError: If one is stated.
    """
    usual = {"loss": "student", "smoothness": "auto", "drift": 0, "remove": "none"}
    for name, value in options.items():
        if np.ndim(value) or value != usual.get(name):
            msg = f"{name}: found {value!r} of a friction, which has none; leave it out"
            raise FitError(msg)


def stack_of(effects: Any) -> tuple[AbstractEffect | Friction, ...]:
    """Return effects one by one.

    Raises:
        FitError: If there is none, one is something else, or a plane lies over its own axis.
    """
    known = AbstractEffect | Friction
    several = isinstance(effects, Iterable) and not isinstance(effects, known)
    stack: tuple[Any, ...] = tuple(effects) if several else (effects,)
    wrong = [repr(one) for one in stack if not isinstance(one, known)]
    if wrong or not stack:
        found = ", ".join(wrong) or "none"
        msg = f"effects: found {found}, expected some such as axcomp.Backlash('X')"
        raise FitError(msg)
    for one in stack:
        if isinstance(one, AbstractEffect) and len(one.masters) > 1:
            found = f"the axis {one.axis} twice"
            one.expect(one.axis not in one.masters, found, "another master")
    return stack


def names_of(effects: Sequence[AbstractEffect | Friction]) -> tuple[str, ...]:
    """Return the name of each effect: its compensation, with the axis where it recurs."""
    kinds = [one.compensation for one in effects]
    names = tuple(
        kind if kinds.count(kind) == 1 else f"{one.axis}.{kind}"
        for kind, one in zip(kinds, effects, strict=True)
    )
    if len(set(names)) < len(names):
        msg = f"found an effect twice among {', '.join(kinds)}, expected each once an axis"
        raise FitError(msg)
    return names


def by_name(constraints: Any) -> dict[str, Any]:
    """Return what effects keep by name, words in a row; what keeps nothing is left out.

    Raises:
        FitError: If there are no names.
    """
    found = _named(
        "constraints", constraints, "them by name: {'leadscrew': ['monotone']}"
    )
    rows = {
        name: (own,) if isinstance(own, str) else own for name, own in found.items()
    }
    for name, own in rows.items():
        words = isinstance(own, Sequence) and all(isinstance(each, str) for each in own)
        if not callable(own) and not words:
            msg = f"constraints of {name}: found {own!r}, expected words or a function"
            raise FitError(msg)
    return {name: own for name, own in rows.items() if callable(own) or own}


def models_by_name(active: Any) -> dict[str, Any]:
    """Return the models that acted, by name.

    Raises:
        FitError: If there are no names.
    """
    return _named("active", active, "models by name: {'leadscrew': model}")


def _named(option: str, given: Any, expected: str) -> dict[str, Any]:
    if not isinstance(given, Mapping | None):
        msg = f"{option}: expected {expected}"
        raise FitError(msg)
    return dict(given or {})


def check_names(
    names: Sequence[str],
    effects: Sequence[AbstractEffect | Friction],
    active: Iterable[str],
    constraints: Mapping[str, Any],
) -> None:
    """Check that what was active, or keeps inequalities, is one of the effects.

    Raises:
        FitError: If a name is none of theirs, or that of a friction.
    """
    unknown = [name for name in (*active, *constraints) if name not in names]
    if unknown:
        msg = (
            f"found {', '.join(unknown)} among active and constraints, expected {names}"
        )
        raise FitError(msg)
    for name, one in zip(names, effects, strict=True):
        if isinstance(one, Friction) and name in {*active, *constraints}:
            msg = f"{name}: found active or constraints of it, which a job takes only"
            raise FitError(msg)


def datum_of(
    stack: Sequence[AbstractEffect], datum: Datum | Mapping[str, Datum] | None
) -> tuple[float, ...] | None:
    """Return where the error is zero, one position per master.

    Raises:
        FitError: If an effect is no table, does not stand alone, or ends before.
    """
    if datum is None:
        return None
    if isinstance(datum, Mapping) and set(datum) != {"at"}:
        msg = f"datum: found {', '.join(datum) or 'no key'}, expected at"
        raise FitError(msg)
    at = datum["at"] if isinstance(datum, Mapping) else datum
    numbers = numbers_of(at)
    if numbers.ndim > 1 or not numbers.size:
        msg = f"datum: found {at!r}, expected a position for each master"
        raise FitError(msg)
    place = tuple(np.atleast_1d(numbers).tolist())
    for one in stack:
        nodes = one.grid
        alone = [other.axis for other in stack].count(one.axis) == 1
        if not nodes or not alone or len(nodes) != len(place):
            msg = (
                f"datum: found {one.compensation} of {one.axis}, expected a table alone on "
                "its axis, and a position for each of its masters"
            )
            raise FitError(msg)
        for at, own in zip(place, nodes, strict=True):
            if not own[0] <= at <= own[-1]:
                msg = f"datum: found {at:g}, expected {own[0]:g} to {own[-1]:g}"
                raise FitError(msg)
    return place


def check_reach(
    stack: Sequence[AbstractEffect], given: Mapping[str, np.ndarray]
) -> None:
    """Check that some reading lies in each table.

    Raises:
        FitError: If none does.
    """
    for one in stack:
        if one.table_effect is None or one.table_effect.periodic:
            continue
        for (channel, name), (low, high) in one.ranges.items():
            places = given[f"{name}.{channel}"]
            if not np.any((places >= low) & (places <= high)):
                known = places[np.isfinite(places)]
                ends = f"{known.min():g} to {known.max():g}" if len(known) else "NaN"
                msg = (
                    f"{one.name}: found readings at {name} = {ends}, expected some from"
                    f" {low:g} to {high:g}, where its nodes are"
                )
                raise FitError(msg)


def check_alike(name: str, acted: Any, model: Any) -> None:
    """Check that a model which acted is of the kind that is fitted, and holds no more.

    Raises:
        FitError: If it does not.
    """
    if not isinstance(acted, type(model)):
        found, expected = type(acted).__name__, type(model).__name__
        msg = f"active: found a {found} as {name}, expected a {expected}"
        raise FitError(msg)
    if isinstance(acted, AbstractLookup) and len(acted.tables) > len(model.tables):
        msg = (
            f"active: found {name} of two directions, of which one would be lost; expected "
            "bilateral=True"
        )
        raise FitError(msg)


def check_words(part: Part, words: Sequence[Constraint]) -> None:
    """Check that a part is a table that may keep words.

    Raises:
        FitError: If it is none, or goes round.
    """
    table, known = part.effect.table_effect, get_args(Constraint)
    one_way = table is not None and not (table.periodic and known[0] in words)
    if not one_way or not set(words) <= {*known}:
        msg = (
            f"constraints of {part.name}: found {', '.join(words)}, expected a function, or"
            f" of a table {' and '.join(known)} (the first with two ends)"
        )
        raise FitError(msg)

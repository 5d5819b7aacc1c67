"""What a controller does with a compensation, in words for the person at the machine."""

import math
from collections.abc import Collection, Sequence

from ._channel import AbstractChannel, Change
from ._hypothesis import Hypothesis, other_rules

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight",
            "nine", "ten")  # fmt: skip
WORDS = ("sign", "twice", "unit", "shift", "swapped", "lag", "filter", "edge")
"""All faults that a hypothesis may consist of."""


def said(
    hypothesis: Hypothesis, channel: AbstractChannel, words: Collection[str] = WORDS
) -> str:
    """Return the faults of a hypothesis as part of a sentence, or those of some words."""
    return joined(
        [
            _text(word, value or 0.0, hypothesis.change, channel)
            for word, value in hypothesis.faults(channel).items()
            if word in words
        ]
    )


def _text(word: str, value: float, change: Change, channel: AbstractChannel) -> str:
    match word:
        case "sign":
            return "added with opposite sign"
        case "twice":
            return "applied twice"
        case "unit":
            return f"unit is {_times(value)}"
        case "shift":
            return _shift(change.shift, channel)
        case "swapped":
            return f"masters swapped: {_swapped(change.masters, channel)}"
        case "lag":
            return _lag(round(value))
        case "filter":
            return _filter(change, channel)
        case _:
            return _edge(change, channel)


def _lag(cycles: int) -> str:
    size = abs(cycles)
    count = _NUMBERS[size] if size < len(_NUMBERS) else str(size)
    way = "later" if cycles > 0 else "earlier"
    return f"{count} {'cycle' if size == 1 else 'cycles'} {way}"


def _filter(change: Change, channel: AbstractChannel) -> str:
    cycles = channel.cycles_of(change)
    if change.cycles is None:
        return f"filtered over {cycles} cycles all the time, not on switching only"
    listed = max(channel.cycles_under(channel.conventions), 1)
    if cycles <= 1:
        return f"not filtered, instead of over {listed} cycles"
    instead = f"instead of {listed}" if listed > 1 else "instead of none"
    return f"filtered over {cycles} cycles {instead}"


def _edge(change: Change, channel: AbstractChannel) -> str:
    if change.edge is None:
        rules = other_rules(change, channel.plain)
        named = ", ".join(f"{name} = {value}" for name, value in rules.items())
        return f"another edge rule ({named})"
    return {
        "zero": "edge not held: no offset beyond the table",
        "line": "edge not held: goes on as a straight line beyond the table",
        "held": "edge held: the last value is held beyond the table",
    }[change.edge]


def _times(size: float) -> str:
    larger = size > 1.0
    factor = size if larger else 1.0 / size
    word = "larger" if larger else "smaller"
    exact = round(factor)
    if math.isclose(factor, exact, rel_tol=1e-9) and exact == 10:
        return f"ten times {word}"
    note = " (inch for mm?)" if math.isclose(factor, 25.4, rel_tol=0.01) else ""
    return f"{factor:.4g} times {word}{note}"


def _shift(shift: tuple[float, ...], channel: AbstractChannel) -> str:
    parts = []
    masters = channel.masters[-len(shift) :]
    for master, value in zip(masters, shift, strict=True):
        if value:
            along = f" along {channel.motion.name(master)}" if len(shift) > 1 else ""
            unit = "°" if master in channel.motion.ranges else "mm"
            way = "further" if value > 0 else "back"
            parts.append(f"{abs(value):.1f} {unit} {way}{along}")
    return f"table applied {' and '.join(parts)}"


def _swapped(masters: tuple[int, ...] | None, channel: AbstractChannel) -> str:
    if masters is None:
        return "the other order of the indices"
    names, own = (
        " and ".join(map(channel.motion.name, every))
        for every in (masters, channel.masters)
    )
    return f"{'it follows ' * (len(masters) == 1)}{names} instead of {own}"


def joined(texts: Sequence[str]) -> str:
    """Return parts of a sentence as one."""
    if len(texts) < 2:
        return "".join(texts)
    return ", ".join(texts[:-1]) + " and " + texts[-1]

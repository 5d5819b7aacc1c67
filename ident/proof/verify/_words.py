"""What a controller does with a compensation, in words for the person at the machine."""

import dataclasses
import math

from ._channel import AbstractChannel
from ._hypothesis import SCALES, Hypothesis, other_rules

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight",
            "nine", "ten")  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Phrase:
    """One fault: its word, its size, and what it means.

    Attributes:
        word: Of the interface.
        value: Factor; mm or °; cycles; None where there is no size.
        text: Part of a sentence.
    """

    word: str
    value: float | None
    text: str


def phrases(hypothesis: Hypothesis, channel: AbstractChannel) -> list[Phrase]:
    """Return every fault of a hypothesis."""
    found = _of_scale(hypothesis)
    change, plain = hypothesis.change, channel.plain
    words = hypothesis.words(channel)
    if change.is_shifted:
        found.append(_shift(change.shift, channel))
    rules = other_rules(change, plain)
    if change.masters is not None:
        found.append(Phrase("swapped", None, _swapped(change.masters, channel)))
    elif "swapped" in words:
        found.append(
            Phrase("swapped", None, "masters swapped: the other order of the indices")
        )
    if hypothesis.lag:
        size = abs(hypothesis.lag)
        count = _NUMBERS[size] if size < len(_NUMBERS) else str(size)
        way = "later" if hypothesis.lag > 0 else "earlier"
        noun = "cycle" if size == 1 else "cycles"
        found.append(Phrase("lag", float(hypothesis.lag), f"{count} {noun} {way}"))
    if change.cycles is None and "filter" in words:
        cycles = channel.cycles_of(change)
        text = f"filtered over {cycles} cycles all the time, not on switching only"
        found.append(Phrase("filter", float(cycles), text))
    if change.cycles is not None:
        listed = max(channel.cycles_under(channel.conventions), 1)
        instead = f"instead of {listed}" if listed > 1 else "instead of none"
        text = f"filtered over {change.cycles} cycles {instead}"
        if change.cycles <= 1:
            text = f"not filtered, instead of over {listed} cycles"
        found.append(Phrase("filter", float(change.cycles), text))
    if "edge" in words:
        beyond = {
            "zero": "no offset beyond the table",
            "line": "goes on as a straight line beyond the table",
            "held": "the last value is held beyond the table",
        }
        edge = change.edge
        if edge is None:
            named = ", ".join(f"{name} = {value}" for name, value in rules.items())
            text = f"another edge rule ({named})"
        else:
            held = "edge held: " if edge == "held" else "edge not held: "
            text = held + beyond[edge]
        found.append(Phrase("edge", None, text))
    return found


def _of_scale(hypothesis: Hypothesis) -> list[Phrase]:
    scale = hypothesis.scale
    words = () if hypothesis.is_free else SCALES[scale]
    found: list[Phrase] = []
    if scale < 0:
        found.append(Phrase("sign", -1.0, "added with opposite sign"))
    size = abs(scale)
    if "twice" in words:
        found.append(Phrase("twice", 2.0, "applied twice"))
        size /= 2.0
    if hypothesis.is_free or "unit" in words:
        found.append(Phrase("unit", size, f"unit is {_times(size)}"))
    return found


def _times(size: float) -> str:
    larger = size > 1.0
    factor = size if larger else 1.0 / size
    word = "larger" if larger else "smaller"
    exact = round(factor)
    if math.isclose(factor, exact, rel_tol=1e-9) and exact == 10:
        return f"ten times {word}"
    note = " (inch for mm?)" if math.isclose(factor, 25.4, rel_tol=0.01) else ""
    return f"{factor:.3g} times {word}{note}"


def _shift(shift: tuple[float, ...], channel: AbstractChannel) -> Phrase:
    parts = []
    masters = channel.masters[-len(shift) :]
    ranges = channel.motion.ranges
    for k, value in enumerate(shift):
        if value:
            way = "further" if value > 0 else "back"
            along = f" along A{masters[k]}" if len(shift) > 1 else ""
            unit = "°" if masters[k] in ranges else "mm"
            parts.append(f"{abs(value):.1f} {unit} {way}{along}")
    largest = max(shift, key=abs)
    return Phrase("shift", largest, f"table applied {' and '.join(parts)}")


def _swapped(masters: tuple[int, ...], channel: AbstractChannel) -> str:
    names = " and ".join(f"A{number}" for number in masters)
    own = " and ".join(f"A{number}" for number in channel.masters)
    if len(masters) == 1:
        return f"masters swapped: it follows {names} instead of {own}"
    return f"masters swapped: {names} instead of {own}"


def joined(texts: list[str]) -> str:
    """Return parts of a sentence as one."""
    if len(texts) < 2:
        return "".join(texts)
    return ", ".join(texts[:-1]) + " and " + texts[-1]

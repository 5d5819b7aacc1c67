"""What a controller may do otherwise than the lists say, how likely that is, and in words."""

import dataclasses
import math
from collections.abc import Collection, Sequence

from ._channel import AbstractChannel, Change

_UNITS = (10.0, 0.1, 1000.0)
"""Factors between the units that lists have and had."""

SCALES: dict[float, tuple[str, ...]] = {
    sign * size * times: (*first, *second, *third)
    for sign, first in ((1.0, ()), (-1.0, ("sign",)))
    for size, second in ((1.0, ()), *((unit, ("unit",)) for unit in _UNITS))
    for times, third in ((1.0, ()), (2.0, ("twice",)))
}
"""Factors of the offset that a fault explains, with the words for it."""

FREE_BAND = 0.02
"""A fitted factor that lies that near one of `SCALES` is that one."""

FAULT = 2.0 * math.log(100.0)
"""Cost of a fault: one compensation in a hundred has it, so one in 10 000 has two."""

SHIFTS = 240
"""Most places of a table that are tried along one master."""

RULES = {
    "plane_index": "swapped",
    "crosstalk_outside": "edge",
    "friction_above": "edge",
    "friction_below": "edge",
    "table_filter": "filter",
    "temperature_filter": "filter",
}
"""Conventions whose other choice is one of the faults; the rest are named as such."""


def other_rules(change: Change, plain: Change) -> dict[str, int | str]:
    """Return the conventions that differ from those assumed, with their values."""
    if change.conventions == plain.conventions:
        return {}
    assumed = plain.conventions.to_dict()
    return {
        name: value
        for name, value in change.conventions.to_dict().items()
        if value != assumed[name]
    }


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """One way in which a compensation may be applied.

    Attributes:
        change: Of the table, its edge, its masters, its filter.
        lag: Cycles that the offset comes later.
        scale: Factor of the offset.
        is_free: The factor is none of `SCALES`, but what fits best.
    """

    change: Change
    lag: int = 0
    scale: float = 1.0
    is_free: bool = False

    def faults(self, channel: AbstractChannel) -> dict[str, float | None]:
        """Return the size of each fault that it consists of; empty where there is none.

        A factor; mm or °; cycles; None where a fault has no size.
        """
        faults: dict[str, float | None] = {}
        words, size = () if self.is_free else SCALES[self.scale], abs(self.scale)
        if self.scale < 0:
            faults["sign"] = -1.0
        if "twice" in words:
            faults["twice"] = 2.0
            size /= 2.0
        if self.is_free or "unit" in words:
            faults["unit"] = size
        change, plain = self.change, channel.plain
        if change.is_shifted:
            faults["shift"] = max(change.shift, key=abs)
        rules = {RULES[name] for name in other_rules(change, plain) if name in RULES}
        if change.masters is not None or change.turned or "swapped" in rules:
            faults["swapped"] = None
        if self.lag:
            faults["lag"] = float(self.lag)
        if change.cycles is not None or "filter" in rules:
            faults["filter"] = float(channel.cycles_of(change))
        if change.edge is not None or "edge" in rules:
            faults["edge"] = None
        return faults

    def apart(self, other: "Hypothesis") -> set[str]:
        """Return the names of the attributes, and of the change's, that differ."""
        mine, theirs = (
            vars(hypothesis) | vars(hypothesis.change) for hypothesis in (self, other)
        )
        return {k for k in mine if k != "change" and mine[k] != theirs[k]}

    def cost(self, channel: AbstractChannel, samples: float) -> float:
        """Return twice the logarithm by which it is less likely than the plain one.

        A fault costs `FAULT`; a choice among several what it takes to name one; a number
        fitted to the data what the Bayesian information criterion charges for so many
        independent rows.
        """
        number = math.log(max(samples, 2.0))
        faults = self.faults(channel)
        cost = FAULT * len(faults) + 2.0 * math.log(len(_UNITS)) * ("unit" in faults)
        # The best of many places gains by chance what it takes to name it, however few rows.
        shifted = sum(1 for shift in self.change.shift if shift)
        cost += max(number, 2.0 * math.log(SHIFTS)) * shifted
        cost += 2.0 * math.log(20.0) * (self.lag != 0)
        if self.change.cycles is not None:
            cost += 2.0 * math.log(40.0)
            # Where the manuals know of no filter, a delay is the simpler story.
            taken, assumed = self.change.conventions, channel.conventions
            unknown = channel.cycles_under(taken) <= 1
            cost += FAULT * (unknown or taken.table_filter != assumed.table_filter)
        if self.change.masters is not None:
            cost += 2.0 * math.log(len(channel.swaps))
        if self.is_free:
            cost += number + FAULT  # the factors above are what faults are made of
        rules = other_rules(self.change, channel.plain)
        cost += FAULT * sum(1 for name in rules if name not in RULES)
        return cost


_EDGES = {
    "zero": "edge not held: no offset beyond the table",
    "line": "edge not held: goes on as a straight line beyond the table",
    "hold": "edge held: the last value is held beyond the table",
}


def fault_words(
    hypothesis: Hypothesis,
    channel: AbstractChannel,
    words: Collection[str] | None = None,
) -> str:
    """Return the faults of a hypothesis as part of a sentence, or those of some words."""
    faults, change = hypothesis.faults(channel).items(), hypothesis.change
    named = [fault for fault in faults if words is None or fault[0] in words]
    return joined([_text(word, size or 0.0, change, channel) for word, size in named])


def _text(word: str, value: float, change: Change, channel: AbstractChannel) -> str:
    match word:
        case "sign":
            return "added with opposite sign"
        case "twice":
            return "applied twice"
        case "unit":
            factor, way = (value, "larger") if value > 1.0 else (1.0 / value, "smaller")
            note = " (inch for mm?)" if math.isclose(factor, 25.4, rel_tol=0.01) else ""
            return f"unit is {factor:.4g} times {way}{note}"
        case "shift":
            return _shift(change, channel)
        case "swapped" if change.turned:
            return (
                "directions swapped: motion in one gets what the list has for the other"
            )
        case "swapped":
            return f"masters swapped: {_swapped(change.masters, channel)}"
        case "lag":
            size, direction = abs(round(value)), "later" if value > 0 else "earlier"
            return f"{size} {'cycle' if size == 1 else 'cycles'} {direction}"
        case "filter":
            return _filter(change, channel)
        case _ if change.edge is not None:
            return _EDGES[change.edge]
        case _:
            rules = other_rules(change, channel.plain).items()
            listing = ", ".join(f"{name} = {value}" for name, value in rules)
            return f"another edge rule ({listing})"


def _filter(change: Change, channel: AbstractChannel) -> str:
    cycles = channel.cycles_of(change)
    if change.cycles is None:
        return f"filtered over {cycles} cycles all the time, not on switching only"
    listed = channel.cycles_under(channel.conventions)
    if cycles <= 1:
        return f"not filtered, instead of over {max(listed, 1)} cycles"
    instead = listed if listed > 1 else "none"
    return f"filtered over {cycles} cycles instead of {instead}"


def _shift(change: Change, channel: AbstractChannel) -> str:
    parts = []
    masters = channel.masters[-len(change.shift) :]
    for master, value in zip(masters, change.shift, strict=True):
        if value:
            name, several = channel.motion.name(master), len(change.shift) > 1
            along = f" along {name}" if several else ""
            unit, turn = "mm", channel.motion.ranges.get(master)
            if turn is not None:  # the shorter way round
                unit, span = "°", turn[1] - turn[0]
                value -= span * round(value / span)
            direction = "further" if value > 0 else "back"
            parts.append(f"{abs(value):.1f} {unit} {direction}{along}")
    return f"table applied {' and '.join(parts)}"


def _swapped(masters: tuple[int, ...] | None, channel: AbstractChannel) -> str:
    if masters is None:
        return "the other order of the indices"
    names, listed = (
        " and ".join(channel.motion.name(number) for number in axes)
        for axes in (masters, channel.masters)
    )
    return f"{'it follows ' * (len(masters) == 1)}{names} instead of {listed}"


def joined(texts: Sequence[str]) -> str:
    """Return parts of a sentence as one."""
    if len(texts) < 2:
        return "".join(texts)
    return ", ".join(texts[:-1]) + " and " + texts[-1]

"""One row of the registry: what the manuals say of one parameter.

Named tuples, not dataclasses: making the classes takes a sixth of the time, and every
start of ``axcomp check`` pays for it.
"""

import functools
from typing import Literal, NamedTuple, TypeAlias

from ._finding import Level
from ._values import INTEGER_LIMITS

Kind: TypeAlias = Literal["compensation", "axis", "startup", "unknown"]


class Interval(NamedTuple):
    """A range of numbers with open or closed ends; None is an end without limit."""

    minimum: int | None
    maximum: int | None
    exclusive_minimum: bool = False
    exclusive_maximum: bool = False

    def holds(self, low: int | float, high: int | float) -> bool:
        """Return whether all numbers from ``low`` to ``high`` lie inside."""
        bottom, top = self.minimum, self.maximum
        if bottom is not None and (
            low < bottom or (self.exclusive_minimum and low == bottom)
        ):
            return False
        return top is None or not (
            high > top or (self.exclusive_maximum and high == top)
        )

    def __str__(self) -> str:
        """Return the range as the manuals print it, without the name."""
        low, high = self.minimum, self.maximum
        left = "" if low is None else f"{low} {'<' if self.exclusive_minimum else '≤'} "
        right = (
            "" if high is None else f" {'<' if self.exclusive_maximum else '≤'} {high}"
        )
        return f"{left}x{right}"


class Alias(NamedTuple):
    """Another name of a parameter."""

    name: str
    kind: Literal["alias", "legacy"]
    note: str
    """Where the name stands."""
    semantics: str


class Condition(NamedTuple):
    """What must hold between the entries of one structure.

    One reading that fails gives `level`. Several readings are contradictory statements
    of the manuals: an error where all fail, a warning where only some do.
    """

    readings: tuple[str, ...]
    expected: str
    when: str | None = None
    level: Level = "error"
    number: int | None = None
    semantics: str | None = None


class Change(NamedTuple):
    """How much an entry may plausibly differ from another one, in list units.

    The other one is the neighbour in its column, or the entry of the same index in
    another column.
    """

    largest: int
    number: int | None = None
    """Error number of the controller for a change out of its range."""
    against: str | None = None
    """Key of the other column; None: neighbours of the own one."""
    when: str | None = None
    """Flag of the structure without which the other column is not used."""
    slope: int | None = None
    """Largest plausible change of neighbours in list units per 1000 of their distance."""
    least: int = 0
    """Least plausible change: of points, which must not lie too close."""


class Parameter(NamedTuple):
    """What the manuals say of one parameter."""

    id: str | None
    """Such as ``P-COMP-00016``; None for entries that the manuals name without one."""
    key: str
    """Name in the list, lower case, indices as ``[]``; empty where only mentioned."""
    text: str
    kind: Kind
    type: str
    """BOOLEAN, UNS08 … UNS32, SGN16 … SGN64, REAL64, STRING or BITS (named bits)."""
    narrow_type: str | None = None
    range: Interval | None = None
    wide_range: Interval | None = None
    plausible: Interval | None = None
    """What a sound machine needs: outside of it, though allowed, is likely a mistake."""
    step: Change | None = None
    jump: Change | None = None
    demanded: str | None = None
    """Bit of P-AXIS-00465 that demands the compensation which the entry switches on."""
    values: tuple[int, ...] = ()
    also: tuple[int, ...] = ()
    words: tuple[str, ...] = ()
    length: int | None = None
    unit: tuple[str, str] = ("", "")
    """Unit in the list for linear axes, and for rotary axes and spindles."""
    default: int | str | None = None
    zero_is_default: bool = False
    axes: tuple[str, ...] = ()
    since: str | None = None
    since_note: str | None = None
    number: int | None = None
    """Error number that the controller reports for a defective value."""
    negative: int | None = None
    missing: int | None = None
    changed: int | None = None
    """Error number where the value is changed after start-up: a restart is needed."""
    numbers: tuple[int, ...] = ()
    """Further error numbers of the same cause."""
    needed: str | None = None
    conditions: tuple[Condition, ...] = ()
    aliases: tuple[Alias, ...] = ()
    generation: Literal["present", "old"] = "present"
    discontinued: str | None = None
    mentioned: bool = False
    misspelt: tuple[str, ...] = ()
    semantics: tuple[str, ...] = ()
    source: tuple[str, ...] = ()

    @property
    def structure(self) -> str:
        """Part of the key before the table and the last dot, such as ``kw.ssfk``."""
        return structure_of(self.key)

    @property
    def name(self) -> str:
        """Part of the key behind the last dot."""
        return self.key.rpartition(".")[2]

    @property
    def is_integer(self) -> bool:
        """Whether the value is a whole number (BOOLEAN included)."""
        return self.type in INTEGER_LIMITS

    @property
    def error_numbers(self) -> tuple[int, ...]:
        """Error numbers of the controller that the parameter can cause, ascending."""
        codes = {self.number, self.negative, self.missing, self.changed, *self.numbers}
        codes.update(condition.number for condition in self.conditions)
        codes.update(change.number for change in (self.step, self.jump) if change)
        return tuple(sorted(number for number in codes if number is not None))


@functools.cache
def structure_of(key: str) -> str:
    """Return the structure of a key: ``kw.ssfk`` for all its entries and tables."""
    return key.partition("[")[0].rpartition(".")[0]


class Function(NamedTuple):
    """A compensation whose table stands in a compensation list."""

    name: str
    structure: str
    activation: str
    """Key of the axis parameter that switches it on."""
    signs: tuple[str, ...]
    """Scalars of the structure that, when not 0, show that it is in use."""
    masters: tuple[str, ...] = ()
    adaptations: tuple[str, ...] = ()
    absent: int | None = None
    """What the controller reports where it is switched on without a table."""
    unit: str | None = None


def parse_interval(text: str, type_name: str) -> Interval:
    """Return the interval of a text such as ``0 < x <= MAX``, for a kernel type."""
    low, high = INTEGER_LIMITS.get(type_name, (None, None))
    words = text.split()
    at = words.index("x")

    def number(word: str) -> int | None:
        return {"MIN": low, "MAX": high}[word] if word in ("MIN", "MAX") else int(word)

    bottom = number(words[at - 2]) if at else low
    top = number(words[at + 2]) if at + 2 < len(words) else high
    return Interval(
        bottom,
        top,
        exclusive_minimum=bool(at) and words[at - 1] == "<",
        exclusive_maximum=at + 2 < len(words) and words[at + 1] == "<",
    )

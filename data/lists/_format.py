"""Text of values, as strictly as the manuals ask for it anywhere."""

import math
import unicodedata
from collections.abc import Sequence

from ..errors import AxcompError
from ._grammar import QUOTES
from ._names import locate
from ._parameter import Parameter
from ._registry import registry
from ._values import (
    INTEGER_LIMITS,
    parse_bits,
    parse_boolean,
    parse_integer,
    parse_real,
)

_PLAIN_LETTERS = {
    "\u00b5": "u",
    "\u03bc": "u",
    "\u00df": "ss",
    "\u00d7": "x",
    "\u00b7": "*",
    "\u2212": "-",
    "\u2013": "-",
    "\u2014": "-",
    "\u2026": "...",
    "\u00b0": "deg",
}


class EntryValueError(AxcompError, ValueError):
    """A value that does not fit the entry it is meant for."""

    def __init__(self, source: str, name: str, value: str, expected: str) -> None:
        super().__init__(source, name, value, expected)
        self.source, self.name = source, name
        self.value, self.expected = value, expected

    def __str__(self) -> str:
        return (
            f"{self.source}: {self.name}: found {self.value}, expected {self.expected}"
        )


class UnknownEntryError(AxcompError, KeyError):
    """A name that the list, or every manual, lacks."""

    def __init__(self, source: str, name: str, expected: str) -> None:
        super().__init__(source, name, expected)
        self.source, self.name, self.expected = source, name, expected

    def __str__(self) -> str:
        return f"{self.source}: {self.name}: expected {self.expected}"


def known_place(name: str, source: str) -> tuple[str, tuple[int, ...]]:
    """Return the canonical key and the indices of a parameter by its name.

    Raises:
        UnknownEntryError: If no manual knows the name, or its indices do not fit.
    """
    place = locate(name)
    known = place is not None and place[0] in registry().by_key
    if place is None or not known or place[0].count("[]") != len(place[1]):
        expected = "the name of a parameter in the manuals, with its indices"
        raise UnknownEntryError(source, name, expected)
    return place


def value_texts(
    key: str, names: Sequence[str], values: Sequence[object], source: str
) -> list[str]:
    """Return the texts of all values of one canonical key.

    Args:
        key: Canonical key, with blank indices.
        names: Name of each entry, for messages.
        values: `str`, `int`, `float` or `bool` each.
        source: The list, for messages.

    Raises:
        EntryValueError: If a value does not fit the type or range of the parameter.
    """
    row = registry().by_key.get(key)
    if row is not None and row.is_integer:
        numbers = [value for value in values if type(value) is int]
        fit = len(numbers) == len(values) > 0
        if fit and _integers_fit(row, min(numbers), max(numbers)):
            return list(map(str, numbers))  # a large table: one test for all of it
    return [
        value_text(row, name, value, source)
        for name, value in zip(names, values, strict=True)
    ]


def value_text(row: Parameter | None, name: str, value: object, source: str) -> str:
    """Return the text of one value; see `value_texts`."""
    text = _free_text(value) if row is None or not row.type else _typed_text(row, value)
    if text is None:
        literal = repr(value)
        if len(literal) > 60:
            literal = f"{literal[:57]}..."
        raise EntryValueError(source, name, literal, _expected(row))
    return text


def _integers_fit(row: Parameter, low: int, high: int) -> bool:
    """Return whether all integers from ``low`` to ``high`` fit the parameter."""
    bottom, top = INTEGER_LIMITS[row.type]
    if low < bottom or high > top:
        return False
    if row.values:
        return set(range(low, high + 1)) <= {*row.values, *row.also}
    if low == high and low in row.also:
        return True
    narrow, wide = row.range, row.wide_range
    if narrow is None and wide is None:
        return True
    return bool(
        (narrow and narrow.holds(low, high)) or (wide and wide.holds(low, high))
    )


def _typed_text(row: Parameter, value: object) -> str | None:
    if row.type == "BOOLEAN":
        truth = value if isinstance(value, bool) else parse_boolean(str(value))
        return None if truth is None else str(int(truth))
    if row.type == "BITS":
        text = "" if isinstance(value, bool) else str(value).strip()
        return text if parse_bits(text) is not None else None
    if row.is_integer:
        number = parse_integer(str(value))
        fits = number is not None and _integers_fit(row, number, number)
        return str(number) if fits and not isinstance(value, bool) else None
    if row.type == "REAL64":
        return _real_text(row, value)
    return _string_text(row, value)


def _real_text(row: Parameter, value: object) -> str | None:
    number = None if isinstance(value, bool) else parse_real(str(value))
    if number is None or not math.isfinite(number):
        return None
    if row.range is not None and not row.range.holds(number, number):
        return None
    return _without_exponent(number)


def _without_exponent(number: float) -> str:
    """Return the number without exponent, as its reading stands nowhere (S-08)."""
    import decimal  # rarely needed, and not cheap to load

    return format(decimal.Decimal(repr(number)), "f")


def _string_text(row: Parameter, value: object) -> str | None:
    if not isinstance(value, str):
        return None
    if row.words and value not in row.words:
        return None
    if row.length is not None and len(value) > row.length:
        return None
    return _quoted_where_needed(value)


def _quoted_where_needed(value: str) -> str | None:
    """Return the text, quoted where a manual asks for it, or None if it cannot be."""
    if any(sign in QUOTES or not sign.isprintable() for sign in value):
        return None
    if value != value.rstrip():
        return None  # trailing blanks are discarded on import (ISG manual, 1.3)
    special = not value or any(
        sign in value for sign in (" ", "\u00a0", "(", "#", "/*")
    )
    return f'"{value}"' if special else value


def _free_text(value: object) -> str | None:
    """Return the text of a value for an entry that no manual names."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _without_exponent(value) if math.isfinite(value) else None
    return _quoted_where_needed(value) if isinstance(value, str) else None


def _expected(row: Parameter | None) -> str:
    if row is None or not row.type:
        return "a number, or a text of printable characters without quotes"
    if row.type == "BOOLEAN":
        return "BOOLEAN, 0 or 1"
    if row.type == "BITS":
        return "identifiers joined by |, or a number"
    if row.words:
        return f"STRING, one of {', '.join(row.words)}"
    if row.type == "STRING":
        size = "" if row.length is None else f" of at most {row.length} characters"
        return f"STRING{size}, printable, without quotes and without a blank at its end"
    if row.values:
        return f"{row.type}, one of {', '.join(map(str, (*row.also, *row.values)))}"
    if row.range is not None:
        return f"{row.type}, {row.range}"
    if row.type in INTEGER_LIMITS:
        low, high = INTEGER_LIMITS[row.type]
        return f"{row.type}, {low} ≤ x ≤ {high}"
    return f"{row.type}, a finite number"


def comment_lines(comment: str, encoding: str, newline: str) -> list[str]:
    """Return full-line comments of a text, in letters that the encoding has."""
    lines: list[str] = []
    for part in comment.splitlines() or [""]:
        text = part.rstrip()
        try:
            text.encode(encoding)
        except UnicodeEncodeError:
            text = _plain_letters(text)
        printable = text
        if not text.isprintable():
            printable = "".join(sign if sign.isprintable() else " " for sign in text)
        line = f"# {printable}".rstrip()
        # An empty comment keeps its blank: "#" alone breaks the manuals' own rule.
        lines.append(("# " if line == "#" else line) + newline)
    return lines


def _plain_letters(text: str) -> str:
    """Return the nearest ASCII text: a comment is no data, so a near miss will do."""
    words = "".join(_PLAIN_LETTERS.get(sign, sign) for sign in text)
    bare = unicodedata.normalize("NFKD", words)
    letters = (sign for sign in bare if not unicodedata.combining(sign))
    return "".join(sign if sign.isascii() else "?" for sign in letters)

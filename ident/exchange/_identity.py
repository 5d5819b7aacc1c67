"""Which axis a list belongs to, and what its integers are worth."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Int

from ...data.lists import ListFile, parse_real, registry
from ._units import LIST_UNITS, ExchangeError, expect

Increments = float | Mapping[int, float] | None
"""mm (or °) per encoder increment: one for all axes, by axis number, or not known."""

MOST_REVERSAL_CYCLES = 19
"""For a reversal and for the temperature: fewer than 20 (S-25, S-44)."""
_TABLES = ("table[]", "table[][]", "position[]")
_WIDE = 2**32
"""Size from which on no type of a table has an integer."""
_LONGEST = 60
"""Characters of a number that somebody meant."""
_DIGITS = re.compile(r"([0-9]{1,5})\D*$")


def axis_number(listing: ListFile) -> int:
    """Return the logical axis number: ``kopf.achs_nr``, else from the file name.

    Raises:
        ExchangeError: If neither tells it.
    """
    number = listing.integer("kopf.achs_nr")
    if number is not None:
        return number
    match = _DIGITS.search(re.split(r"[\\/]", listing.source)[-1])
    if match is None:
        words = "neither kopf.achs_nr nor a number in the file name"
        raise ExchangeError(listing.source, words, "the logical axis number")
    return int(match[1])


def _unreadable(listing: ListFile, name: str, expected: str) -> ExchangeError:
    entry = listing.get(name)
    line = "" if entry is None else f":{entry.line}"
    description = "no entry" if entry is None else repr(entry.value[:_LONGEST])
    return ExchangeError(f"{listing.source}{line}: {name}", description, expected)


def required(listing: ListFile, name: str) -> int:
    """Return an integer entry; refuse a list that lacks it, or where it is unreadable."""
    value = listing.integer(name)
    if value is None:
        raise _unreadable(listing, name, "an integer")
    return value


def optional(listing: ListFile, name: str) -> int:
    """Return an integer entry, its default where it is left out; refuse one unreadable."""
    if listing.get(name) is not None:
        return required(listing, name)
    row = registry().by_key.get(name)
    return row.default if row is not None and isinstance(row.default, int) else 0


def not_negative(listing: ListFile, name: str) -> int:
    """Return an integer entry, 0 where it is left out; refuse one unreadable or below 0."""
    value = optional(listing, name)
    expect(value >= 0, f"{listing.source}: {name}", value, "0 or more")
    return value


def refuse_many(cycles: int, name: str) -> None:
    """Raise where a reversal or a temperature line takes more cycles than it may."""
    limit = f"at most {MOST_REVERSAL_CYCLES} cycles"
    expect(cycles <= MOST_REVERSAL_CYCLES, name, cycles, limit)


def flag(listing: ListFile, name: str) -> bool:
    """Return a BOOLEAN entry, false where the list leaves it out; refuse one that is none."""
    value = listing.boolean(name)
    if value is None and listing.get(name) is not None:
        raise _unreadable(listing, name, "0 or 1")
    return bool(value)


def real(listing: ListFile, name: str) -> float:
    """Return a REAL64 entry, 0 where the list leaves it out; refuse one that is none."""
    entry = listing.get(name)
    value = 0.0 if entry is None else parse_real(entry.value)
    if value is None:
        raise _unreadable(listing, name, "a number")
    return value


def values_of(
    listing: ListFile, prefix: str, field: str
) -> dict[int, int] | dict[tuple[int, int], int]:
    """Return a column of a table in list units, by index.

    An unreadable entry is refused: as 0 it would make another table.
    """
    keys = [f"{prefix}.{table}.{field}".lower() for table in _TABLES]
    for rows in (listing.columns[name] for name in keys if name in listing.columns):
        for line, value in zip(rows.lines, rows.integers, strict=True):
            if value is None or abs(value) >= _WIDE:
                entry = listing.entry_at(line)
                raise ExchangeError(
                    where=f"{listing.source}:{entry.line}: {entry.name}",
                    found=repr(entry.value),
                    expected="an integer" + " of 32 bits" * (value is not None),
                )
    return listing.table(prefix, field)


def column(
    listing: ListFile, prefix: str, field: str, count: int
) -> Int[np.ndarray, " n"]:
    """Return the first `values_of` a column in list units; what is missing is 0 (S-57)."""
    integers: dict[Any, int] = dict(values_of(listing, prefix, field))
    return np.array([integers.get(k, 0) for k in range(count)], dtype=np.int64)


def unit_size(
    listing: ListFile, prefix: str, axis: int, increments: Increments
) -> float:
    """Return how many mm or ° one integer of an axis is worth in a structure.

    Args:
        listing: The list.
        prefix: Structure, for example ``kw.crosscomp2``; its ``unit`` decides.
        axis: Logical number of the axis whose lengths are meant.
        increments: Worth of an encoder increment, needed where ``unit`` is 0.

    Raises:
        ExchangeError: If the list counts in increments and their worth is not known.
    """
    if flag(listing, f"{prefix}.unit"):
        return 1.0 / LIST_UNITS
    size = increments.get(axis) if isinstance(increments, Mapping) else increments
    if size is None:
        option = "" if isinstance(increments, Mapping) else "--increment, or "
        raise ExchangeError(
            where=f"{listing.source}: {prefix}.unit",
            found="0 or nothing (encoder increments)",
            expected=f"1 (0.1 µm), or the worth of an increment of axis {axis}"
            f" ({option}increment = … of the axis in the job)",
        )
    return size


def scaled(values: Any, size: float) -> Any:
    """Return integers of the list in mm or °, exact for list units."""
    return values / LIST_UNITS if size == 1.0 / LIST_UNITS else values * size

"""Which axis a list belongs to, and what its integers are worth."""

import re
from collections.abc import Mapping

from ...data.lists import ListFile
from ._units import LIST_UNITS, ExchangeError, expect

Increments = float | Mapping[int, float] | None
"""mm (or °) per encoder increment: one for all axes, by axis number, or not known."""

MOST_REVERSAL_CYCLES = 19
"""For a reversal and for the temperature: fewer than 20 (S-25, S-44)."""
_TABLES = ("table[]", "table[][]", "position[]")
_REAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,2})?")
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
        raise ExchangeError(
            where=listing.source,
            found="neither kopf.achs_nr nor a number in the file name",
            expected="the logical axis number",
        )
    return int(match[1])


def _unreadable(listing: ListFile, name: str, expected: str) -> ExchangeError:
    entry = listing.get(name)
    line = "" if entry is None else f":{entry.line}"
    found = "no entry" if entry is None else repr(entry.value[:_LONGEST])
    return ExchangeError(f"{listing.source}{line}: {name}", found, expected)


def required(listing: ListFile, name: str) -> int:
    """Return an integer entry that the function needs.

    Raises:
        ExchangeError: If it is missing or unreadable.
    """
    value = listing.integer(name)
    if value is None:
        raise _unreadable(listing, name, "an integer")
    return value


def optional(listing: ListFile, name: str) -> int:
    """Return an integer entry, 0 where the list leaves it out, as in the controller.

    Raises:
        ExchangeError: If it stands there and is unreadable.
    """
    return 0 if listing.get(name) is None else required(listing, name)


def not_negative(listing: ListFile, name: str) -> int:
    """Return an integer entry, 0 where the list leaves it out.

    Raises:
        ExchangeError: If it stands there and is unreadable or below 0.
    """
    value = optional(listing, name)
    expect(value >= 0, f"{listing.source}: {name}", value, "0 or more")
    return value


def refuse_many(cycles: int, name: str) -> None:
    """Raise where a reversal or a temperature line takes more cycles than it may.

    Raises:
        ExchangeError: Naming the entry.
    """
    most = f"at most {MOST_REVERSAL_CYCLES} cycles"
    expect(cycles <= MOST_REVERSAL_CYCLES, name, cycles, most)


def flag(listing: ListFile, name: str) -> bool:
    """Return a BOOLEAN entry, false where the list leaves it out.

    Raises:
        ExchangeError: If it stands there and is none.
    """
    value = listing.boolean(name)
    if value is None and listing.get(name) is not None:
        raise _unreadable(listing, name, "0 or 1")
    return bool(value)


def real(listing: ListFile, name: str) -> float:
    """Return a REAL64 entry, 0 where the list leaves it out.

    Raises:
        ExchangeError: If it stands there and is no finite number.
    """
    entry = listing.get(name)
    if entry is None:
        return 0.0
    if len(entry.value) > _LONGEST or _REAL.fullmatch(entry.value) is None:
        raise _unreadable(listing, name, "a number")
    return float(entry.value)


def values_of(
    listing: ListFile, prefix: str, field: str
) -> dict[int, int] | dict[tuple[int, int], int]:
    """Return a column of a table in list units, by index.

    Raises:
        ExchangeError: If an entry is unreadable: as 0 it would make another table.
    """
    keys = [f"{prefix}.{table}.{field}".lower() for table in _TABLES]
    for rows in (listing.columns[name] for name in keys if name in listing.columns):
        if None in rows.integers:
            at = rows.integers.index(None)
            entry = listing.entry_at(rows.lines[at])
            raise ExchangeError(
                where=f"{listing.source}:{entry.line}: {entry.name}",
                found=repr(entry.value),
                expected="an integer",
            )
    return listing.table(prefix, field)


def column(listing: ListFile, prefix: str, field: str) -> dict[int, int]:
    """Return a column of a table with one index, in list units.

    Raises:
        ExchangeError: If an entry is unreadable.
    """
    return {
        index: value
        for index, value in values_of(listing, prefix, field).items()
        if isinstance(index, int)
    }


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
        by_job = isinstance(increments, Mapping)
        way = "" if by_job else "--increment, or "
        raise ExchangeError(
            where=f"{listing.source}: {prefix}.unit",
            found="0 or nothing (encoder increments)",
            expected=f"1 (0.1 µm), or the worth of an increment of axis {axis}"
            f" ({way}increment = … of the axis in the job)",
        )
    return size


def scaled(value: int, size: float) -> float:
    """Return an integer of the list in mm or °, exact for list units."""
    return value / LIST_UNITS if size == 1.0 / LIST_UNITS else value * size

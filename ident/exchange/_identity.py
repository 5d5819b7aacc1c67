"""Which axis a list belongs to, and what its integers are worth."""

import re
from collections.abc import Mapping

from ...data.lists import ListFile
from ._errors import ExchangeError
from ._units import LIST_UNITS

Increments = float | Mapping[int, float] | None
"""mm (or °) per encoder increment: one for all axes, by axis number, or not known."""

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


def required(listing: ListFile, name: str) -> int:
    """Return an integer entry that the function needs.

    Raises:
        ExchangeError: If it is missing or unreadable.
    """
    value = listing.integer(name)
    if value is None:
        entry = listing.get(name)
        found = "no readable value" if entry is None else repr(entry.value)
        raise ExchangeError(
            where=f"{listing.source}: {name}", found=found, expected="an integer"
        )
    return value


def column(listing: ListFile, prefix: str, field: str) -> dict[int, int]:
    """Return a column of a table with one index, in list units."""
    return {
        index: value
        for index, value in listing.table(prefix, field).items()
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
    if listing.boolean(f"{prefix}.unit"):
        return 1.0 / LIST_UNITS
    size = increments.get(axis) if isinstance(increments, Mapping) else increments
    if size is None:
        raise ExchangeError(
            where=f"{listing.source}: {prefix}.unit",
            found="0 or nothing (encoder increments)",
            expected=f"1 (0.1 µm), or the worth of an increment of axis {axis}"
            " (--increment, or increment = … of the axis in the job)",
        )
    return size


def scaled(value: int, size: float) -> float:
    """Return an integer of the list in mm or °, exact for list units."""
    return value / LIST_UNITS if size == 1.0 / LIST_UNITS else value * size

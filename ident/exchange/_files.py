"""The list files of an axis: their names, new tables in them, entries to add to them."""

import dataclasses
from collections.abc import Mapping, Sequence

from ...data.lists import ListFile, Value, full_name, new_list
from ..kinds import kinds


def compensation_file(number: int) -> str:
    """Return the name of the compensation list of an axis."""
    return f"achskw{number}.lis"


def axis_file(number: int, *, whole: bool = True) -> str:
    """Return the name of the axis list of an axis, or of the entries to add to it."""
    return f"achsmds{number}{'' if whole else '.add'}.lis"


_ADDITIONS = "no whole axis list"


def is_to_add(listing: ListFile) -> bool:
    """Return whether a list is one of entries to add to an axis list, as `to_add` makes it."""
    named = listing.source.endswith(".add.lis")
    return named or any(_ADDITIONS in line for line in listing.lines)


def to_add(
    number: int, values: Mapping[str, Value], *comments: str, of: str = ""
) -> ListFile:
    """Return entries to add to an axis list, under comments that say so."""
    name = f" of axis {of}" if of else ""
    words = f"Entries to set in {axis_file(number)}{name}: {_ADDITIONS}"
    listing = new_list(values, comment=(words, *comments))
    return dataclasses.replace(listing, source=axis_file(number, whole=False))


@dataclasses.dataclass(frozen=True)
class Edited:
    """A compensation list whose tables were replaced.

    Attributes:
        listing: The list, under the name that it is written by.
        added: Names of the entries that it lacked before.
        removed: Names of those that went.
    """

    listing: ListFile
    added: Sequence[str]
    removed: Sequence[str]


def with_tables(
    existing: ListFile | None,
    number: int,
    entries: Mapping[str, Value],
    *comment: str,
    name: str | None = None,
) -> Edited:
    """Return a list with new entries in place of the tables that these are of.

    Args:
        existing: The list, all else in which stays; None: a new one is made.
        number: Of its axis, which is added where the list does not say it.
        entries: What it is to hold.
        comment: Lines at the top of a new list.
        name: Of the axis, for a new list.
    """
    source = compensation_file(number)
    if existing is None:
        head: dict[str, Value] = {"kopf.achs_nr": number}
        head |= {} if name is None else {"kopf.log_achs_name": name}
        listing = new_list(head | dict(entries), comment=comment)
        return Edited(dataclasses.replace(listing, source=source), [], [])
    columns = existing.columns.items()
    names = (full_name(key, at) for key, rows in columns for at in rows.last)
    present = dict.fromkeys(names)
    begin = tuple(
        f"{record.prefix}.{part}"
        for record in kinds()
        if any(name.startswith(f"{record.prefix}.") for name in entries)
        for part in record.entries.stale
    )
    stale = [name for name in present if name.startswith(begin) and name not in entries]
    values = dict(entries)
    if "kopf.achs_nr" not in present:
        values = {"kopf.achs_nr": number} | values
    added = [name for name in values if name not in present]
    listing = existing.remove(stale).merge(values)
    return Edited(dataclasses.replace(listing, source=source), added, stale)

"""The strict writer: a new list that every reading of the manuals accepts."""

import functools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias

from ._edit import check_encoding
from ._format import UnknownEntryError, comment_lines, known_place, value_texts
from ._listfile import ListFile, Value
from ._names import full_name
from ._parameter import structure_of

_SOURCE = "new list"
_CLOSING = "# Ende"
"""Real lists close with ``Ende``, which the manuals' grammar reads as an entry without
a value; they print ``End`` and ``# End`` and mostly nothing. As a comment it closes the
list for people and is right under every reading (semantics S-09)."""


def new_list(
    values: Mapping[str, Value],
    *,
    comment: Sequence[str] = (),
    newline: str = "\n",
) -> ListFile:
    """Return a new list of these entries that satisfies every reading of the manuals.

    ASCII; the header first; in each structure the sizes before the table (semantics
    S-08); decimal integers, BOOLEAN as 0 or 1 (S-02), a text with special characters in
    quotes (S-03); comments on lines of their own behind ``#`` and a blank (S-09).

    Args:
        values: Value by name, in the order in which they are to stand.
        comment: Lines of the comment at the top; other letters become ASCII.
        newline: Line end.

    Raises:
        UnknownEntryError: If a name is none that the manuals know, or stands twice.
        EntryValueError: If a value does not fit its parameter.
    """
    columns = _columns(values)
    width = 2 + max(map(len, values), default=0)
    lines = [line for text in comment for line in comment_lines(text, "ascii", newline)]
    for block in _blocks(columns):
        if lines:
            lines.append(newline)
        texts: dict[str, str] = {}
        for key, names in block:
            inputs = [values[name] for name in names]
            written = value_texts(key, list(names), inputs, _SOURCE)
            check_encoding(list(names), written, _SOURCE, "ascii")
            texts.update(zip(names.values(), written, strict=True))
        order = list(texts)
        if len(block) > 1:  # as they were given
            given = {name: full for _, names in block for name, full in names.items()}
            order = [given[name] for name in values if name in given]
        lines += [name.ljust(width) + texts[name] + newline for name in order]
    if lines:
        lines.append(newline)
    return ListFile((*lines, _CLOSING + newline), _SOURCE, "ascii")


def _columns(values: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return the names by canonical key: the name as given and as it is written."""
    columns: dict[str, dict[str, str]] = {}
    names = list(values)
    odd = False
    text = "".join([f"{name}\n" for name in names])
    single = text.count("\n") == len(names)
    at = row = 0
    before = ""
    while row < len(names):
        name = names[row]
        key, full = _canonical(name)
        odd = odd or full != name
        column = columns.setdefault(key, {})
        column[name] = full
        at += len(name) + 1
        row += 1
        repeated, before = key == before, key
        if repeated and full == name and "[" in name and single:
            # Names that follow and differ in their indices alone need no further look.
            run = _run(name).match(text, at)
            if run is not None:
                end = row + run.group().count("\n")
                followers = names[row:end]
                column.update(zip(followers, followers, strict=True))
                at, row = run.end(), end
    if odd:
        _refuse_repeated(columns)
    return columns


@functools.lru_cache(maxsize=64)
def _pattern(head: str, tail: str, count: int) -> re.Pattern[str]:
    indices = r"\]\[".join(["(?:0|[1-9][0-9]{0,8}+)"] * count)
    return re.compile(f"(?:{re.escape(head)}{indices}{re.escape(tail)}\n)++")


def _run(name: str) -> re.Pattern[str]:
    """Return what matches lines of names that differ from this one in indices alone."""
    first, last = name.index("[") + 1, name.rindex("]")
    return _pattern(name[:first], name[last:], name.count("["))


def _refuse_repeated(columns: Mapping[str, Mapping[str, str]]) -> None:
    for names in columns.values():
        used: set[str] = set()
        for name, full in names.items():
            if full in used:
                raise UnknownEntryError(_SOURCE, name, "each entry once")
            used.add(full)


@functools.lru_cache(maxsize=4096)
def _canonical(name: str) -> tuple[str, str]:
    """Return the canonical key and name, or refuse what no manual names."""
    place = known_place(name, _SOURCE)
    return place[0], full_name(*place)


_Block: TypeAlias = list[tuple[str, dict[str, str]]]


def _blocks(columns: Mapping[str, dict[str, str]]) -> Iterator[_Block]:
    """Return the columns of each block: header, structures, sizes before tables."""
    stems: dict[str, tuple[_Block, _Block]] = {}
    for key, names in columns.items():
        stems.setdefault(structure_of(key), ([], []))["[" in key].append((key, names))
    for stem in sorted(stems, key=lambda stem: stem != "kopf"):
        yield from filter(None, stems[stem])

"""Names of list entries: one canonical spelling for each.

Case does not matter (semantics S-07), blanks inside a name neither (S-46), and other
names of a parameter stand for it (S-10, S-41, S-48).
"""

import functools
import re
from typing import NamedTuple

from ._registry import registry

BLANKS = " \t\v\f\u00a0\u2007\u202f"
"""What separates the parts of a line; the last three are no-break spaces (S-09)."""
NO_BREAK = "\u00a0\u2007\u202f"

_WORD = "[A-Za-z_][A-Za-z0-9_]*"
_INDEX = rf"\[[{BLANKS}]*[0-9]{{1,9}}[{BLANKS}]*\]"
_PART = rf"{_WORD}(?:[{BLANKS}]*{_INDEX})*"
NAME = re.compile(rf"{_PART}(?:[{BLANKS}]*\.[{BLANKS}]*{_PART})*")
"""A name as it may stand in a file; an index has at most nine digits."""
INDEX = re.compile(rf"\[[{BLANKS}]*([0-9]{{1,9}})[{BLANKS}]*\]")

_SPACES = re.compile(rf"[{BLANKS}]+")


class Meaning(NamedTuple):
    """What the registry says of a key, as far as reading a line needs it."""

    key: str
    """Canonical key."""
    style: str
    """How its value is written: ``number``, ``text``, ``bits`` or ``unknown``."""
    boolean: bool
    other: str | None
    """``alias`` or ``legacy`` where the key is not the canonical one."""


@functools.lru_cache(maxsize=4096)
def meaning(key: str) -> Meaning:
    """Return what the registry says of a lower-case key with blank indices."""
    manual = registry()
    canonical = manual.canonical(key)
    parameter = manual.by_key.get(canonical)
    if parameter is None:
        return Meaning(canonical, "unknown", False, None)
    styles = {"STRING": "text", "BITS": "bits", "": "unknown"}
    style = styles.get(parameter.type, "number")
    alias = manual.alias(key)
    other = None if alias is None else alias.kind
    return Meaning(canonical, style, parameter.type == "BOOLEAN", other)


def split_name(written: str) -> tuple[str, tuple[int, ...]] | None:
    """Return the lower-case key with blank indices and the indices of a written name.

    None where the text is not a name.
    """
    if NAME.fullmatch(written) is None:
        return None
    indices = tuple(int(digits) for digits in INDEX.findall(written))
    return _SPACES.sub("", INDEX.sub("[]", written)).lower(), indices


@functools.lru_cache(maxsize=4096)
def locate(name: str) -> tuple[str, tuple[int, ...]] | None:
    """Return the canonical key and the indices of a name, or None for no name."""
    parts = split_name(name.strip())
    return None if parts is None else (meaning(parts[0]).key, parts[1])


def full_name(key: str, indices: tuple[int, ...]) -> str:
    """Return the canonical name: the key with its indices filled in."""
    if not indices:
        return key
    pieces = key.split("[]")
    filled = [
        f"{piece}[{index}]" for piece, index in zip(pieces, indices, strict=False)
    ]
    return "".join(filled) + "".join(pieces[len(indices) :])

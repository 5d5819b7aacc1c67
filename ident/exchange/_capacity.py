"""How many entries a table may have, and from which build that can be changed."""

import re

from ...data.lists import ListFile
from ._errors import ExchangeError

FIRST_WITH_MAX_POINTS = (3, 1, 3079, 6)
"""Build V3.1.3079.06, from which the size of the tables can be set."""

_BUILD = re.compile(r"[Vv]?(\d+(?:\.\d+){1,4})\s*")


def build_number(build: str) -> tuple[int, ...]:
    """Return a build such as ``V3.1.3108.4`` as numbers that can be compared.

    Raises:
        ExchangeError: If the text is no build.
    """
    match = _BUILD.fullmatch(build)
    if match is None:
        raise ExchangeError(
            where="build", found=repr(build), expected="a build such as V3.1.3108.4"
        )
    return tuple(int(part) for part in match[1].split("."))


def max_points_entry(
    needed: int,
    *,
    name: str,
    fits_default: bool,
    wanted: int | None,
    existing: ListFile | None,
    build: str | None,
) -> dict[str, int | str]:
    """Return the entry ``max_points`` to write; none where it stays as it is.

    It is written only where it must be: its change asks for a restart.

    Args:
        needed: Smallest value that holds the table under every reading of the manuals.
        name: Of the entry, for the message.
        fits_default: Whether the table fits without the entry, in every build.
        wanted: What the user asked for, or None.
        existing: List that will be edited; 0 in it stands for the default.
        build: Of the controller, or None for the newest.

    Raises:
        ExchangeError: If the build lacks the parameter but the table needs it, or the
            user asks for less than the table needs.
    """
    if wanted is not None and wanted < needed:
        raise ExchangeError(
            where=name, found=str(wanted), expected=f"at least {needed} for this table"
        )
    stated = None if existing is None else existing.integer(name)
    if wanted is None:
        if stated:
            wanted = None if stated >= needed else needed
        elif not fits_default:
            wanted = needed
    if wanted is None or wanted == stated:
        return {}
    if build is not None and build_number(build) < FIRST_WITH_MAX_POINTS:
        raise ExchangeError(
            where=name,
            found=f"a table that needs {needed} on build {build}",
            expected="a table within the fixed size (max_points: V3.1.3079.06 on)",
        )
    return {name: wanted}


_MOST = 4_000_000
"""Values of a table that is read; no controller has the memory for as many."""


def refuse_huge(count: int, where: str) -> None:
    """Raise at a size that only a mistyped list states, before it fills the memory.

    Raises:
        ExchangeError: If a table has more than some million values.
    """
    if count > _MOST:
        raise ExchangeError(
            where=where, found=f"{count} values", expected=f"at most {_MOST}"
        )

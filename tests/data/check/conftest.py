"""Complete lists to change, and what `check` says of the changed ones, in brief."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from axcomp.data.lists import ListFile
from axcomp.data.lists._check import check

Entries = dict[str, object]
Brief = tuple[str, str | None, int | None]

COMPLETE = Path(__file__).parent / "complete"


@pytest.fixture(scope="session")
def complete() -> Callable[[str], Entries]:
    """Return the entries of a list without fault: ``complete("plane")``."""

    def entries(name: str) -> Entries:
        listing = ListFile.read(COMPLETE / f"{name}.lis")
        return {
            each.name: int(each.value)
            if each.value.lstrip("-").isdigit()
            else each.value
            for each in listing.entries
        }

    return entries


@pytest.fixture(scope="session")
def write() -> Callable[[Mapping[str, object]], ListFile]:
    """Return a compensation list of entries; those that are None are left out."""

    def written(entries: Mapping[str, object]) -> ListFile:
        lines = [
            f"{key} {value}" for key, value in entries.items() if value is not None
        ]
        return ListFile.parse("\n".join([*lines, ""]).encode(), "achskw3.lis")

    return written


@pytest.fixture(scope="session")
def judge(
    write: Callable[[Mapping[str, object]], ListFile],
) -> Callable[..., list[Brief]]:
    """Return level, id and controller error of what `check` says, advice left out."""

    def judged(
        listing: ListFile | Mapping[str, object], build: str | None = None
    ) -> list[Brief]:
        file = listing if isinstance(listing, ListFile) else write(listing)
        found = check([file]) if build is None else check([file], build=build)
        brief = ((each.level, each.id, each.number) for each in found)
        return sorted((each for each in brief if each[0] != "info"), key=str)

    return judged

"""A list as the commands that show lists read it: it must hold something."""

import pathlib
from typing import TYPE_CHECKING

from ...data.errors import AxcompError

if TYPE_CHECKING:
    from ...data.lists import ListFile


class NoEntryError(AxcompError):
    """A file of which no line is an entry of a list."""

    def __init__(self, source: str, found: str) -> None:
        super().__init__(source, found)
        self.source, self.found = source, found

    def __str__(self) -> str:
        return f"{self.source}: found {self.found}, expected entries of a list"


def read_list(path: pathlib.Path) -> "ListFile":
    """Return the list in a file.

    Raises:
        OSError: If the file cannot be read.
        NoEntryError: If no line of it is an entry.
    """
    from ...data.lists import ListFile

    listing = ListFile.read(path)
    if not listing.columns:
        found = "no entry" if listing.lines else "an empty file"
        raise NoEntryError(str(path), "UTF-16" if listing.is_wide else found)
    return listing

"""TOML files, read with the line of what is wrong in them."""

import bisect
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .errors import AxcompError

_AT = re.compile(r"(.*?) \(at (?:line (\d+), column (\d+)|end of document)\)")


class TomlError(AxcompError, ValueError):
    """A file that is no TOML, or not what it should be.

    Attributes:
        source: The file.
        line: Where in it, or None.
        reason: What was found and what was expected.
    """

    def __init__(self, source: str, line: int | None, reason: str) -> None:
        super().__init__(source, line, reason)
        self.source, self.line, self.reason = source, line, reason

    def __str__(self) -> str:
        where = self.source if self.line is None else f"{self.source}:{self.line}"
        return f"{where}: {self.reason}"


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Return the text and the values of a TOML file.

    Raises:
        TomlError: If it is none.
        OSError: If it cannot be read.
    """
    text = read_utf8(path)
    try:
        return text, tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = _AT.fullmatch(str(error))
        if match is None:
            raise TomlError(str(path), None, f"not TOML: {error}") from None
        line = int(match[2]) if match[2] else text.count("\n") + 1
        place = f" in column {match[3]}" if match[3] else ""
        twice = _stated_twice(text, line) if "Cannot" in match[1] else None
        reason = twice or f"not TOML: {match[1]}{place}"
        raise TomlError(str(path), line, reason) from None


def read_utf8(path: Path) -> str:
    """Return the text of a file.

    Raises:
        TomlError: If it is not UTF-8.
        OSError: If it cannot be read.
    """
    raw = path.read_bytes()
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        reason = f"found byte 0x{raw[error.start]:02x}, expected UTF-8 text"
        raise TomlError(str(path), line, reason) from None


def _stated_twice(text: str, line: int) -> str | None:
    """Return what is wrong with a line whose key or heading stands above it, or None.

    Args:
        text: In which something stands twice in one table.
        line: Where the second one ends (1-based).
    """
    *above, last = (row.partition("=")[0].strip() for row in text.splitlines()[:line])
    equal = [number for number, head in enumerate(above, 1) if head == last]
    if not equal:
        return None
    return (
        f"found {last} a second time, after line {equal[-1]}, expected one of both: the"
        " other one is no answer, and has a # in front"
    )


def line_of(text: str, where: Iterable[int | str]) -> int | None:
    """Return the line (1-based) of a key of a TOML text, or of the nearest table around it.

    Args:
        text: That `tomllib` reads; it does not tell where its keys stand.
        where: Names of tables and keys, numbers in arrays: ``("fits", 0, "start")``.
    """
    lines, path = text.splitlines(keepends=True), tuple(where)

    def holds(count: int) -> bool:
        # A value of several lines makes no text before its end.
        for end in range(count, len(lines) + 1):
            try:
                return _is_in(tomllib.loads("".join(lines[:end])), path)
            except tomllib.TOMLDecodeError:
                continue
        return True

    while path and not _is_in(tomllib.loads(text), path):
        path = path[:-1]
    if not path:
        return None
    return bisect.bisect_left(range(len(lines) + 1), True, key=holds)


def _is_in(tree: Any, path: Iterable[int | str]) -> bool:
    try:
        for part in path:
            tree = tree[part]
    except (KeyError, IndexError, TypeError):
        return False
    return True

"""Where in a TOML text each key stands: the standard library's reader does not tell."""

import re

Path = tuple[str | int, ...]

_PART = re.compile(r"""\s*(?:"((?:[^"\\]|\\.)*)"|'([^']*)'|([A-Za-z0-9_-]+))\s*""")
_FENCES = ('"""', "'''")
_TOKEN = re.compile(r'"""|\'\'\'|"(?:[^"\\]|\\.)*"|\'[^\']*\'|#.*')
"""What brackets do not count in: long strings, strings, comments."""


def _key(text: str, start: int = 0) -> tuple[list[str], int]:
    """Return a dotted key and where it ends; no parts where there is none."""
    parts: list[str] = []
    at = start
    while match := _PART.match(text, at):
        parts.append(next(part for part in match.groups() if part is not None))
        at = match.end()
        if not text.startswith(".", at):
            break
        at += 1
    return parts, at


def key_lines(text: str) -> dict[Path, int]:
    """Return the line (1-based) of every table and key of a TOML text.

    Elements of arrays of tables carry their index. Keys inside inline tables and of
    texts that are no TOML may be missing.
    """
    lines: dict[Path, int] = {}
    counts: dict[Path, int] = {}
    table: Path = ()
    depth = 0
    fence = ""
    for number, line in enumerate(text.splitlines(), start=1):
        rest = line
        if fence:
            end = line.find(fence)
            if end < 0:
                continue
            rest, fence = line[end + 3 :], ""
        elif depth == 0:
            stripped = line.strip()
            if stripped.startswith("["):
                double = stripped.startswith("[[")
                parts, _ = _key(stripped, 2 if double else 1)
                table = _resolved(parts, counts, double)
                lines.setdefault(table, number)
                continue
            parts, end = _key(line)
            if parts and line.startswith("=", end):
                for k in range(1, len(parts) + 1):
                    lines.setdefault((*table, *parts[:k]), number)
                rest = line[end + 1 :]
        bare, at = "", 0
        while match := _TOKEN.search(rest, at):
            bare += rest[at : match.start()]
            at = match.end()
            if match[0] in _FENCES:
                close = rest.find(match[0], at)
                fence = "" if close >= 0 else match[0]
                at = close + 3 if close >= 0 else len(rest)
        bare += rest[at:]
        depth += sum(bare.count(c) for c in "[{") - sum(bare.count(c) for c in "]}")
        depth = max(depth, 0)
    return lines


def _resolved(parts: list[str], counts: dict[Path, int], double: bool) -> Path:
    """Return the path of a table header, with the index of each array of tables."""
    path: Path = ()
    for k, part in enumerate(parts):
        path = (*path, part)
        if double and k == len(parts) - 1:
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path = (*path, counts[path])
    return path


def line_of(lines: dict[Path, int], path: Path) -> int | None:
    """Return the line of a key, or of the nearest table around it that is known."""
    for end in range(len(path), 0, -1):
        if path[:end] in lines:
            return lines[path[:end]]
    return None

"""Where in a TOML text each key stands: the standard library's reader does not tell."""

import re

Path = tuple[str | int, ...]

_PART = re.compile(r"""\s*(?:"((?:[^"\\]|\\.)*)"|'([^']*)'|([A-Za-z0-9_-]+))\s*""")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'')
_LONG = re.compile(r'"""|\'\'\'')


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
        while match := _LONG.search(rest):
            close = rest.find(match[0], match.end())
            if close < 0:
                fence, rest = match[0], rest[: match.start()]
                break
            rest = rest[: match.start()] + rest[close + 3 :]
        bare = _STRING.sub("", rest).split("#", 1)[0]
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

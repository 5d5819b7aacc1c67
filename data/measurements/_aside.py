"""Lines of a text table that are no rows: words below them, headings between its blocks."""

import re
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Int

from ._headings import heading, numbered
from ._layout import Layout
from ._table import Column

_FOOT = 30
"""Lines at the end of a text that may be no rows."""
_SUMMARY = re.compile(
    r"(?i)(mean|average|avg|mittel\w*|max\w*|min\w*|sum\w*|std\w*|sigma|range|spannweite"
    r"|total|result\w*|ergebnis\w*|standardabweichung|end|ende|eof|\[end\])\b.*"
)


def without_foot(layout: Layout, text: str) -> tuple[str, list[tuple[int, str]]]:
    """Return a text without the lines of words below its rows, and these with their numbers.

    A row that was cut off is no such line: it begins like a row.
    """
    tail = text[layout.body :].rstrip("\n").rsplit("\n", _FOOT)
    foot = len(tail)
    for at in range(len(tail) - 1, 0, -1):
        if tail[at].strip():
            if not _is_foot(
                layout, tail[at], after_gap=_is_after_gap(layout, tail, at)
            ):
                break
            foot = at
    if foot == len(tail):
        return text, []
    body = text[: layout.body] + "\n".join(tail[:foot])
    line = body.count("\n") + 1 - text[: layout.body].count("\n") + layout.body_line
    notes = [(line + k, words) for k, words in enumerate(tail[foot:])]
    return body, [(number, words.strip()) for number, words in notes if words.strip()]


def _is_after_gap(layout: Layout, lines: Sequence[str], at: int) -> bool:
    """Whether a line stands below an empty one, or in a block of words that does."""
    above = at - 1
    while layout.numeric[0] and above > 0 and lines[above].strip()[:1].isalpha():
        above -= 1
    return not lines[above].strip()


def _is_foot(layout: Layout, line: str, *, after_gap: bool) -> bool:
    dialect = layout.dialect
    if dialect.is_comment(line):
        return True
    cells = dialect.split(line)
    filled = [cell for cell in cells if cell]
    if not filled or dialect.number(filled[0]) is not None:
        return False
    if layout.header and tuple(cells) == layout.header[: len(cells)]:
        return False
    numbers = any(map(dialect.is_number, filled))
    summary = _SUMMARY.fullmatch(filled[0]) is not None
    if len(layout.names) == 1 and not after_gap:
        return summary  # any other word is a bad cell of the only column
    words = after_gap or not numbers or summary
    if layout.numeric[0]:
        return words and filled[0][0] not in "+-.,0123456789"
    return after_gap or (len(filled) == 1 and summary)


def without_headings(layout: Layout, text: str) -> tuple[str, list[tuple[int, str]]]:
    """Return a text without the lines between its rows that name a run or a direction."""
    if not layout.header or len(layout.names) < 2 or layout.block is None:
        return text, []
    lines = text[layout.body :].split("\n")
    headings = [
        (at + layout.body_line, line.strip())
        for at, line in enumerate(lines)
        if line[:1].strip().isalpha() and len(line) < 80 and heading(line) is not None
    ]
    for number, _ in headings:
        lines[number - layout.body_line] = ""
    return text[: layout.body] + "\n".join(lines), headings


def columns_of_blocks(
    blocks: Sequence[tuple[int, str]], lines: Int[np.ndarray, " t"]
) -> Iterator[Column]:
    """Yield run and direction of each row, as the line above its block names them."""
    headings = [item for _, text in blocks if (item := heading(text)) is not None]
    block = np.searchsorted([line for line, _ in blocks], lines) - 1
    runs = list(numbered(dict(enumerate(headings))).values())
    for name in ("run", "direction"):
        values = [getattr(item, name) for item in runs]
        if None not in values:
            cells = np.array(values, dtype=np.float64)[block]
            yield Column(name, None, None, cells, header=name)

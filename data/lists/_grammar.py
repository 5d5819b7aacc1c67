"""One line of a list: what it is, where its parts stand, what is odd about it.

Grammar after the ISG parameter manual, 1.3 and 1.4, read liberally (semantics.md rule 1
and S-03, S-04, S-07, S-09): ``name blank value [blank comment]``. A comment behind a
number needs a blank only; behind a text it opens with ``(``. It ends with its line.
"""

import functools
import re
from typing import Literal, NamedTuple

from ._names import BLANKS, INDEX, NAME, NO_BREAK, full_name, meaning, split_name
from ._remarks import RemarkCode

QUOTES = '"\u2033\u201c\u201d\u201e\u201f\x84\x93\x94'
"""The plain quote, and what typography makes of it; the last three are its Windows
codes, which Latin-1 shows as control characters."""

_SHORT = 200
"""Characters up to which a line is looked up among the last ones."""
_BLANK_RUN = re.compile(f"[{BLANKS}]*")
_TOKEN = re.compile(f"[^{BLANKS}]+")
_BITS = re.compile(rf"\w+(?:[{BLANKS}]*\|[{BLANKS}]*\w+)*")
_OPENER = re.compile(r"#|\(|/\*")
_NUMBER = re.compile(r"[+-]?\.?[0-9]|(?:true|false)(?![A-Za-z0-9_])", re.IGNORECASE)
_LATE_COMMENT = re.compile(rf"[{BLANKS}](?:#|/\*)")

Note = tuple[int, str, str]
"""1-based column, code and text of a remark."""


class Line(NamedTuple):
    """One line, taken apart; offsets are 0-based within the line."""

    kind: Literal["blank", "comment", "end", "entry", "unreadable"]
    notes: tuple[Note, ...] = ()
    written: str = ""
    key: str = ""
    indices: tuple[int, ...] = ()
    start: int = 0
    value: str = ""
    """Text of the value without quotes."""
    value_start: int = 0
    value_end: int = 0
    """End of what an edit replaces: value with its quotes, without a glued comment."""
    quoted: bool = False
    glued: bool = False
    """Whether a comment follows without a blank."""

    @property
    def name(self) -> str:
        """Canonical name with indices."""
        return full_name(self.key, self.indices)


def read_line(text: str) -> Line:
    """Return the parts of one line; never raises, whatever the line holds."""
    return _cached(text) if len(text) <= _SHORT else _read(text)


def _read(text: str) -> Line:
    body = text.rstrip("\r\n")
    start = _skip(body, 1 if body.startswith("\ufeff") else 0)
    if start == len(body):
        return Line("blank")
    first = body[start]
    if first == "#":
        bare = len(body) == start + 1 or body[start + 1] not in BLANKS
        note = (start + 1, str(RemarkCode.BARE_HASH), body[start : start + 20])
        return Line("comment", (note,) if bare else ())
    if first == "(" or body.startswith("/*", start):
        return _comment_line(body, start)
    match = NAME.match(body, start)
    if match is None:
        return _unreadable(body, start)
    return _entry(body, start, match.end())


_cached = functools.lru_cache(maxsize=4096)(_read)
"""Lists of a kind of machine share most of their lines outside tables."""


def _skip(body: str, start: int) -> int:
    match = _BLANK_RUN.match(body, start)
    return start if match is None else match.end()


def _unreadable(body: str, column: int) -> Line:
    text = body.strip(BLANKS)
    excerpt = text if len(text) <= 60 else f"{text[:57]}..."
    note = (column + 1, str(RemarkCode.UNREADABLE_LINE), excerpt)
    return Line("unreadable", (note,))


def _comment_line(body: str, start: int) -> Line:
    """Read a line that opens with a comment of the kind that belongs behind a value."""
    closing = ")" if body[start] == "(" else "*/"
    end = body.find(closing, start + 1)
    if end >= 0:
        following = _skip(body, end + len(closing))
        if following < len(body) and _OPENER.match(body, following) is None:
            # Something follows the comment: if it was meant to count, say that it
            # does not.
            return _unreadable(body, following)
    note = (start + 1, str(RemarkCode.COMMENT_LINE), body[start : start + 20])
    return Line("comment", (note,))


def _entry(body: str, start: int, end: int) -> Line:
    """Read a line whose name stands from ``start`` to ``end``."""
    after = _skip(body, end)
    # `name [1]` and `name .5` could be read on as parts of the name; a value is needed.
    if after == len(body):
        shorter = _last_word(body, start, end)
        if shorter is not None:
            end, after = shorter
    spelling = body[start:end]
    parts = split_name(spelling)
    glued_quote = after == end < len(body) and body[end] in QUOTES
    separated = after > end or after == len(body) or _OPENER.match(body, after)
    if parts is None or not (separated or glued_quote):
        return _unreadable(body, start)
    if parts[0] in ("end", "ende"):
        return Line("end", ((start + 1, str(RemarkCode.END_LINE), spelling),))
    sense = meaning(parts[0])
    notes: list[Note] = []
    if spelling != spelling.lower():
        notes.append((start + 1, RemarkCode.CASE, spelling))
    if any(blank in INDEX.sub("", spelling) for blank in BLANKS):
        notes.append((start + 1, RemarkCode.NAME_BLANK, spelling))
    if sense.other is not None:
        code = RemarkCode.LEGACY if sense.other == "legacy" else RemarkCode.ALIAS
        notes.append((start + 1, code, f"{spelling} for {sense.key}"))
    if glued_quote:
        notes.append((end + 1, RemarkCode.GLUED_QUOTE, body[end : end + 20]))
    style = sense.style
    if style == "unknown":
        style = "number" if _NUMBER.match(body, after) else "text"
    value, stop, span, quoted, glued = _value(body, after, style, notes)
    if not value and not quoted:
        notes.append((start + 1, RemarkCode.NO_VALUE, spelling))
        stop = span = after = end
    if sense.style not in ("text", "unknown"):
        following = _skip(body, stop)
        # A thousand may be parted from its hundreds: 1 250.
        if "0" <= value[-1:] <= "9" and "0" <= body[following : following + 1] <= "9":
            excerpt = body[after : following + 20]
            notes.append((following + 1, RemarkCode.DIGIT_COMMENT, excerpt))
    gaps = [at for at in range(start, stop) if body[at] in NO_BREAK]
    if gaps:
        excerpt = f"U+{ord(body[gaps[0]]):04X}"
        notes.append((gaps[0] + 1, RemarkCode.NO_BREAK_SPACE, excerpt))
    if sense.boolean and value.lower() in ("true", "false"):
        notes.append((after + 1, RemarkCode.TRUE_FALSE, value))
    remarks = tuple((column, str(code), text) for column, code, text in notes)
    return Line(
        "entry",
        remarks,
        spelling,
        sense.key,
        parts[1],
        start,
        value,
        after,
        span,
        quoted,
        glued,
    )


def _last_word(body: str, start: int, end: int) -> tuple[int, int] | None:
    """Split ``name [1]`` into name and value, where the value looked like an index."""
    spelling = body[start:end]
    gap = max((spelling.rfind(blank) for blank in BLANKS), default=-1)
    if gap <= 0:
        return None
    head = spelling[:gap].rstrip(BLANKS)
    if not spelling[gap + 1 :].startswith(("[", ".")) or NAME.fullmatch(head) is None:
        return None
    return start + len(head), start + gap + 1


def _value(
    body: str, start: int, style: str, notes: list[Note]
) -> tuple[str, int, int, bool, bool]:
    """Read the value at ``start``.

    Returns:
        Its text; where the value with what belongs to it ends; where the part that an
        edit replaces ends; whether it stands in quotes; whether a comment is glued on.
    """
    if start == len(body) or _OPENER.match(body, start):
        return "", start, start, False, False
    if style == "text":
        if body[start] in QUOTES:
            return _quoted(body, start, notes)
        return _bare_text(body, start, notes)
    pattern = _BITS if style == "bits" and _BITS.match(body, start) else _TOKEN
    match = pattern.match(body, start)
    stop = start if match is None else match.end()
    value = body[start:stop]
    opener = _OPENER.search(value)
    if opener is None:
        return value, stop, stop, False, False
    at = start + opener.start()
    notes.append((at + 1, RemarkCode.GLUED_COMMENT, value))
    return value, stop, at, False, True


def _quoted(
    body: str, start: int, notes: list[Note]
) -> tuple[str, int, int, bool, bool]:
    stop = start + 1
    while stop < len(body) and body[stop] not in QUOTES:
        stop += 1
    if stop == len(body):
        notes.append((start + 1, RemarkCode.UNTERMINATED_QUOTE, body[start:]))
        return body[start + 1 :].rstrip(BLANKS), stop, stop, True, False
    for at in (start, stop):
        if body[at] != '"':
            notes.append((at + 1, RemarkCode.TYPOGRAPHIC_QUOTE, body[at]))
            break
    following = _skip(body, stop + 1)
    if following < len(body) and body[following] != "(":
        excerpt = body[following : following + 20]
        notes.append((following + 1, RemarkCode.QUOTE_COMMENT, excerpt))
    # "Trailing spaces are discarded on import" (ISG manual, 1.3); leading ones stay.
    return body[start + 1 : stop].rstrip(BLANKS), stop + 1, stop + 1, True, False


def _bare_text(
    body: str, start: int, notes: list[Note]
) -> tuple[str, int, int, bool, bool]:
    """Read a text without quotes: all up to ``(``, or to a comment of another style."""
    stop = body.find("(", start)
    stop = len(body) if stop < 0 else stop
    comment = _LATE_COMMENT.search(body, start, stop)
    if comment is not None:
        stop = comment.start()
        excerpt = body[stop + 1 : stop + 21]
        notes.append((stop + 2, RemarkCode.QUOTE_COMMENT, excerpt))
    while stop > start and body[stop - 1] in BLANKS:
        stop -= 1
    value = body[start:stop]
    opener = _OPENER.search(value)
    if opener is not None:
        at = start + opener.start()
        notes.append((at + 1, RemarkCode.GLUED_COMMENT, value))
        return value, stop, at, False, True
    if any(blank in value for blank in BLANKS):
        notes.append((start + 1, RemarkCode.UNQUOTED_BLANK, value))
    return value, stop, stop, False, False

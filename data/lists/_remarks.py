"""The anomalies of spelling that the text layer marks and the checker reports.

Both use the codes below, so that neither can say what the other does not know.
"""

import enum
from typing import NamedTuple

from ._finding import Level


class RemarkCode(enum.StrEnum):
    """Names of the anomalies of a list's text."""

    CASE = "case"
    TRUE_FALSE = "true-false"
    UNQUOTED_BLANK = "unquoted-blank"
    TYPOGRAPHIC_QUOTE = "typographic-quote"
    QUOTE_COMMENT = "quote-comment"
    UNTERMINATED_QUOTE = "unterminated-quote"
    GLUED_COMMENT = "glued-comment"
    DIGIT_COMMENT = "digit-comment"
    GLUED_QUOTE = "glued-quote"
    END_LINE = "end-line"
    BEHIND_END = "behind-end"
    NO_BREAK_SPACE = "no-break-space"
    NAME_BLANK = "name-blank"
    NO_VALUE = "no-value"
    UNREADABLE_LINE = "unreadable-line"
    BARE_HASH = "bare-hash"
    COMMENT_LINE = "comment-line"
    REPEATED = "repeated"
    ALIAS = "alias"
    LEGACY = "legacy"
    ENCODING = "encoding"
    BYTE_ORDER_MARK = "byte-order-mark"


class RemarkRule(NamedTuple):
    """What a remark means: level, sentence, expectation and the decision behind it."""

    level: Level
    message: str
    expected: str
    semantics: str | None = None


REMARKS: dict[str, RemarkRule] = {
    RemarkCode.CASE: RemarkRule(
        "info", "capital letters in a name", "lower case", "S-07"
    ),
    RemarkCode.TRUE_FALSE: RemarkRule(
        "info", "BOOLEAN written as a word", "0 or 1", "S-02"
    ),
    RemarkCode.UNQUOTED_BLANK: RemarkRule(
        "warning",
        "text with a blank but without quotes",
        'quotes around the text, "…"',
        "S-03",
    ),
    RemarkCode.TYPOGRAPHIC_QUOTE: RemarkRule(
        "warning", "typographic quote", 'the plain quote "', "S-04"
    ),
    RemarkCode.QUOTE_COMMENT: RemarkRule(
        "warning",
        "comment behind a text does not open with a bracket",
        "a comment that opens with (",
        "S-04",
    ),
    RemarkCode.UNTERMINATED_QUOTE: RemarkRule(
        "warning", "quote is not closed on its line", 'a closing quote "', "S-04"
    ),
    RemarkCode.GLUED_COMMENT: RemarkRule(
        "error",
        "comment without a blank before it",
        "a blank between value and comment",
        "S-09",
    ),
    RemarkCode.DIGIT_COMMENT: RemarkRule(
        "warning",
        "digits behind a value are a comment, not a part of it",
        "a value without blanks, or a comment that opens with # or (",
        "S-09",
    ),
    RemarkCode.GLUED_QUOTE: RemarkRule(
        "warning",
        "quote without a blank before it",
        "a blank between name and value",
        "S-04",
    ),
    RemarkCode.END_LINE: RemarkRule(
        "info", "closing line without #", "# Ende, or nothing", "S-09"
    ),
    RemarkCode.BEHIND_END: RemarkRule(
        "warning",
        "entries stand behind the closing line",
        "Ende as the last line",
        "S-09",
    ),
    RemarkCode.NO_BREAK_SPACE: RemarkRule(
        "warning", "no-break space", "a plain blank", "S-09"
    ),
    RemarkCode.NAME_BLANK: RemarkRule(
        "warning", "blank inside a name", "the name in one piece", "S-46"
    ),
    RemarkCode.NO_VALUE: RemarkRule("warning", "entry without a value", "a value"),
    RemarkCode.UNREADABLE_LINE: RemarkRule(
        "error",
        "line is neither an entry nor a comment, and is left out",
        "name, blank, value",
        "S-01",
    ),
    RemarkCode.BARE_HASH: RemarkRule(
        "info", "comment without a blank after #", "# and a blank", "S-09"
    ),
    RemarkCode.COMMENT_LINE: RemarkRule(
        "info", "comment line that does not open with #", "# and a blank", "S-09"
    ),
    RemarkCode.REPEATED: RemarkRule(
        "warning", "entry stands twice, the last one counts", "one entry", "S-08"
    ),
    RemarkCode.ALIAS: RemarkRule("info", "another name of the parameter", "its name"),
    RemarkCode.LEGACY: RemarkRule(
        "info", "name of an older manual generation", "its present name", "S-10"
    ),
    RemarkCode.ENCODING: RemarkRule(
        "info", "text is not UTF-8 and is read as Latin-1", "ASCII or UTF-8", "S-09"
    ),
    RemarkCode.BYTE_ORDER_MARK: RemarkRule(
        "warning",
        "byte order mark, which the kernel may take for part of the first line",
        "a file without it",
        "S-09",
    ),
}
"""Every code of `RemarkCode`, with what the checker says of it."""

"""Rules for single entries: type, range, words, build."""

from ._check_view import ListView, read_value
from ._entry import Rows
from ._parameter import Parameter
from ._registry import build_has, parse_build, registry
from ._remarks import RemarkCode
from ._values import BITS, INTEGER_LIMITS, parse_integer

_QUOTES_SINCE = "V3.1.3081.0"
"""Build from which a text may stand in quotes (ISG manual, 1.3; semantics S-04)."""
_READABLE = {
    "BOOLEAN": "0 or 1",
    "REAL64": "a number such as 12.5",
    "BITS": f"{', '.join(BITS)} joined by |, or a number",
}
"""What can be read as a value, for the types that are not plain decimal integers."""


def check_values(view: ListView) -> None:
    """Judge every entry of a known name for itself."""
    parameters = registry().by_key
    # A remark calls these unreadable already.
    codes = (RemarkCode.GLUED_COMMENT, RemarkCode.NO_VALUE)
    explained = frozenset(r.line for r in view.file.remarks if r.code in codes)
    for key, rows in view.columns.items():
        row = parameters.get(key)
        if row is None:
            continue
        # The axis list has ``kopf.*`` at its head too.
        shared = row.structure == "kopf" and view.file.kind == "axis"
        if row.kind != view.file.kind and not shared:
            _misplaced(view, rows, row)
        if not build_has(row, view.build):
            _too_new(view, rows, row)
        if row.is_integer:
            _check_integers(view, rows, row, explained)
        else:
            _check_others(view, rows, row, explained)


def _misplaced(view: ListView, rows: Rows, row: Parameter) -> None:
    names = {"compensation": "a compensation list", "axis": "an axis list"}
    place = names.get(row.kind, "a start-up list")
    view.add(
        "warning",
        f"{row.key} belongs into {place}",
        row.key,
        place=view.name_place(rows, 0),
        found=names.get(view.file.kind, "a start-up list"),
        expected=place,
    )


def _too_new(view: ListView, rows: Rows, row: Parameter) -> None:
    view.add(
        "error",
        f"{row.key} exists as of build {row.since}; {view.build} does not take it over",
        row.key,
        place=view.name_place(rows, 0),
        found=view.build or "",
        expected=f"build {row.since}",
    )


def _check_integers(
    view: ListView, rows: Rows, row: Parameter, explained: frozenset[int]
) -> None:
    """Judge a column of whole numbers; a clean one is looked at as a whole."""
    numbers = [value for value in rows.integers if value is not None]
    if len(numbers) < len(rows.integers):
        unreadable: list[int] = []
        numbers = []
        for at, text in enumerate(rows.texts):
            value = read_value(row, text)
            if isinstance(value, int):
                numbers.append(value)
            elif rows.lines[at] not in explained:
                unreadable.append(at)
        _unreadable(view, rows, row, unreadable)
    if not numbers:
        return
    low, high = min(numbers), max(numbers)
    bottom, top = INTEGER_LIMITS[row.type]
    if low < bottom or high > top or not _in_range(row, low, high):
        _sort_out(view, rows, row)
    elif row.narrow_type is not None:
        narrow = INTEGER_LIMITS[row.narrow_type]
        if low < narrow[0] or high > narrow[1]:
            invalid = [
                at
                for at, text in enumerate(rows.texts)
                if not narrow[0] <= (parse_integer(text) or 0) <= narrow[1]
            ]
            words = (
                f"{{name}} = {{text}} does not fit {row.narrow_type}, which one of the"
                " manuals gives as its type"
            )
            expected = f"{narrow[0]} to {narrow[1]}"
            view.add_rows("warning", rows, invalid, words, expected, row.number)


def _in_range(row: Parameter, low: int | float, high: int | float) -> bool:
    """Return whether all numbers from ``low`` to ``high`` are surely allowed."""
    if row.values:
        return low == high and low in row.values
    if row.range is None or row.range.holds(low, high):
        return True
    return low == high and low in row.also


def surely_allowed(row: Parameter, value: int | float) -> bool:
    """Return whether a value has no finding of its own: every statement allows it."""
    bottom, top = INTEGER_LIMITS.get(row.narrow_type or row.type, (value, value))
    return bottom <= value <= top and _in_range(row, value, value)


def _sort_out(view: ListView, rows: Rows, row: Parameter) -> None:
    """Report the values of a column that are outside of type or range, by severity."""
    bottom, top = INTEGER_LIMITS[row.type]
    untyped: list[int] = []
    negative: list[int] = []
    outside: list[int] = []
    doubtful: list[int] = []
    for at, text in enumerate(rows.texts):
        value = read_value(row, text)
        if not isinstance(value, int):
            continue
        if row.negative is not None and value < 0 and bottom >= 0:
            negative.append(at)
        elif not bottom <= value <= top:
            untyped.append(at)
        elif _in_range(row, value, value) or _is_idle_default(view, row, value):
            pass
        elif row.wide_range is not None and row.wide_range.holds(value, value):
            doubtful.append(at)
        else:
            outside.append(at)
    number, expected = row.number, _bounds(row)
    typed = f"{bottom} to {top}"
    words = f"{{name}} = {{text}} does not fit {row.type}"
    view.add_rows("error", rows, untyped, words, typed, number)
    words = "{name} = {text} is negative"
    view.add_rows("error", rows, negative, words, expected, row.negative)
    words = f"{{name}} = {{text}} is not allowed, expected {expected}"
    view.add_rows("error", rows, outside, words, expected, number)
    words = (
        "{name} = {text} is allowed by one of two statements of the manuals only,"
        f" expected {expected}"
    )
    view.add_rows("warning", rows, doubtful, words, expected, number)


def _is_idle_default(view: ListView, row: Parameter, value: int) -> bool:
    """Return whether the value is the default of a function that the list leaves idle.

    Several defaults lie outside their own range (semantics S-49); that matters only
    where the function is in use.
    """
    functions = {function.structure for function in registry().functions}
    idle = row.structure in functions - view.in_use
    return idle and value == row.default


def _bounds(row: Parameter) -> str:
    """Return what a value must be, in words."""
    if row.values:
        return " or ".join(str(value) for value in row.values)
    if row.range is None:
        bottom, top = INTEGER_LIMITS.get(row.type, (0, 0))
        return f"{bottom} to {top}"
    also = "".join(f", or {value}" for value in row.also)
    return f"{row.range}{also}"


def _unreadable(view: ListView, rows: Rows, row: Parameter, invalid: list[int]) -> None:
    words = "{name} cannot be read: {text!r}"
    expected = _READABLE.get(row.type, f"a decimal {row.type}")
    view.add_rows("error", rows, invalid, words, expected, row.number)


def _check_others(
    view: ListView, rows: Rows, row: Parameter, explained: frozenset[int]
) -> None:
    """Judge texts, named bits and real numbers."""
    values = [read_value(row, text) for text in rows.texts]
    unreadable = [
        at
        for at, value in enumerate(values)
        if value is None and rows.lines[at] not in explained
    ]
    _unreadable(view, rows, row, unreadable)
    if row.range is not None:
        invalid = [
            at
            for at, value in enumerate(values)
            if isinstance(value, int | float) and not row.range.holds(value, value)
        ]
        words = f"{{name}} = {{text}} is not allowed, expected {_bounds(row)}"
        view.add_rows("error", rows, invalid, words, _bounds(row), row.number)
    if row.words:
        invalid = [at for at, value in enumerate(values) if value not in row.words]
        words, expected = "{name} = {text!r} is not allowed", " or ".join(row.words)
        view.add_rows("error", rows, invalid, words, expected, row.number)
    if row.type == "STRING" and view.build is not None:
        _check_quotes(view, rows, view.build)
    if row.length is not None:
        longest = row.length
        invalid = [at for at, text in enumerate(rows.texts) if len(text) > longest]
        words = f"{{name}} is longer than {longest} characters: {{text!r}}"
        expected = f"at most {longest} characters"
        view.add_rows("warning", rows, invalid, words, expected)


def _check_quotes(view: ListView, rows: Rows, build: str) -> None:
    """Report a text in quotes that a build before they existed takes literally."""
    if parse_build(build) >= parse_build(_QUOTES_SINCE):
        return
    quoted = [at for at, line in enumerate(rows.lines) if view.line(line).quoted]
    words = f"quotes exist as of build {_QUOTES_SINCE}, not in {build}: {{text!r}}"
    view.add_rows("warning", rows, quoted, words, "a text without quotes")

"""Tables in HTML: how measurements, lists and fits show themselves in a notebook."""

import html
from collections.abc import Iterable


def table_html(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """Return a table; every cell is escaped.

    Args:
        head: Cells of the heading; none: the table has no heading.
        rows: Cells of each row.
    """
    top = _row("th", head)
    body = "".join(_row("td", row) for row in rows)
    heading = f"<thead>{top}</thead>" if top else ""
    return f"<table>{heading}<tbody>{body}</tbody></table>"


def _row(tag: str, cells: Iterable[object]) -> str:
    inner = "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells)
    return f"<tr>{inner}</tr>" if inner else ""

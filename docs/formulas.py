"""Formulas of the pages as MathML: a browser shows them without a script from outside."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

_FORMULA = re.compile(r'class="arithmatex">\\([\[(])(.*?)\\[\])]<', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Replace each formula of a page (a hook of mkdocs)."""

    def rendered(found: re.Match[str]) -> str:
        display = "block" if found[1] == "[" else "inline"
        return f">{convert(html.unescape(found[2]), display=display)}<"

    return _FORMULA.sub(rendered, content)

"""Texts with gaps that lie in a package: pages of HTML, and plain ones for a controller."""

import functools

import jinja2


@functools.cache
def templates(package: str, *, html: bool = False) -> jinja2.Environment:
    """Return the templates in the folder of a package.

    What fills a gap of a page is escaped; in a plain text the filter ``ascii`` makes of it
    what a comment may hold.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package, ""),
        autoescape=html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=not html,
    )
    environment.filters["ascii"] = _ascii
    return environment


def _ascii(text: str) -> str:
    """Return a text that may stand in a comment of a program of the controller."""
    plain = text.encode("ascii", "replace").decode()
    printable = "".join(sign if sign.isprintable() else " " for sign in plain)
    return printable.replace("(*", "(").replace("*)", ")")

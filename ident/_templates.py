"""Texts with gaps that lie in a package: pages of HTML, and plain ones for a controller."""

import functools

import jinja2


@functools.cache
def templates(package: str, *, html: bool = False) -> jinja2.Environment:
    """Return the templates in the folder of a package.

    What fills a gap of a page is escaped; in a plain text the caller sees to it.
    """
    return jinja2.Environment(
        loader=jinja2.PackageLoader(package, ""),
        autoescape=html,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=not html,
    )

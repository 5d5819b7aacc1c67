"""Sentences for a terminal."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from ..job import Remark

_LEVELS = ("error", "warning", "info")


def print_remarks(console: "Console", remarks: Iterable["Remark"]) -> None:
    """Print remarks, errors first."""
    for remark in sorted(remarks, key=lambda one: _LEVELS.index(one.level)):
        tell(console, f"{remark.level}: {remark.message}")


def tell(console: "Console", line: str) -> None:
    """Print a sentence, wrapped to a terminal only: elsewhere it stays one line."""
    console.print(line, markup=False, soft_wrap=not console.is_terminal)

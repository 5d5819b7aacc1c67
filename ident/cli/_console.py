"""What commands print: sentences, JSON, and what they do while it takes long."""

import contextlib
import dataclasses
import json
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.console import Console, JustifyMethod
    from rich.table import Table

    from ..job import Remark

_SOON, _LONG = 2.0, 10.0
"""Seconds after which a terminal shows what goes on, and after which other places do."""


def print_remarks(
    console: "Console", remarks: Iterable["Remark"], printed: set[str]
) -> None:
    """Print remarks, errors first, without what was said before them; now they are said."""
    from ..job import by_level

    for remark in by_level(remarks):
        message = remark.message
        for sentence in printed:
            message = message.replace(sentence, "").strip()
        if message.endswith(":"):
            message += " as said above."
        if message:
            print_line(console, f"{remark.level}: {message}")
        printed.add(remark.message)


def print_line(console: "Console", line: str) -> None:
    """Print a sentence, wrapped to a terminal only: elsewhere it stays one line."""
    console.print(line, markup=False, soft_wrap=not console.is_terminal)


def table_of(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    numbers: Collection[str] = (),
    title: str | None = None,
    caption: str | None = None,
    plain: bool = False,
) -> "Table":
    """Return a table of texts as they stand; a plain one has no lines.

    Columns whose heads are among the `numbers` are those of numbers.
    """
    from rich.box import HEAVY_HEAD
    from rich.markup import escape
    from rich.table import Table

    table = Table(
        title=None if title is None else escape(title),
        caption=None if caption is None else escape(caption),
        box=None if plain else HEAVY_HEAD,
        pad_edge=not plain,
        padding=(0, 2, 0, 0) if plain else (0, 1),
        title_justify="left",
        caption_justify="left",
    )
    for head in heads:
        side: JustifyMethod = "right" if head in numbers else "left"
        table.add_column(escape(head), justify=side, vertical="bottom", overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))
    return table


def print_json(tree: object) -> None:
    """Print a result for machines on standard output."""
    text = json.dumps(tree, ensure_ascii=False, indent=2, default=dataclasses.asdict)
    typer.echo(text)


def print_result(tree: object, lines: Iterable[str]) -> None:
    """Print what was found on standard output: for machines, for people where that is None."""
    if tree is not None:
        print_json(tree)
    else:
        for line in lines:
            typer.echo(line)


def note(lines: Iterable[str], head: str = "axcomp: ") -> None:
    """Print sentences beside the result, on standard error."""
    for line in lines:
        typer.echo(f"{head}{line}", err=True)


def wide_console(*, wraps: bool = False) -> "Console":
    """Return standard output for tables, sentences may wrap: a pipe is as wide as they are."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=not wraps)
    if not console.is_terminal:
        console.width = 160
    return console


@contextlib.contextmanager
def working(words: str, *, every: float = 0.0) -> Iterator[Callable[[str], None]]:
    """Say on standard error what goes on, where that takes long; yield what says the next step.

    A terminal shows it beside a spinner after two seconds, until the end. Other places get
    the steps as plain lines once it takes ten seconds, `every` so many seconds.
    """
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    status = console.status(words)
    spinner = threading.Timer(_SOON, status.start)
    spinner.daemon = True
    if console.is_terminal:
        spinner.start()
    due = time.monotonic() + _LONG

    def step(line: str) -> None:
        nonlocal due
        status.update(line)
        if not console.is_terminal and time.monotonic() > due:
            due += every
            console.print(line, markup=False)

    try:
        yield step
    finally:
        spinner.cancel()
        status.stop()

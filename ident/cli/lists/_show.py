"""The command ``show``."""

import pathlib
from typing import Annotated

import typer

from .._options import Plots, read_shown_list
from .._said import wide_console


def show(
    file: Annotated[
        pathlib.Path, typer.Argument(metavar="FILE.lis", help="List of any kind.")
    ],
    out: Plots = None,
) -> None:
    """Show a list: its parameters with their meaning, its tables in mm and µm."""
    from ....data.lists import offset_curves
    from ._show_tables import list_views

    shown = read_shown_list(file)
    console = wide_console(wraps=True)
    for view in list_views(shown):
        console.print(view)
    if out is not None:
        from ._list_plots import draw_tables

        paths = draw_tables(offset_curves(shown), out)
        for path in paths:
            typer.echo(f"wrote {path}", err=True)
        if not paths:
            typer.echo("no cross, plane or leadscrew table to draw", err=True)

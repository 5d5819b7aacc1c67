"""The command ``show``."""

import pathlib
from typing import Annotated

import typer

from .._options import Plots, Rules, read_shown_list, rules_of
from .._said import wide_console


def show(
    file: Annotated[
        pathlib.Path, typer.Argument(metavar="FILE.lis", help="List of any kind.")
    ],
    conventions: Rules = None,
    out: Plots = None,
) -> None:
    """Show a list: its parameters with their meaning, its tables in mm and µm."""
    from ....data.lists import offset_curves
    from ._show_tables import list_views

    shown, index, settled = read_shown_list(file), "ji", False
    if conventions is not None:  # the rules take the models: only where there are some
        rules = rules_of(conventions)
        index = rules.conventions.plane_index
        settled = "plane_index" in rules.verified
    console = wide_console(wraps=True)
    for view in list_views(shown, index, settled=settled):
        console.print(view)
    if out is not None:
        from ._list_plots import draw_tables

        paths = draw_tables(offset_curves(shown, index), out)
        for path in paths:
            typer.echo(f"wrote {path}", err=True)
        if not paths:
            typer.echo("no cross, plane or leadscrew table to draw", err=True)

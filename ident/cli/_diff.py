"""The command ``diff``."""

import pathlib
from typing import Annotated

import typer


def diff(
    old: Annotated[pathlib.Path, typer.Argument(help="The list as it was.")],
    new: Annotated[pathlib.Path, typer.Argument(help="The list as it is to be.")],
    out: Annotated[
        pathlib.Path | None,
        typer.Option(metavar="DIR", help="Folder for plots of both tables."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the changes for machines.")
    ] = False,
) -> None:
    """Say what changed between two lists, and whether a reload is enough."""
    from ...data.lists import compare, offset_curves
    from ._diff_text import comparison_json, comparison_lines
    from ._read_list import read_list

    lists = read_list(old), read_list(new)
    found = compare(*lists)
    if as_json:
        typer.echo(comparison_json(found))
    else:
        for line in comparison_lines(found):
            typer.echo(line, err=True)
    if out is not None:
        from ._list_plots import draw_comparison

        curves = [offset_curves(listing) for listing in lists]
        for path in draw_comparison(curves[0], curves[1], out):
            typer.echo(f"wrote {path}", err=True)

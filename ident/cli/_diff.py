"""The command ``diff``."""

import pathlib
from typing import Annotated

import typer

from ._options import AsJson, Plots
from ._said import print_json


def diff(
    old: Annotated[pathlib.Path, typer.Argument(help="The list as it was.")],
    new: Annotated[pathlib.Path, typer.Argument(help="The list as it is to be.")],
    out: Plots = None,
    as_json: AsJson = False,
) -> None:
    """Say what changed between two lists, and whether a reload is enough."""
    from ...data.lists import compare, offset_curves
    from ._diff_text import comparison_lines, comparison_tree
    from ._read_list import read_list

    lists = read_list(old), read_list(new)
    found = compare(*lists)
    if as_json:
        print_json(comparison_tree(found))
    else:
        for line in comparison_lines(found):
            typer.echo(line, err=True)
    if out is not None:
        from ._list_plots import draw_comparison

        curves = [offset_curves(listing) for listing in lists]
        for path in draw_comparison(curves[0], curves[1], out):
            typer.echo(f"wrote {path}", err=True)

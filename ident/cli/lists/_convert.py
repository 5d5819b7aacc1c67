"""The command ``convert``: a table from one format into another."""

from pathlib import Path
from typing import Annotated

import typer

from ....data.errors import UsageError


def convert(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help="List, CSV, LinuxCNC compensation file, bed mesh or height map.",
        ),
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="File to write.")],
    to: Annotated[
        str | None,
        typer.Option(
            help="Format of OUT where its ending does not tell: list, csv, linuxcnc, bed-mesh"
            " or height-map."
        ),
    ] = None,
    compensation: Annotated[
        str | None, typer.Option(help="Which table: leadscrew, cross or plane.")
    ] = None,
    axis: Annotated[
        int | None, typer.Option(help="Number of the compensated axis, for a list.")
    ] = None,
    master: Annotated[
        list[int] | None,
        typer.Option(help="Number of a master, for a list; twice for a plane."),
    ] = None,
    trim: Annotated[
        bool,
        typer.Option(
            "--trim", help="LinuxCNC: COMP_FILE_TYPE = 1, values to add, instead of 0."
        ),
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace a file that exists.")
    ] = False,
) -> None:
    """Convert a table: lists, CSV, LinuxCNC compensation files, bed meshes, height maps.

    Lengths are in mm; a CSV holds the entries as the list has them, LinuxCNC's file where
    the joint really was, a mesh the height, whose negative a plane holds.
    """
    from ....data.files import write_atomically
    from ....data.lists import ListFile
    from ...exchange import (
        FORMATS,
        format_of,
        list_with,
        table_in,
        table_of_file,
        text_of,
    )

    form = to or format_of(target)
    if form not in FORMATS:
        message = f"--to: found {form!r}, expected one of {', '.join(FORMATS)}"
        raise UsageError(message)
    if target.exists() and not force:
        message = f"OUT: found {target}, which exists, expected a new file or --force"
        raise UsageError(message)
    if source.suffix.casefold() == ".lis":
        table = table_in(ListFile.read(source), compensation)
    else:
        table = table_of_file(source, trim=trim)
    table = table.stated(compensation, axis, master or [])
    if form == "list":
        listing, machine = list_with(table)
        write_atomically(target, listing.dumps())
    else:
        machine = {}
        write_atomically(target, text_of(table, form, trim=trim).encode())
    size = " × ".join(str(len(each)) for each in table.nodes)
    both = len(table.nodes) == 1 and len(table.entries) == 2
    directions = ", both directions" * both
    typer.echo(
        f"{table.compensation}, {size} nodes{directions}: {target} ({form})", err=True
    )
    for name, value in machine.items():
        typer.echo(f"To set in the axis list: {name} {value}", err=True)

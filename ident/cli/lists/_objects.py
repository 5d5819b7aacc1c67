"""The command ``objects``: what to read on a controller to see its compensations work."""

from pathlib import Path
from typing import Annotated

import typer

from .._options import Rules, positive, read_lists, rules_of


def objects(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE.lis …",
            help="Compensation lists of a machine, and its axis lists.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for cnc_objects.csv and compensations.tcscopex; left out: the"
            " table on standard output.",
        ),
    ] = None,
    cycle_time: Annotated[
        float | None,
        typer.Option(
            callback=positive,
            help="Time between samples in s; left out: that of the task.",
        ),
    ] = None,
    net_id: Annotated[
        str, typer.Option(help="AMS net id of the controller, for the recording.")
    ] = "127.0.0.1.1.1",
    conventions: Rules = None,
) -> None:
    """List the ADS objects of all compensations of a machine, and record them with Scope.

    Addresses are those of the manuals; where they give none, the table says so. The
    channels of positions are to be completed in Scope: choose the variable, then enable
    them. axcomp verify --log reads the text export of the recording as it is.
    """
    from ....data.files import write_atomically
    from ...diagnosis import (
        OBJECTS,
        SCOPE,
        objects_csv,
        observables,
        scope_configuration,
    )

    rules, lists = rules_of(conventions), read_lists(files)
    rows = observables(lists, rules.conventions)
    table = objects_csv(rows)
    if out is None:
        typer.echo(table, nl=False)
        return
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / OBJECTS, table.encode())
    scope = scope_configuration(rows, cycle_time=cycle_time, net_id=net_id)
    write_atomically(out / SCOPE, scope)
    typer.echo(f"{len(rows)} objects in {out / OBJECTS}, {out / SCOPE}", err=True)

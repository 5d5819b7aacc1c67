"""The command ``results``: questions to the table of a batch."""

from pathlib import Path
from typing import Annotated

import typer

_SELECT = (
    "job, machine_id, axis, compensation, state, passed, verdict, before_rms, predicted_rms,"
    " from_file_rms, reason"
)


def results(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a batch.")],
    where: Annotated[
        str | None,
        typer.Option(help="SQL condition, e.g. \"not passed and machine_id = 'm7'\"."),
    ] = None,
    select: Annotated[
        str, typer.Option(help="SQL list of columns; * for all.")
    ] = _SELECT,
    order: Annotated[str | None, typer.Option(help="SQL list to sort by.")] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Rows at most.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print a JSON list, one object per row.")
    ] = False,
) -> None:
    """Show rows of the table of a batch as CSV; `docs/batch.md` names the columns."""
    import csv
    import json
    import sys

    from ..batch import query_results

    table = query_results(folder, where, select, order, limit)
    rows = table.to_pylist()
    if as_json:
        typer.echo(json.dumps(rows, default=str))
        return
    writer = csv.DictWriter(sys.stdout, table.column_names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        # With the digits that people read; JSON has them all.
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
        for row in rows
    )
    if not rows:
        typer.echo("No row answers that.", err=True)

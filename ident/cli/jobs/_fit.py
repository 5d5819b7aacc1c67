"""The command ``fit``: a job file → lists, report, result."""

import time
from pathlib import Path
from typing import Annotated

import typer

from .._options import AsJson
from .._said import working
from ._fit_text import print_result


def fit(
    job: Annotated[Path, typer.Argument(metavar="JOB.toml", help="Job file.")],
    out: Annotated[
        Path,
        typer.Option(help="Folder for lists, report and result."),
    ] = Path("axcomp-out"),
    after: Annotated[
        Path | None,
        typer.Option(
            metavar="JOB2.toml",
            help="Job of a second measurement, made with the lists of the first one"
            " loaded: says what became of each error, and settles signs.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a job: measurements → lists, report, result.

    Ends with exit status 1 where a gate fails (the list then lies in rejected/), or a
    second measurement does not show what was predicted.
    AXCOMP_CACHE=off does without the compilation cache in the user's cache folder.
    """
    from rich.console import Console

    start = time.monotonic()
    with working("reading the job") as step:
        from ...job import result_json, run_job, use_compilation_cache

        use_compilation_cache()
        result = run_job(job, out, progress=step, after=after)
        step("drawing the report")
        from ...report import write_report

        report = write_report(result, out)
    console = Console(stderr=as_json, highlight=False)
    print_result(console, result, out, report, start)
    if as_json:
        typer.echo(result_json(result), nl=False)
    if not (result.passed and result.confirmed):
        raise typer.Exit(1)

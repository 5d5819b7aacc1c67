"""The command ``new``: a commented job for measurements."""

import dataclasses
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ....data.errors import UsageError
from .._options import AsJson
from .._said import print_json, working

if TYPE_CHECKING:
    from ...new import NewJob

_AXIS = "--axis"


def new(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Measurement files.")
    ],
    lists: Annotated[
        list[Path] | None,
        typer.Option(
            "--list",
            metavar="FILE.lis",
            help="Compensation or axis list that is there already; may be repeated.",
        ),
    ] = None,
    axes: Annotated[
        list[str] | None,
        typer.Option(
            _AXIS,
            metavar="NAME=NUMBER",
            help="Axis and its number in the controller (kopf.achs_nr); may be repeated. The"
            " first is the one whose error was measured, where the file does not say.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="JOB.toml", help="The job to write.")
    ] = Path("job.toml"),
    force: Annotated[
        bool, typer.Option("--force", help="Replace a job that exists.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write a commented job for measurements.

    Roles, units, nodes and the fit that suits are filled in; what the files do not tell is
    asked in the job, next to the possible answers.
    """
    from ....data.files import write_atomically
    from ...new import new_job

    numbers = dict(map(_numbered, axes or []))
    if out.exists() and not force:
        message = f"--out: found {out}, which exists, expected a new file or --force"
        raise UsageError(message)
    with working("reading the measurements"):
        job = new_job(files, path=out, lists=lists or [], axes=numbers)
    write_atomically(out, job.text.encode())
    if as_json:
        asked = [dataclasses.asdict(one) for one in job.questions]
        print_json({"job": str(out), "fits": job.fits, "questions": asked})
        return
    _print(out, job)


def _numbered(text: str) -> tuple[str, int | None]:
    name, equals, number = text.partition("=")
    plain = name.isascii() and name.replace("_", "").isalnum()
    if plain and (not equals or number.isdecimal()):
        return name, int(number) if equals else None
    message = f"{_AXIS}: found {text!r}, expected a name and a number, like X=1"
    raise UsageError(message)


def _print(out: Path, job: "NewJob") -> None:
    typer.echo(f"Job: {out}")
    if not job.fits:
        typer.echo(
            "It holds no fit: the columns, as they were understood, suit no compensation."
            " Correct them there, then: axcomp discover"
            f" {shlex.quote(str(out))} --write fits.toml"
        )
        return
    if job.questions:
        typer.echo('It asks (take the "#? " off the answer that is right):')
    for number, one in enumerate(job.questions, start=1):
        optional = "" if one.needed else " (may stay open)"
        typer.echo(f"  {out}:{one.line}: QUESTION {number}{optional}: {one.words}")
    typer.echo(f"Then: axcomp fit {shlex.quote(str(out))}")

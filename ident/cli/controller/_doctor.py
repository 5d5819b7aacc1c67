"""The command ``doctor``: what is wrong with a list, from measurements with and without."""

from pathlib import Path
from typing import Annotated

import typer

from .._options import AsJson, read_lists
from .._said import print_json, working


def doctor(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE.lis …",
            help="Lists as they were active in the second measurement.",
        ),
    ],
    before: Annotated[
        Path,
        typer.Option(
            metavar="JOB.toml",
            help="Job with the measurements without the lists; needs no [\\[fits]].",
        ),
    ],
    after: Annotated[
        Path,
        typer.Option(
            metavar="JOB.toml",
            help="Job with the measurements with the lists active; active = [...] where"
            " not all of them were.",
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Say what is wrong with a list, from measurements without and with it.

    Right, sign, unit, shift, wrong axis, applied twice, or that the measurements cannot
    tell. Exit status 0 where all is right.
    """
    from ...job import load_job, use_compilation_cache
    from ...proof import diagnose, not_judged
    from ...readings import read_outside

    use_compilation_cache()
    old, new = (load_job(path, needs_fits=False) for path in (before, after))
    lists = read_lists(files)
    names = {axis.number: name for name, axis in new.spec.axes.items()}
    with working("reading the measurements"):
        found = diagnose(
            lists,
            read_outside(old),
            read_outside(new),
            new.reading,
            names=names,
        )
    for line in not_judged(lists, new.conventions, names):
        typer.echo(line, err=True)
    shown = [(names.get(one.axis, f"A{one.axis}"), one) for one in found]
    if as_json:
        keys = ("compensation", "verdict", "value", "sentence")
        print_json(
            [
                {"axis": name} | {key: getattr(one, key) for key in keys}
                for name, one in shown
            ]
        )
    else:
        for name, one in shown:
            typer.echo(f"{name} {one.compensation}: {one.sentence}")
    if any(one.verdict != "right" for one in found):
        raise typer.Exit(1)

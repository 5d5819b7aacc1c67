"""The command ``doctor``: what is wrong with a list, from measurements with and without."""

import json
from pathlib import Path
from typing import Annotated

import typer


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
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the diagnoses as JSON.")
    ] = False,
) -> None:
    """Say what is wrong with a list, from measurements without and with it.

    Right, sign, unit, shift, wrong axis, applied twice, or that the measurements cannot
    tell. Exit status 0 where all is right.
    """
    from ...data.lists import ListFile
    from ..job import load_job, use_compilation_cache
    from ..proof import diagnose, not_judged
    from ..readings import read_outside

    use_compilation_cache()
    old, new = (load_job(path, needs_fits=False) for path in (before, after))
    lists = [ListFile.read(file) for file in dict.fromkeys(files)]
    axes = new.spec.axes
    names = {axis.number: name for name, axis in axes.items()}
    found = diagnose(
        lists,
        read_outside(old),
        read_outside(new),
        new.conventions,
        {a.number: a.increment for a in axes.values() if a.increment is not None},
        modulo={
            axis.number: (axis.modulo[0], axis.modulo[1])
            for axis in axes.values()
            if axis.modulo is not None
        },
        names=names,
    )
    for line in not_judged(lists, new.conventions, names):
        typer.echo(line, err=True)
    shown = [(names.get(one.axis, f"A{one.axis}"), one) for one in found]
    if as_json:
        result = [
            {
                "axis": name,
                "compensation": one.compensation,
                "verdict": one.verdict,
                "value": one.value,
                "sentence": one.sentence,
            }
            for name, one in shown
        ]
        typer.echo(json.dumps(result, indent=2, ensure_ascii=False))
    else:
        for name, one in shown:
            typer.echo(f"{name} {one.compensation}: {one.sentence}")
    if any(one.verdict != "right" for one in found):
        raise typer.Exit(1)

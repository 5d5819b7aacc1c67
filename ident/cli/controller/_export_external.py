"""The command ``export-external``: tables as C and C++ of an external compensation."""

from pathlib import Path
from typing import Annotated

import typer

from .._options import Increment, Modulo, axis_ranges, positive


def export_external(
    result: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT",
            help="Folder of axcomp fit, its result.json, or list files (FILE.lis …).",
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="A folder of its own for the files.")
    ],
    axes: Annotated[
        str | None,
        typer.Option(
            metavar="1,2,3",
            help="Logical numbers of all axes of the controller; left out: those of the"
            " job, else those that the lists name.",
        ),
    ] = None,
    workspace: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A1=-10:410",
            help="Where limits hold, in mm or °; left out: the limits of the job, else the"
            " reach of the tables. May be given several times.",
        ),
    ] = None,
    modulo: Modulo = None,
    increment: Increment = None,
    conventions: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Rules of this machine's controller, as axcomp verify saves them; left"
            " out: those of the job, else the defaults.",
        ),
    ] = None,
    feed: Annotated[
        float,
        typer.Option(callback=positive, help="mm/min at which P-AXIS-00745 is found."),
    ] = 30000.0,
    acceleration: Annotated[
        float,
        typer.Option(callback=positive, help="Of the axes in mm/s² (P-AXIS-00008)."),
    ] = 5000.0,
    cycle_time: Annotated[
        float, typer.Option(callback=positive, help="Of the position controller in s.")
    ] = 0.001,
    ramp: Annotated[
        float,
        typer.Option(
            callback=positive,
            help="Time in s over which ON, OFF and LEVEL come into effect.",
        ),
    ] = 1.0,
) -> None:
    """Write tables as C and C++ of an external compensation, with its list entries.

    Cross, plane and leadscrew tables; what needs more than positions is left out, and named.
    """
    from ...exchange import read_conventions
    from ...external import export_external as export, list_source
    from ...job import use_compilation_cache

    use_compilation_cache()
    source = list_source(
        result,
        None if conventions is None else read_conventions(conventions).conventions,
        axes=None if axes is None else _numbers(axes),
        modulo=axis_ranges(modulo, "--modulo"),
        increment=increment,
    )
    given = axis_ranges(workspace, "--workspace")
    written = export(
        source.law,
        out,
        axes=source.axes,
        workspace={**source.workspace, **given},
        replaced=source.replaced,
        remarks=source.remarks,
        title=f"compensation of {', '.join(f'A{axis}' for axis in source.axes)}",
        feed=feed,
        acceleration=acceleration,
        cycle_time=cycle_time,
        ramp=ramp,
    )
    source.name_in_result(out / "axcomp_external.c")
    for remark in written.remarks:
        typer.echo(f"axcomp: {remark}", err=True)
    for path in written.files:
        typer.echo(str(path))
    typer.echo(f"axcomp: read {out / 'README.md'} next", err=True)


def _numbers(text: str) -> tuple[int, ...]:
    parts = [part.strip().removeprefix("A") for part in text.split(",")]
    if not all(part.isdecimal() for part in parts):
        message = f"found {text!r}, expected numbers of axes as in 1,2,3"
        raise typer.BadParameter(message, param_hint="--axes")
    return tuple(int(part) for part in parts)

"""Commands that write for the controller: ``objects``, ``probe`` and ``export-external``."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._options import (
    AsJson,
    Increment,
    Lists,
    Modulo,
    Rules,
    axis_ranges,
    by_axis,
    positive,
    read_lists,
    rules_of,
)
from ._said import print_json

if TYPE_CHECKING:
    from ..diagnosis import Probe


def objects(
    files: Lists,
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

    Examples:
      axcomp objects axcomp-out/achskw1.lis --out watch
    """
    from ...data.files import write_atomically
    from ..diagnosis import (
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


def probe(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE …",
            help="A job file, or the lists that are loaded now: the same compensations"
            " are probed, over the same axes.",
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="Folder for the probe lists, the text and the program.")
    ] = Path("axcomp-probe"),
    travel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A1=0:500",
            help="Positions in mm or ° between which an axis may move, where neither"
            " job nor lists say it; may be given several times.",
        ),
    ] = None,
    word: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A1=X",
            help="Word of an axis in NC programs, for lists without a job (which says"
            " nc_name); left out: A1. May be given several times.",
        ),
    ] = None,
    increment: Increment = None,
    as_json: AsJson = False,
) -> None:
    """Make lists with one plateau of 10 µm per compensation, and say what to read.

    One short log, or one reading of a dial gauge per axis, then settles sign, unit,
    order and owner of every table of this controller.

    Examples:
      axcomp probe job.toml
    """
    from ..diagnosis import AXIS_WORD, probe_programs, probe_steps, probe_text
    from ..job import OutFolder

    own = axis_ranges(travel, "--travel", "its travel as in A1=0:500", 1e5)
    pattern, example = f"(?P<word>{AXIS_WORD})", "its word as in A1=X"
    words = by_axis(word, "--word", pattern, example)
    read: Sequence[Path] = ()
    if len(files) == 1 and files[0].suffix.lower() == ".toml":
        found, read = _probe_of_job(files[0], own)
    else:
        named = {axis: match["word"] for axis, match in words.items()}
        found = _probe_of_lists(files, own, named, increment)
    contents = {
        listing.source: listing.dumps()
        for group in (found.lists, found.additions)
        for listing in group.values()
    }
    contents["probe.txt"] = probe_text(found).encode()
    contents |= {name: text.encode() for name, text in probe_programs(found).items()}
    folder = OutFolder(out, files[0], [*files[1:], *read])
    folder.refuse_sources(contents)
    for name, content in contents.items():
        folder.write(name, content)
    if as_json:
        steps = [
            {**dataclasses.asdict(step), "sentence": step.sentence}
            for step in probe_steps(found)
        ]
        said = {"remarks": list(found.remarks)}
        print_json({"files": list(contents), "steps": steps, **said})
    else:
        typer.echo(probe_text(found), nl=False)
    for remark in folder.remarks:
        typer.echo(f"axcomp: {remark}", err=True)
    typer.echo(f"{', '.join(contents)} in {out}", err=True)


def _probe_of_lists(
    files: Sequence[Path],
    travel: Mapping[int, tuple[float, float]],
    words: Mapping[int, str],
    increment: float | None,
) -> "Probe":
    """Return the probe of what lists hold."""
    from ...models import Conventions
    from ..diagnosis import ProbeAxis, make_probe, probed_in, travel_in
    from ..exchange import machine_lists

    conventions, lists = Conventions(), read_lists(files)
    known = {**travel_in(lists, conventions, increment), **travel}
    axes = {
        number: ProbeAxis(number, words.get(number, f"A{number}"), between)
        for number, between in known.items()
    }
    existing = machine_lists(lists).compensation
    return make_probe(axes, probed_in(lists, conventions), conventions, existing)


def _probe_of_job(
    file: Path, travel: Mapping[int, tuple[float, float]]
) -> "tuple[Probe, list[Path]]":
    """Return the probe of what a job fits, or else its lists hold; and these lists."""
    from ..diagnosis import ProbeAxis, Probed, make_probe, probed_in
    from ..exchange import machine_lists
    from ..job import load_job
    from ..kinds import kind

    job = load_job(file)
    spec = job.spec
    axes, paths = {}, []
    for name, axis in spec.axes.items():
        between = travel.get(axis.number) or axis.modulo or axis.limits
        paths += [job.file(p) for p in (axis.listing, axis.machine_data) if p]
        if between is not None:
            axes[axis.number] = ProbeAxis(
                axis.number,
                spec.nc_word(name),
                (float(between[0]), float(between[1])),
                rotary=axis.kind != "linear",
                modulo=axis.modulo is not None and axis.number not in travel,
                channel=axis.channel,
            )
    lists = read_lists(paths)
    found = {(one.axis, one.name): one for one in probed_in(lists, job.conventions)}
    remarks = []
    for fit in spec.fits:
        key = spec.axes[fit.axis].number, fit.compensation
        if not kind(fit.compensation).adds_current:
            named = getattr(fit, "masters", None) or [getattr(fit, "master", fit.axis)]
            found[key] = Probed(*key, tuple(spec.axes[one].number for one in named))
        elif key not in found:
            remarks.append(_unprobed(fit.axis, fit.compensation))
    tables, existing = [found[key] for key in sorted(found)], machine_lists(lists)
    made = make_probe(axes, tables, job.conventions, existing.compensation, remarks)
    return made, paths


def _unprobed(axis: str, compensation: str) -> str:
    return (
        f"{axis}, {compensation}: not probed, as no list holds its table: a current that"
        " nobody measured is never put on a drive. Measure and fit it (axcomp fit), load the"
        f" list that is written, name it under [axes.{axis}] as list, and probe again: at a"
        " low level of it."
    )


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
    conventions: Rules = None,
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

    Examples:
      axcomp export-external achskw3.lis --out external
    """
    from ..exchange import read_conventions
    from ..external import export_external as export, list_source
    from ..job import use_compilation_cache

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

"""Commands that write for the controller: ``objects``, ``probe`` and ``export-external``."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._console import note, print_json, print_result
from ._options import (
    AsJson,
    CycleTime,
    Increment,
    Lists,
    Modulo,
    Positive,
    Rules,
    axis_ranges,
    by_axis,
    matched,
    positive,
    read_lists,
    refuse_target,
    rules_of,
)

if TYPE_CHECKING:
    from ..diagnosis import Probe

_LONGEST_CYCLE = 0.1
"""s; position controllers run at 0.25 to 20 ms, which many write in ms."""


def objects(
    files: Lists,
    *,
    out: Path | None = None,
    cycle_time: CycleTime = None,
    net_id: str = "127.0.0.1.1.1",
    conventions: Rules = None,
    force: bool = False,
) -> None:
    """List the ADS objects of all compensations of a machine, and record them with Scope.

    Addresses are those of the manuals; where they give none, the table says so. The
    channels of positions are to be completed in Scope: choose the variable, then enable
    them. axcomp verify --log reads the text export of the recording as it is.

    Options:
        out (DIR): Folder for cnc_objects.csv and compensations.tcscopex; left out: the table on
            standard output.
        cycle_time: Time between samples in s; left out: that of the task.
        net_id: AMS net id of the controller, for the recording.
        force: Replace files that exist.

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
    for name in (OBJECTS, SCOPE):
        refuse_target(out / name, "--out", force=force)
    write_atomically(out / OBJECTS, table.encode())
    scope = scope_configuration(rows, cycle_time=cycle_time, net_id=net_id)
    write_atomically(out / SCOPE, scope)
    typer.echo(f"{len(rows)} objects in {out / OBJECTS}, {out / SCOPE}", err=True)


def probe(
    files: list[Path],
    *,
    out: Path = Path("axcomp-probe"),
    travel: list[str] | None = None,
    word: list[str] | None = None,
    increment: Increment = None,
    as_json: AsJson = False,
) -> None:
    """Make lists with one plateau of 10 µm per compensation, and say what to read.

    One short log, or one reading of a dial gauge per axis, then settles sign, unit,
    order and owner of every table of this controller.

    Options:
        files (FILE …): A job file, or the lists that are loaded now: the same compensations are
            probed, over the same axes.
        out: Folder for the probe lists, the text and the program.
        travel (A1=0:500): Positions in mm or ° between which an axis may move, where neither
            job nor lists say it; may be given several times.
        word (A1=X): Word of an axis in NC programs, for lists without a job (which says
            nc_name); left out: A1. May be given several times.

    Examples:
      axcomp probe job.toml
    """
    from ...models import Conventions
    from ..diagnosis import (
        AXIS_WORD,
        ProbeAxis,
        make_probe,
        probe_programs,
        probe_steps,
        probe_text,
        probed_in,
        travel_in,
    )
    from ..exchange import machine_lists
    from ..job import OutFolder

    ranges = axis_ranges(travel, "--travel", "its travel as in A1=0:500", 1e5)
    pattern, example = f"(?P<word>{AXIS_WORD})", "its word as in A1=X"
    words = by_axis(word, "--word", pattern, example)
    if len(files) == 1 and files[0].suffix.lower() == ".toml":
        probes, read = _probe_of_job(files[0], ranges)
    else:
        lists, rules = read_lists(files), Conventions()
        reach = {**travel_in(lists, rules, increment), **ranges}
        axes = {
            k: ProbeAxis(k, words[k]["word"] if k in words else f"A{k}", between)
            for k, between in reach.items()
        }
        existing = machine_lists(lists).compensation
        probes = make_probe(axes, probed_in(lists, rules), rules, existing, ())
        read = files[1:]
    contents = {
        listing.source: listing.dumps()
        for group in (probes.lists, probes.additions)
        for listing in group.values()
    }
    contents["probe.txt"] = probe_text(probes).encode()
    contents |= {name: text.encode() for name, text in probe_programs(probes).items()}
    folder = OutFolder(out, files[0], read)
    folder.refuse_sources(contents)
    for name, content in contents.items():
        folder.write(name, content)
    if as_json:
        steps = [
            {**dataclasses.asdict(step), "sentence": step.sentence}
            for step in probe_steps(probes)
        ]
        tree = {"files": list(contents), "steps": steps, "remarks": probes.remarks}
        print_json(tree)
    else:
        typer.echo(probe_text(probes), nl=False)
    note(folder.remarks)
    typer.echo(f"{', '.join(contents)} in {out}", err=True)


def _probe_of_job(
    file: Path, travel: Mapping[int, tuple[float, float]]
) -> "tuple[Probe, list[Path]]":
    """Return the probe of what a job fits, or of what its lists hold where it fits nothing.

    Beside it stand the lists that it is made of.
    """
    from ..diagnosis import ProbeAxis, Probed, make_probe, probed_in
    from ..exchange import machine_lists
    from ..job import load_job
    from ..kinds import kind

    job = load_job(file)
    spec = job.spec
    axes, paths = {}, []
    for name, axis in spec.axes.items():
        between = travel.get(axis.number) or axis.modulo or axis.limits
        paths += [job.file(name) for name in axis.files.values()]
        if between is not None:
            axes[axis.number] = ProbeAxis(
                axis.number,
                spec.nc_word(name),
                (float(between[0]), float(between[1])),
                rotary=axis.kind != "linear",
                modulo=axis.modulo is not None and axis.number not in travel,
                channel=axis.channel,
                partner=next(map(spec.nc_word, spec.partners(name)), None),
            )
    lists = read_lists(paths)
    probed = {(use.axis, use.name): use for use in probed_in(lists, job.conventions)}
    remarks = []
    for fit in spec.fits:
        number = spec.axes[fit.axis].number
        facts = kind(fit.compensation)
        if facts.adds_current and (number, facts.name) not in probed:
            remarks.append(
                f"{fit.axis}, {facts.name}: not probed, as no list holds its table: a"
                " current that nobody measured is never put on a drive. Measure and fit"
                " it (axcomp fit), load the list that is written, name it under"
                f" [axes.{fit.axis}] as list, and probe again: at a low level of it."
            )
        if facts.adds_current:
            continue
        named = getattr(fit, "masters", None) or [getattr(fit, "master", fit.axis)]
        masters = tuple(spec.axes[master].number for master in named)
        probed[number, fit.compensation] = Probed(number, fit.compensation, masters)
    names = {axis.number: name for name, axis in spec.axes.items()}
    for number, name in sorted(probed):
        for partner in spec.partners(names[number]):
            if (spec.axes[partner].number, name) not in probed:
                probed.pop((number, name), None)
                remarks.append(
                    f"{names[number]}, {name}: not probed, as its gantry partner {partner} has"
                    f" none: one of both alone twists the gantry. Fit {partner} as well"
                    f' ([[fits]] with axis = "{partner}"), or give its list.'
                )
    tables = [probed[key] for key in sorted(probed)]
    existing = machine_lists(lists).compensation
    return make_probe(axes, tables, job.conventions, existing, remarks), paths


def export_external(
    result: list[Path],
    *,
    out: Path,
    axes: str | None = None,
    workspace: list[str] | None = None,
    modulo: Modulo = None,
    increment: Increment = None,
    conventions: Rules = None,
    feed: Positive = 30000.0,
    acceleration: Positive = 5000.0,
    cycle_time: Annotated[
        float, typer.Option(max=_LONGEST_CYCLE, callback=positive)
    ] = 0.001,
    ramp: Positive = 1.0,
) -> None:
    """Write tables as C and C++ of an external compensation, with its list entries.

    Cross, plane and leadscrew tables; what needs more than positions is left out, and named.

    Options:
        result (RESULT): Folder of axcomp fit, its result.json, or list files (FILE.lis …).
        out (DIR): A folder of its own for the files.
        axes (1,2,3): Logical numbers of all axes of the controller; left out: those of the job,
            else those that the lists name.
        workspace (A1=-10:410): Where limits hold, in mm or °; left out: the limits of the job,
            else the reach of the tables. May be given several times.
        feed: mm/min at which P-AXIS-00745 is found.
        acceleration: Of the axes in mm/s² (P-AXIS-00008).
        cycle_time: Of the position controller in s.
        ramp: Time in s over which ON, OFF and LEVEL come into effect.

    Examples:
      axcomp export-external achskw3.lis --out external
    """
    from ..exchange import read_conventions
    from ..external import export_external as export, list_source
    from ..job import use_compilation_cache

    use_compilation_cache()
    numbers, pattern = None, r"(\s*A?\d+\s*(,(?!$)|$))+"
    if axes is not None:
        matched("--axes", axes, pattern, "numbers of axes as in 1,2,3")
        numbers = tuple(map(int, re.findall(r"\d+", axes)))
    source = list_source(
        result,
        None if conventions is None else read_conventions(conventions).conventions,
        axes=numbers,
        modulo=axis_ranges(modulo, "--modulo"),
        increment=increment,
    )
    ranges = axis_ranges(workspace, "--workspace")
    written = export(
        source.law,
        out,
        axes=source.axes,
        workspace={**source.workspace, **ranges},
        replaced=source.replaced,
        remarks=source.remarks,
        title=f"compensation of {', '.join(f'A{axis}' for axis in source.axes)}",
        feed=feed,
        acceleration=acceleration,
        cycle_time=cycle_time,
        ramp=ramp,
    )
    note(written.remarks)
    try:
        source.name_in_result(out / "axcomp_external.c")
    except OSError as error:
        note([f"{source.result} does not name these files: {error.strerror or error}"])
    print_result(None, map(str, written.files))
    note([f"read {out / 'README.md'} next"])

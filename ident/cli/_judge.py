"""Commands that judge a controller: ``verify`` by what it logged, ``doctor`` by an instrument."""

import dataclasses
import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._options import (
    AsJson,
    CycleTime,
    Increment,
    Lists,
    Modulo,
    Rules,
    axis_ranges,
    read_lists,
    rules_of,
)
from ._said import print_json, working

if TYPE_CHECKING:
    from ..exchange import StoredConventions
    from ..proof import Verdict, Verification


def verify(
    files: Lists,
    log: Annotated[
        Path,
        typer.Option(
            metavar="L.csv",
            help="What the controller logged: time, A1.position, … and A3.cross,"
            " V.A.CROSS_COMP_CURR.Z, CROSSC::actual_offset, A3.EXTC[0].actual_offset or"
            " A3.drive_position; or diagdata.txt of an external compensation.",
        ),
    ],
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="CONVENTIONS.toml",
            help="Where to store the rules that the log settles, for the jobs of this"
            " machine; what stands there already is kept.",
        ),
    ] = None,
    increment: Increment = None,
    conventions: Rules = None,
    cycle_time: CycleTime = None,
    modulo: Modulo = None,
    as_json: AsJson = False,
) -> None:
    """Compare what a controller logged that it added with what its lists say.

    Says in one sentence per compensation what the controller does. Exit status 0 only
    where all agree.

    Examples:
      axcomp verify axcomp-out/achskw1.lis --log log.csv
    """
    from ...data.measurements import read_log
    from ..exchange import Reading
    from ..external import read_snapshot, verify_external, verify_snapshot
    from ..job import use_compilation_cache
    from ..kinds import kinds
    from ..proof import Verification, verify_log

    ranges = axis_ranges(modulo, "--modulo")
    use_compilation_cache()
    stored = rules_of(save if save is not None and save.exists() else None)
    assumed = stored if conventions is None else rules_of(conventions)
    lists = read_lists(files)
    rules = assumed.conventions
    reading = Reading(rules, increment, ranges)
    with working("reading the log"):
        snapshot, found = read_snapshot(log), Verification((), (), rules, frozenset())
        if snapshot is not None:
            outside = verify_snapshot(lists, snapshot, reading)
        else:
            names = [one.name for one in kinds()]
            logged = read_log(log, increment, cycle_time, names)
            outside, logged = verify_external(lists, logged, reading)
            if logged.offsets or not outside:
                found = verify_log(lists, logged, reading)
        found = dataclasses.replace(found, verdicts=(*outside, *found.verdicts))
    if as_json:
        print_json([_json(one) for one in found.verdicts])
    else:
        for one in found.verdicts:
            typer.echo(f"A{one.axis} {one.compensation}: {one.sentence}")
    for remark in found.remarks:
        typer.echo(f"axcomp: {remark}", err=True)
    if save is not None:
        _save(save, stored, found)
    if not found.agrees:
        raise typer.Exit(1)


def _json(one: "Verdict") -> Mapping[str, object]:
    values = one.value
    return {
        "axis": f"A{one.axis}",
        "compensation": one.compensation,
        "verdict": list(one.verdict),
        "value": values[0] if len(values) == 1 else list(values) or None,
        "sentence": one.sentence,
    }


def _save(path: Path, stored: "StoredConventions", found: "Verification") -> None:
    """Add the rules that the log settled to a file; those that only fit stay assumed."""
    from ..job import write_atomically

    values = found.conventions.to_dict()
    settled = {name: values[name] for name in sorted(found.settled)}
    turned = stored.contradicted(settled)
    before = stored.conventions.to_dict()
    kept = {name: before[name] for name in stored.verified}
    fitting = type(found.conventions).from_dict({**values, **kept})
    merged = dataclasses.replace(stored, conventions=fitting).with_verified(
        settled, saved_at=datetime.date.today().isoformat()
    )
    write_atomically(path, merged.dumps())
    names = ", ".join(f"{name} = {value}" for name, value in settled.items())
    typer.echo(f"axcomp: {path}: settled {names or 'nothing'}", err=True)
    for name in turned:
        typer.echo(
            f"axcomp: {name} was settled otherwise before; the new log counts.",
            err=True,
        )


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

    Examples:
      axcomp doctor axcomp-out/achskw1.lis --before job.toml --after after.toml
    """
    from ..job import load_job, use_compilation_cache
    from ..proof import diagnose, not_judged
    from ..readings import read_outside

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

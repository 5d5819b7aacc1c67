"""The command ``verify``: what a controller does with its lists, from what it logged."""

import dataclasses
import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .._options import (
    AsJson,
    CycleTime,
    Increment,
    Modulo,
    axis_ranges,
    read_lists,
    rules_of,
)
from .._said import print_json, working

if TYPE_CHECKING:
    from ...exchange import StoredConventions
    from ...proof import Verdict, Verification


def verify(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE.lis …",
            help="Compensation lists that are loaded, and axis lists for what is active.",
        ),
    ],
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
    conventions: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Rules that are assumed; left out: those of --save, else the defaults.",
        ),
    ] = None,
    cycle_time: CycleTime = None,
    modulo: Modulo = None,
    as_json: AsJson = False,
) -> None:
    """Compare what a controller logged that it added with what its lists say.

    Says in one sentence per compensation what the controller does. Exit status 0 only
    where all agree.
    """
    from ....data.measurements import read_log
    from ...exchange import Reading
    from ...external import read_snapshot, verify_external, verify_snapshot
    from ...job import use_compilation_cache
    from ...kinds import kinds
    from ...proof import Verification, verify_log

    ranges = axis_ranges(modulo, "--modulo")
    use_compilation_cache()
    stored = rules_of(save if save is not None and save.exists() else None)
    assumed = stored if conventions is None else rules_of(conventions)
    lists = read_lists(files)
    rules = assumed.conventions
    reading = Reading(rules, increment, ranges)
    with working("reading the log"):
        snapshot = read_snapshot(log)
        if snapshot is not None:
            outside = verify_snapshot(lists, snapshot, reading)
            found = Verification(outside, (), rules, frozenset())
        else:
            names = [one.name for one in kinds()]
            logged = read_log(log, increment, cycle_time, names)
            outside, logged = verify_external(lists, logged, reading)
            found = Verification(outside, (), rules, frozenset())
            if logged.offsets or not outside:
                found = verify_log(lists, logged, reading)
                every = (*outside, *found.verdicts)
                found = dataclasses.replace(found, verdicts=every)
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
    from ...job import write_atomically

    values = found.conventions.to_dict()
    settled = {name: values[name] for name in sorted(found.settled)}
    turned = stored.contradicted(settled)
    kept = {
        name: value
        for name, value in stored.conventions.to_dict().items()
        if name in stored.verified
    }
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

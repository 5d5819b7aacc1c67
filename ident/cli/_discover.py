"""The command ``discover``: which compensations the measurements ask for."""

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...data.errors import UsageError
from ..kinds import kind

if TYPE_CHECKING:
    from rich.console import Console

    from ..discover import Discovery
    from ..job import Job
    from ..readings import Observation

_LONG = 10.0
"""Seconds after which progress is printed as plain lines."""


def discover(
    job: Annotated[
        Path,
        typer.Argument(
            metavar="JOB.toml", help="Job with the measurements; needs no [\\[fits]]."
        ),
    ],
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="NEW.toml",
            help="Write the job that fits what was found, beside JOB.toml, for"
            " `axcomp fit`.",
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print what was found as JSON.")
    ] = False,
) -> None:
    """Find which compensations the measurements ask for, and from which masters.

    Looks for terms of every compensation and for what the controller has none for.
    Exit status 1 where the data show an effect and cannot tell which of several it is.
    """
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    if write is not None:
        _refuse_place(job, write)
    with console.status("reading the job") as status:
        from ..discover import discover as look
        from ..job import load_job
        from ..readings import observe

        start = time.monotonic()

        def progress(line: str) -> None:
            status.update(line)
            # Where nobody sees the spinner, plain lines, but only once it takes long.
            if not console.is_terminal and time.monotonic() - start > _LONG:
                console.print(line, markup=False)

        loaded = load_job(job, needs_fits=False)
        progress("reading the measurements")
        seen = observe(loaded)
        found = look(
            seen.data, tuple(loaded.spec.axes), source=str(job), progress=progress
        )
    for remark in seen.remarks:
        console.print(f"info: {remark}", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(json.dumps(_json(found, seen.names), indent=2, ensure_ascii=False))
    else:
        _print(Console(highlight=False), found)
    if write is not None and found.found:
        _write(console, write, loaded, seen, found)
    elif write is not None:
        console.print(
            f"Nothing to fit was found: {write} was not written.", markup=False
        )
    if not found.told:
        raise typer.Exit(1)


def _write(
    console: "Console",
    write: Path,
    job: "Job",
    seen: "Observation",
    found: "Discovery",
) -> None:
    """Write the job that fits what was found, and say what else it states."""
    from ..job import found_keys, job_with_fits, write_atomically

    write_atomically(write, job_with_fits(job, seen, found).encode())
    console.print(f"Job with {_fits(len(found.found))}: {write}", markup=False)
    for name, keys in found_keys(job, seen, found).items():
        for key, value in keys.items():
            does = f"states {key} = {json.dumps(value)}"
            if value is None:
                does = f"leaves out {key}"
            why = _WHY["datum" if "datum" in keys and key == "remove" else key]
            words = f"It {does} of measurement {name}: {why}"
            console.print(words, markup=False, soft_wrap=True)


_WHY = {
    "drift": "the error wanders in time, which no compensation is made of.",
    "remove": "the error is far from zero everywhere, as an instrument in motion shows it"
    " whose zero is arbitrary.",
    "datum": "of fits that are identified together, none is zero at a place by itself.",
}


def _fits(count: int) -> str:
    return "one fit" if count == 1 else f"{count} fits"


def _refuse_place(job: Path, write: Path) -> None:
    """Raise where a new job would not find its files, or would replace another."""
    if write.resolve().parent != job.resolve().parent:
        message = (
            f"--write: found {write}, expected a file beside {job}: paths in a job are"
            " relative to it"
        )
        raise UsageError(message)
    if write.exists():
        message = f"--write: found {write}, which exists, expected a new file"
        raise UsageError(message)


def _json(found: "Discovery", names: tuple[str, ...]) -> dict[str, object]:
    return {
        "axes": [
            {
                "axis": one.axis,
                "channel": one.channel,
                "rows": one.rows,
                "rms": one.rms,
                "noise": one.noise,
                "unit": one.unit,
            }
            for one in found.axes
        ],
        "found": [
            {
                "compensation": one.compensation,
                "axis": one.axis,
                "masters": list(one.masters),
                "sensor": one.sensor,
                "share": one.share,
                "rms": one.rms,
                "unit": one.unit,
                "stability": one.stability,
                "keys": dict(one.keys),
                "group": one.group,
                "sentence": one.sentence,
            }
            for one in found.found
        ],
        "rejected": [
            {
                "compensation": one.compensation,
                "axis": one.axis,
                "masters": list(one.masters),
                "sensor": one.sensor,
                "reason": one.reason,
            }
            for one in found.rejected
        ],
        "unexplained": [
            {
                "axis": one.axis,
                "what": one.what,
                "masters": list(one.masters),
                "share": one.share,
                "rms": one.rms,
                "unit": one.unit,
                "verdict": one.verdict,
                "sentence": one.sentence,
            }
            for one in found.unexplained
        ],
        "drifts": [
            {
                "axis": one.axis,
                "measurement": names[one.source],
                "pieces": one.pieces,
                "rms": one.rms,
                "unit": one.unit,
                "sentence": one.sentence,
            }
            for one in found.drifts
        ],
    }


def _print(console: "Console", found: "Discovery") -> None:
    """Print what a person wants to know: what to compensate, by how much, what stays."""
    from rich.table import Table

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    for axis in found.axes:
        mine = [
            one
            for one in found.found
            if one.axis == axis.axis
            and kind(one.compensation).adds_current == (axis.channel == "current")
        ]
        title = (
            f"{axis.channel} of {axis.axis}: {_amount(axis.rms, axis.unit)} rms in"
            f" {axis.rows} readings, {_amount(axis.noise, axis.unit)} of it scatter"
        )
        table = Table()
        for words in ("compensation", "over", "sensor"):
            table.add_column(words)
        for words in ("rms", "share", "stability"):
            table.add_column(words, justify="right")
        for one in mine:
            table.add_row(
                one.compensation,
                ", ".join(one.masters) or "–",
                one.sensor or _sensors(one.keys) or "–",
                _amount(one.rms, one.unit),
                f"{one.share:.1%}",
                f"{one.stability:.0%}",
            )
        tell(title if mine else f"{title}: no compensation found")
        if mine:
            console.print(table)
        for one in mine:
            tell(one.sentence)
        for drift in found.drifts:
            if drift.axis == axis.axis and axis.channel == "error":
                tell(drift.sentence)
        console.print()
    if found.unexplained:
        tell("Unexplained:")
    for rest in found.unexplained:
        said = f"{rest.verdict[0].upper()}{rest.verdict[1:]}: "
        tell(f"  {rest.verdict}: {rest.sentence.removeprefix(said)}")
    if found.rejected:
        tell("Looked for and not taken:")
    for no in found.rejected:
        by = [*no.masters, *([no.sensor] if no.sensor else [])]
        over = f" ({', '.join(by)})" if by else ""
        name = f"{no.compensation} of {no.axis}{over}"
        tell(f"  {name}: {no.reason}")


def _sensors(keys: object) -> str:
    sensors = keys.get("sensors") if isinstance(keys, dict) else None
    if not isinstance(sensors, dict):
        return ""
    return ", ".join(dict.fromkeys(map(str, sensors.values())))


def _amount(value: float, unit: str) -> str:
    if unit == "mm":
        return f"{1e3 * value:.3g} µm"
    return f"{1e3 * value:.3g} m°" if unit == "°" else f"{value:.3g}"

"""The command ``discover``: which compensations the measurements ask for."""

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING

from ..kinds import kind
from ..report._scale import count
from ._console import print_json, print_line, table_of, working
from ._options import AsJson, refuse, refuse_target

if TYPE_CHECKING:
    from rich.console import Console

    from ..discover import Discovery
    from ..job import Job
    from ..readings import Observation


def discover(
    job: Path,
    *,
    write: Path | None = None,
    as_json: AsJson = False,
) -> bool:
    """Find which compensations the measurements ask for, and from which masters.

    Looks for terms of every compensation and for what the controller has none for.
    Exit status 1 where the data show an effect and cannot tell which of several it is.

    Options:
        job (JOB.toml): Job with the measurements; needs no [[fits]].
        write (NEW.toml): Write the job that fits what was found, beside JOB.toml, for `axcomp
            fit`.

    Examples:
      axcomp discover job.toml --write fits.toml
    """
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    if write is not None:
        # Else the new job would not find its files, or replace another.
        if write.resolve().parent != job.resolve().parent:
            place = f"a file beside {job}: paths in a job are relative to it"
            refuse("--write", str(write), place)
        refuse_target(write, "--write")
    with working("reading the job") as progress:
        from ..discover import discover as look
        from ..job import load_job
        from ..readings import observe

        loaded = load_job(job, fits=False)
        progress("reading the measurements")
        observed = observe(loaded)
        discovery = look(
            observed.data, tuple(loaded.spec.axes), source=str(job), progress=progress
        )
    for remark in observed.remarks:
        print_line(console, f"info: {remark}")
    if as_json:
        tree = dataclasses.asdict(discovery)
        for drift in tree["drifts"]:
            drift["measurement"] = observed.names[drift.pop("source")]
        print_json(tree)
    else:
        _print(Console(highlight=False), discovery)
    if write is not None and discovery.found:
        _write(console, write, loaded, observed, discovery)
    elif write is not None:
        print_line(console, f"Nothing to fit was found: {write} was not written.")
    return not discovery.confused


def _write(
    console: "Console",
    write: Path,
    job: "Job",
    observation: "Observation",
    discovery: "Discovery",
) -> None:
    """Write the job that fits what was found, and say what else it states."""
    from ..job import found_keys, job_with_fits, write_atomically

    doubts = [f"{part.sentence} {_HELD}" for part in discovery.confused]
    above = "".join(f"# {doubt}\n" for doubt in doubts)
    text = above + job_with_fits(job, observation, discovery)
    write_atomically(write, text.encode())
    print_line(console, f"Job with {count(len(discovery.found), 'fit')}: {write}")
    if doubts:
        print_line(console, f"Warning: {doubts[0]}")
    for name, keys in found_keys(job, observation, discovery).items():
        for key, value in keys.items():
            does = f"states {key} = {json.dumps(value)}"
            if value is None:
                does = f"leaves out {key}"
            why = _WHY["datum" if "datum" in keys and key == "remove" else key]
            print_line(console, f"It {does} of measurement {name}: {why}")


_HELD = "Until that is known the lists of this job may hold a part of it."
_NUMBERS = ("rms", "share", "stability")
_WHY = {
    "drift": "the error wanders in time, which no compensation is made of.",
    "remove": "the error is far from zero everywhere, as an instrument in motion shows it"
    " whose zero is arbitrary.",
    "datum": "of fits that are identified together, none is zero at a place by itself.",
}


def _print(console: "Console", discovery: "Discovery") -> None:
    """Print what a person wants to know: what to compensate, by how much, what stays."""
    for axis in discovery.axes:
        mine = [
            fit
            for fit in discovery.found
            if fit.axis == axis.axis
            and kind(fit.compensation).adds_current == (axis.channel == "current")
        ]
        title = (
            f"{axis.channel} of {axis.axis}: {_amount(axis.rms, axis.unit)} rms in"
            f" {axis.rows} readings, {_amount(min(axis.noise, axis.rms), axis.unit)} of it scatter"
        )
        print_line(console, title if mine else f"{title}: no compensation found")
        rows = [
            (
                fit.compensation,
                ", ".join(fit.masters) or "–",
                ", ".join(fit.sensors) or "–",
                _amount(fit.rms, fit.unit),
                f"{fit.share:.1%}",
                f"{fit.stability:.0%}",
            )
            for fit in mine
        ]
        if mine:
            heads = ["compensation", "over", "sensor", *_NUMBERS]
            console.print(table_of(heads, rows, numbers=_NUMBERS))
        for fit in mine:
            print_line(console, fit.sentence)
        for drift in discovery.drifts:
            if drift.axis == axis.axis and axis.channel == "error":
                print_line(console, drift.sentence)
        console.print()
    if discovery.unexplained:
        print_line(console, "Unexplained:")
    for item in discovery.unexplained:
        verdict = f"{item.verdict[0].upper()}{item.verdict[1:]}: "
        print_line(console, f"  {item.verdict}: {item.sentence.removeprefix(verdict)}")
    if discovery.rejected:
        print_line(console, "Looked for and not taken:")
    for no in discovery.rejected:
        inputs = [*no.masters, *([no.sensor] if no.sensor else [])]
        over = f" ({', '.join(inputs)})" if inputs else ""
        print_line(console, f"  {no.compensation} of {no.axis}{over}: {no.reason}")


def _amount(value: float, unit: str) -> str:
    if unit not in {"mm", "°"}:
        return f"{value:.3g}"
    from ...data.units import small_unit

    return f"{1e3 * value:.3g} {small_unit(unit)}"

"""Commands about a measurement file: ``read`` what it holds, ``new`` job for it."""

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ._console import note, print_json, table_of, wide_console, working
from ._options import AsJson, matched, refuse, refuse_target

if TYPE_CHECKING:
    from ...data.measurements import CellError, Column, Table, TextForm
    from ..new import NewJob

_LAST_AXIS = 65535
_SHOWN = 20
"""Lines left out that are named."""


def read(
    file: Path,
    *,
    profile: str | None = None,
    skip: str = "0",
    header: list[int] | None = None,
    rows: tuple[int, int] | None = None,
    as_json: AsJson = False,
) -> bool:
    """Say what a measurement file holds: format, columns, units, rows, skipped lines.

    Where channels have several sample times, first and last are those of each channel.
    Ends with exit status 1 where a column of numbers holds a cell that is none, a direction,
    run or time cannot be told, or a row stands there twice.

    Options:
        file (FILE): Measurement file.
        profile: Profile of a Klipper file that holds several bed meshes.
        skip (N): Lines left out: so many at the top, or which, as in '[7]' or '7,9'.
        header (LINE): Line with the names of the columns.
        rows (FIRST LAST): First and last line of the rows.

    Examples:
      axcomp read laser_x.csv
    """
    from ...data.measurements import Lines, problems_of, read_table

    lines = Lines.of(_lines(skip), header or None, rows)
    with working("reading the file"):
        table = read_table(file, profile=profile, lines=lines)
    problems = problems_of(table)
    if as_json:
        print_json(_as_dict(table, problems))
    else:
        _print(table)
        typer.echo(f"A job for it: axcomp new {shlex.quote(str(file))}")
    note(map(str, problems))
    return not problems


def _lines(text: str) -> int | list[int]:
    """Return a number of lines, or which ones."""
    pattern = r"[\[\] ]*\d+(\s*,\s*\d+)*[\[\] ]*"
    matched("--skip", text, pattern, "a number such as 3, or lines such as [7]")
    numbers = [int(digits) for digits in re.findall(r"\d+", text)]
    return numbers if len(numbers) > 1 or "[" in text else numbers[0]


def _as_dict(table: "Table", problems: "list[CellError]") -> dict[str, Any]:
    keys = ("line", "column", "found", "expected")
    return {
        "file": str(table.path),
        "format": table.format,
        "form": table.form,
        "axis": table.axis,
        "columns": [_heading(column) for column in table.columns],
        "scalars": [{"name": name, "value": value} for name, value in table.scalars],
        "rows": table.rows,
        "first": [column.cell(0) for column in table.columns],
        "last": [column.cell(-1) for column in table.columns],
        "skipped": table.skipped,
        "remarks": table.remarks,
        "problems": [
            {key: getattr(problem, key) for key in keys} for problem in problems
        ],
    }


def _heading(column: "Column") -> dict[str, Any]:
    """Return what a column is; where the file has several clocks, also of which."""
    keys = ["name", "role", "unit"]
    keys += ["run", "direction"] * (column.run is not None)
    keys += ["samples", "sample_time"] * (column.sample_time is not None)
    return {key: getattr(column, key) for key in keys}


def _print(table: "Table") -> None:
    console, say = wide_console(), typer.echo
    say(f"{table.path}: {table.format}, {table.rows} rows")
    if table.form is not None:
        say(_form_words(table.form, several=len(table.columns) > 1))
    heads = ["column", "role", "unit", "first row", "last row", "smallest", "largest"]
    clocked = any(column.sample_time is not None for column in table.columns)
    heads += ["samples", "every"] * clocked
    console.print(
        table_of(heads, [_row(table, c, clocked=clocked) for c in table.columns])
    )
    for name, number in table.scalars:
        say(f"scalar {name} = {number:.10g}")
    for remark in table.remarks:
        say(remark)
    if not table.skipped:
        say("Nothing was skipped.")
    for item in table.skipped[:_SHOWN]:
        say(f"skipped {f'line {item.line}: ' if item.line else ''}{item.reason}")
    if len(table.skipped) > _SHOWN:
        say(f"… and {len(table.skipped) - _SHOWN} more (all of them with --json)")


def _row(table: "Table", column: "Column", *, clocked: bool) -> list[str]:
    """Return the line of a column."""
    import numpy as np

    role = column.role or ""
    if role and "." not in role and role not in ("time", "run"):
        role = f"<axis>.{role}"
    if column.run is not None:
        run = table.run_of(column)
        side = {1: " +", -1: " -"}.get(column.direction or 0, "")
        role = f"{role},{'' if run is None else f' run {run}'}{side}"
    unit = "text" if column.text is not None else column.unit or ""
    finite = column.values[np.isfinite(column.values)]
    ends = [finite.min(), finite.max()] if finite.size else ["", ""]
    values = [column.cell(0), column.cell(-1), *ends]
    clock = [str(column.samples), ""]
    if column.sample_time is not None:
        clock[1] = f"{1e3 * column.sample_time:g} ms"
    return [column.name, role, unit, *map(_shown, values), *clock[: 2 * clocked]]


def _form_words(form: "TextForm", *, several: bool) -> str:
    """Return how a text table was found to be written, in a sentence."""
    from ...data.measurements import SEPARATORS

    mark = {".": "point", ",": "comma"}[form.decimal]
    cells = f"Cells separated by {SEPARATORS.get(form.separator, repr(form.separator))}"
    words = [cells if several else "One column", f"decimal {mark}"]
    if form.thousands:
        words.append(f"digits in groups by '{form.thousands}'")
    words.append(
        f"header in line {_numbers(form.header)}" if form.header else "no header"
    )
    if form.units is not None:
        words.append(f"units in line {form.units}")
    if form.titles:
        words.append(f"titles in line {_numbers(form.titles)}")
    words += [f"rows from line {form.first}", form.encoding]
    return ", ".join(words) + "."


def _numbers(lines: "tuple[int, ...]") -> str:
    first, last = min(lines), max(lines)
    whole = len(lines) > 2 and last - first == len(lines) - 1
    return f"{first} to {last}" if whole else ", ".join(map(str, lines))


def _shown(value: float | str | None) -> str:
    if value is None:
        return "no number"
    return value if isinstance(value, str) else f"{value:.10g}"


def new(
    files: list[Path],
    *,
    lists: list[Path] | None = None,
    axes: list[str] | None = None,
    out: Path = Path("job.toml"),
    force: bool = False,
    as_json: AsJson = False,
) -> None:
    """Write a commented job for measurements.

    Roles, units, nodes and the fit that suits are filled in; what the files do not tell is
    asked in the job, next to the possible answers.

    Options:
        files (FILE...): Measurement files.
        lists (--list FILE.lis): Compensation or axis list that is there already; may be
            repeated.
        axes (--axis NAME=NUMBER): Axis and its number in the controller (kopf.achs_nr); may be
            repeated. The first is the one whose error was measured, where the file does not
            say.
        out (JOB.toml): The job to write.
        force: Replace a job that exists.

    Examples:
      axcomp new laser_x.csv
      axcomp new laser_x.csv --axis X=1 --out screw.toml
      axcomp new laser_x.csv --list achskw1.lis --out again.toml
    """
    from ...data.files import write_atomically
    from ..new import new_job

    numbers = dict(map(_numbered, axes or []))
    refuse_target(out, "--out", [*files, *(lists or [])], force=force)
    with working("reading the measurements"):
        job = new_job(files, path=out, lists=lists or [], axes=numbers)
    write_atomically(out, job.text.encode())
    if as_json:
        print_json({"job": str(out), "fits": job.fits, "questions": job.questions})
    else:
        _print_questions(out, job, lists or [])


def _numbered(text: str) -> tuple[str, int | None]:
    expected = "a name and a number, like X=1"
    match = matched("--axis", text, r"(?a:(\w*[^\W_]\w*)(=(\d+))?)", expected)
    if match[3] and not 1 <= int(match[3]) <= _LAST_AXIS:
        refuse("--axis", text, f"a number from 1 to {_LAST_AXIS}")
    return match[1], int(match[3]) if match[3] else None


def _print_questions(out: Path, job: "NewJob", lists: Sequence[Path]) -> None:
    typer.echo(f"Job: {out}")
    if not job.fits:
        typer.echo(
            "It holds no fit: the columns, as they were understood, suit no compensation."
            " Correct them there, then: axcomp discover"
            f" {shlex.quote(str(out))} --write fits.toml"
        )
        return
    from ..new import OPTIONAL

    if job.questions:
        typer.echo('It asks (take the "#? " off the answer that is right):')
    for number, question in enumerate(job.questions, start=1):
        optional = "" if question.needed else OPTIONAL
        typer.echo(
            f"  {out}:{question.line}: QUESTION {number}{optional}: {question.words}"
        )
    name = shlex.quote(str(out))
    if any((path.parent / "result.json").exists() for path in lists):
        # Measured again with what a job wrote: a fit of its own would write onto that.
        typer.echo(
            f"Then, with the job that wrote the list: axcomp fit JOB --after {name}"
        )
        return
    typer.echo(f"Then: axcomp fit {name}")

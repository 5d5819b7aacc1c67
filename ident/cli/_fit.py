"""The command ``fit``: a job file → lists, report, result."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from ..job import AbstractResult, JobResult

_LONG = 10.0
"""Seconds after which progress is printed as plain lines."""


def fit(
    job: Annotated[Path, typer.Argument(metavar="JOB.toml", help="Job file.")],
    out: Annotated[
        Path,
        typer.Option(help="Folder for lists, report and result."),
    ] = Path("axcomp-out"),
    as_json: Annotated[
        bool, typer.Option("--json", help="Print result.json on standard output.")
    ] = False,
) -> None:
    """Run a job: measurements → lists, report, result.

    Ends with exit status 1 where a gate fails (the list then lies in rejected/).
    AXCOMP_CACHE=off does without the compilation cache in the user's cache folder.
    """
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    with console.status("reading the job") as status:
        from ..job import result_json, run_job, use_compilation_cache

        start = time.monotonic()

        def progress(line: str) -> None:
            status.update(line)
            # Where nobody sees the spinner, plain lines, but only once it takes long.
            if not console.is_terminal and time.monotonic() - start > _LONG:
                console.print(line, markup=False)

        use_compilation_cache()
        result = run_job(job, out, progress=progress)
        progress("drawing the report")
        from ..report import write_report

        report = write_report(result, out)
    _print(console, result, out, report)
    if as_json:
        typer.echo(result_json(result), nl=False)
    if not result.passed:
        raise typer.Exit(1)


def _print(
    console: "Console", result: "JobResult", out: Path, report: tuple[Path, ...]
) -> None:
    """Print what a person wants to know first; all else is in the report."""
    for fit_result in result.fits:
        _print_fit(console, fit_result)
    for remark in result.remarks:
        console.print(f"{remark.level}: {remark.message}", markup=False)
    console.print(f"Files in {out}:", markup=False)
    for file in result.files:
        console.print(f"  {file}", markup=False)
    page = next((file for file in report if file.suffix == ".html"), None)
    if page is not None:
        # Some writers name files relative to the folder, others with it.
        shown = page if page.is_file() else out / page
        console.print(f"Report: {shown}", markup=False, soft_wrap=True)
    verdict = "Done"
    if not result.passed:
        rejected = any(file.parts[0] == "rejected" for file in result.files)
        verdict = "NOT PASSED: do not load the rejected lists"
        if not rejected:
            verdict = "NOT PASSED: not all that was asked for is known, see the errors"
    console.print(f"{verdict} ({result.wall_time:.1f} s).", markup=False)


def _print_fit(console: "Console", found: "AbstractResult") -> None:
    from rich.table import Table

    over = f" over {', '.join(found.over)}" if found.over else ""
    unit, factor = found.shown
    table = Table(
        title=f"{found.compensation} of {found.axis}{over}, {unit}",
        title_justify="left",
    )
    table.add_column("error")
    stages = {"before": "before", "predicted": "predicted", "from_file": "from file"}
    for words in stages.values():
        table.add_column(words, justify="right")
    rows: dict[str, list[float | None]] = {
        "rms": [found.error[stage].sound.rms for stage in stages],
        "max": [found.error[stage].sound.max for stage in stages],
    }
    if any(found.error[stage].rms_without_wild is not None for stage in stages):
        rows["rms, wild kept"] = [found.error[stage].rms for stage in stages]
        rows["max, wild kept"] = [found.error[stage].max for stage in stages]
    for key in ("A", "R", "B", "E", "M"):
        figures = [(found.error[stage].iso230 or {}).get(key) for stage in stages]
        if any(value is not None for value in figures):
            rows[key] = figures
    for name, values in rows.items():
        digits = ".3g" if factor == 1.0 else ".1f"
        cells = [
            "–" if value is None else f"{factor * value:{digits}}" for value in values
        ]
        table.add_row(name, *cells)
    console.print(table)
    failed = [check for check in found.gate if not check.passed]
    if not failed:
        console.print(f"gate: passed ({len(found.gate)} checks)", markup=False)
    for check in failed:
        console.print(
            f"gate: FAILED {check.name}: {check.value:.4g} {check.unit}, allowed"
            f" {check.limit:.4g} ({check.where})",
            markup=False,
        )
    for remark in found.remarks:
        console.print(f"{remark.level}: {remark.message}", markup=False)

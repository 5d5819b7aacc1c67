"""The command ``demo``: a machine with known faults, from measurement to proof.

The machine and its jobs are in `_run`; `_files` is what it leaves to be read; its jobs and texts
lie in this folder.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._console import print_json, table_of, working

if TYPE_CHECKING:
    from rich.console import Console

    from ...job import TableResult
    from ...proof import ErrorFigures
    from ._run import DemoResult

_WHAT = {
    "leadscrew": "X  screw pitch off, lost motion",
    "cross": "Y  bent beam: Y wanders as X moves",
    "plane": "Z  table not flat",
}


def demo(
    *,
    out: Path = Path("axcomp-demo"),
    picture: Path | None = None,
    as_json: bool = False,
) -> bool:
    """Make a virtual machine, measure it, compensate it, and measure it again.

    Writes the measurement files, a job file to read and to rerun, the lists and a
    report. A folder that holds anything else is left alone.

    Options:
        out: Folder for everything it makes.
        picture: Also write the before-and-after picture, as PNG.
        as_json (--json): Print the figures on standard output.

    Examples:
      axcomp demo --out mill
    """
    from rich.console import Console

    with working("starting") as step:
        from ...job import use_compilation_cache
        from ._run import run_demo

        use_compilation_cache()
        result = run_demo(out, step)
        if picture is not None:
            from ...report import write_picture

            write_picture(result.job, picture)
    if as_json:
        print_json(_as_dict(result))
    else:
        _print(Console(highlight=False), out, result)
    return result.job.passed and result.work.passed


def _print(console: "Console", out: Path, result: "DemoResult") -> None:
    console.print(
        "A portal mill that exists only in the computer was measured, compensated,\n"
        "and measured again with the new lists loaded. Typical error in µm\n"
        "(rms without wild readings):\n",
        markup=False,
    )
    tables = result.job.tables
    rows = {
        _WHAT[t.compensation]: [f.rms for f in _figures(t).values()] for t in tables
    }
    rows["X  friction: mark on a circle, largest"] = [*result.spikes.values()]
    _print_stages(console, "known fault", rows)
    console.print(
        "\nThen such a mill worked for two minutes with every fault at once: pitch,\n"
        "backlash, a bent beam, an uneven table, warmth, and a column that nods. One job\n"
        "took its log, in motion, apart; the reference was late against the encoders.\n",
        markup=False,
    )
    compensations = {
        axis: [fit.compensation for fit in result.work.fits if fit.axis == axis]
        for axis in result.work_rms
    }
    rows = {
        f"{axis}  {', '.join(compensations[axis])}": list(sizes.values())
        for axis, sizes in result.work_rms.items()
    }
    _print_stages(console, "everything at once", rows)
    lists = ", ".join(fit.files[0].name for fit in tables)
    lines = [
        "",
        "predicted  computed, on readings that were kept out of the computation",
        "verified   the second measurement, at other positions",
        "",
        f"Lists   {lists} in {out / 'result'}",
        f"        and in {out / 'work' / 'result'}",
        f"Report  {result.report}  (open it in a browser)",
        f"Next    read {out / 'job.toml'}; copy it there, change it, then",
        "        axcomp fit COPY.toml --out my-result",
        f"Done in {result.wall_time:.0f} s.",
    ]
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)


def _print_stages(
    console: "Console", head: str, rows: Mapping[str, Sequence[float]]
) -> None:
    """Print errors in mm by stage as µm."""
    stages = ("before", "predicted", "verified")
    lines = [
        [words, *(f"{1000 * size:.1f}" for size in sizes)]
        for words, sizes in rows.items()
    ]
    console.print(table_of([head, *stages], lines, numbers=stages, plain=True))


def _figures(fit: "TableResult") -> "dict[str, ErrorFigures]":
    """Return the errors by stage, wild readings left out."""
    assert fit.measured is not None  # the demo measures every table again
    return {
        "before": fit.error["before"].sound,
        "predicted": fit.error["predicted"].sound,
        "verified": fit.measured.figures.sound,
    }


def _as_dict(result: "DemoResult") -> dict[str, Any]:
    """Return the result for machines: errors in mm by stage, and where things lie."""
    return {
        "fits": [
            {
                "compensation": fit.compensation,
                "axis": fit.axis,
                "rms": {stage: figures.rms for stage, figures in _figures(fit).items()},
                "max": {stage: figures.max for stage, figures in _figures(fit).items()},
                "list": str(fit.files[0]),
            }
            for fit in result.job.tables
        ],
        "friction": dict(result.spikes),
        "work": {axis: dict(sizes) for axis, sizes in result.work_rms.items()},
        "report": str(result.report),
        "wall_time": result.wall_time,
    }

"""The commands ``batch``, many jobs here or on a cluster, and ``results``, its table."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..report._scale import count
from ._console import note, working
from ._options import AsJson, OneOrMore

if TYPE_CHECKING:
    from ..batch import BatchResult

_EVERY = 10.0
"""Seconds between plain lines where nobody sees a status line."""
_SHOWN = 20
"""Reasons that are printed; all of them stand in results.parquet."""
_SELECT = (
    "job, machine_id, axis, compensation, state, passed, verdict, before_rms, predicted_rms,"
    " from_file_rms, reason"
)


def batch(
    jobs: list[str],
    *,
    out: Path = Path("axcomp-batch"),
    scheduler: str | None = None,
    workers: OneOrMore = None,
    resume: bool = False,
    reports: bool = False,
    time_limit: Annotated[float | None, typer.Option(min=0.1)] = 600.0,
    history: list[Path] | None = None,
    as_json: AsJson = False,
) -> bool:
    """Run many jobs: lists for each, one table of all results, one summary.

    A job that fails is a row with its reason. Exit status 1 where any failed or was
    rejected. Lists of machines whose conventions are only assumed go to unverified/.

    Options:
        jobs (JOBS…): Job files, patterns in quotes, or tables (.csv, .parquet) with one job per
            row.
        out: Folder for lists, table of results and summary.
        scheduler (ADDRESS): A running dask scheduler (tcp://host:8786); without it, workers
            here.
        workers: Workers here; one per core by default.
        resume: Go on with the batch in the folder.
        reports: Draw every report, not only where a job failed.
        time_limit: Seconds after which a job is given up.
        history: Folder of an earlier batch, for trends; may be repeated.

    Examples:
      axcomp batch "machines/*.toml" --out night
    """
    with working("starting the workers", every=_EVERY) as step:
        from ..batch import run_batch

        result = run_batch(
            jobs,
            out,
            scheduler=scheduler,
            workers=workers,
            resume=resume,
            reports=reports,
            time_limit=time_limit,
            history=history or (),
            progress=lambda stand: step(str(stand)),
        )
    _print(result, out)
    if as_json:
        typer.echo((out / "summary.json").read_text(), nl=False)
    return result.passed


def _print(result: "BatchResult", out: Path) -> None:
    reasons = [f"failed: {name}: {why}" for name, why in result.reasons.items()]
    lines = reasons[:_SHOWN]
    if len(reasons) > _SHOWN:
        lines.append(f"… and {len(reasons) - _SHOWN} more failed, see results.parquet")
    summary = result.summary
    lines += [
        f"gate: {name} failed in {count(number, 'fit')}"
        for name, number in summary.gate.items()
    ]
    lines += [
        f"same readings: {' and '.join(twins['jobs'])}: one of them has the file of another"
        for twins in summary.twins[:_SHOWN]
    ]
    if summary.unverified:
        lines.append(
            f"{count(summary.unverified, 'list')} lie{'s' * (summary.unverified == 1)}"
            " in unverified/: computed; sign unproven. The conventions of their machines"
            " are only assumed. Verify them before loading."
        )
    if summary.no_gain:
        lines.append(
            f"Of {count(summary.no_gain, 'list')} among them nothing shows yet that"
            f" {'it helps' if summary.no_gain == 1 else 'they help'}: do not load"
            f" {'it' if summary.no_gain == 1 else 'them'} (reasons: no_gain)."
        )
    lines.append(
        f"{count(summary.jobs, 'job')}, {summary.failed} failed, {result.rejected} did not pass"
        f" ({result.seconds:.1f} s). Table: {out / 'results.parquet'}, summary:"
        f" {out / 'summary.html'}"
    )
    note(lines, "")


def results(
    folder: Path,
    *,
    where: str | None = None,
    select: str = _SELECT,
    order: str | None = None,
    limit: OneOrMore = None,
    as_json: AsJson = False,
) -> None:
    """Show rows of the table of a batch as CSV; `docs/batch.md` names the columns.

    Options:
        folder (DIR): Folder of a batch.
        where: SQL condition, e.g. "not passed and machine_id = 'm7'".
        select: SQL list of columns; * for all.
        order: SQL list to sort by.
        limit: Rows at most.

    Examples:
      axcomp results night --where "not passed"
    """
    import csv
    import json
    import sys

    from ..batch import query_results

    table = query_results(folder, where, select, order, limit)
    rows = table.to_pylist()
    if as_json:
        typer.echo(json.dumps(rows, default=str))
        return
    writer = csv.DictWriter(sys.stdout, table.column_names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        # With the digits that people read; JSON has them all.
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
        for row in rows
    )
    if not rows:
        typer.echo("No row answers that.", err=True)

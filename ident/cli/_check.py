"""The command ``check``."""

import pathlib
from typing import Annotated

import typer

from ...data.errors import UsageError


def check(
    files: Annotated[
        list[pathlib.Path],
        typer.Argument(
            metavar="FILE...", help="Compensation, axis and start-up lists."
        ),
    ],
    strict: Annotated[
        bool, typer.Option("--strict", help="A warning fails the check too.")
    ] = False,
    build: Annotated[
        str | None,
        typer.Option(
            help="Controller build, such as V3.1.3108.4; the newest if left out."
        ),
    ] = None,
    increment: Annotated[
        float | None,
        typer.Option(help="mm per encoder increment, for lists that count in them."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the findings for machines.")
    ] = False,
) -> None:
    """Check compensation, axis and start-up lists, each alone and as a set."""
    from ...data.lists import BuildError, ListFile, check as check_lists

    if increment is not None and not 0 < increment < float("inf"):
        msg = f"--increment: found {increment:g}, expected more than 0"
        raise UsageError(msg)
    # A glob and a name may both give a file: it is one list all the same.
    lists = [ListFile.read(path) for path in dict.fromkeys(files)]
    try:
        findings = check_lists(lists, build=build, increment=increment)
    except BuildError as error:
        msg = f"--build: {error}"
        raise UsageError(msg) from error
    if as_json:
        import dataclasses
        import json

        shown = [dataclasses.asdict(finding) for finding in findings]
        typer.echo(json.dumps({"findings": shown}, ensure_ascii=False, indent=2))
    for finding in findings:
        known = not finding.expected or finding.expected in finding.message
        expected = "" if known else f"; expected {finding.expected}"
        typer.echo(f"{finding}{expected}", err=True)
    counts = {
        level: sum(finding.level == level for finding in findings)
        for level in ("error", "warning", "info")
    }
    typer.echo(_summary(len(lists), counts), err=True)
    if counts["error"] or (strict and counts["warning"]):
        raise typer.Exit(1)


def _summary(files: int, counts: dict[str, int]) -> str:
    """Return one sentence on the whole check."""
    checked = "1 list checked" if files == 1 else f"{files} lists checked"
    if not any(counts.values()):
        return f"{checked}: nothing found"
    parts = [
        f"{counts['error']} error{'s' * (counts['error'] != 1)}",
        f"{counts['warning']} warning{'s' * (counts['warning'] != 1)}",
        f"{counts['info']} remark{'s' * (counts['info'] != 1)}",
    ]
    return f"{checked}: {', '.join(parts)}"

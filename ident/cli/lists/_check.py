"""The command ``check``."""

import pathlib
from typing import Annotated

import typer

from ....data.errors import UsageError
from .._options import AsJson, Increment, Rules, read_lists, rules_of
from .._said import print_json


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
    increment: Increment = None,
    conventions: Rules = None,
    as_json: AsJson = False,
) -> None:
    """Check compensation, axis and start-up lists, each alone and as a set."""
    from ....data.lists import BuildError, check as check_lists

    lists = read_lists(files)
    # The rules take the models: only where there are some.
    index = (
        "ji" if conventions is None else rules_of(conventions).conventions.plane_index
    )
    try:
        findings = check_lists(
            lists, build=build, increment=increment, plane_index=index
        )
    except BuildError as error:
        msg = f"--build: {error}"
        raise UsageError(msg) from error
    if as_json:
        import dataclasses

        print_json({"findings": [dataclasses.asdict(one) for one in findings]})
    for finding in findings:
        known = not finding.expected or finding.expected in finding.message
        expected = "" if known else f"; expected {finding.expected}"
        typer.echo(f"{finding}{expected}", err=as_json)
    counts = {
        level: sum(finding.level == level for finding in findings)
        for level in ("error", "warning", "info")
    }
    nouns = {"error": "error", "warning": "warning", "info": "remark"}
    parts = [f"{counts[k]} {noun}{'s' * (counts[k] != 1)}" for k, noun in nouns.items()]
    summary = ", ".join(parts) if findings else "nothing found"
    typer.echo(
        f"{len(lists)} list{'s' * (len(lists) != 1)} checked: {summary}", err=as_json
    )
    if counts["error"] or (strict and counts["warning"]):
        raise typer.Exit(1)

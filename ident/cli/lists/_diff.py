"""The command ``diff``: what changed between two lists."""

import dataclasses
import pathlib
from typing import TYPE_CHECKING, Annotated

import typer

from .._options import AsJson, Plots, read_shown_list
from .._said import print_json

if TYPE_CHECKING:
    from ....data.lists import Change, Comparison, CurveChange

_MOST_ENTRIES = 12
"""Changed entries of one table that are named one by one."""


def diff(
    old: Annotated[pathlib.Path, typer.Argument(help="The list as it was.")],
    new: Annotated[pathlib.Path, typer.Argument(help="The list as it is to be.")],
    out: Plots = None,
    as_json: AsJson = False,
) -> None:
    """Say what changed between two lists, and whether a reload is enough."""
    from ....data.lists import compare, offset_curves

    lists = read_shown_list(old), read_shown_list(new)
    found = compare(*lists)
    if as_json:
        print_json(_tree(found))
    else:
        for line in _lines(found):
            typer.echo(line)
    if out is not None:
        from ._list_plots import draw_tables

        before, after = map(offset_curves, lists)
        for path in draw_tables(after, out, before):
            typer.echo(f"wrote {path}", err=True)


def _tree(found: "Comparison") -> dict[str, object]:
    """Return the comparison for machines."""
    return {
        "changed": [dataclasses.asdict(change) for change in found.changed],
        "action": found.action,
        "reasons": list(found.reasons),
        "curves": [dataclasses.asdict(curve) for curve in found.curves],
    }


def _lines(found: "Comparison") -> list[str]:
    """Return the comparison as lines for people."""
    lines: list[str] = []
    groups: dict[str, list[Change]] = {}
    for change in found.changed:
        head, bracket, tail = change.name.partition("[")
        key = f"{head}{bracket}{tail.rpartition(']')[2]}" if bracket else change.name
        groups.setdefault(key, []).append(change)
    for changes in groups.values():
        shown = changes[:_MOST_ENTRIES]
        lines += [_entry_line(change) for change in shown]
        if len(changes) > len(shown):
            lines.append(f"  ... and {len(changes) - len(shown)} more of this table")
    lines += [_curve_line(curve) for curve in found.curves]
    actions = {
        "none": "No entry changed: nothing to load.",
        "reload": "A reload of the list is enough.",
        "restart": "The controller must be restarted:",
    }
    lines.append(actions[found.action])
    lines += [f"  {reason}" for reason in found.reasons]
    return lines


def _entry_line(change: "Change") -> str:
    if change.old is None:
        return f"+ {change.name}: {change.new}"
    if change.new is None:
        return f"- {change.name}: {change.old}"
    return f"~ {change.name}: {change.old} -> {change.new}"


def _curve_line(curve: "CurveChange") -> str:
    branch = "" if curve.branch == "both" else f", {curve.branch} direction"
    name = f"{curve.compensation}{branch}"
    if curve.largest is None:
        return f"{name}: the offset curves cannot be compared: {curve.note}"
    note = f" ({curve.note})" if curve.note else ""
    if curve.largest == 0:
        return f"{name}: the controller adds the same as before{note}"
    unit = "mm" if curve.unit == "µm" else "increments"
    place = ", ".join(f"{position:g}" for position in curve.at)
    return (
        f"{name}: the offset changes by at most {curve.largest:+g} {curve.unit}, "
        f"at {place} {unit}{note}"
    )

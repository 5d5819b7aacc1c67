"""Commands about list files: ``check``, ``show``, ``diff`` and ``convert``."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ...data.errors import UsageError
from ..report._scale import count
from ._console import note, print_json, print_result, wide_console
from ._options import (
    AsJson,
    Increment,
    Modulo,
    Plots,
    Rules,
    axis_ranges,
    read_lists,
    read_shown_list,
    refuse,
    refuse_target,
    rules_of,
)

if TYPE_CHECKING:
    from ...data.lists import Change, Comparison, CurveRules

_MOST_ENTRIES = 12
"""Changed entries of one table that are named one by one."""


def check(
    files: list[Path],
    *,
    strict: bool = False,
    build: str | None = None,
    increment: Increment = None,
    modulo: Modulo = None,
    conventions: Rules = None,
    as_json: AsJson = False,
) -> bool:
    """Check compensation, axis and start-up lists, each alone and as a set.

    Options:
        files (FILE...): Compensation, axis and start-up lists; a folder: all in it.
        strict: A warning fails the check too.
        build: Controller build, such as V3.1.3108.4; the newest if left out.

    Examples:
      axcomp check axcomp-out/achskw1.lis
    """
    from ...data.lists import BuildError, check as check_lists

    lists = read_lists(files)
    rules, _ = _rules(conventions)
    ranges = None if modulo is None else axis_ranges(modulo, "--modulo")
    index = str(rules.get("plane_index", "ji"))
    try:
        findings = check_lists(
            lists, build=build, increment=increment, plane_index=index, modulo=ranges
        )
    except BuildError as error:
        msg = f"--build: {error}"
        raise UsageError(msg) from error
    if as_json:
        print_json({"findings": findings})
    for finding in findings:
        stated = not finding.expected or finding.expected in finding.message
        expected = "" if stated else f"; expected {finding.expected}"
        typer.echo(f"{finding}{expected}", err=as_json)
    counts = Counter[str](finding.level for finding in findings)
    nouns = {"error": "error", "warning": "warning", "info": "remark"}
    parts = [count(counts[level], noun) for level, noun in nouns.items()]
    summary = ", ".join(parts) if findings else "nothing found"
    typer.echo(f"{count(len(lists), 'list')} checked: {summary}", err=as_json)
    return not (counts["error"] or (strict and counts["warning"]))


def show(
    file: Path,
    *,
    conventions: Rules = None,
    out: Plots = None,
) -> None:
    """Show a list: its parameters with their meaning, its tables in mm and µm.

    Options:
        file (FILE.lis): List of any kind.

    Examples:
      axcomp show axcomp-out/achskw1.lis
    """
    from ...data.lists import offset_curves
    from ._show_tables import list_views

    listing, (rules, verified) = read_shown_list(file), _rules(conventions)
    console = wide_console(wraps=True)
    for view in list_views(listing, rules, verified):
        console.print(view)
    if out is not None:
        from ._list_plots import draw_tables

        paths = draw_tables(offset_curves(listing, rules), out)
        text = "no cross, plane or leadscrew table to draw"
        note([f"wrote {path}" for path in paths] or [text], "")


def _rules(conventions: Path | None) -> tuple["CurveRules", frozenset[str]]:
    """Return the rules of a file by name, of none no rules, and which are verified."""
    if conventions is None:  # the rules take the models: only where there are some
        return {}, frozenset()
    rules = rules_of(conventions)
    return rules.conventions.to_dict(), rules.verified


def diff(
    old: Path,
    new: Path,
    *,
    conventions: Rules = None,
    out: Plots = None,
    as_json: AsJson = False,
) -> bool:
    """Say what changed between two lists, and whether a reload is enough.

    A new list with errors (axcomp check) ends with exit status 1.

    Options:
        old: The list as it was.
        new: The list as it is to be.

    Examples:
      axcomp diff achskw1.lis axcomp-out/achskw1.lis
    """
    from ...data.lists import RemarkCode, compare, offset_curves

    lists = read_shown_list(old), read_shown_list(new)
    rules, _ = _rules(conventions)
    comparison = compare(*lists, rules)
    note(
        f"{listing.source}:{remark.line}: left out, neither an entry nor a comment:"
        f" {remark.text}"
        for listing in lists
        for remark in listing.remarks
        if remark.code == RemarkCode.UNREADABLE_LINE
    )
    print_result(comparison if as_json else None, _lines(comparison))
    if out is not None:
        from ._list_plots import draw_tables

        before, after = (offset_curves(listing, rules) for listing in lists)
        note((f"wrote {path}" for path in draw_tables(after, out, before)), "")
    return not comparison.faults


def _lines(comparison: "Comparison") -> list[str]:
    """Return the comparison as lines for people."""
    lines: list[str] = []
    groups: dict[str, list[Change]] = {}
    for change in comparison.changed:
        head, bracket, tail = change.name.partition("[")
        key = f"{head}{bracket}{tail.rpartition(']')[2]}" if bracket else change.name
        groups.setdefault(key, []).append(change)
    for changes in groups.values():
        first = changes[:_MOST_ENTRIES]
        lines += map(str, first)
        if len(changes) > len(first):
            lines.append(f"  ... and {len(changes) - len(first)} more of this table")
    if not comparison.faults:  # else a value that cannot be read would count as 0
        lines += map(str, comparison.curves)
    actions = {
        "none": "No entry changed: nothing to load.",
        "reload": "A reload of the list is enough.",
        "restart": "The controller must be restarted:",
    }
    if comparison.faults:
        lines.append("The new list is not to be loaded as it is (axcomp check):")
        return lines + [f"  {finding}" for finding in comparison.faults]
    lines.append(actions[comparison.action])
    lines += [f"  {reason}" for reason in comparison.reasons]
    return lines


def convert(
    source: Path,
    target: Path,
    *,
    to: str | None = None,
    compensation: str | None = None,
    axis: int | None = None,
    master: list[int] | None = None,
    increment: Increment = None,
    trim: bool = False,
    force: bool = False,
) -> None:
    """Convert a table: lists, CSV, LinuxCNC compensation files, bed meshes, height maps.

    Lengths are in mm; a CSV holds the entries as the list has them, LinuxCNC's file where
    the joint really was, a mesh the error as a height, whose negative a plane holds.

    Options:
        source (IN): List, CSV, LinuxCNC compensation file, bed mesh or height map.
        target (OUT): File to write.
        to: Format of OUT where its ending does not tell: list, csv, linuxcnc, bed-mesh or
            height-map.
        compensation: Which table: leadscrew, cross or plane.
        axis: Number of the compensated axis, for a list.
        master: Number of a master, for a list; twice for a plane.
        trim: LinuxCNC: COMP_FILE_TYPE = 1, values to add, instead of 0.
        force: Replace a file that exists.

    Examples:
      axcomp convert axcomp-out/achskw1.lis screw.csv
      axcomp convert axcomp-out/achskw1.lis screw.comp
      axcomp convert screw.comp converted.lis --axis 1
    """
    from ...data.files import write_atomically
    from ...data.lists import ListFile
    from ..exchange import (
        FORMATS,
        HEIGHTS,
        format_of,
        list_with,
        table_in,
        table_of_file,
        text_of,
    )

    form = to or format_of(target)
    if form not in FORMATS:
        refuse("--to", repr(form), f"one of {', '.join(FORMATS)}")
    refuse_target(target, "OUT", [source], force=force)
    if source.suffix.casefold() == ".lis":
        table = table_in(ListFile.read(source), compensation, increment)
    else:
        table = table_of_file(source, compensation, trim=trim)
    table = table.stated(compensation, axis, master or [])
    heights = (HEIGHTS,) if form in ("bed-mesh", "height-map") else ()
    note(dict.fromkeys((*table.remarks, *heights)))
    if form == "list":
        listing, machine = list_with(table)
        write_atomically(target, listing.dumps())
    else:
        machine = {}
        write_atomically(target, text_of(table, form, trim=trim).encode())
    size = " × ".join(str(len(line)) for line in table.nodes)
    both = len(table.nodes) == 1 and len(table.entries) == 2
    directions = ", both directions" * both
    typer.echo(
        f"{table.compensation}, {size} nodes{directions}: {target} ({form})", err=True
    )
    for name, value in machine.items():
        typer.echo(f"To set in the axis list: {name} {value}", err=True)

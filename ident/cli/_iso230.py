"""The command ``iso230``: accuracy and repeatability of positioning."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ._options import AsJson, matched, refuse
from ._said import note, print_json, table_of, wide_console

if TYPE_CHECKING:
    from ...data.measurements import ColumnSpec, Iso230, Table


def iso230(
    file: Path,
    after: Path | None = None,
    *,
    tolerance: str | None = None,
    axis: str | None = None,
    column: list[str] | None = None,
    as_json: AsJson = False,
    out: Path | None = None,
) -> bool:
    """Evaluate a positioning test by ISO 230-2: A, R, B, mean B, E and M.

    With a second file: before and after.

    With a tolerance: a verdict on A of the last file; exit status 1 where it fails.

    Options:
        file (FILE): Runs of the test.
        after ([AFTER]): Runs after the compensation.
        tolerance (T): Largest A that passes, in mm, or as 20um.
        axis: Axis, where the file holds several.
        column (ROLE=COLUMN[:UNIT]): Column of target, actual or error, run, direction, where
            the file does not say: --column error=dx:um. Once per role.
        out: Folder for the chart (SVG and PNG).

    Examples:
      axcomp iso230 laser_x.csv
      axcomp iso230 laser_x.csv laser_again.csv --tolerance 20um --out chart
    """
    from ...data.measurements import MeasurementError

    columns = _columns(column or (), axis)
    limit, limit_unit = (None, None) if tolerance is None else _tolerance(tolerance)
    files = {"before": file, "after": after} if after else {"": file}
    found = [_evaluate(path, axis, columns) for path in files.values()]
    first, last, judged = found[0], found[-1], after or file
    if last.unit != first.unit:
        reason = f"found {last.unit}, expected {first.unit} as in {file}"
        raise MeasurementError(str(after), reason)
    if limit_unit not in (None, last.unit):
        refuse("--tolerance", repr(tolerance), f"{last.unit} as in {judged}")
    tests = dict(zip(files, (one.figures for one in found), strict=True))
    if _targets(last.figures) != _targets(first.figures):
        remark = "Its targets are not those of the first file: compare with care."
        remarks = (remark, *last.figures.remarks)
        tests["after"] = dataclasses.replace(last.figures, remarks=remarks)
    tree = [_as_dict(test) for test in tests.values()]
    result: dict[str, Any] = tree[0] | {"unit": last.unit}
    if after is not None:
        result["after"] = tree[1]
    if limit is not None:
        result["verdict"] = _verdict(last, limit, judged)
    if out is not None:
        from ..report._iso_chart import draw_iso_chart, write_chart

        figure = draw_iso_chart(tests, axis=last.axis, unit=last.unit, tolerance=limit)
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem)
        charts = write_chart(figure, out, f"iso230_{stem}")
        result["charts"] = [str(path) for path in charts]
    if as_json:
        print_json(result)
    else:
        _print(files, tests, last)
    verdict: dict[str, Any] = result.get("verdict", {"passed": True})
    if "sentence" in verdict:
        typer.echo(verdict["sentence"], err=as_json)
    note((f"wrote {path}" for path in result.get("charts", ())), "")
    return bool(verdict["passed"])


def _columns(texts: Sequence[str], axis: str | None) -> "dict[str, ColumnSpec]":
    """Return the column of each role that was named; empty: as the file says.

    Raises:
        UsageError: If one is no ``ROLE=COLUMN`` with a role of a positioning test.
    """
    from ...data.measurements import ColumnSpec, find_unit

    expected = "ROLE=COLUMN with role target, actual, error, run or direction, such as error=dx:um"
    pattern = r"(target|position|actual|error|run|direction)=(.+)"
    found: dict[str, ColumnSpec] = {}
    for text in texts:
        role, name = matched("--column", text, pattern, expected).groups()
        role = {"target": "position"}.get(role, role)
        key = role if role == "run" else f"{axis or 'axis'}.{role}"
        head, _, unit = name.rpartition(":")
        stated = head and find_unit(unit) is not None
        found[key] = ColumnSpec(head, unit) if stated else ColumnSpec(name)
    return found


@dataclasses.dataclass(frozen=True)
class _Test:
    """One file: its figures, their unit, its axis, and readings that it lacks."""

    figures: "Iso230"
    unit: str
    axis: str
    missing: int


def _evaluate(
    path: Path, axis: str | None, columns: "Mapping[str, ColumnSpec]"
) -> _Test:
    """Return what a file holds, with all remarks on it."""
    from ...data.measurements import (
        derive_error,
        explain_direction,
        iso230 as evaluate,
        measurement,
        read_table,
    )

    table = read_table(path)
    if not columns:
        axis = axis or _only_axis(table)
    data = measurement(table, columns, axis=axis or "axis")
    name = axis or "axis"
    position = data.require(f"{name}.position", "for an ISO 230-2 evaluation")
    error = derive_error(data, name)
    direction = explain_direction(data, name)
    figures = evaluate(position, error, data.get("run"), direction.values)
    remarks = [*data.remarks, *direction.remarks]
    remarks += [
        f"Skipped line {s.line}: {s.reason}."
        for s in table.skipped
        if s.reason != "comment"
    ]
    figures = dataclasses.replace(figures, remarks=(*remarks, *figures.remarks))
    unit = data.units[f"{name}.position"]
    return _Test(figures, unit, axis or "", table.missing)


def _only_axis(table: "Table") -> str | None:
    """Return the one axis with a position and an error or actual; None for bare roles.

    Raises:
        MeasurementError: If there are several, or none.
    """
    from ...data.measurements import MeasurementError, find_role

    roles = [column.role for column in table.columns if column.role]
    if "position" in roles:
        return None
    known = [role for text in roles if (role := find_role(text)) and role.axis]
    axes = sorted(
        {
            role.axis or ""
            for role in known
            if role.kind in ("error", "actual") and f"{role.axis}.position" in roles
        }
    )
    if len(axes) == 1:
        return axes[0]
    columns = ", ".join(column.name for column in table.columns[:12])
    found = f"axes {', '.join(axes)}" if axes else f"columns {columns}"
    expected = (
        "--axis with one of them"
        if axes
        else "target, error (or actual), run, direction; or X.position, X.error …;"
        " --column ROLE=COLUMN tells which is which"
    )
    raise MeasurementError(str(table.path), f"found {found}, expected {expected}")


def _targets(test: "Iso230") -> tuple[float, ...]:
    """Return the targets of a test, to the µm."""
    return tuple(round(item.target, 3) for item in test.positions)


def _tolerance(text: str) -> tuple[float, str | None]:
    """Return a tolerance in mm or °, and which of both where the text says so."""
    import numpy as np

    from ...data.measurements import find_unit

    match = re.fullmatch(r"\s*([0-9]*[.,]?[0-9]+(?:[eE][+-]?[0-9]+)?)\s*(\D.*)?", text)
    unit = find_unit(match[2] or "mm") if match else None
    found, expected, value, stated = repr(text), "mm such as 0.02, or 20um", 0.0, None
    if match and unit and unit.dimension in ("length", "angle"):
        number = np.array([float(match[1].replace(",", "."))])
        value, expected = float(unit.to_library(number)[0]), "more than 0"
        stated = {"length": "mm", "angle": "deg"}[unit.dimension] if match[2] else None
    plain = stated is None and value >= _PLAIN_TOLERANCE
    if plain:  # 20 is meant as µm, and 20 mm would pass every machine
        found, expected = f"{found} without a unit", f"{text}um or {text}mm"
    if plain or value <= 0.0:
        refuse("--tolerance", found, expected)
    return value, stated


def _verdict(found: _Test, limit: float, file: Path) -> dict[str, Any]:
    """Return the verdict: A against the tolerance, the figure named.

    A test with missing readings does not pass: the figures of the whole one are larger.

    Raises:
        MeasurementError: If the data give no accuracy to judge.
    """
    from ...data.measurements import MeasurementError, amount, with_arrows

    test, unit, missing = found.figures, found.unit, found.missing
    name, value = test.judged()
    if value is None:
        reason = "found one run only, expected at least two: no accuracy A to judge"
        raise MeasurementError(str(file), reason)
    within = value <= limit
    single = test.single_targets()
    passed = within and not missing and not single
    shown = with_arrows(name)
    sentence = (
        f"{'PASS' if passed else 'NOT JUDGED' if within else 'FAIL'}: {shown} = "
        f"{amount(value, unit)} {'≤' if within else '>'} tolerance "
        f"{amount(limit, unit)} ({file.name})"
    )
    if within and missing:
        sentence += f", but {missing} readings that the file announces are missing"
    elif within and single:
        places = ", ".join(f"{target:g}" for target in single[:8])
        sentence += f", but it leaves out targets with a single approach: {places}"
    return {
        "passed": passed,
        "figure": name,
        "value": value,
        "tolerance": limit,
        "sentence": sentence,
    }


def _as_dict(test: "Iso230") -> dict[str, Any]:
    return {
        **test.figures(),
        "positions": test.positions,
        "run_offsets": {str(run): value for run, value in test.run_offsets.items()},
        "remarks": test.remarks,
    }


_PLAIN_TOLERANCE = 1.0
"""Tolerance in mm or ° from which on its unit must be stated."""

_MEANING = {
    "A": "accuracy, both directions",
    "R": "repeatability, both directions",
    "B": "largest reversal",
    "B_mean": "mean reversal",
    "E": "systematic deviation, both directions",
    "M": "range of the mean deviation",
    "R_up": "repeatability ↑",
    "R_down": "repeatability ↓",
    "A_up": "accuracy ↑",
    "A_down": "accuracy ↓",
    "E_up": "systematic deviation ↑",
    "E_down": "systematic deviation ↓",
}


def _print(files: dict[str, Path], tests: "dict[str, Iso230]", last: _Test) -> None:
    from ...data.measurements import EDITION, describe_drift, with_arrows

    console = wide_console()
    small = "0.001°" if last.unit == "deg" else "µm"
    heads = [
        f"{f'{name}: {path.name}' if name else path.name} [{small}]"
        for name, path in files.items()
    ]
    rows = []
    for key, meaning in _MEANING.items():
        values = [getattr(test, key) for test in tests.values()]
        if any(value is not None for value in values):
            cells = ["–" if value is None else f"{value * 1e3:.1f}" for value in values]
            shown = with_arrows(key).replace("B_mean", "mean B")
            rows.append((shown, meaning, *cells))
    title = f"{EDITION}{f', axis {last.axis}' if last.axis else ''}"
    every = ["figure", "meaning", *heads]
    console.print(table_of(every, rows, numbers=heads, title=title))
    for name, test in tests.items():
        drift = describe_drift(test, unit=last.unit)
        for remark in (*test.remarks, *([drift] if drift else ())):
            console.print(f"{name}: {remark}" if name else remark, markup=False)

"""The command ``iso230``: accuracy and repeatability of positioning."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...data.errors import UsageError
from ._options import AsJson, expect
from ._said import print_json, print_table, wide_console

if TYPE_CHECKING:
    from ...data.measurements import ColumnSpec, Iso230, Iso230Verdict


def iso230(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Runs of the test.")],
    after: Annotated[
        Path | None,
        typer.Argument(metavar="[AFTER]", help="Runs after the compensation."),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(metavar="T", help="Largest A that passes, in mm, or as 20um."),
    ] = None,
    axis: Annotated[
        str | None, typer.Option(help="Axis, where the file holds several.")
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ROLE=COLUMN[:UNIT]",
            help="Column of target, actual or error, run, direction, where the file does"
            " not say: --column error=dx:um. Once per role.",
        ),
    ] = None,
    as_json: AsJson = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the chart (SVG and PNG).")
    ] = None,
) -> None:
    """Evaluate a positioning test by ISO 230-2: A, R, B, mean B, E and M.

    With a second file: before and after.

    With a tolerance: a verdict on A of the last file; exit status 1 where it fails.

    Examples:
      axcomp iso230 laser_x.csv
      axcomp iso230 laser_x.csv laser_again.csv --tolerance 20um --out chart
    """
    from ...data.measurements import MeasurementError, read_iso230

    files = {"before": file, "after": after} if after else {"": file}
    limit, limit_unit = (None, None) if tolerance is None else _tolerance(tolerance)
    columns = _columns(column or (), axis)
    found = {name: read_iso230(path, columns, axis) for name, path in files.items()}
    tests = {name: one.figures for name, one in found.items()}
    last = next(reversed(files))
    unit = next(iter(found.values())).unit
    if found[last].unit != unit:
        reason = f"found {found[last].unit}, expected {unit} as in {file}"
        raise MeasurementError(str(after), reason)
    alike = f"{unit} as in {files[last]}"
    expect(limit_unit in (None, unit), "--tolerance", f"'{tolerance}'", alike)
    if _targets(tests[last]) != _targets(next(iter(tests.values()))):
        remark = "Its targets are not those of the first file: compare with care."
        remarks = (remark, *tests[last].remarks)
        tests[last] = dataclasses.replace(tests[last], remarks=remarks)
    verdict = None if limit is None else found[last].verdict(limit)
    charts: tuple[Path, ...] = ()
    if out is not None:
        from ..report._iso_chart import draw_iso_chart, write_chart

        figure = draw_iso_chart(
            tests, axis=found[last].axis, unit=unit, tolerance=limit
        )
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem)
        charts = write_chart(figure, out, f"iso230_{stem}")
    if as_json:
        print_json(_as_dict(tests, unit, verdict, charts))
    else:
        _print(files, tests, unit, found[last].axis)
    if verdict is not None:
        typer.echo(verdict.sentence, err=as_json)
    for path in charts:
        typer.echo(f"wrote {path}", err=True)
    if verdict is not None and not verdict.passed:
        raise typer.Exit(1)


def _columns(texts: Sequence[str], axis: str | None) -> "dict[str, ColumnSpec]":
    """Return the column of each role that was named; empty: as the file says.

    Raises:
        UsageError: If one is no ``ROLE=COLUMN`` with a role of a positioning test.
    """
    from ...data.measurements import ColumnSpec, find_unit

    found: dict[str, ColumnSpec] = {}
    for text in texts:
        role, equals, name = text.partition("=")
        role = {"target": "position"}.get(role, role)
        expect(
            equals and name and role in _ROLES,
            "--column",
            f"'{text}'",
            "ROLE=COLUMN with role target, actual, error, run or direction, such as"
            " error=dx:um",
        )
        head, colon, unit = name.rpartition(":")
        stated = bool(colon and head) and find_unit(unit) is not None
        key = role if role == "run" else f"{axis or 'axis'}.{role}"
        found[key] = ColumnSpec(head, unit) if stated else ColumnSpec(name)
    return found


def _targets(test: "Iso230") -> tuple[float, ...]:
    """Return the targets of a test, to the µm."""
    return tuple(round(item.target, 3) for item in test.positions)


def _tolerance(text: str) -> tuple[float, str | None]:
    """Return a tolerance in mm or °, and which of both where the text says so."""
    from ...data.measurements import find_unit

    match = re.fullmatch(r"\s*([0-9]*[.,]?[0-9]+(?:[eE][+-]?[0-9]+)?)\s*(\D.*)?", text)
    unit = find_unit(match[2]) if match and match[2] else find_unit("mm")
    if match is None or unit is None or unit.dimension not in ("length", "angle"):
        msg = f"--tolerance: found '{text}', expected mm such as 0.02, or 20um"
        raise UsageError(msg)
    import numpy as np

    value = float(unit.to_library(np.array([float(match[1].replace(",", "."))]))[0])
    expect(value > 0.0, "--tolerance", f"'{text}'", "more than 0")
    # 20 is meant as µm, and 20 mm would pass every machine.
    clear, found = match[2] or value < _PLAIN_TOLERANCE, f"'{text}' without a unit"
    expect(clear, "--tolerance", found, f"{text}um or {text}mm")
    stated = {"length": "mm", "angle": "deg"}[unit.dimension]
    return value, stated if match[2] else None


def _as_dict(
    tests: "dict[str, Iso230]",
    unit: str,
    verdict: "Iso230Verdict | None",
    charts: Sequence[Path],
) -> dict[str, Any]:
    first, *others = map(_figures, tests.values())
    result = {**first, "unit": unit}
    if others:
        result["after"] = others[0]
    if verdict is not None:
        result["verdict"] = dataclasses.asdict(verdict)
    if charts:
        result["charts"] = [str(path) for path in charts]
    return result


def _figures(test: "Iso230") -> dict[str, Any]:
    return {
        **test.figures(),
        "positions": [dataclasses.asdict(item) for item in test.positions],
        "run_offsets": {str(run): value for run, value in test.run_offsets.items()},
        "remarks": list(test.remarks),
    }


_ROLES = ("position", "actual", "error", "run", "direction")
"""What a positioning test is made of."""

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


def _print(
    files: dict[str, Path], tests: "dict[str, Iso230]", unit: str, axis: str
) -> None:
    from ...data.measurements import EDITION, describe_drift, with_arrows

    console = wide_console()
    small = "0.001°" if unit == "deg" else "µm"
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
    title = f"{EDITION}{f', axis {axis}' if axis else ''}"
    every = ["figure", "meaning", *heads]
    print_table(console, every, rows, numbers=heads, title=title)
    for name, test in tests.items():
        drift = describe_drift(test, unit=unit)
        for remark in (*test.remarks, *([drift] if drift else ())):
            console.print(f"{name}: {remark}" if name else remark, markup=False)

"""The command ``iso230``: accuracy and repeatability of positioning."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ._console import note, print_json, table_of, wide_console
from ._options import RANGE, AsJson, ascending, matched, refuse

if TYPE_CHECKING:
    from ...data.measurements import ColumnSpec, Iso230, Iso230Test


def iso230(
    file: Path,
    after: Path | None = None,
    *,
    tolerance: str | None = None,
    axis: str | None = None,
    column: list[str] | None = None,
    modulo: str | None = None,
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
        modulo (LOW:HIGH): Range of an axis that goes round, such as 0:360.
        out: Folder for the chart (SVG and PNG).

    Examples:
      axcomp iso230 laser_x.csv
      axcomp iso230 laser_x.csv laser_again.csv --tolerance 20um --out chart
    """
    from ...data.measurements import MeasurementError, read_iso230

    columns, turn = _columns(column or (), axis), None
    if modulo is not None:
        expected = "its range as in 0:360"
        ends = matched("--modulo", modulo, RANGE, expected)
        low, high = ascending(ends, "--modulo", expected)
        turn = high - low
    limit, limit_unit = (None, None) if tolerance is None else _tolerance(tolerance)
    files = {"before": file, "after": after} if after else {"": file}
    outcomes = [
        _with_wild(read_iso230(path, columns, axis, turn)) for path in files.values()
    ]
    first, last, judged = outcomes[0], outcomes[-1], after or file
    if last.unit != first.unit:
        reason = f"found {last.unit}, expected {first.unit} as in {file}"
        raise MeasurementError(str(after), reason)
    if limit_unit not in (None, last.unit):
        refuse("--tolerance", repr(tolerance), f"{last.unit} as in {judged}")
    tests = dict(zip(files, (outcome.figures for outcome in outcomes), strict=True))
    targets, others = (
        [round(item.target, 3) for item in outcome.figures.positions]  # to the µm
        for outcome in (first, last)
    )
    if targets != others:
        remark = "Its targets are not those of the first file: compare with care."
        remarks = (remark, *last.figures.remarks)
        tests["after"] = dataclasses.replace(last.figures, remarks=remarks)
    tree = [_as_dict(test) for test in tests.values()]
    result: dict[str, Any] = tree[0] | {"unit": last.unit}
    if after is not None:
        result["after"] = tree[1]
    verdict = None if limit is None else last.verdict(limit)
    if verdict is not None:
        result["verdict"] = verdict
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
    if verdict is not None:
        typer.echo(verdict.sentence, err=as_json)
    note((f"wrote {path}" for path in result.get("charts", ())), "")
    return verdict is None or verdict.passed


def _with_wild(test: "Iso230Test") -> "Iso230Test":
    """Return a test that names its wild readings: the standard leaves none out."""
    import numpy as np

    from ...data.signals import MOST_WILD, wild_readings
    from ...data.units import small_unit

    runs = test.figures.runs
    target, error = (
        np.concatenate([getattr(run, name) for run in runs])
        for name in ("target", "error")
    )
    side = np.concatenate([np.full(run.target.size, run.direction) for run in runs])
    _, group = np.unique(np.stack([target, side]), axis=1, return_inverse=True)
    group = group.reshape(-1)
    middle = np.array([np.median(error[group == k]) for k in range(group.max() + 1)])
    apart = error - middle[group]
    wild = wild_readings(apart, _LEAST)
    if not wild.any() or wild.mean() > MOST_WILD:
        return test
    places = sorted({round(float(each), 3) for each in target[wild]})
    largest = 1e3 * float(np.abs(apart[wild]).max())
    remark = (
        f"At {', '.join(f'{each:g}' for each in places[:8])} a reading lies up to"
        f" {largest:.4g} {small_unit(test.unit)} from the others there. All figures hold it:"
        " the standard leaves none out."
    )
    remarks = (*test.figures.remarks, remark)
    figures = dataclasses.replace(test.figures, remarks=remarks)
    return dataclasses.replace(test, figures=figures)


def _columns(texts: Sequence[str], axis: str | None) -> "dict[str, ColumnSpec]":
    """Return the column of each role that was named; empty: as the file says."""
    from ...data.measurements import ColumnSpec, find_unit

    expected = "ROLE=COLUMN with role target, actual, error, run or direction, such as error=dx:um"
    pattern = r"(target|position|actual|error|run|direction)=(.+)"
    columns: dict[str, ColumnSpec] = {}
    for text in texts:
        role, name = matched("--column", text, pattern, expected).groups()
        role = {"target": "position"}.get(role, role)
        key = role if role == "run" else f"{axis or 'axis'}.{role}"
        head, _, unit = name.rpartition(":")
        stated = head and find_unit(unit) is not None
        spec = ColumnSpec(head, unit) if stated else ColumnSpec(name)
        # The figures of corrections are those of errors.
        columns[key] = dataclasses.replace(spec, sign=1 if role == "error" else None)
    return columns


def _tolerance(text: str) -> tuple[float, str | None]:
    """Return a tolerance in mm or °, and which of both where the text says so."""
    import numpy as np

    from ...data.measurements import find_unit

    match = re.fullmatch(r"\s*([0-9]*[.,]?[0-9]+(?:[eE][+-]?[0-9]+)?)\s*(\D.*)?", text)
    unit = find_unit(match[2] or "mm") if match else None
    words, expected, value, stated = repr(text), "mm such as 0.02, or 20um", 0.0, None
    if match and unit and unit.dimension in ("length", "angle"):
        number = np.array([float(match[1].replace(",", "."))])
        value, expected = float(unit.to_library(number)[0]), "more than 0"
        stated = {"length": "mm", "angle": "deg"}[unit.dimension] if match[2] else None
    plain = stated is None and value >= _PLAIN_TOLERANCE
    if plain:  # 20 is meant as µm, and 20 mm would pass every machine
        words, expected = f"{words} without a unit", f"{text}um or {text}mm"
    if plain or value <= 0.0:
        refuse("--tolerance", words, expected)
    return value, stated


def _as_dict(test: "Iso230") -> dict[str, Any]:
    return {
        **test.figures(),
        "positions": test.positions,
        "run_offsets": {str(run): value for run, value in test.run_offsets.items()},
        "remarks": test.remarks,
    }


_LEAST = 1e-3
"""Distance in mm or ° within which no reading is wild."""
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
    files: dict[str, Path], tests: "dict[str, Iso230]", last: "Iso230Test"
) -> None:
    from ...data.measurements import EDITION, describe_drift, with_arrows
    from ...data.units import small_unit

    console = wide_console()
    small = small_unit(last.unit)
    heads = [
        f"{f'{name}: {path.name}' if name else path.name} [{small}]"
        for name, path in files.items()
    ]
    rows = []
    for key, meaning in _MEANING.items():
        values = [getattr(test, key) for test in tests.values()]
        if any(value is not None for value in values):
            cells = ["–" if value is None else f"{value * 1e3:.1f}" for value in values]
            label = with_arrows(key).replace("B_mean", "mean B")
            rows.append((label, meaning, *cells))
    title = f"{EDITION}{f', axis {last.axis}' if last.axis else ''}"
    every = ["figure", "meaning", *heads]
    console.print(table_of(every, rows, numbers=heads, title=title))
    for name, test in tests.items():
        drift = describe_drift(test, unit=last.unit)
        for remark in (*test.remarks, *([drift] if drift else ())):
            console.print(f"{name}: {remark}" if name else remark, markup=False)

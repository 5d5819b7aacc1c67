"""ISO 230-2 run tables: ``TGT_DATA[i]=``, ``REF_DATA_FWD[i,j]=``, ``…_BWD[i,j]=``.

Both dialects: with ``TEST_DATA=`` in front of the first comment and targets among the
readings, and without, targets first. See the public ECMC tools for ISO 230-2.
"""

import re
from pathlib import Path

import numpy as np

from ._dialect import NUMBER
from ._errors import CellError, LineError, MeasurementError
from ._table import Skipped, Table, number_columns
from ._units import unit as named_unit

_ASSIGNED = re.compile(
    r"(?P<key>[A-Za-z_]\w*)\s*(?:\[(?P<index>[^\]]*)\])?\s*=\s*(?P<value>.*)"
)
_READING = re.compile(r"(?m)^\s*(?:TGT_DATA|REF_DATA_(?:FWD|BWD))\s*\[")
_SIDES = {"REF_DATA_FWD": 1, "REF_DATA_BWD": -1}
_PLAIN = {"REF_PV", "TEST_PV", "TGT_SET_PV", "UNIT", "CYCLES", "POSITIONS", "DEC"}


def is_run_table(text: str) -> bool:
    """Whether a text assigns targets or readings in this form."""
    return _READING.search(text) is not None


def read_run_table(path: Path, text: str) -> Table:
    """Return columns target, actual, run and direction in the order of measurement.

    Each cycle runs forward through the targets and then backward; the file stores the
    two directions apart. Readings that the file announces and lacks are listed as
    skipped.

    Raises:
        CellError: If a target or reading is not a finite number.
        LineError: If a line is none of the known assignments, or repeats one.
        MeasurementError: If readings have no target, or there are more than announced.
    """
    targets, readings, settings, skipped = _assignments(path, text)
    if not readings:
        raise MeasurementError(
            str(path), "found no readings, expected REF_DATA_FWD[i,j]=…"
        )
    for (_, at, run), (_, line) in readings.items():
        if at not in targets:
            expected = f"TGT_DATA[{at}]=… for REF_DATA of cycle {run}"
            raise LineError(str(path), line, f"a reading at position {at}", expected)
    cycles = max(run for _, _, run in readings)
    count = max(targets)
    for key, largest in (("CYCLES", cycles), ("POSITIONS", count)):
        stated, line = settings.get(key, ("", 0))
        if stated and (not stated.isdigit() or int(stated) < largest):
            found = f"{key}={stated} and {key.lower()[:-1]} {largest} among the data"
            raise LineError(str(path), line, found, f"at least {largest}")
        if stated and key == "CYCLES":
            cycles = int(stated)
        elif stated:
            count = int(stated)
    text_unit, unit_line = settings.get("UNIT", ("mm", 0))
    what = f"UNIT in line {unit_line}" if unit_line else "UNIT"
    unit = named_unit(text_unit, ("length", "angle"), str(path), what).name
    remarks = [] if unit_line else ["No UNIT stated: mm, as the format has it."]
    ascending = sorted(targets, key=lambda at: targets[at][0])
    if ascending != sorted(targets):
        remarks.append(
            "Targets are not numbered in ascending order; forward is taken as +."
        )

    rows: list[tuple[float, float, int, int, int]] = []
    sides = sorted({side for side, _, _ in readings}, reverse=True)
    for run in range(1, cycles + 1):
        for side in sides:
            for at in ascending[::side]:
                if (reading := readings.get((side, at, run))) is None:
                    name = "REF_DATA_FWD" if side > 0 else "REF_DATA_BWD"
                    reason = (
                        f"no reading {name}[{at},{run}] at target {targets[at][0]:g}"
                    )
                    skipped.append(Skipped(targets[at][1], reason))
                else:
                    rows.append((targets[at][0], reading[0], run, side, reading[1]))
    for at in range(1, count + 1):
        if at not in targets:
            line = settings["POSITIONS"][1] if "POSITIONS" in settings else 1
            skipped.append(Skipped(line, f"no target TGT_DATA[{at}]"))
    body = np.array(rows, dtype=np.float64)
    names = (
        ("target", "position", unit),
        ("actual", "actual", unit),
        ("run", "run", None),
        ("direction", "direction", None),
    )
    return Table(
        path=path,
        format="ISO 230-2 run table",
        columns=number_columns(body, names),
        rows=len(rows),
        lines=body[:, 4].astype(np.int64),
        skipped=tuple(skipped),
        remarks=tuple(remarks),
        missing=cycles * len(sides) * count - len(rows),
    )


_Readings = dict[tuple[int, int, int], tuple[float, int]]


def _assignments(
    path: Path, text: str
) -> tuple[
    dict[int, tuple[float, int]], _Readings, dict[str, tuple[str, int]], list[Skipped]
]:
    """Return targets, readings and settings, each with its line."""
    targets: dict[int, tuple[float, int]] = {}
    readings: _Readings = {}
    settings: dict[str, tuple[str, int]] = {}
    skipped: list[Skipped] = []
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip().removeprefix("TEST_DATA=").strip().strip("'\"")
        if not line or line.startswith("#"):
            continue
        match = _ASSIGNED.fullmatch(line)
        if match is None:
            expected = (
                "TGT_DATA[i]=, REF_DATA_FWD[i,j]=, REF_DATA_BWD[i,j]= or a setting"
            )
            raise LineError(str(path), number, f"'{line[:40]}'", expected)
        key, value = match["key"], match["value"].strip()
        index = [part.strip() for part in (match["index"] or "").split(",")]
        depth = {"TGT_DATA": 1, "REF_DATA_FWD": 2, "REF_DATA_BWD": 2}.get(key, 0)
        if depth == 0:
            settings[key] = (value, number)
            if key not in _PLAIN:
                skipped.append(Skipped(number, f"unknown setting {key}"))
            continue
        if len(index) != depth or not all(i.isdigit() and int(i) > 0 for i in index):
            found = f"{key}[{match['index'] or ''}]"
            expected = f"{depth} whole number{'s' if depth > 1 else ''} from 1 up"
            raise LineError(str(path), number, found, expected)
        if not NUMBER.fullmatch(value):
            name = f"{key}[{','.join(index)}]"
            raise CellError(str(path), number, name, value, "a finite number")
        if depth == 1:
            place = int(index[0])
            previous = targets.get(place)
            targets[place] = (float(value), number)
        else:
            spot = (_SIDES[key], int(index[0]), int(index[1]))
            previous = readings.get(spot)
            readings[spot] = (float(value), number)
        if previous is not None:
            found = f"{key}[{','.join(index)}] a second time"
            expected = f"it once (first in line {previous[1]})"
            raise LineError(str(path), number, found, expected)
    return targets, readings, settings, skipped

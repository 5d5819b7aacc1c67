"""The command ``simulate``: what the controller would add along a motion."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._events_file import read_events
from ._motion_file import read_motion

if TYPE_CHECKING:
    import numpy as np

    from ...data.lists import ListFile
    from ...models import Conventions, TemperatureLine
    from ..exchange import AxisOffsets, Motion, StoredConventions


def simulate(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE.lis …",
            help="Compensation lists, and axis lists for what is active.",
        ),
    ],
    motion: Annotated[
        Path,
        typer.Option(
            metavar="M.csv",
            help="Columns A1.position, A2.position, … in mm or °, named after the"
            " logical axis numbers; time in s where the rows are cycles;"
            " A1.direction (±1) where they are not.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="O.csv",
            help="Where to write the offsets (.csv or .parquet); left out: as CSV on"
            " standard output.",
        ),
    ] = None,
    increment: Annotated[
        float | None,
        typer.Option(help="mm (or °) per encoder increment, for lists with unit 0."),
    ] = None,
    conventions: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Rules of this machine's controller, as axcomp verify saves them;"
            " left out: the defaults.",
        ),
    ] = None,
    cycle_time: Annotated[
        float | None,
        typer.Option(
            help="Of the controller in s: a motion with another time step is refused."
        ),
    ] = None,
    modulo: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A4=0:360",
            help="Range of an axis that turns, in °; may be given several times.",
        ),
    ] = None,
    temperature: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A1=T.csv",
            help="Temperature table of an axis as the PLC follows it (temperature_X.csv"
            " of a job), for the column temperature.<sensor> of the motion;"
            " A1=T.csv:frame where there are several sensors.",
        ),
    ] = None,
    events: Annotated[
        Path | None,
        typer.Option(
            metavar="E.csv",
            help="What happens meanwhile: columns time, axis (empty: all) and event, which"
            " is COMP ON CROSS, COMP OFF LEAD TEMP, COMP OFF_ALL, HOMED, NOT HOMED,"
            " PROGRAM END or RELOAD FILE.lis. Left out: the column event of the motion,"
            " if it has one.",
        ),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print columns, rows and largest values as JSON."),
    ] = False,
) -> None:
    """Compute what the controller would add, per row of a motion and compensation.

    Without an axis list everything in a list is active, from the first row on. With
    events, what waits for COMP ON waits for it, and an axis that an event homes was not
    homed before.

    Columns: time, then per axis each compensation and their sum: A3.cross … A3.offset,
    and A3.friction in drive units.
    """
    from ...data.lists import ListFile
    from ..exchange import (
        Reading,
        StoredConventions,
        read_conventions,
        simulate_events,
    )
    from ..job import use_compilation_cache

    for name, number in (("--increment", increment), ("--cycle-time", cycle_time)):
        if number is not None and not 0 < number < float("inf"):
            message = f"found {number:g}, expected more than 0"
            raise typer.BadParameter(message, param_hint=name)
    ranges = dict(axis_range(text) for text in modulo or ())
    use_compilation_cache()
    rules = (
        StoredConventions() if conventions is None else read_conventions(conventions)
    )
    lists = [ListFile.read(file) for file in dict.fromkeys(files)]
    path = read_motion(motion)
    happened = read_events(motion if events is None else events, path, events is None)
    found = simulate_events(
        lists,
        path,
        Reading(
            rules.conventions,
            increment,
            ranges,
            _lines(temperature or (), lists, path, rules.conventions),
        ),
        cycle_time=cycle_time,
        events=happened,
    )
    columns = _columns(path, found)
    for remark in dict.fromkeys(text for axis in found for text in axis.remarks):
        typer.echo(f"axcomp: {remark}", err=True)
    if out is not None:
        _write(out, columns)
    if as_json:
        typer.echo(json.dumps(_summary(columns, found, rules), indent=2))
    elif out is None:
        typer.echo(_csv(columns).decode("ascii"), nl=False)
    else:
        rows = len(next(iter(columns.values()))) if columns else 0
        typer.echo(f"{rows} rows, {', '.join(columns)} in {out}", err=True)


_RANGE = re.compile(r"A?(\d{1,5})=([^:]+):([^:]+)")
_TABLE = re.compile(r"A?(\d{1,5})=(.+?)(?::([A-Za-z_][\w-]*))?")


def axis_range(text: str, option: str = "--modulo") -> tuple[int, tuple[float, float]]:
    match = _RANGE.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        low, high = float(match[2]), float(match[3])
        if not -float("inf") < low < high < float("inf"):
            raise ValueError
    except ValueError:
        message = f"found {text!r}, expected an axis and its range as in A4=0:360"
        raise typer.BadParameter(message, param_hint=option) from None
    return int(match[1]), (low, high)


def _lines(
    texts: Sequence[str],
    lists: "Sequence[ListFile]",
    motion: "Motion",
    conventions: "Conventions",
) -> "dict[int, TemperatureLine]":
    """Return the temperature lines that a PLC would follow, by axis."""
    from ..exchange import machine_lists
    from ..kinds.temperature._plc_table import read_temperature_table

    found = {}
    machines = machine_lists(lists).machine if texts else {}
    for text in texts:
        match = _TABLE.fullmatch(text)
        if match is None:
            message = f"found {text!r}, expected an axis and its file as in A1=T.csv"
            raise typer.BadParameter(message, param_hint="--temperature")
        axis = int(match[1])
        found[axis] = read_temperature_table(
            Path(match[2]),
            list(motion.temperatures),
            match[3],
            conventions,
            machines.get(axis),
        )
    return found


def _columns(
    motion: "Motion", found: "tuple[AxisOffsets, ...]"
) -> "dict[str, np.ndarray]":
    import numpy as np

    columns: dict[str, np.ndarray] = {}
    if motion.time is not None:
        columns["time"] = motion.time
    for axis in found:
        parts = {**axis.parts, "offset": axis.total}
        if axis.current is not None:
            parts["friction"] = axis.current
        for name, values in parts.items():
            # 1 pm: what stands behind it is the noise of floating point.
            columns[f"A{axis.axis}.{name}"] = np.round(values, 9)
    return columns


def _summary(
    columns: "dict[str, np.ndarray]",
    found: "tuple[AxisOffsets, ...]",
    rules: "StoredConventions",
) -> dict[str, object]:
    import numpy as np

    return {
        "columns": list(columns),
        "rows": len(next(iter(columns.values()))) if columns else 0,
        "largest": {
            name: float(np.max(np.abs(values), initial=0.0))
            for name, values in columns.items()
            if name != "time"
        },
        "conventions": {
            rule.name: {
                "value": rule.value,
                "state": "verified" if rule.name in rules.verified else "assumed",
            }
            for rule in rules.conventions.listing()
        },
        "remarks": [text for axis in found for text in axis.remarks],
    }


def _csv(columns: "dict[str, np.ndarray]") -> bytes:
    import io

    import pyarrow as pa
    from pyarrow import csv

    sink = io.BytesIO()
    sink.write((",".join(columns) + "\n").encode("ascii"))
    csv.write_csv(
        pa.table({name: pa.array(values) for name, values in columns.items()}),
        sink,
        csv.WriteOptions(include_header=False),
    )
    return sink.getvalue()


def _write(out: Path, columns: "dict[str, np.ndarray]") -> None:
    from ..job import write_atomically

    if out.suffix.lower() != ".parquet":
        write_atomically(out, _csv(columns))
        return
    import io

    import pyarrow as pa
    from pyarrow import parquet

    sink = io.BytesIO()
    parquet.write_table(
        pa.table({name: pa.array(values) for name, values in columns.items()}), sink
    )
    write_atomically(out, sink.getvalue())

"""The command ``simulate``: what the controller would add along a motion."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import numpy as np

    from ..exchange import AxisOffsets, Motion


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
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print columns, rows and largest values as JSON."),
    ] = False,
) -> None:
    """Compute what the controller would add, per row of a motion and compensation.

    Without an axis list everything in a list is active, from the first row on.

    Columns: time, then per axis each compensation and their sum: A3.cross … A3.offset.
    """
    from ...data.lists import ListFile
    from ...models import Conventions
    from ..exchange import simulate as offsets_of
    from ..job import use_compilation_cache

    if increment is not None and not 0 < increment < float("inf"):
        message = f"found {increment:g}, expected more than 0"
        raise typer.BadParameter(message, param_hint="--increment")
    use_compilation_cache()
    lists = [ListFile.read(file) for file in dict.fromkeys(files)]
    path = _read_motion(motion)
    found = offsets_of(lists, path, Conventions(), increment)
    columns = _columns(path, found)
    for axis in found:
        for name in axis.left_out:
            typer.echo(
                f"axcomp: A{axis.axis}: {name} stands in the list and is not computed"
                " by this version",
                err=True,
            )
    if out is not None:
        _write(out, columns)
    if as_json:
        typer.echo(json.dumps(_summary(columns), indent=2))
    elif out is None:
        typer.echo(_csv(columns).decode("ascii"), nl=False)
    else:
        rows = len(next(iter(columns.values())))
        typer.echo(f"{rows} rows, {', '.join(columns)} in {out}", err=True)


def _read_motion(file: Path) -> "Motion":
    """Return a motion file: columns that are called like roles, in mm, ° and s."""
    import numpy as np

    from ...data.measurements import MeasurementError, measurement, read_table
    from ..exchange import Motion

    table = read_table(file)
    measured = measurement(table)
    positions: dict[int, np.ndarray] = {}
    directions: dict[int, np.ndarray] = {}
    for axis in measured.axes:
        number = axis.removeprefix("A")
        if not number.isdigit():
            reason = (
                f"found axis {axis!r}, expected A1, A2, … after the logical numbers"
            )
            raise MeasurementError(str(file), reason)
        if (place := measured.get(f"{axis}.position")) is not None:
            positions[int(number)] = np.asarray(place, dtype=float)
        if (direction := measured.get(f"{axis}.direction")) is not None:
            directions[int(number)] = np.asarray(direction, dtype=np.int64)
    if not positions:
        reason = "found no position, expected a column such as A1.position"
        raise MeasurementError(str(file), reason)
    time = measured.get("time")
    if time is not None and np.any(np.diff(time) <= 0):
        at = int(np.argmax(np.diff(time) <= 0))
        reason = (
            f"line {measured.lines[at + 1]}: found time {time[at + 1]:g} after"
            f" {time[at]:g}, expected ascending times"
        )
        raise MeasurementError(str(file), reason)
    return Motion(positions, directions, time)


def _columns(
    motion: "Motion", found: "tuple[AxisOffsets, ...]"
) -> "dict[str, np.ndarray]":
    import numpy as np

    columns: dict[str, np.ndarray] = {}
    if motion.time is not None:
        columns["time"] = motion.time
    for axis in found:
        parts = {**axis.parts, "offset": axis.total}
        for name, values in parts.items():
            # 1 pm: what stands behind it is the noise of floating point.
            columns[f"A{axis.axis}.{name}"] = np.round(values, 9)
    return columns


def _summary(columns: "dict[str, np.ndarray]") -> dict[str, object]:
    import numpy as np

    return {
        "columns": list(columns),
        "rows": len(next(iter(columns.values()))),
        "largest": {
            name: float(np.max(np.abs(values)))
            for name, values in columns.items()
            if name != "time"
        },
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

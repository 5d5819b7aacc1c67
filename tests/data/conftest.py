"""TwinCAT Scope text exports as Scope writes them, for the tests of their reader."""

from collections.abc import Callable

import numpy as np
import pytest

START = 132959733843760000
KEYS = (
    "SymbolComment",
    "Data-Type",
    "SampleTime[ms]",
    "VariableSize",
    "SymbolBased",
    "IndexGroup",
    "IndexOffset",
    "SymbolName",
    "NetID",
    "Port",
    "Offset",
    "ScaleFactor",
    "BitMask",
    "Unit",
    "Unit ScaleFactor",
    "Unit Offset",
)
PLAIN = {
    "SymbolComment": "",
    "Data-Type": "REAL64",
    "VariableSize": "8",
    "SymbolBased": "True",
    "Offset": "0",
    "ScaleFactor": "1",
    "Unit": "(None)",
    "Unit ScaleFactor": "1",
    "Unit Offset": "0",
}

Channels = dict[str, str]
"""Unit as Scope writes it, by name."""
AXIS: list[tuple[float, Channels]] = [
    (0.5, {"current": "A (Current)"}),
    (1.0, {"ActPos": "mm (Length)", "ActVelo": "(None)"}),
    (5.0, {"temp": "°C (Temperature)"}),
]


@pytest.fixture
def export() -> Callable[..., str]:
    """Return the function that writes an export; see `write_export`."""
    return write_export


@pytest.fixture
def values_of() -> Callable[[int, np.ndarray], np.ndarray]:
    """Return the function that tells what a channel of an export holds."""
    return channel_values


def channel_values(number: int, time: np.ndarray) -> np.ndarray:
    """Return what channel `number` holds at some times in ms."""
    return np.round(np.sin(0.01 * time + number) * 10 + number, 4)


def write_export(
    groups: list[tuple[float, Channels]] | None = None,
    *,
    separator: str = "\t",
    decimal: str = ",",
    duration: float = 100.0,
    blanks: bool = False,
    end_mark: bool = False,
    keys: tuple[str, ...] = KEYS,
    first: tuple[float, ...] = (),
) -> str:
    """Return an export of groups of channels, each with its sample time in ms.

    Args:
        groups: Sample time and channels; left out: `AXIS`.
        separator: Between the cells.
        decimal: Of the samples; the header has a comma in any case.
        duration: In ms.
        blanks: Fill ended groups with blank cells instead of shorter lines.
        end_mark: Close with a line ``EOF``.
        keys: Lines of the block below the names.
        first: Time of the first sample of each group in ms.
    """
    groups = AXIS if groups is None else groups
    end = START + round(duration * 10_000)
    lines = [
        separator.join(["Name", "trace", ""]),
        separator.join(["File", r"C:\traces\trace.csv".replace(separator, ""), ""]),
        separator.join(["Starttime of export", str(START), "Montag", "15-56"]),
        separator.join(["Endtime of export", str(end), "Montag", "15-57"]),
        "",
        "",
    ]
    for key in ("Name", *keys):
        cells = []
        for step, channels in groups:
            cells.append(key)
            for name, unit in channels.items():
                filled = {
                    "Name": name,
                    "SampleTime[ms]": f"{step:g}".replace(".", ","),
                    "Unit": unit,
                }
                cells.append(filled.get(key) or PLAIN.get(key, "851"))
        lines.append(separator.join(cells))
    lines.append("")
    columns: list[list[str]] = []
    number = 0
    for at, (step, channels) in enumerate(groups):
        begin = first[at] if at < len(first) else 0.0
        time = np.round(np.arange(begin, duration + 1e-6, step), 6)
        columns.append([f"{value:.10g}" for value in time])
        for _ in channels:
            columns.append([f"{value:.10g}" for value in channel_values(number, time)])
            number += 1
    for row in range(max(map(len, columns))):
        cells = [column[row] if row < len(column) else " " for column in columns]
        while not blanks and cells[-1] == " ":
            cells.pop()
        lines.append(separator.join(cells).replace(".", decimal))
    if end_mark:
        lines.append("EOF")
    return "\n".join(lines) + "\n"

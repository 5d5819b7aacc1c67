"""TwinCAT Scope text exports: channels of several sample times on one list of instants."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from ._header import Name, roles_of
from ._scope_body import read_body
from ._scope_group import GroupSamples
from ._scope_header import Channel, read_header
from ._table import SCOPE_FORMAT, Column, Skipped, Table
from ._units import find_unit

_DECIMALS = 6
"""Times are compared to the nanosecond; Scope writes them in ms."""


def read_scope(path: Path, text: str) -> Table:
    """Return the channels of a TwinCAT Scope text export.

    The rows are all instants at which any channel has a sample, in ms since the start
    of the export; `Column.present` tells where a channel has one. `measurement` brings
    the channels that are used to one clock.

    Raises:
        MeasurementError: If the file is damaged; names the line.
    """
    header = read_header(path, text)
    groups = read_body(path, header, text)
    times = [np.round(samples.time, _DECIMALS) for samples in groups]
    clocks = {time.tobytes(): time for time in times}  # most groups share one
    instants = np.unique(np.concatenate(list(clocks.values())))
    rows = {key: np.searchsorted(instants, time) for key, time in clocks.items()}
    places = [rows[time.tobytes()] for time in times]
    lines = np.zeros(instants.size, dtype=np.int64)
    for samples, place in zip(groups[::-1], places[::-1], strict=True):
        lines[place] = samples.lines
    used = {channel.name.casefold() for group in header.groups for channel in group}
    clock = next(n for n in ("time", "scope time", "time of export") if n not in used)
    columns = [Column(clock, "time", "ms", instants, header=clock)]
    remarks = []
    for samples, channels, place in zip(groups, header.groups, places, strict=True):
        step = np.median(np.diff(samples.time)) if samples.time.size > 1 else None
        measured = None if step is None else float(step) / 1000.0
        for k, channel in enumerate(channels):
            columns.append(_column(channel, samples, k, place, instants.size, measured))
        stated = channels[0].sample_time
        if stated and measured and abs(stated - measured) > 0.01 * stated:
            remarks.append(
                f"'{channels[0].name}' states a sample time of {1e3 * stated:g} ms and"
                f" its times advance by {1e3 * measured:g} ms; the times are taken."
            )
    names = [Name(c.name, c.unit, False, c.name, c.header) for c in columns[1:]]
    roles, _ = roles_of(names)
    named = [
        dataclasses.replace(column, role=role if role != "time" else None)
        for column, role in zip(columns[1:], roles, strict=True)
    ]
    if header.rescaled:
        remarks.append(
            f"The header states a scale or an offset for {_listed(header.rescaled)}, not"
            " whether it was applied before the export; values are taken as they stand."
        )
    unknown = [c.name for c in named if c.unit and find_unit(c.unit) is None]
    if unknown:
        remarks.append(
            f"The units of {_listed(unknown)} are none that can be converted: state them"
            " where these channels are used."
        )
    repeated = sum(samples.repeated for samples in groups)
    skipped = (
        (Skipped(0, f"{repeated} samples repeated to fill lines"),) if repeated else ()
    )
    return Table(
        path=path,
        format=SCOPE_FORMAT,
        columns=(columns[0], *named),
        rows=instants.size,
        lines=lines,
        skipped=skipped,
        remarks=tuple(remarks),
    )


def _column(
    channel: Channel,
    samples: GroupSamples,
    k: int,
    place: Int[np.ndarray, " _"],
    rows: int,
    measured: float | None,
) -> Column:
    values = samples.values[k]
    present: Bool[np.ndarray, " t"] | None = None
    if place.size != rows:
        present = np.zeros(rows, dtype=bool)
        present[place] = True
        spread = np.full(rows, np.nan)
        spread[place] = values
        values = spread
    unit = find_unit(channel.unit) if channel.unit else None
    return Column(
        name=channel.name,
        role=None,
        unit=unit.name if unit else channel.unit,
        values=values,
        bad=samples.bad[k],
        header=channel.name,
        present=present,
        sample_time=channel.sample_time or measured,
    )


def _listed(names: Sequence[str]) -> str:
    text = ", ".join(f"'{name}'" for name in names[:4])
    return text if len(names) <= 4 else f"{text} and {len(names) - 4} more"

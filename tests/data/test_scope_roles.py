"""Channels of a Scope export as roles: one clock, units of the header, no invention."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    ColumnSpec,
    Measurement,
    MeasurementError,
    UnitError,
    measurement,
    read_table,
)

Export = Callable[..., str]
Values = Callable[[int, np.ndarray], np.ndarray]


def load(folder: Path, text: str, columns: dict[str, str]) -> Measurement:
    path = folder / "trace.csv"
    path.write_text(text, encoding="utf-8")
    specs = {role: ColumnSpec(column) for role, column in columns.items()}
    return measurement(read_table(path), specs)


def test_units_of_the_header_are_the_defaults_and_time_comes_along(
    tmp_path: Path, export: Export, values_of: Values
) -> None:
    groups = [(1.0, {"pos": "m (Length)", "i": "mA (Current)"})]
    found = load(tmp_path, export(groups), {"X.position": "pos", "X.current": "i"})
    ms = np.arange(101.0)
    assert np.array_equal(found.values["time"], ms / 1000.0)
    assert np.array_equal(found.values["X.position"], values_of(0, ms) * 1000.0)
    assert np.array_equal(found.values["X.current"], values_of(1, ms) / 1000.0)
    assert found.units["X.current"] == "A"
    assert not found.remarks


def test_faster_channel_is_read_at_the_instants_of_the_slower(
    tmp_path: Path, export: Export, values_of: Values
) -> None:
    roles = {"X.position": "ActPos", "X.current": "current"}
    found = load(tmp_path, export(), roles)
    ms = np.arange(101.0)
    assert np.array_equal(found.values["time"], ms / 1000.0)
    # Every instant of the slower channel is one of the faster, so nothing is computed.
    assert np.array_equal(found.values["X.current"], values_of(0, ms))
    assert np.array_equal(found.values["X.position"], values_of(1, ms))
    assert found.remarks == (
        "Channels of several sample times are taken at the 101 instants of 'ActPos'.",
    )


def test_channel_between_two_samples_is_read_linearly_and_said(
    tmp_path: Path, export: Export, values_of: Values
) -> None:
    text = export(first=(0.25, 0.0, 0.0))
    found = load(tmp_path, text, {"X.position": "ActPos", "X.current": "current"})
    ms = found.values["time"] * 1000.0
    assert np.array_equal(ms, np.arange(1.0, 100.0))  # inside the range of both
    nearby = [values_of(0, np.round(ms + side, 6)) for side in (-0.25, 0.25)]
    # Half way between two numbers of four decimals: the mean of both, but for rounding.
    assert np.allclose(found.values["X.current"], sum(nearby) / 2, rtol=0, atol=1e-12)
    assert "read between two samples there: current" in found.remarks[0]


def test_slow_temperature_does_not_thin_the_others(
    tmp_path: Path, export: Export, values_of: Values
) -> None:
    roles = {"X.position": "ActPos", "temperature.frame": "temp"}
    found = load(tmp_path, export(), roles)
    assert found.rows == 101
    warmth = found.values["temperature.frame"]
    assert np.array_equal(warmth[::5], values_of(3, np.arange(0.0, 101.0, 5.0)))
    assert np.array_equal(warmth[2], warmth[0] + 0.4 * (warmth[5] - warmth[0]))


def test_nothing_is_read_within_a_gap_of_a_channel(
    tmp_path: Path, export: Export
) -> None:
    text = export(blanks=True, first=(0.25,))
    lines = text.split("\n")
    gap = [k for k, row in enumerate(lines) if row[:3] in ("20,", "21,", "22,", "23,")]
    assert len(gap) == 8
    for k in gap:  # the samples of the fast channel from 20 to 24 ms are lost
        del lines[gap[0]]
        del k
    rows = "\n".join(lines)
    path = tmp_path / "t.csv"
    path.write_text(rows, encoding="utf-8")
    table = read_table(path)
    found = measurement(
        table, {"X.position": ColumnSpec("ActPos"), "X.current": ColumnSpec("current")}
    )
    ms = set((found.values["time"] * 1000.0).tolist())
    assert not ms & {20.0, 21.0, 22.0, 23.0, 24.0}
    assert {19.0, 25.0} <= ms


def test_unit_that_the_library_lacks_is_refused_unless_the_job_states_one(
    tmp_path: Path, export: Export
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(export([(1.0, {"i": "kp (Force)"})]), encoding="utf-8")
    table = read_table(path)
    assert "none that can be converted" in table.remarks[0]
    with pytest.raises(UnitError, match="found unit 'kp', expected"):
        measurement(table, {"X.current": ColumnSpec("i")})
    stated = measurement(table, {"X.current": ColumnSpec("i", "N")})
    assert stated.units["X.current"] == "N"


def test_unit_of_the_job_that_contradicts_the_header_is_refused(
    tmp_path: Path, export: Export
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(export(), encoding="utf-8")
    with pytest.raises(UnitError, match="the file says mm"):
        measurement(read_table(path), {"X.position": ColumnSpec("ActPos", "um")})


def test_channels_without_a_common_instant_are_refused(
    tmp_path: Path, export: Export
) -> None:
    groups = [(1.0, {"a": "mm (Length)"}), (30.0, {"b": "mm (Length)"})]
    text = export(groups, first=(95.5, 0.0))
    with pytest.raises(MeasurementError, match="'a', 'b' without a common instant"):
        load(tmp_path, text, {"X.position": "a", "X.actual": "b"})


def test_sparse_channel_is_not_handed_out_as_a_plain_column(
    tmp_path: Path, export: Export
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(export(), encoding="utf-8")
    table = read_table(path)
    with pytest.raises(MeasurementError, match="found 21 samples of 'temp' at 201"):
        table.numbers(table.column("temp"))

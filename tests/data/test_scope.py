"""TwinCAT Scope text exports: every way in which Scope writes them."""

import gzip
import time as clock
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import SCOPE_FORMAT, Table, read_table

DATA = Path(__file__).parents[3] / "shared" / "data" / "scope"
START = 132959733843760000
"""Ticks at which the exports of these tests begin."""
Export = Callable[..., str]
Values = Callable[[int, np.ndarray], np.ndarray]


def put(folder: Path, text: str, name: str = "trace.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8", newline="")
    return path


def samples(table: Table, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times in ms and values of one channel."""
    column = table.column(name)
    there = slice(None) if column.present is None else column.present
    return table.column("time").values[there], column.values[there]


REAL = ("scope_default.csv", "scope_decimal_mark.csv", "scope_separator_semicolon.csv")


@pytest.mark.parametrize("name", REAL)
def test_real_export_has_names_units_counts_and_times(name: str) -> None:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs ../shared/data/scope/{name}")
    table = read_table(path)
    assert table.format == SCOPE_FORMAT
    assert not table.skipped
    first = table.columns[0]
    assert (first.name, first.role, first.unit) == ("time", "time", "ms")
    names = {column.name for column in table.columns[1:]}
    assert len(names) == len(table.columns) - 1 == 21
    assert {"func_OS", "var_INT8", "test_special([{äöü!?ß$²}])"} <= names
    assert {"test space", "test space (1)"} <= names
    units = {c.name: c.unit for c in table.columns if c.unit and c.role is None}
    assert units == {"func_units_scaled": "dV", "func_units_unscaled": "V"}
    for column in table.columns[1:]:
        fast, slow = column.name == "func_OS", column.name == "func_freesample"
        step = 0.0002 if fast else 0.005 if slow else 0.001
        assert column.sample_time == step
        assert column.samples == (4996 if fast else 201 if slow else 1000)
        time, values = samples(table, column.name)
        # Scope prints ms with one decimal: equal to the last bit after rounding.
        usual = np.round(np.arange(time.size) * 1e3 * step, 6) - (3.0 if slow else 0)
        assert np.array_equal(time, usual)
        if column.name in ("func_OS", "var_REAL64", "func_units_unscaled"):
            assert np.array_equal(values, time)  # the channel counts the time
    _, small = samples(table, "var_INT8")
    assert np.array_equal(small, (np.arange(1000) + 128) % 256 - 128)


# Scope does not separate with the decimal mark, and between blanks a blank cell is none.
WAYS = [
    (separator, decimal, blanks)
    for separator in "\t;:, "
    for decimal in ".,"
    for blanks in (False, True)
    if separator != decimal and not (separator == " " and blanks)
]


@pytest.mark.parametrize(("separator", "decimal", "blanks"), WAYS)
def test_any_separator_and_decimal_mark_gives_the_same_channels(
    tmp_path: Path,
    export: Export,
    values_of: Values,
    separator: str,
    decimal: str,
    blanks: bool,
) -> None:
    text = export(separator=separator, decimal=decimal, blanks=blanks)
    table = read_table(put(tmp_path, text))
    assert [c.name for c in table.columns] == [
        "time",
        "current",
        "ActPos",
        "ActVelo",
        "temp",
    ]
    assert [c.unit for c in table.columns] == ["ms", "A", "mm", None, "degC"]
    steps = [c.sample_time for c in table.columns[1:]]
    assert steps == [0.0005, 0.001, 0.001, 0.005]
    for number, (column, count) in enumerate(
        zip(table.columns[1:], (201, 101, 101, 21), strict=True)
    ):
        time, values = samples(table, column.name)
        assert column.samples == time.size == count
        assert np.array_equal(values, values_of(number, time))


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_line_ends_and_encodings_do_not_matter(
    tmp_path: Path, export: Export, ending: str, encoding: str
) -> None:
    path = tmp_path / "trace.csv"
    path.write_bytes(export().replace("\n", ending).encode(encoding))
    table = read_table(path)
    assert table.rows == 201
    assert table.column("temp").unit == "degC"
    assert table.lines[0] == 25


def test_packed_export_reads_like_the_plain_one(tmp_path: Path, export: Export) -> None:
    path = tmp_path / "trace.csv.gz"
    path.write_bytes(gzip.compress(export().encode()))
    assert read_table(path).column("ActPos").samples == 101


def test_header_of_names_only_takes_sample_times_from_the_times(
    tmp_path: Path, export: Export
) -> None:
    table = read_table(put(tmp_path, export(keys=(), separator=",", decimal=".")))
    assert [c.sample_time for c in table.columns[1:]] == [0.0005, 0.001, 0.001, 0.005]
    assert [c.unit for c in table.columns[1:]] == [None] * 4


def test_comment_over_several_lines_is_read_over(
    tmp_path: Path, export: Export
) -> None:
    text = export().replace(
        "SymbolComment\t", "SymbolComment\tfirst line\n\n2\tthird\tline\n", 1
    )
    table = read_table(put(tmp_path, text))
    assert table.column("current").samples == 201


def test_line_that_ends_with_a_separator_is_whole(
    tmp_path: Path, export: Export
) -> None:
    text = export()
    head, body = text.split("\n\n0\t", 1)
    body = "0\t" + body.replace("\n", "\t\n")
    head = "\n".join(
        line + "\t" if at > 5 else line for at, line in enumerate(head.split("\n"))
    )
    table = read_table(put(tmp_path, f"{head}\n\n{body}"))
    assert table.column("current").samples == 201
    assert table.column("temp").samples == 21


def test_times_as_ticks_are_relative_to_the_start_of_the_export(
    tmp_path: Path, export: Export
) -> None:
    text = export([(1.0, {"x": "mm (Length)"})], duration=3.0, decimal=".")
    for ms in range(4):
        text = text.replace(f"\n{ms}\t", f"\n{START + 10_000 * ms}\t")
    table = read_table(put(tmp_path, text))
    assert table.column("time").values.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_samples_repeated_to_fill_lines_are_left_out_and_counted(
    tmp_path: Path, export: Export
) -> None:
    text = export(
        [(1.0, {"x": "mm (Length)"}), (2.0, {"y": "A (Current)"})], duration=4.0
    )
    head, _ = text.split("\n\n0\t", 1)
    rows = "0\t1\t0\t7\n1\t2\t0\t7\n2\t3\t2\t8\n3\t4\t2\t8\n4\t5\t4\t9\n"
    table = read_table(put(tmp_path, f"{head}\n\n{rows}"))
    time, values = samples(table, "y")
    assert time.tolist() == [0.0, 2.0, 4.0]
    assert values.tolist() == [7.0, 8.0, 9.0]
    assert table.skipped[0].reason == "2 samples repeated to fill lines"


def test_groups_that_begin_apart_keep_their_times(
    tmp_path: Path, export: Export
) -> None:
    table = read_table(put(tmp_path, export(first=(0.0, 0.25, -3.0))))
    time, _ = samples(table, "ActPos")
    assert time[:3].tolist() == [0.25, 1.25, 2.25]
    time, _ = samples(table, "temp")
    assert time[:2].tolist() == [-3.0, 2.0]


def test_stated_scale_is_named_and_not_applied(
    tmp_path: Path, export: Export, values_of: Values
) -> None:
    text = export([(1.0, {"x": "mm (Length)"})])
    text = text.replace("ScaleFactor\t1", "ScaleFactor\t-1", 1)
    table = read_table(put(tmp_path, text))
    assert "scale or an offset for 'x'" in table.remarks[0]
    time, values = samples(table, "x")
    assert np.array_equal(values, values_of(0, time))


def test_number_that_is_not_finite_spoils_only_its_channel(
    tmp_path: Path, export: Export
) -> None:
    text = export()
    at = text.index("\n\n0\t") + 2
    line = text[at:].split("\n", 1)[0].split("\t")
    line[3] = "NaN"
    text = text[:at] + "\t".join(line) + "\n" + text[at:].split("\n", 1)[1]
    table = read_table(put(tmp_path, text))
    bad = table.column("ActPos").bad
    assert bad is not None
    assert bad.line == 25
    assert table.column("ActVelo").bad is None


@pytest.mark.slow
@pytest.mark.heavy  # a ratio of times: a busy machine may meet one of the two only
def test_a_million_rows_read_within_a_few_times_plain_csv(
    tmp_path: Path, export: Export
) -> None:
    rows = 1_000_000
    groups = [(1.0, {"x": "mm (Length)", "i": "A (Current)"})]
    head = export(groups, duration=1.0).split("\n\n0\t", 1)[0]
    head = head.replace(str(START + 10_000), str(START + 10_000 * (rows - 1)))
    ticks = np.arange(rows)
    body = "\n".join(f"{t}\t{t % 977},5\t{t % 13},25" for t in ticks.tolist())
    path = put(tmp_path, f"{head}\n\n{body}\n")
    plain = put(tmp_path, f"t;x;i\n{body.replace(chr(9), ';')}\n", "plain.csv")
    took = []
    for file in (path, plain):
        begun = clock.perf_counter()
        assert read_table(file).rows == rows
        took.append(clock.perf_counter() - begun)
    # Both go through pyarrow, the plain table as it lies on the disk; the rest is
    # counting cells. Slow code would be 80 times.
    assert took[0] < 16.0 * took[1]

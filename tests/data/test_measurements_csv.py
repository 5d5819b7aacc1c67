"""Text tables in every dialect: read whole, or refused with the place that is wrong."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from axcomp.data.errors import AxcompError
from axcomp.data.measurements import (
    CellError,
    LineError,
    Table,
    measurement,
    read_table,
)

VALUES = np.array([[0.0, 10.0, -12.5], [1.5, 10.0, 3.25], [3.0, 20.0, 0.001]])


def write(folder: Path, text: str | bytes, name: str = "file.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def rows(separator: str, decimal: str = ".") -> str:
    lines = (separator.join(f"{v:.4f}" for v in row) for row in VALUES)
    return "\n".join(lines).replace(".", decimal) + "\n"


def matrix(table: Table) -> np.ndarray:
    return np.column_stack([column.values for column in table.columns])


DIALECTS = {
    "comma": (",", ","),
    "comma and blank": (", ", ","),
    "semicolon": (";", "."),
    "semicolon with decimal comma": (";", ","),
    "tab": ("\t", "."),
    "tab with decimal comma": ("\t", ","),
    "one blank": (" ", "."),
    "blanks with decimal comma": ("   ", ","),
    "blanks and tabs": (" \t ", "."),
}


@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_separator_and_decimal_mark_reads_alike(
    tmp_path: Path, dialect: str, header: bool
) -> None:
    separator, decimal = DIALECTS[dialect]
    decimal = "." if dialect.startswith("comma") else decimal
    top = separator.join(("x", "y", "dz_um")) + "\n" if header else ""
    table = read_table(write(tmp_path, top + rows(separator, decimal)))
    np.testing.assert_array_equal(matrix(table), VALUES)  # decimal text: exact
    names = [column.name for column in table.columns]
    assert names == (["x", "y", "dz_um"] if header else ["1", "2", "3"])
    assert table.lines.tolist() == ([2, 3, 4] if header else [1, 2, 3])


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("x [mm]", "x", "mm"),
        ("x (mm)", "x", "mm"),
        ("x / mm", "x", "mm"),
        ("dz_um", "dz_um", "um"),
        ("dz [µm]", "dz", "um"),
        ("dz [\N{GREEK SMALL LETTER MU}m]", "dz", "um"),
        ("phi [°]", "phi", "deg"),
        ("T [°C]", "T", "degC"),
        ("a [mm/s²]", "a", "mm/s2"),
        ("t_s", "t_s", "s"),
        ("t_ms", "t_ms", "ms"),
        ("dz [0.1um]", "dz", "0.1um"),
        ("note [left]", "note [left]", None),
        ("frame_t", "frame_t", None),
    ],
)
def test_header_gives_name_and_unit(
    tmp_path: Path, header: str, name: str, unit: str | None
) -> None:
    table = read_table(write(tmp_path, f"{header};k\n1;2\n3;4\n"))
    assert (table.columns[0].name, table.columns[0].unit) == (name, unit)
    assert table.column(header) is table.columns[0]


def test_units_may_stand_in_a_row_of_their_own(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "x;dz\nmm;µm\n1;2\n3;4\n"))
    assert [column.unit for column in table.columns] == ["mm", "um"]
    assert table.lines.tolist() == [3, 4]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_line_ends_and_encodings_do_not_matter(
    tmp_path: Path, end: str, encoding: str
) -> None:
    text = f"x [µm];y{end}1;2{end}{end}3;4"
    table = read_table(write(tmp_path, text.encode(encoding)))
    assert matrix(table).tolist() == [[1, 2], [3, 4]]
    assert table.columns[0].unit == "um"
    assert table.lines.tolist() == [2, 4]


def test_comments_are_listed_as_skipped_and_lines_still_count(tmp_path: Path) -> None:
    text = "# Laser 7\nx,y\n1,2\n# warm, now\n3,4\n; end\n5,6\n"
    table = read_table(write(tmp_path, text))
    assert matrix(table).tolist() == [[1, 2], [3, 4], [5, 6]]
    assert table.lines.tolist() == [3, 5, 7]
    assert [(s.line, s.reason) for s in table.skipped] == [
        (1, "comment"),
        (4, "comment"),
        (6, "comment"),
    ]


def test_long_preamble_and_comments_below_the_header_are_skipped(
    tmp_path: Path,
) -> None:
    text = "# note\n" * 600 + "x,y\n# here\n1,2\n"
    table = read_table(write(tmp_path, text))
    assert matrix(table).tolist() == [[1, 2]]
    assert len(table.skipped) == 601
    assert table.skipped[-1].line == 602


def test_header_in_a_comment_is_taken_where_it_can_only_be_one(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "# x y dz_um\n1 2 3\n4 5 6\n"))
    assert [column.name for column in table.columns] == ["x", "y", "dz_um"]
    table = read_table(write(tmp_path, "# made by John\n1 2 3\n4 5 6\n"))
    assert [column.name for column in table.columns] == ["1", "2", "3"]


def test_repeated_header_is_skipped_and_named(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "x,y\n1,2\nx,y\n3,4\n"))
    assert matrix(table).tolist() == [[1, 2], [3, 4]]
    assert [(s.line, s.reason) for s in table.skipped] == [(3, "the header line again")]


def test_lines_may_end_with_a_separator(tmp_path: Path) -> None:
    for header in ("x;y;", "x;y"):
        table = read_table(write(tmp_path, f"{header}\n1;2;\n3;4;\n"))
        assert matrix(table).tolist() == [[1, 2], [3, 4]]


def test_an_apostrophe_groups_digits_with_and_without_decimals(tmp_path: Path) -> None:
    table = read_table(
        write(tmp_path, "x [mm];e [um]\n900.5;1.5\n1'000;2.5\n1'000.5;3.5\n")
    )
    assert table.column("x").values.tolist() == [900.5, 1000.0, 1000.5]


def test_quoted_cells_and_excel_hint_are_understood(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, 'sep=,\n"x [mm]","y"\n"1,5","2"\n"3,5","4"\n'))
    assert matrix(table).tolist() == [[1.5, 2], [3.5, 4]]


def test_text_columns_stay_text(tmp_path: Path) -> None:
    table = read_table(
        write(tmp_path, "when,x\n2026/01/01 10:00,1\n2026/01/01 11:00,2\n")
    )
    assert table.column("when").text == ("2026/01/01 10:00", "2026/01/01 11:00")
    with pytest.raises(CellError, match=r"csv:2: column 'when': found '2026.*a number"):
        table.numbers(table.column("when"))


@pytest.mark.parametrize(
    "cell", ["abc", "nan", "NaN", "inf", "-Inf", "", "1.5.2", "1e999", "0x10"]
)
def test_cell_that_is_no_number_is_named_when_its_column_is_used(
    tmp_path: Path, cell: str
) -> None:
    lines = "".join(f"{i},{i}\n" for i in range(20))
    path = write(tmp_path, f"x,dz\n{lines}7,{cell}\n8,9\n")
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers(table.column("x"))[-2:], [7, 8])
    found = "an empty cell" if cell == "" else f"'{cell}'"
    with pytest.raises(CellError) as caught:
        table.numbers(table.column("dz"))
    expected = f"{path}:22: column 'dz': found {found}, expected a finite number"
    assert str(caught.value) == f"{expected} (or the job says skip = [22])"


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "found an empty file"),
        (" \n\n", "found an empty file"),
        ("# nothing\n# here\n", "found only comments"),
        ("x,y,z\n", r"found a header \(x, y, z\) and no rows"),
        ("x,y\n1,2\n3\n4,5\n", r"file.csv:3: found 1 cells.*expected 2"),
        ("x,y\n1,2\n3,4,5\n", r"file.csv:3: found 3 cells.*expected 2"),
        (
            "x,y\n1,2\n3,4\n5",
            r"file.csv:4: found 1 cells in the last line \('5'\), expected 2",
        ),
        (b"\x00\x01\x02\xff" * 50, r"file.csv:1: found binary data \(byte 0x00"),
        (b"x,y\n1,2\n3,\x07\n", r"file.csv:3: found binary data \(byte 0x07"),
        (b"PK\x03\x04rest", "found a spreadsheet"),
        (b"MATLAB 5.0 MAT-file", "found damaged MATLAB data"),
        (b'{"a": 1}', "found a JSON document"),
        (b"\x1f\x8b garbage", "found damaged gzip data"),
        (b"PAR1 garbage", "found damaged Parquet data"),
        ("Name\tscope\nStarttime of export\t1\n", "expected a line 'File'"),
    ],
)
def test_unusable_file_ends_in_one_line(
    tmp_path: Path, text: str | bytes, match: str
) -> None:
    with pytest.raises(AxcompError, match=match) as caught:
        read_table(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder_are_os_errors(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_table(tmp_path / "nothing.csv")
    with pytest.raises(IsADirectoryError):
        read_table(tmp_path)


def test_number_line_above_numbers_is_no_header(tmp_path: Path) -> None:
    path = write(tmp_path, "24 -1448819\n0.5\n-32.5\n-38\n-47\n")
    with pytest.raises(LineError, match=r":1: found '24 -1448819'.*skip = \[1\]"):
        read_table(path)


@pytest.mark.parametrize("content", [b"PK\x03\x04rest", b"<ScopeProject/>"])
def test_a_recording_of_the_scope_itself_is_to_be_exported(
    tmp_path: Path, content: bytes
) -> None:
    file = tmp_path / "trace.svdx"
    file.write_bytes(content)
    with pytest.raises(AxcompError, match=r"of TwinCAT Scope, .*export the recording"):
        read_table(file)


def test_unknown_column_names_the_nearest(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "pos,dz\n1,2\n3,4\n"))
    with pytest.raises(AxcompError, match=r"no column 'dzz'.*pos, dz.*nearest: 'dz'"):
        table.column("dzz")


def test_column_name_that_stands_for_two_is_refused(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "x [mm],x [um]\n1,2\n3,4\n"))
    with pytest.raises(AxcompError, match="found 2 columns named 'x'"):
        table.column("x")
    assert table.column("x [um]").values.tolist() == [2.0, 4.0]


def test_columns_of_the_same_name_are_numbered(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "x,x,y\n1,2,5\n3,4,6\n"))
    assert [column.name for column in table.columns] == ["x 1", "x 2", "y"]
    assert "Columns of the same name are numbered: 'x 1', 'x 2'." in table.remarks
    with pytest.raises(AxcompError, match="no column 'x', expected one of x 1, x 2"):
        table.column("x")


def test_a_table_beside_another_is_no_table_of_runs(tmp_path: Path) -> None:
    rows = "0,1,90,5\n50,2,50,6\n90,3,0,7\n"
    table = read_table(write(tmp_path, f"Soll,Abw,Soll,Abw\n{rows}"))
    assert all(column.run is None for column in table.columns)
    assert all(column.role is None for column in table.columns)


@pytest.mark.parametrize(
    "names",
    ["Abweichung,Abweichung,Abweichung,Abweichung", "Lauf 1,Lauf 2,Lauf 1,Lauf 2"],
)
def test_errors_of_the_same_name_are_runs_one_after_the_other(
    tmp_path: Path, names: str
) -> None:
    text = f"Position,{names}\n0,1,2,1,2\n50,2,3,2,3\n90,3,5,3,5\n"
    table = read_table(write(tmp_path, text))
    assert [column.run for column in table.columns] == [None, 1, 2, 3, 4]
    assert len({column.name for column in table.columns}) == 5
    assert measurement(table, axis="X").rows == 12


def test_laser_table_is_recognised_without_a_header(tmp_path: Path) -> None:
    text = "0,0.001,1,1\n100,0.002,1,1\n100,0.001,1,-1\n0,0,1,-1\n"
    table = read_table(write(tmp_path, text))
    assert table.format == "laser table"
    roles = [column.role for column in table.columns]
    assert roles == ["position", "error", "run", "direction"]
    assert "taken as target, error, run, direction" in table.remarks[0]


@pytest.mark.parametrize(
    "header", ["target,error,run,direction", "Target [mm],Error [um],Run,Direction"]
)
def test_laser_table_is_recognised_by_its_header(tmp_path: Path, header: str) -> None:
    table = read_table(write(tmp_path, f"{header}\n0,1,1,1\n100,2,1,-1\n"))
    assert table.format == "laser table"
    assert [c.role for c in table.columns] == ["position", "error", "run", "direction"]


def test_large_file_takes_the_fast_path_and_finds_the_bad_line(tmp_path: Path) -> None:
    numbers = np.random.default_rng(1).normal(size=(20_000, 3))
    lines = [",".join(f"{v:.6f}" for v in row) for row in numbers.tolist()]
    lines[12_345] = "1.0,nan,2.0"
    table = read_table(write(tmp_path, "x,y,z\n" + "\n".join(lines) + "\n"))
    # Six decimals were written.
    np.testing.assert_allclose(table.columns[2].values[:50], numbers[:50, 2], atol=6e-7)
    with pytest.raises(CellError, match=r":12347: column 'y': found 'nan'"):
        table.numbers(table.column("y"))
    lines[12_345] = "1.0,abc,2.0"
    table = read_table(write(tmp_path, "x,y,z\n" + "\n".join(lines) + "\n"))
    with pytest.raises(CellError, match=r":12347: column 'y': found 'abc'"):
        table.numbers(table.column("y"))


@pytest.mark.parametrize(
    "text",
    [
        "x,y\n1,2\n# c\n\n3,nan\n",
        "x;y\n1,5;2\n3;-\n",
        " x  who\n 1  a\n\t2\tb \n",
        "1;2;\n3;;\n",
        "+1.5, .5\n-2e3,5.\n",
        "x,y\n1,2\n-nan,inf\n",
    ],
)
def test_bulk_and_careful_path_read_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    path = write(tmp_path, text)
    fast = read_table(path)
    module = sys.modules[read_table.__module__.replace("_read", "_csv")]
    monkeypatch.setattr(module, "_read_fast", lambda layout, text: None)
    slow = read_table(path)
    np.testing.assert_array_equal(matrix(fast), matrix(slow))
    for mine, other in zip(fast.columns, slow.columns, strict=True):
        assert (mine.name, mine.text, mine.bad) == (other.name, other.text, other.bad)
    assert fast.lines.tolist() == slow.lines.tolist()
    assert fast.skipped == slow.skipped


numbers = st.floats(-1e6, 1e6).map(lambda v: round(v, 6))


@pytest.mark.parametrize("end", ["", "\n"])
def test_an_empty_last_cell_is_a_cell_that_holds_no_number(
    tmp_path: Path, end: str
) -> None:
    path = write(tmp_path, f"x,e\n1,2\n2,3\n3,{end}")
    error = read_table(path).columns[1]
    np.testing.assert_array_equal(error.values, [2.0, 3.0, np.nan])
    assert error.bad is not None
    assert error.bad.line == 4


@pytest.mark.parametrize("code", range(32))
def test_control_characters_are_no_text(tmp_path: Path, code: int) -> None:
    path = write(tmp_path, b"x,e\n1,2\n" + bytes([code]) + b"\n2,3\n")
    if chr(code) in "\t\n\f\r":
        assert read_table(path).rows == 2
        return
    with pytest.raises(AxcompError, match=rf"3: found binary data \(byte 0x{code:02X}"):
        read_table(path)


@settings(max_examples=60, deadline=None)
@given(
    rows=st.lists(st.tuples(numbers, numbers), min_size=2, max_size=8),
    separator=st.sampled_from([",", ";", "\t", "  "]),
    comment=st.booleans(),
)
def test_numbers_written_are_numbers_read(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[float, float]],
    separator: str,
    comment: bool,
) -> None:
    lines = [f"{a!r}{separator}{b!r}" for a, b in rows]
    if comment:
        lines.insert(1, "# a remark")
    path = write(
        tmp_path_factory.mktemp("csv"), "a" + separator + "b\n" + "\n".join(lines)
    )
    assert matrix(read_table(path)).tolist() == [list(row) for row in rows]


@settings(max_examples=150, deadline=None)
@given(raw=st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
@example(raw=b'\xb2\n"')  # a digit that is no number
def test_any_bytes_give_a_table_or_one_clear_line(
    tmp_path_factory: pytest.TempPathFactory, raw: bytes
) -> None:
    path = write(tmp_path_factory.mktemp("any"), raw)
    try:
        table = read_table(path)
    except AxcompError as error:
        rows, message = 1, str(error)
    else:
        rows, message = table.lines.size, table.format
    assert rows > 0
    assert message


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("cells", ["1.5,-2e-3", "+.5,7.", "1,nan", "1,", "1e999,2"])
def test_a_short_table_reads_as_a_long_one(
    tmp_path: Path, separator: str, cells: str
) -> None:
    rows = ["a,b", "0.1,1e5", cells, "", "3,-4"]
    short = "\n".join(rows).replace(",", separator) + "\n"
    more = 8_000 * f"2.5{separator}-1.25\n"
    one, other = (
        read_table(write(tmp_path, text, name))
        for name, text in (("one", short), ("other", short + more))
    )
    for few, many in zip(one.columns, other.columns, strict=True):
        assert (few.name, few.bad) == (many.name, many.bad)
        np.testing.assert_array_equal(few.values, many.values[: one.rows])
    assert np.array_equal(one.lines, other.lines[: one.rows])

"""Header and body of text tables: one look at plain ones finds what all lines tell."""

from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from axcomp.data.measurements import LineError, open_large, read_table
from axcomp.data.measurements._layout import (
    _layout_by_lines,
    _plain_layout,
    find_layout,
)
from axcomp.data.measurements._table import BadCell

FILE = Path("file.csv")
ROWS = ["0.0100,1.5e-3,-7", "+.5,2.,1E6", "-0,0.25,12"]

HEADER_CELLS = st.sampled_from(
    [
        *(
            "x",
            "t",
            "X.position [mm]",
            "dz_um",
            " i ",
            "a b",
            "p\tq",
            "x;y",
            "#x",
            "; x",
        ),
        *(
            "mm",
            "s",
            "1",
            "2.5",
            "",
            " ",
            "nan",
            '"x"',
            "sep=",
            "t / s",
            "%",
            "//",
            "!",
        ),
    ]
)
CELLS = st.sampled_from(["0", "-1.5", "+.25", "3.", "1e-3", "7E+20", "9" * 40])
ODD_LINES = st.sampled_from(
    [
        *("", " ", "# 1,2", ";1,2", "x,y", "nan,1", "1;2", "1\t2", '"1,5","2"', "1,"),
        *(",1", "1 2", "mm,mm", "[mm],[s]", "sep=,", "1,2,3,4,5", "9" * 41 + ",1"),
        "1e,2",
    ]
)


@st.composite
def texts(draw: st.DrawFn) -> str:
    """Tables of some columns, most of them plain, of a few or some hundred rows."""
    width = draw(st.integers(1, 4))
    header = draw(st.lists(HEADER_CELLS, min_size=width, max_size=width))
    row = st.lists(CELLS, min_size=width, max_size=width).map(",".join)
    lines = draw(st.lists(row, max_size=5)) * draw(st.sampled_from([1, 1, 45, 90]))
    if draw(st.booleans()):
        lines.insert(draw(st.integers(0, len(lines))), draw(ODD_LINES))
    top = [",".join(header)] if draw(st.integers(0, 4)) else []
    return "\n".join([*top, *lines]) + draw(st.sampled_from(["", "\n", "\n\n"]))


@settings(max_examples=400)
@given(text=texts())
def test_one_look_finds_what_all_lines_tell(text: str) -> None:
    plain = _plain_layout(text)
    assert plain is None or plain == _layout_by_lines(FILE, text)


@pytest.mark.parametrize("count", [2, 199, 200, 201, 1000])
@pytest.mark.parametrize("end", ["", "\n"])
@pytest.mark.parametrize("header", ["t,x,i", "t [s], X.position [mm] ,dz_um"])
def test_one_look_is_enough_for_a_plain_table(
    count: int, end: str, header: str
) -> None:
    text = "\n".join([header, *(ROWS * count)[:count]]) + end
    assert _plain_layout(text) == _layout_by_lines(FILE, text)


def test_a_plain_first_piece_says_nothing_of_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("t,x\n" + "1,2\n" * 30 + "3,x\n" + "5,6\n" * 9)
    monkeypatch.setattr("axcomp.data.measurements._large._BLOCK", 64)
    large = open_large(path, 0)
    assert large is not None
    (part,) = large.parts(["t", "x"], 1, 1000)
    bad = [column.bad for piece in part.tables() for column in piece.columns]
    assert [cell for cell in bad if cell is not None] == [BadCell(32, "x")]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "t,x,i",
        "t,x,i\n1,2,3",
        "x\n1\n2\n",
        "t,x,i" + "y" * 20_000 + "\n1,2,3\n4,5,6\n",
        "\n1,2\n3,4\n",
        "t,x\n1,2\n3,\n",
        "t,x\n1,2\n\n3,4\n",
        "t,x\n1,2\n3,4,\n",
        "t,x\nmm,mm\n1,2\n3,4\n",
        "t,x,\n1,2\n3,4\n",
        '"t,x",y\n1,2\n3,4\n',
        "1,2\n3,4\n5,6\n",
        "# t,x\n1,2\n3,4\n",
        "sep=,\n1,2\n3,4\n",
        "t;x\n1,5;2,5\n3,5;4,5\n",
    ],
)
def test_what_is_not_plain_is_read_line_by_line(text: str) -> None:
    assert _plain_layout(text) is None


def test_an_odd_line_far_below_changes_nothing_of_the_layout() -> None:
    text = "t,x,i\n" + "\n".join(ROWS * 70 + ['"a";b\tc', "# end"])
    assert find_layout(FILE, text) == _layout_by_lines(FILE, text)


def test_a_line_of_units_may_hold_some_that_the_library_lacks(tmp_path: Path) -> None:
    path = tmp_path / "six.csv"
    path.write_text(
        "Position,Linear,Pitch,Air\nmm,um,arcsec,hPa\n0,0,1,990\n9,1,2,991\n"
    )
    units = [column.unit for column in read_table(path).columns]
    assert units == ["mm", "um", "arcsec", "hPa"]


def test_a_line_of_units_that_contradicts_the_names_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_text("Target [mm];Error [mm]\nmm;um\n0;1\n50;2\n100;3\n")
    with pytest.raises(LineError, match=r":2: found the unit um below 'Error \[mm\]'"):
        read_table(path)
    path.write_text("Target [mm];Error [µm]\nmm;um\n0;1\n50;2\n100;3\n")
    assert [column.unit for column in read_table(path).columns] == ["mm", "um"]


def test_rows_between_other_separators_are_no_titles(tmp_path: Path) -> None:
    rows = [f"{k}.5, 0.{k}" for k in range(9)]
    again = [row.replace(", ", "\t") for row in ["x [mm], dx [um]", *rows]]
    text = "\n".join(["x [mm], dx [um]", *rows[:4], *again])
    path = tmp_path / "half.csv"
    path.write_text(text)
    with pytest.raises(
        LineError, match=r"half.csv:2: found '0.5, 0.0', expected 2 cells"
    ):
        read_table(path)


@pytest.mark.parametrize(
    "header", ["target error run", "target error run dir note", "target run dir"]
)
def test_a_name_too_few_or_too_many_between_blanks_is_told(
    tmp_path: Path, header: str
) -> None:
    path = tmp_path / "table.txt"
    path.write_text(f"{header}\n" + "".join(f"{k}.5 0.1 1 -1\n" for k in range(9)))
    with pytest.raises(LineError, match=r"table.txt:1: found \d names .* expected 4"):
        read_table(path)


def test_a_table_of_markdown_is_a_table(tmp_path: Path) -> None:
    path = tmp_path / "table.md"
    path.write_text("| x [mm] | dx [um] |\n|---|---|\n| 0 | 1.5 |\n| 10 | 2.5 |\n")
    roles = [
        (column.role, column.values.tolist()) for column in read_table(path).columns
    ]
    assert roles == [("X.position", [0.0, 10.0]), ("X.error", [1.5, 2.5])]


@pytest.mark.parametrize("rows", ["0;1\n", "0,5;1,25\n"])
def test_a_number_that_was_cut_off_at_its_decimal_mark_is_refused(
    tmp_path: Path, rows: str
) -> None:
    file = tmp_path / "cut.csv"
    file.write_text("Soll [mm];Abweichung [um]\n" + 5 * "0,5;1,2\n" + rows + "350;7,")
    with pytest.raises(
        LineError, match=r":8: found '350;7,' in the last line.*cut off"
    ):
        read_table(file)
    file.write_text("x,dx\n" + 5 * "1.,2.\n" + "350.,7.")  # written so throughout
    assert read_table(file).rows == 6
    file.write_text("x,dx\n" + 5 * "1.5,2.5\n" + "End of measurement.")
    assert read_table(file).rows == 5


BLOCK = "0;1\n50;2\n100;3\n"


def two_blocks(folder: Path, first: str, second: str) -> Path:
    file = folder / "blocks.csv"
    file.write_text(f"{first}\n{BLOCK}{second}\n{BLOCK}")
    return file


@pytest.mark.parametrize(
    ("first", "second", "found"),
    [
        (
            "Soll [mm];Abweichung [um]",
            "Soll [mm];Abweichung [mm]",
            "header of other units",
        ),
        ("Soll;Abweichung\nmm;um", "mm;mm", "line of other units"),
        ("X [mm];dX [um]", "Y [mm];dY [um]", "header of other columns"),
        ("Achse: X\nSoll [mm];Abweichung [um]", "Achse: Y", "title of axis Y"),
    ],
)
def test_a_second_block_of_another_unit_or_axis_is_refused_and_cannot_be_skipped(
    tmp_path: Path, first: str, second: str, found: str
) -> None:
    with pytest.raises(LineError, match=f"between rows, a {found}") as refused:
        read_table(two_blocks(tmp_path, first, second))
    assert "split the file there" in str(refused.value)
    assert "skip" not in str(refused.value)


@pytest.mark.parametrize("second", ["Soll (mm);Abweichung (um)", "Soll;Abweichung"])
def test_a_second_header_of_the_same_units_is_left_out(
    tmp_path: Path, second: str
) -> None:
    table = read_table(two_blocks(tmp_path, "Soll [mm];Abweichung [um]", second))
    assert table.rows == 6
    assert [item.reason for item in table.skipped] == ["the header line again"]


def test_units_behind_the_numbers_of_cells_are_named(tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_text("Soll;Abw.\n0,000 mm;-0,08 µm\n50,000 mm;1,2 µm\n")
    expected = r":2: found '0,000 mm', a number with its unit, expected numbers alone"
    with pytest.raises(LineError, match=expected):
        read_table(path)


@pytest.mark.parametrize(
    "foot",
    ["Mittelwert;;9\nUmkehrspanne B;8,0", "A;29,1;um\nR;2,3;um", "T Anfang;20,1;C"],
)
def test_statistics_in_a_block_below_the_rows_are_none(
    tmp_path: Path, foot: str
) -> None:
    path = tmp_path / "file.csv"
    rows = "".join(f"{10 * k},0;{k},5;{k},1\n" for k in range(5))
    path.write_text(f"Soll;Lauf 1;Lauf 2\n{rows}\n{foot}\n")
    assert read_table(path).rows == 5


@pytest.mark.parametrize("separator", [";", ",", "\t"])
def test_rows_of_a_spreadsheet_without_any_cell_are_blank_lines(
    tmp_path: Path, separator: str
) -> None:
    empty = f"{separator}{separator}\n"
    rows = [separator.join(map(str, (k, 0.5 * k, 1))) + "\n" for k in range(6)]
    head = separator.join(("x [mm]", "error [um]", "run")) + "\n"
    text = head + "".join(rows[:3]) + empty + "".join(rows[3:]) + 2 * empty
    (tmp_path / "m.csv").write_text(text)
    found = read_table(tmp_path / "m.csv")
    assert found.rows == 6
    assert found.lines.tolist() == [2, 3, 4, 6, 7, 8]

"""Rows of plain numbers in machine code: the bits of `float`, and nothing else taken."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.io import savemat

from axcomp.data.errors import AxcompError
from axcomp.data.measurements import Table, read_table
from axcomp.ident.readings._plain_rows import _POWERS, _fill, plain_rows

NUMBERS = st.one_of(
    st.from_regex(r"\A[+-]?[0-9]{1,8}(\.[0-9]{0,7})?\Z"),
    st.from_regex(r"\A-?0{0,5}\.0{0,6}[0-9]{1,9}\Z"),
    st.sampled_from(
        ["0", "-0", "-0.0", "+.5", "5.", "9007199254740980", "0.1234567890123456"]
    ),
)


def rows_of(text: str, width: int) -> Any:
    return plain_rows(text.encode(), 0, width)


@settings(max_examples=150)
@given(cells=st.lists(NUMBERS, min_size=6, max_size=6), end=st.sampled_from(["", "\n"]))
def test_numbers_are_those_of_float(cells: list[str], end: str) -> None:
    text = "\n".join(",".join(cells[k : k + 2]) for k in (0, 2, 4)) + end
    found = rows_of(text, 2)
    wanted = np.array(list(map(float, cells))).reshape(3, 2).T.copy()
    assert found is not None
    assert found.tobytes() == wanted.tobytes()  # also the sign of zero


@pytest.mark.parametrize(
    "text",
    [
        *("", "\n", "1", "1,", ",1", "1,2,3", "1,2,", "1,2\n\n", "\n1,2", "1,2\n3\n"),
        *("1,x", "1e3,2", "1,2\r\n", " 1,2", "1,2 ", "1,-", "1,.", "1,+-2", "1,1.2.3"),
        *("1,nan", "1,inf", '"1",2', "1;2", "1,2\n# end", "1,2\n3,4\n5", "1,2\x00"),
        *("90071992547409919,1", "1,0.12345678901234567", "1,0." + "0" * 25 + "1"),
    ],
)
def test_all_else_is_left_to_the_careful_reader(text: str) -> None:
    assert rows_of(text, 2) is None


@pytest.mark.parametrize("text", ["1,2\n3,4", "1,2\n", "-", "1,", "1,2\n3", "1.", ""])
def test_no_cell_behind_the_end_is_looked_at(text: str) -> None:
    # As Python has it, where an index beyond the end is an error.
    cells = np.frombuffer(text.encode(), np.uint8)
    values = np.empty((2, text.count("\n") + (not text.endswith("\n"))))
    found = rows_of(text, 2)
    assert _fill(cells, _POWERS, values) == (found is not None)


def shown(table: Table) -> object:
    columns = [
        (dataclasses.replace(column, values=np.empty(0)).__dict__ | {"values": None})
        for column in table.columns
    ]
    values = [column.values.tobytes() for column in table.columns]
    lines = table.lines.tolist()
    return (
        table.format,
        table.rows,
        lines,
        table.skipped,
        table.remarks,
        columns,
        values,
    )


BODY = "".join(f"{k / 100:.7f},{k * k / 7:.6f},{-k}\n" for k in range(1, 3000))


@pytest.mark.parametrize(
    "text",
    [
        "t,x,i\n" + BODY,
        "t [s], X.position [mm] ,X.current [A]\n" + BODY.rstrip("\n"),
        "target,error,run\n" + BODY,
        "t,x,i\n" + BODY + "1,2,x\n",
        "t,x,i\n" + BODY + "1,2\n",
        "t,x,i\n" + BODY + "\n# end\n",
        "t,x,i\n" + BODY.replace("\n", "\r\n"),
        "# log\nt,x,i\n" + BODY,
        "t,x,i\ns,mm,A\n" + BODY,
        "t,x,i,\n" + BODY.replace("\n", ",\n"),
        "t;x;i\n" + BODY.replace(",", ";"),
        "t,x\n" + BODY,
        BODY,
        "\ufefft,\u00b5,i\n" + BODY,
        "[bed_mesh default]\n" + BODY,
        "t,x,i\n" + BODY + "1e5,2,3\n",
    ],
)
def test_a_file_says_the_same_whoever_reads_its_rows(text: str, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_bytes(text.encode())

    def read(**how: Any) -> object:
        try:
            return shown(read_table(path, **how))
        except AxcompError as error:
            return str(error)

    assert read(plain_rows=plain_rows) == read()


def test_rows_of_a_recording_are_read_by_machine_code(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("t,x,i\n" + BODY)
    asked: list[int] = []

    def watched(raw: bytes, start: int, width: int) -> Any:
        asked.append(width)
        return plain_rows(raw, start, width)

    read_table(path, plain_rows=watched)
    assert asked == [3]


def test_a_matlab_file_is_read_as_one_where_rows_are_read_fast(tmp_path: Path) -> None:
    path = tmp_path / "trace.mat"
    clock = np.arange(20_000.0)
    savemat(path, {"t": clock, "i": np.sin(clock)})
    table = read_table(path, plain_rows=plain_rows)
    assert table.format == "MATLAB"
    assert table.rows == clock.size

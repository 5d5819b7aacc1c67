"""Instants given as date and time, and readings that were missed."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    CellError,
    ColumnSpec,
    Measurement,
    measurement,
    problems_of,
    read_table,
)


def read(folder: Path, text: str) -> Measurement:
    path = folder / "log.csv"
    path.write_text(text)
    columns = {"time": ColumnSpec("t"), "temperature.frame": ColumnSpec("warm")}
    return measurement(read_table(path), columns)


@pytest.mark.parametrize(
    "dates",
    [
        ("2021/06/05-13:24:41", "2021/06/05-13:24:45.5", "2021/06/06-13:24:41"),
        ("2026-11-21T23:59:58", "2026-11-22 00:00:02.5", "2026-11-22T23:59:58"),
        ("21.11.2026 08:00:00", "21.11.2026 08:00:04.500", "22.11.2026 08:00:00"),
    ],
)
def test_dates_become_seconds_since_the_first_row(
    tmp_path: Path, dates: tuple[str, ...]
) -> None:
    rows = "\n".join(f"{date},20.5" for date in dates)
    found = read(tmp_path, f"t,warm\n{rows}\n").require("time")
    np.testing.assert_array_equal(found, [0.0, 4.5, 86400.0])


def test_what_is_no_date_is_named_with_its_line(tmp_path: Path) -> None:
    text = "t,warm\n2026-11-21 08:00:00,20\n03/04/2026 08:00,21\n"
    with pytest.raises(CellError, match=r"log.csv:3: column 't': found '03/04/2026"):
        read(tmp_path, text).require("time")


def test_missed_readings_raise_unless_gaps_are_asked_for(tmp_path: Path) -> None:
    found = read(tmp_path, "t,warm\n0,20\n1,\n2,22\n")
    with pytest.raises(CellError, match="expected a finite number"):
        found.require("temperature.frame")
    gaps = found.with_gaps().require("temperature.frame")
    np.testing.assert_array_equal(gaps, [20.0, np.nan, 22.0])


def problems(folder: Path, text: str) -> list[str]:
    path = folder / "log.csv"
    path.write_text(text)
    return [str(each) for each in problems_of(read_table(path))]


def test_rows_that_are_written_again_further_down_are_told(tmp_path: Path) -> None:
    rows = [
        f"{r},{s},{x},{x / 7 + r + s:.3f}"
        for r in (1, 2)
        for s in (1, -1)
        for x in range(9)
    ]
    text = "\n".join(["run,direction,target,error", *rows, *rows[4:7]]) + "\n"
    (problem,) = problems(tmp_path, text)
    assert "log.csv:38: column 'target': found '4', expected another reading" in problem
    assert "than in line 6, which it repeats (or the job says skip = [38])" in problem


def test_a_clock_that_goes_back_is_told(tmp_path: Path) -> None:
    stamps = [*range(10, 40), *range(37, 50)]
    text = "time,T1 [degC]\n" + "".join(f"2026-11-20 10:{m}:00,{m}\n" for m in stamps)
    (problem,) = problems(tmp_path, text)
    assert "log.csv:32: column 'time': found '2026-11-20 10:37:00'" in problem


def test_a_line_that_is_damaged_in_several_cells_is_told_once(tmp_path: Path) -> None:
    text = "target,error\n" + "".join(f"{k},{k}\n" for k in range(20)) + "x,y\n1,2\n"
    assert len(problems(tmp_path, text)) == 1


def test_a_direction_that_was_cut_off_is_told(tmp_path: Path) -> None:
    text = "target,error,direction\n" + "".join(f"{k},1,up\n" for k in range(9))
    (problem,) = problems(tmp_path, text + "9,1,u\n")
    assert "column 'direction': found 'u', expected +1 or -1" in problem

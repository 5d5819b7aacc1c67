"""Instants given as date and time, and readings that were missed."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    CellError,
    ColumnSpec,
    Measurement,
    measurement,
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

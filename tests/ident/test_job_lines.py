"""Keys of a job that say which lines and columns of a file count, and constant ones."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    Measurement,
    MeasurementError,
    measurement,
    read_table,
)
from axcomp.ident.job import JobError, load_job
from axcomp.ident.readings import Tables

JOB = """
[axes.X]
number = 1
[measurements.laser]
file = "laser.csv"
active = []
{keys}
[measurements.laser.columns]
"X.position" = {{ column = "place", unit = "mm" }}
{columns}
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
start = 0.0
interval = 100.0
points = 3
"""
WIDE = """"X.error" = [
  {{ column = "a", unit = "um", run = 1, direction = 1 }},
  {{ column = "b", unit = "um", run = 1, direction = -1 }},
  {{ column = "c", unit = "um", run = 2, direction = 1 }},
]""".replace("{{", "{").replace("}}", "}")
ROWS = "place,a,b,c\n0,1,2,3\n100,4,5,6\n200,7,8,9\n"


def measured(folder: Path, text: str, columns: str, keys: str = "") -> Measurement:
    (folder / "laser.csv").write_text(text)
    path = folder / "job.toml"
    path.write_text(JOB.format(columns=columns, keys=keys))
    job = load_job(path)
    fit = job.spec.fits[0]
    return Tables(job).measured("laser", fit.axis)


def test_columns_per_run_and_direction_become_one_reading_per_row(
    tmp_path: Path,
) -> None:
    found = measured(tmp_path, ROWS, WIDE)
    places = [0, 100, 200, 200, 100, 0, 0, 100, 200]
    assert found.require("X.position").tolist() == places
    errors = np.array([1, 4, 7, 8, 5, 2, 3, 6, 9]) / 1000.0
    np.testing.assert_array_equal(found.require("X.error"), errors)
    assert found.require("run").tolist() == [1] * 6 + [2] * 3
    assert found.require("X.direction").tolist() == [1] * 3 + [-1] * 3 + [1] * 3
    assert found.lines.tolist() == [2, 3, 4, 4, 3, 2, 2, 3, 4]


def test_an_empty_cell_of_a_run_is_no_reading(tmp_path: Path) -> None:
    found = measured(tmp_path, ROWS.replace("5,6", ",6"), WIDE)
    assert found.rows == 8
    assert "1 empty cells of X.error hold no reading." in found.remarks


BOTH_WAYS = """Lauf;Soll [mm];hin [um];rück [um]
3;0;1;6
3;100;2;5
3;200;3;4
4;0;7;12
4;100;8;11
4;200;9;
"""


def test_columns_per_direction_have_their_runs_in_a_column(tmp_path: Path) -> None:
    path = tmp_path / "laser.csv"
    path.write_text(BOTH_WAYS, encoding="utf-8")
    table = read_table(path)
    assert "2 runs as 'Lauf' says, both directions" in table.remarks[0]
    found = measurement(table, axis="X")
    # One run after the other, each there and back.
    errors = 1000.0 * found.require("X.error")
    np.testing.assert_allclose(errors, [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12])
    assert found.require("run").tolist() == [3] * 6 + [4] * 5
    assert (
        found.require("X.direction").tolist() == [1] * 3 + [-1] * 3 + [1] * 3 + [-1] * 2
    )


@pytest.mark.parametrize("listed", [1, -1])
def test_a_column_that_counts_the_rows_is_no_run(tmp_path: Path, listed: int) -> None:
    rows = [f"{k + 1};{20 * listed * k};{k};{k + 5}" for k in range(6)]
    path = tmp_path / "laser.csv"
    head = "Lauf;Soll [mm];hin [um];rück [um]"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    found = measurement(read_table(path), axis="X")
    assert set(found.require("run").tolist()) == {1}


def test_one_value_stands_for_all_rows(tmp_path: Path) -> None:
    columns = '"X.error" = "a"\n"X.direction" = { value = -1 }\nrun = { value = 4 }'
    found = measured(tmp_path, ROWS, columns)
    assert found.require("X.direction").tolist() == [-1, -1, -1]
    assert found.require("run").tolist() == [4, 4, 4]


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        (f"1,2,3,4\n5,6,7,8\n{ROWS}", "skip = 2"),
        (ROWS.replace("200,", "150,1\n200,"), "skip = [4]"),
        (f"alpha,beta,c,d\n{ROWS}", "header = 2"),
        (f"{ROWS}300,9,9,9\n", "rows = [2, 4]"),
        (f"x\n\n{ROWS}\nsum\n", "header = [3]\nrows = [4, 6]"),
    ],
)
def test_keys_say_which_lines_count(tmp_path: Path, text: str, keys: str) -> None:
    found = measured(tmp_path, text, '"X.error" = { column = "c", unit = "um" }', keys)
    assert found.require("X.position").tolist() == [0, 100, 200]
    assert found.require("X.error").tolist() == [0.003, 0.006, 0.009]


def test_header_may_be_said_to_be_missing(tmp_path: Path) -> None:
    path = tmp_path / "job.toml"
    path.write_text(
        JOB.format(columns='"X.error" = "2"', keys="header = []").replace("place", "1")
    )
    (tmp_path / "laser.csv").write_text("a,b,c\n0,1\n100,2\n200,3\n")
    job = load_job(path)
    fit = job.spec.fits[0]
    found = Tables(job).measured("laser", fit.axis)
    assert found.require("X.error").tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("columns", "keys", "match"),
    [
        ('"X.error" = {}', "", "found neither, expected one of column and value"),
        ('"X.error" = { column = "a", value = 1 }', "", "found both"),
        ('"X.error" = []', "", "expected"),
        (
            '"X.error" = [{ column = "a", run = 1 }, { column = "b" }]',
            "",
            "found run in 1 of 2 columns",
        ),
        ('"X.error" = [{ column = "a", rnu = 1 }]', "", "unknown key .*'run'"),
        ('"X.error" = [{ column = "a", direction = 2 }]', "", "found 2, expected 1"),
        ('"X.error" = "a"', "rows = [4, 2]", "expected first ≤ last"),
        ('"X.error" = "a"', "skip = -1", "greater than or equal to 0"),
        ('"X.error" = "a"', 'header = "top"', "found 'top', expected"),
    ],
)
def test_what_the_keys_cannot_mean_is_refused_with_its_line(
    tmp_path: Path, columns: str, keys: str, match: str
) -> None:
    with pytest.raises(JobError, match=match) as caught:
        measured(tmp_path, ROWS, columns, keys)
    assert "job.toml:" in str(caught.value)


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        (f'{WIDE}\nrun = "c"', "found run as a column and beside each column"),
        (WIDE.replace('"um", run = 2', '"mm", run = 2'), "units mm, um, expected one"),
        (WIDE.replace('"b"', '"bb"'), "no column 'bb'"),
    ],
)
def test_columns_that_do_not_fit_together_are_named(
    tmp_path: Path, columns: str, match: str
) -> None:
    with pytest.raises(MeasurementError, match=match):
        measured(tmp_path, ROWS, columns)


def test_the_keys_in_the_documentation_are_those_of_a_job(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "instrument-files.md"
    block = page.read_text(encoding="utf-8").split("```toml")[1].split("```")[0]
    (tmp_path / "laser.csv").write_text(ROWS)
    path = tmp_path / "job.toml"
    fit = JOB.partition("[[fits]]")[2]
    path.write_text(f"[axes.X]\nnumber = 1\n{block}\n[[fits]]{fit}", encoding="utf-8")
    spec = load_job(path).spec.measurements["laser"]
    assert (spec.skip, spec.header, spec.rows) == (3, [5, 6], [8, 28])
    assert set(spec.columns) == {"X.position", "X.error"}

"""The command ``axcomp read``."""

import json
from pathlib import Path

import pytest

from axcomp.ident.cli import main


def put(folder: Path, text: str, name: str = "probe.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_read_prints_json_for_machines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = put(tmp_path, "# probe\nX.position [mm],dz [um],who\n1,2,me\n3,4,you\n")
    assert main(["read", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "CSV"
    assert found["columns"] == [
        {"name": "X.position", "role": "X.position", "unit": "mm"},
        {"name": "dz", "role": None, "unit": "um"},
        {"name": "who", "role": None, "unit": None},
    ]
    assert (found["rows"], found["first"], found["last"]) == (
        2,
        [1, 2, "me"],
        [3, 4, "you"],
    )
    assert found["skipped"] == [{"line": 1, "reason": "comment"}]


def test_read_tells_people_on_standard_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = put(tmp_path, "target,error,run,direction\n0,0.001,1,1\n10,0.002,1,-1\n")
    assert main(["read", str(path)]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert "laser table, 2 rows" in shown.out
    assert "<axis>.position" in shown.out
    assert "Nothing was skipped." in shown.out


@pytest.mark.parametrize("cell", ["abc", "nan", "inf"])
def test_read_fails_for_a_cell_that_is_no_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], cell: str
) -> None:
    path = put(tmp_path, f"x,dz\n1,2\n2,3\n3,{cell}\n")
    assert main(["read", str(path), "--json"]) == 1
    shown = capsys.readouterr()
    problems = json.loads(shown.out)["problems"]
    assert problems == [
        {"line": 4, "column": "dz", "found": cell, "expected": "a finite number"}
    ]
    assert f"{path}:4: column 'dz': found '{cell}'" in shown.err


@pytest.mark.parametrize(
    ("text", "match"),
    [("", "found an empty file"), ("x,y\n1,2\n3\n4,5\n", "probe.csv:3: found 1 cells")],
)
def test_read_ends_in_one_line_for_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, match: str
) -> None:
    assert main(["read", str(put(tmp_path, text))]) == 1
    shown = capsys.readouterr()
    assert match in shown.err
    assert shown.err.count("\n") == 1


def test_read_names_a_missing_file_and_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["read", str(tmp_path / "nothing.csv")]) == 1
    assert "nothing.csv: No such file" in capsys.readouterr().err
    assert main(["read", str(tmp_path)]) == 1
    assert "is a folder, expected a file" in capsys.readouterr().err


def test_read_without_a_file_is_bad_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["read"]) == 2
    assert "FILE" in capsys.readouterr().err


GERMAN = """Laser SIOS;;;
Achse: X;;;
Soll;Lauf 1;;
;vorwärts;rückwärts;
mm;µm;µm;
0,000;1,5;2,5;
100,000;3,5;4,5;
200,000;5,5;6,5;
"""


def test_read_says_how_a_table_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = put(tmp_path, GERMAN)
    assert main(["read", str(path)]) == 0
    said = capsys.readouterr().out
    assert "Cells separated by semicolons, decimal comma" in said
    assert "header in line 3, 4, units in line 5, titles in line 1, 2" in said
    assert "<axis>.error, run 1 -" in said
    assert "Line 2 says that the axis is X." in said
    assert main(["read", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["form"]["decimal"], found["axis"]) == (",", "X")
    assert found["columns"][2] == {
        "name": "Lauf 1 rückwärts",
        "role": "error",
        "unit": "um",
        "run": 1,
        "direction": -1,
    }


def test_read_takes_the_keys_of_a_job_as_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = put(tmp_path, "1 2\nalpha,beta\nx,dz\n1,2\n3\n5,6\n7,8\n")
    given = ["--skip", "[5]", "--header", "3", "--rows", "4", "6", "--json"]
    assert main(["read", str(path), *given]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [column["name"] for column in found["columns"]] == ["x", "dz"]
    assert (found["rows"], found["last"]) == (2, [5, 6])
    assert main(["read", str(path), "--skip", "some"]) == 2
    assert "expected a number such as 3" in capsys.readouterr().err


def test_read_fails_for_a_time_that_stands_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{0.1 * k:.1f},{k}\n" for k in (0, 1, 2, 2, 3, 4))
    path = put(tmp_path, f"time,X.position\n{rows}")
    assert main(["read", str(path)]) == 1
    assert "5: column 'time': found '0.2', expected a later" in capsys.readouterr().err

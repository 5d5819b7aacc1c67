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


def test_read_tells_people_on_standard_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = put(tmp_path, "target,error,run,direction\n0,0.001,1,1\n10,0.002,1,-1\n")
    assert main(["read", str(path)]) == 0
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "laser table, 2 rows" in shown.err
    assert "<axis>.position" in shown.err
    assert "Nothing was skipped." in shown.err


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
    assert "Is a directory" in capsys.readouterr().err


def test_read_without_a_file_is_bad_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["read"]) == 2
    assert "FILE" in capsys.readouterr().err

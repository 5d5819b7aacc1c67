"""`axcomp read` on recordings: TwinCAT Scope exports and MATLAB files."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from axcomp.ident.cli import main

SCOPE = """Name\ttrace
File\tC:\\trace.csv
Starttime of export\t132959733843760000\tMontag\t15:56
Endtime of export\t132959733843780000\tMontag\t15:56

Name\tpos\tName\ti
SampleTime[ms]\t1\tSampleTime[ms]\t0,5
Unit\tmm (Length)\tUnit\tA (Current)

0\t1,5\t0\t-2,5
1\t2,5\t0,5\t-3
2\t3,5\t1\t-4
 \t \t1,5\t-5
 \t \t2\t-6
"""


def test_scope_export_shows_samples_and_sample_time_of_each_channel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(SCOPE, encoding="utf-8")
    assert main(["read", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "TwinCAT Scope"
    assert found["rows"] == 5
    assert found["columns"] == [
        {"name": "time", "role": "time", "unit": "ms"},
        {
            "name": "pos",
            "role": None,
            "unit": "mm",
            "samples": 3,
            "sample_time": 0.001,
        },
        {"name": "i", "role": None, "unit": "A", "samples": 5, "sample_time": 0.0005},
    ]
    assert found["first"] == [0.0, 1.5, -2.5]
    assert found["last"] == [2.0, 3.5, -6.0]
    main(["read", str(path)])
    assert "0.5 ms" in capsys.readouterr().out


def test_scalars_of_a_matlab_file_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trace.mat"
    savemat(path, {"t": np.arange(5.0), "kp": 160.18})
    assert main(["read", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["scalars"] == [{"name": "kp", "value": 160.18}]
    main(["read", str(path)])
    assert "scalar kp = 160.18" in capsys.readouterr().out


def test_damaged_export_ends_in_one_line_and_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(SCOPE.replace("3,5", "3;5"), encoding="utf-8")
    assert main(["read", str(path)]) == 1
    wanted = f"{path}:12: column 'pos': found '3;5', expected a number"
    assert wanted in capsys.readouterr().err

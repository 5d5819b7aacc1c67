"""`axcomp simulate`: offsets of a motion as CSV, and one line for bad input."""

import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.cli import main

PLANE = (
    "kopf.achs_nr 3\nkopf.log_achs_name Z\nkw.crosscomp2.unit 1\n"
    "kw.crosscomp2.interval 100000\n"
    "kw.crosscomp2.last_index_master1 1\nkw.crosscomp2.last_index_master2 1\n"
    "kw.crosscomp2.start_position_master1 0\nkw.crosscomp2.start_position_master2 0\n"
    "kw.crosscomp2.master1_ax_nr 1\nkw.crosscomp2.master2_ax_nr 2\n"
    "kw.crosscomp2.table[0][0].correction 0\nkw.crosscomp2.table[0][1].correction 100\n"
    "kw.crosscomp2.table[1][0].correction 20\n"
    "kw.crosscomp2.table[1][1].correction 120\n"
)
MOTION = (
    "time,A1.position,A2.position,A3.position\n0,0,0,5\n0.001,5,0,5\n0.002,5,10,5\n"
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "achskw3.lis").write_text(PLANE)
    (tmp_path / "m.csv").write_text(MOTION)
    return tmp_path


def test_offsets_go_into_the_columns_of_the_interface(folder: Path) -> None:
    assert main(["simulate", "achskw3.lis", "--motion", "m.csv", "--out", "o.csv"]) == 0
    lines = (folder / "o.csv").read_text().splitlines()
    assert lines[0] == "time,A3.plane,A3.offset"
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    # Entry = offset, in 0.1 µm: 0, 50 and 70.
    np.testing.assert_allclose(table[:, 1], [0.0, 5e-3, 7e-3], atol=1e-12)
    np.testing.assert_array_equal(table[:, 1], table[:, 2])


@pytest.mark.parametrize("out", ["achskw3.lis", "m.csv", "./m.csv"])
def test_an_input_is_never_written_onto(
    folder: Path, capsys: pytest.CaptureFixture[str], out: str
) -> None:
    before = (folder / out).read_bytes()
    command = ["simulate", "achskw3.lis", "--motion", "m.csv", "--out", out]
    assert main(command) == 2
    assert "which is an input, expected another file" in capsys.readouterr().err
    assert (folder / out).read_bytes() == before


@pytest.mark.parametrize(
    ("command", "written"),
    [
        (["simulate", "achskw3.lis", "--motion", "m.csv", "--out", "o.csv"], "o.csv"),
        (["objects", "achskw3.lis", "--out", "."], "cnc_objects.csv"),
        (["objects", "achskw3.lis", "--out", "."], "compensations.tcscopex"),
    ],
)
def test_a_file_that_exists_is_written_onto_by_force_only(
    folder: Path, capsys: pytest.CaptureFixture[str], command: list[str], written: str
) -> None:
    (folder / written).write_text("mine")
    assert main(command) == 2
    words = f"--out: found {written}, which exists, expected a new file or --force"
    assert words in capsys.readouterr().err
    assert (folder / written).read_text() == "mine"
    assert sum(1 for _ in folder.iterdir()) == 3
    assert main([*command, "--force"]) == 0
    assert (folder / written).read_text() != "mine"


def test_without_out_the_csv_is_printed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "achskw3.lis", "--motion", "m.csv"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "time,A3.plane,A3.offset"
    assert len(printed) == 4


def test_json_names_columns_and_largest_values(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "achskw3.lis", "--motion", "m.csv", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["columns"] == ["time", "A3.plane", "A3.offset"]
    assert found["largest"]["A3.offset"] == pytest.approx(7e-3)


def test_parquet_is_written_by_its_ending(folder: Path) -> None:
    import pyarrow.parquet as pq

    assert (
        main(["simulate", "achskw3.lis", "--motion", "m.csv", "--out", "o.parquet"])
        == 0
    )
    assert pq.read_table(folder / "o.parquet").column_names[1] == "A3.plane"


def test_list_in_increments_needs_the_option(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "achskw3.lis").write_text(PLANE.replace("unit 1", "unit 0"))
    command = ["simulate", "achskw3.lis", "--motion", "m.csv"]
    assert main(command) == 1
    assert "--increment" in capsys.readouterr().err
    assert main([*command, "--increment", "0.0001"]) == 0
    assert capsys.readouterr().out.splitlines()[3].split(",")[1] == "0.007"


@pytest.mark.parametrize(
    ("motion", "line"),
    [
        ("A1.position\n0\n", "expected A2.position for the plane of A3"),
        ("time\n0\n", "expected"),
        ("X.position,Y.position\n0,0\n", "found axis 'X', expected A1, A2"),
        ("A1.position,A2.position\n0,a\n", "m.csv"),
        (
            "time,A1.position,A2.position\n1,0,0\n0,0,0\n",
            "time: found 0 s after 1 s in row 2, expected ascending",
        ),
        ("", "m.csv"),
    ],
)
def test_bad_motion_ends_with_1_and_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], motion: str, line: str
) -> None:
    (folder / "m.csv").write_text(motion)
    assert main(["simulate", "achskw3.lis", "--motion", "m.csv"]) == 1
    shown = capsys.readouterr().err.strip()
    assert line in shown
    assert len(shown.splitlines()) == 1


def test_missing_list_ends_with_1(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "no.lis", "--motion", "m.csv"]) == 1
    assert "no.lis: No such file" in capsys.readouterr().err


def test_motion_is_required(folder: Path) -> None:
    assert main(["simulate", "achskw3.lis"]) == 2

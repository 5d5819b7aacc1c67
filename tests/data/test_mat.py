"""MATLAB files as measurements."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from axcomp.data.measurements import (
    ColumnSpec,
    MeasurementError,
    measurement,
    read_table,
)

DATA = Path(__file__).parents[3] / "shared" / "data"


def real(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs ../shared/data/{name}")
    return path


def put(folder: Path, content: dict[str, Any], **options: Any) -> Path:
    path = folder / "trace.mat"
    savemat(path, content, **options)
    return path


TIME = np.arange(50) / 1000.0


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("shape", [(50, 1), (1, 50)])
def test_vectors_of_one_length_are_columns(
    tmp_path: Path, packed: bool, shape: tuple[int, int]
) -> None:
    content = {"t_s": TIME.reshape(shape), "x_mm": (2.0 * TIME).reshape(shape)}
    path = put(tmp_path, {**content, "gain": 2.5})
    if packed:
        path.write_bytes(gzip.compress(path.read_bytes()))
    table = read_table(path)
    assert (table.format, table.rows) == ("MATLAB", 50)
    assert {c.name: c.unit for c in table.columns} == {"t_s": "s", "x_mm": "mm"}
    assert np.array_equal(table.column("x_mm").values, 2.0 * TIME)
    assert table.scalars == (("gain", 2.5),)
    assert table.lines[-1] == 50


def test_compressed_file_of_version_7_is_read(tmp_path: Path) -> None:
    path = put(tmp_path, {"x": TIME}, do_compression=True)
    assert np.array_equal(read_table(path).column("x").values, TIME)


def test_emps_record_gives_roles_and_gains() -> None:
    table = read_table(real("emps/DATA_EMPS.mat"))
    assert [column.name for column in table.columns] == ["qg", "qm", "t", "vir"]
    gains = dict(table.scalars)
    assert gains == {
        "gtau": pytest.approx(35.1507, abs=5e-5),  # printed with four decimals
        "kp": pytest.approx(160.18, abs=5e-3),
        "kv": pytest.approx(243.45, abs=5e-3),
    }
    columns = {
        "time": ColumnSpec("t", "s"),
        "X.position": ColumnSpec("qg", "m"),
        "X.encoder": ColumnSpec("qm", "m"),
        "X.current": ColumnSpec("vir", "V"),
    }
    found = measurement(table, columns)
    assert found.rows == 24841
    assert found.values["X.encoder"].max() == pytest.approx(246.37775, abs=1e-9)
    assert found.units["X.current"] == "V"


def test_fields_of_a_structure_and_columns_of_a_matrix_have_names(
    tmp_path: Path,
) -> None:
    content = {"axis": {"pos": TIME, "kp": 3.0}, "m": np.column_stack([TIME, -TIME])}
    table = read_table(put(tmp_path, content))
    assert [c.name for c in table.columns] == ["axis.pos", "m(:,1)", "m(:,2)"]
    assert np.array_equal(table.column("m(:,2)").values, -TIME)
    assert table.scalars == (("axis.kp", 3.0),)


def test_what_is_no_column_is_listed_with_its_reason(tmp_path: Path) -> None:
    content = {
        "x": TIME,
        "y": TIME,
        "short": TIME[:7],
        "note": "warm",
        "z": TIME + 1j,
        "many": np.zeros((3, 4, 5)),
    }
    table = read_table(put(tmp_path, content))
    assert [c.name for c in table.columns] == ["x", "y"]
    reasons = sorted(item.reason for item in table.skipped)
    assert reasons == [
        "variable 'many': 3 dimensions",
        "variable 'note': text 'warm'",
        "variable 'short': 7 values beside 50 of others",
        "variable 'z': complex numbers",
    ]


def test_value_that_is_not_finite_is_named_with_its_row(tmp_path: Path) -> None:
    x = TIME.copy()
    x[4] = np.nan
    table = read_table(put(tmp_path, {"x": x}))
    with pytest.raises(MeasurementError, match="row 5, column 'x': found 'nan'"):
        table.numbers(table.column("x"))


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"MATLAB 7.3 MAT-file, Platform: X" + bytes(500), "found damaged HDF5 data"),
        (b"\x89HDF\r\n\x1a\n" + bytes(500), "found damaged HDF5 data"),
        (b"MATLAB 5.0 MAT-file" + bytes(200), "found damaged MATLAB data"),
    ],
)
def test_damaged_files_are_refused_in_one_line(
    tmp_path: Path, content: bytes, match: str
) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(content)
    with pytest.raises(MeasurementError, match=match) as caught:
        read_table(path)
    assert "\n" not in str(caught.value)


def test_file_of_version_4_asks_for_a_newer_one(tmp_path: Path) -> None:
    path = put(tmp_path, {"x": TIME}, format="4")
    with pytest.raises(MeasurementError, match="MATLAB data of version 4"):
        read_table(path)


def test_file_without_a_vector_says_what_it_holds(tmp_path: Path) -> None:
    path = put(tmp_path, {"kp": 3.0, "note": "warm"})
    with pytest.raises(MeasurementError, match="found kp, note and no vector"):
        read_table(path)


def test_any_damage_gives_a_table_or_one_clear_line(tmp_path: Path) -> None:
    raw = put(tmp_path, {"x": TIME, "y": TIME}).read_bytes()
    rng = np.random.default_rng(9)
    path = tmp_path / "damaged.mat"
    refused = 0
    for _ in range(200):
        damaged = bytearray(raw[: int(rng.integers(1, len(raw)))])
        for _ in range(3):
            at = int(rng.integers(0, len(damaged)))
            damaged[at : at + 4] = rng.bytes(4)
        path.write_bytes(bytes(damaged))
        try:
            read_table(path)
        except MeasurementError as error:
            refused += "\n" not in str(error)
    assert refused > 100  # the others have kept one whole vector


def test_packed_recording_without_names_reads_like_csv() -> None:
    path = real("friction/ur10e_jointwise_joint_1.csv.gz")
    table = read_table(path)
    assert (table.format, table.rows, len(table.columns)) == ("CSV", 5889, 31)
    columns = {
        "time": ColumnSpec("1", "s"),
        "J1.position": ColumnSpec("2", "rad"),
        "J1.velocity": ColumnSpec("8", "rad/s"),
        "J1.current": ColumnSpec("14", "A"),
    }
    found = measurement(table, columns, rotary=["J1"])
    # 0.9766 rad/s is the fastest that the file prints.
    fastest = found.values["J1.velocity"].max()
    assert fastest == pytest.approx(np.degrees(0.9766), abs=1e-9)

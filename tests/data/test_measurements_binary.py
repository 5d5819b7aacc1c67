"""HDF5, MATLAB 7.3, TDMS and JSON files: named vectors of one length are the columns."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import MeasurementError, measurement, read_table

TIME = np.arange(50) * 0.01


def test_data_sets_of_hdf5_are_columns_with_their_units(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        place = file.create_dataset("axes/X.position", data=1e3 * TIME)
        place.attrs["unit"] = "um"
        file["scale"] = 2.5
        file["note"] = "warm"
        both = np.array([(t, 2 * t) for t in TIME], dtype=[("a", "f8"), ("b", "f4")])
        file["pair"] = both
    table = read_table(path)
    assert (table.format, table.rows, table.counts_rows) == ("HDF5", 50, True)
    assert [(c.name, c.unit) for c in table.columns] == [
        ("axes.X.position", "um"),
        ("pair.a", None),
        ("pair.b", None),
        ("time", None),
    ]
    assert table.scalars == (("scale", 2.5),)
    assert "note" in table.skipped[0].reason


def test_matlab_7_3_is_read_with_its_vectors_upright(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", TIME[None, :]), ("xy", np.ones((2, 50)))):
            file[name] = values  # MATLAB stores the transpose
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["title"] = np.array([[65, 66]], dtype=np.uint16)
        file["title"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: made up".ljust(116))
    table = read_table(path)
    assert (table.format, table.rows) == ("MATLAB 7.3", 50)
    assert [c.name for c in table.columns] == ["t", "xy(:,1)", "xy(:,2)"]
    np.testing.assert_array_equal(table.columns[0].values, TIME)


def test_channels_of_tdms_are_columns_with_the_time_of_the_waveform(
    tmp_path: Path,
) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "log.tdms"
    about = {"wf_increment": 0.01, "wf_start_offset": 0.0, "unit_string": "um"}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("laser", "X.error", 2.0 * TIME, about),
                nptdms.ChannelObject("laser", "X.position", 10.0 * TIME, {}),
            ]
        )
    found = measurement(read_table(path))
    assert found.format == "TDMS"
    np.testing.assert_allclose(found.require("time"), TIME, atol=1e-15)
    # Written in µm, and in mm where the file states no unit: both to the last bit.
    np.testing.assert_allclose(found.require("X.error"), 2e-3 * TIME, rtol=1e-15)
    np.testing.assert_array_equal(found.require("X.position"), 10.0 * TIME)


@pytest.mark.parametrize(
    ("library", "magic", "match"),
    [
        ("h5py", b"\x89HDF\r\n\x1a\n", "found HDF5, which needs h5py: pip install"),
        ("nptdms", b"TDSm", "found TDMS, which needs npTDMS: pip install"),
    ],
)
def test_a_library_that_is_missing_is_named_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    library: str,
    magic: bytes,
    match: str,
) -> None:
    path = tmp_path / "log"
    path.write_bytes(magic + bytes(100))
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MeasurementError, match=match):
        read_table(path)


@pytest.mark.parametrize("share", [0.3, 0.7, 0.95])
def test_binary_files_that_were_cut_off_are_refused_without_other_words(
    tmp_path: Path, share: float, capfd: pytest.CaptureFixture[str]
) -> None:
    h5py, nptdms = pytest.importorskip("h5py"), pytest.importorskip("nptdms")
    whole = tmp_path / "a.h5", tmp_path / "a.tdms"
    with h5py.File(whole[0], "w") as file:
        file["x"] = np.arange(5000.0)
    with nptdms.TdmsWriter(whole[1]) as writer:
        writer.write_segment([nptdms.ChannelObject("g", "x", np.arange(5000.0))])
    for path in whole:
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        with pytest.raises(MeasurementError, match=r"damaged|cut off"):
            read_table(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "document",
    [
        {"time": [0.0, 0.5, 1.0], "X.position": [1, 2, 3], "title": "t"},
        [{"time": 0.5 * k, "X.position": 1 + k} for k in range(3)],
    ],
)
def test_plain_json_gives_columns_by_name(tmp_path: Path, document: object) -> None:
    path = tmp_path / "log.json"
    path.write_text(json.dumps(document))
    found = measurement(read_table(path))
    assert found.require("time").tolist() == [0.0, 0.5, 1.0]
    assert found.require("X.position").tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('{"a": 1}', "without signals, expected a list of signals"),
        ('{"a": [1, 2', "found damaged JSON"),
        ('{"a": ["x", "y"]}', "found a and no vector of numbers"),
        (
            '{"Header": {"S": [{"Name": "a"}]}, "Payload": [{"HFData": [[1, 2]]}]}',
            "found 2 values in sample 1, expected 1",
        ),
        ('{"Header": {"S": [{"Name": "a"}]}, "Payload": []}', "and no samples"),
    ],
)
def test_json_that_holds_no_samples_is_refused_in_one_line(
    tmp_path: Path, text: str, match: str
) -> None:
    path = tmp_path / "log.json"
    path.write_text(text)
    with pytest.raises(MeasurementError, match=match) as caught:
        read_table(path)
    assert "\n" not in str(caught.value)


def test_gaps_of_a_capture_are_counted(tmp_path: Path) -> None:
    rows = [[k, 0.1 * k] for k in (1, 2, 3, 6, 7, 8, 9)]
    head = {"Signals": [{"Name": "CYCLE"}, {"Name": "POS|1", "Axis": "X1"}]}
    path = tmp_path / "capture.json"
    path.write_text(json.dumps({"Header": head, "Payload": [{"HFData": rows}]}))
    table = read_table(path)
    assert table.rows == 7
    assert any("leaves out 2 samples" in remark for remark in table.remarks)


def test_a_group_that_holds_all_is_no_axis(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["laser/target"], file["laser/error"] = TIME, TIME
        file["rate"] = 100.0
    names = [(column.name, column.role) for column in read_table(path).columns]
    assert names == [("error", "error"), ("target", "position")]


def test_records_below_a_key_of_json_are_rows(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    rows = [{"target": 10.0 * k, "error": 0.1 * k} for k in range(4)]
    path.write_text(json.dumps({"about": {"machine": "M7"}, "data": rows}))
    found = measurement(read_table(path), axis="X")
    assert found.require("X.position").tolist() == [0.0, 10.0, 20.0, 30.0]

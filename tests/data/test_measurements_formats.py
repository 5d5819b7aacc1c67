"""ISO 230-2 run tables, bed meshes, height maps, Parquet."""

import datetime
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.errors import AxcompError
from axcomp.data.measurements import (
    CellError,
    Lines,
    MeasurementError,
    derive_error,
    measurement,
    read_table,
)

DATA = Path(__file__).parents[3] / "shared" / "data"


def real(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs ../shared/data/{name}")
    return path


RUNS = """TEST_DATA=# Input data
# Mandatory
UNIT=mm
CYCLES=2
POSITIONS=2
TGT_DATA[1]=0
REF_DATA_FWD[1,1]=.001
TGT_DATA[2]=10
REF_DATA_FWD[2,1]=10.002
REF_DATA_FWD[1,2]=-.001
REF_DATA_FWD[2,2]=10.004
REF_DATA_BWD[1,1]=.005
REF_DATA_BWD[2,1]=10.006
REF_DATA_BWD[1,2]=.007
REF_DATA_BWD[2,2]=10.008
"""


def put(folder: Path, text: str, name: str = "file.dat") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_run_table_is_in_the_order_of_measurement(tmp_path: Path) -> None:
    table = read_table(put(tmp_path, RUNS))
    assert table.format == "ISO 230-2 run table"
    body = np.column_stack([column.values for column in table.columns])
    assert body.tolist() == [
        [0, 0.001, 1, 1],
        [10, 10.002, 1, 1],
        [10, 10.006, 1, -1],
        [0, 0.005, 1, -1],
        [0, -0.001, 2, 1],
        [10, 10.004, 2, 1],
        [10, 10.008, 2, -1],
        [0, 0.007, 2, -1],
    ]
    assert table.lines.tolist() == [7, 9, 13, 12, 10, 11, 15, 14]
    assert not table.skipped


def test_run_table_reading_that_is_not_there_is_skipped_and_named(
    tmp_path: Path,
) -> None:
    text = RUNS.replace("REF_DATA_BWD[2,1]=10.006\n", "")
    table = read_table(put(tmp_path, text))
    assert table.rows == 7
    reasons = [item.reason for item in table.skipped]
    assert reasons == ["no reading REF_DATA_BWD[2,1] at target 10"]


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("=10.002", "=10.oo2", r":9: column 'REF_DATA_FWD\[2,1\]': found '10.oo2'"),
        ("=10.002", "=nan", r":9: .*found 'nan', expected a finite number"),
        ("[2,1]=10.002", "[x,1]=10.002", r":9: found REF_DATA_FWD\[x,1\]"),
        ("[2,1]=10.002", "[1,1]=10.002", r":9: found .*a second time.*line 7"),
        (
            "TGT_DATA[2]=10\n",
            "",
            r"found a reading at position 2, expected TGT_DATA\[2\]",
        ),
        ("CYCLES=2", "CYCLES=1", r":4: found CYCLES=1 and cycle 2"),
        ("UNIT=mm", "UNIT=furlong", r"found unit 'furlong', expected mm, um"),
        ("UNIT=mm", "nonsense here", r":3: found 'nonsense here'"),
    ],
)
def test_run_table_that_breaks_its_form_is_refused(
    tmp_path: Path, old: str, new: str, match: str
) -> None:
    assert old in RUNS
    with pytest.raises(AxcompError, match=match):
        read_table(put(tmp_path, RUNS.replace(old, new, 1)))


def test_run_table_in_micrometres_becomes_mm(tmp_path: Path) -> None:
    text = RUNS.replace("UNIT=mm", "UNIT=um")
    data = measurement(read_table(put(tmp_path, text)), axis="X")
    assert data.values["X.position"].max() == 0.01
    assert data.units["X.actual"] == "mm"


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("ess_b02_X_9pos5cyc_ISO230.dat", 90),
        ("ess_ecmccomgui_testdata_ISO230_2.dat", 50),
        ("ess_w42_X_ILD50_5pos5cyc_ISO230.dat", 50),
    ],
)
def test_real_run_tables_read_whole(name: str, rows: int) -> None:
    table = read_table(real(f"iso230/{name}"))
    assert (table.rows, table.skipped) == (rows, ())


MESH = """[printer]
kinematics: corexy

[bed_mesh]
speed: 200

#*# <---- SAVE_CONFIG ---->
#*# [bed_mesh cold]
#*# version = 1
#*# points =
#*# \t0.1, 0.2, 0.3
#*# \t0.4, 0.5, 0.6
#*# x_count = 3
#*# y_count = 2
#*# min_x = 10.0
#*# max_x = 30.0
#*# min_y = 5.0
#*# max_y = 25.0
#*#
#*# [bed_mesh default]
#*# version = 1
#*# points =
#*# \t1.0, 2.0
#*# \t3.0, 4.0
#*# x_count = 2
#*# y_count = 2
#*# min_x = 0
#*# max_x = 1
#*# min_y = 0
#*# max_y = 2
"""


def test_bed_mesh_takes_the_default_profile_and_says_so(tmp_path: Path) -> None:
    table = read_table(put(tmp_path, MESH))
    assert table.format == "Klipper bed mesh"
    body = np.column_stack([column.values for column in table.columns])
    assert body.tolist() == [[0, 0, 1], [1, 0, 2], [0, 2, 3], [1, 2, 4]]
    assert table.remarks[0] == "Profile 'default' was taken; the file also holds cold."


def test_heights_say_how_they_are_taken(tmp_path: Path) -> None:
    mesh = read_table(put(tmp_path, MESH))
    assert "Heights are taken as errors as they stand" in mesh.remarks[-1]
    lines = read_table(put(tmp_path, "X0 Y0 Z0.1\nX9 Y0 Z0.2\nX0 Y9 Z0.1\n"))
    for said in (mesh.remarks[-1], lines.remarks[-1]):
        assert "on a flat reference are the negative of the error" in said
        # `axcomp convert` says it as well, and has no columns.
        assert "sign = -1 in the columns of a job" in said


def test_bed_mesh_profile_can_be_chosen(tmp_path: Path) -> None:
    table = read_table(put(tmp_path, MESH), profile="cold")
    assert table.column("x").values.tolist() == [10, 20, 30] * 2
    assert table.column("y").values.tolist() == [5] * 3 + [25] * 3
    assert table.column("z").values.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    with pytest.raises(
        AxcompError, match="found profiles cold, default, expected 'hot'"
    ):
        read_table(put(tmp_path, MESH), profile="hot")


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("0.2, 0.3", "0.2", r":11: found 2 points in row 1, expected 3"),
        ("#*# \t0.4, 0.5, 0.6\n", "", r"found 1 rows of points, expected 2"),
        ("0.5", "o.5", r":12: column 'z at x 20': found 'o.5'"),
        ("0.5", "inf", r":12: column 'z at x 20': found 'inf'"),
        ("#*# min_x = 10.0\n", "", r"without min_x, expected min_x = a number"),
        ("#*# min_x = 10.0", "#*# min_x = 90.0", "found min_x 90 and max_x 30"),
        ("[bed_mesh default]", "[bed_mesh cold]", "found 2 profiles 'cold'"),
    ],
)
def test_bed_mesh_that_breaks_its_form_is_refused(
    tmp_path: Path, old: str, new: str, match: str
) -> None:
    with pytest.raises(AxcompError, match=match):
        read_table(put(tmp_path, MESH.replace(old, new, 1)), profile="cold")


def test_mesh_point_without_a_value_is_skipped_and_named(tmp_path: Path) -> None:
    table = read_table(put(tmp_path, MESH.replace("0.5", "nan", 1)), profile="cold")
    assert table.rows == 5
    assert [(s.line, s.reason) for s in table.skipped] == [
        (12, "not probed: x 20, y 25")
    ]


@pytest.mark.parametrize("name", ["cold", "repeat1", "repeat2"])
def test_real_bed_meshes_read_whole(name: str) -> None:
    table = read_table(real(f"grids/bed_mesh_13x13_{name}.cfg"))
    assert (table.rows, table.skipped) == (169, ())


HEIGHTS = """RepRapFirmware height map file v2 generated at 2025-12-10 09:39
axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1
X,Y,20.00,280.00,0.00,40.00,-1.00,86.67,40.00,4,2
 -0.042, -0.033,0, 0.000
  0.010,  0.020,  0.030,nan
"""


def test_height_map_tells_unprobed_from_zero(tmp_path: Path) -> None:
    table = read_table(put(tmp_path, HEIGHTS))
    assert table.format == "RepRapFirmware height map"
    assert table.column("z").values.tolist() == [-0.042, -0.033, 0.0, 0.01, 0.02, 0.03]
    assert [s.line for s in table.skipped] == [4, 5]
    assert table.skipped[0].reason == "not probed: X 193.333, Y 0"


def test_height_map_spacing_is_exact_where_the_ends_confirm_it(tmp_path: Path) -> None:
    table = read_table(put(tmp_path, HEIGHTS))
    # The header rounds 86.666… to 86.67; the last column lies at max0.
    assert table.column("x").values.max() == 280.0
    other = HEIGHTS.replace("86.67", "80.00")
    assert read_table(put(tmp_path, other)).column("x").values.max() == 260.0


def test_height_map_of_the_first_version_reads(tmp_path: Path) -> None:
    text = (
        "RepRapFirmware height map file v1 generated at 2017-01-01 00:00\n"
        "xmin,xmax,ymin,ymax,radius,spacing,xnum,ynum\n"
        "-10.00,10.00,0.00,10.00,-1.00,10.00,3,2\n0.1,0.2,0.3\n0.4,0.5,0.6\n"
    )
    table = read_table(put(tmp_path, text))
    assert table.column("x").values.tolist() == [-10, 0, 10] * 2


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        (",4,2", ",5,2", r":4: found 4 points in row 1, expected 5"),
        (",4,2", ",4,3", r"found 2 rows of points, expected 3"),
        (",4,2", ",4,1", r":5: found row 2 of points, expected 1 rows"),
        ("20.00", "abc", r":3: column 'min0': found 'abc'"),
        ("20.00,280.00", "280.00,20.00", "every 86.67 from 280, expected them to end"),
        ("86.67", "96.67", "every 96.67 from 20, expected them to end by max0 280"),
        (" -0.033", " ????", r":4: column 'z at X 106.667': found '\?\?\?\?'"),
    ],
)
def test_height_map_that_breaks_its_form_is_refused(
    tmp_path: Path, old: str, new: str, match: str
) -> None:
    with pytest.raises(AxcompError, match=match):
        read_table(put(tmp_path, HEIGHTS.replace(old, new, 1)))


def test_real_height_map_reads_whole() -> None:
    table = read_table(real("grids/height_map_20x20.csv"))
    assert (table.rows, table.skipped) == (400, ())
    data = measurement(table, axis="Z", masters=("X", "Y"))
    assert data.values["X.position"].max() == 280.0
    # The file's own first line states the range of the heights.
    error = derive_error(data, "Z")
    assert (error.min(), error.max()) == (-0.244, 0.072)


def test_parquet_reads_numbers_units_and_time(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    start = datetime.datetime(2026, 1, 1)
    table = pa.table(
        {
            "when": [start, start + datetime.timedelta(seconds=1.5)],
            "x [mm]": pa.array([1, 2], pa.int32()),
            "dz": pa.array([1.0, None]),
            "note": ["a", "b"],
            "nested": [[1], [2]],
        }
    )
    dz = table.schema.field("dz").with_metadata({"unit": "µm"})
    path = tmp_path / "data.bin"
    pq.write_table(table.cast(table.schema.set(2, dz)), path)
    read = read_table(path)
    assert [c.name for c in read.columns] == ["when", "x", "dz", "note"]
    assert [c.unit for c in read.columns] == ["s", "mm", "um", None]
    assert read.column("when").values.tolist() == [0.0, 1.5]
    assert "nested" in read.skipped[0].reason
    with pytest.raises(AxcompError, match="row 2, column 'dz': found an empty cell"):
        read.numbers(read.column("dz"))


def test_parquet_without_rows_is_refused(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    pq.write_table(pa.table({"x": pa.array([], pa.float64())}), tmp_path / "no.parquet")
    with pytest.raises(AxcompError, match="found no rows"):
        read_table(tmp_path / "no.parquet")


def test_compressed_text_reads_as_it_is() -> None:
    table = read_table(real("friction/ur10e_jointwise_joint_1.csv.gz"))
    assert (len(table.columns), table.rows) == (31, 5889)


@pytest.mark.parametrize("mark", [";", ",", "\t"])
def test_a_matrix_that_names_no_axes_is_refused_in_one_line(
    tmp_path: Path, mark: str
) -> None:
    file = tmp_path / "plate.csv"
    rows = [["", "0", "10", "20.5"], ["0", "0.1", "0.2", "0.3"], ["5", "0", "0", "0"]]
    file.write_text("".join(f"{mark.join(row)}\n" for row in rows))
    words = "ascending numbers along the top beside an empty cell"
    with pytest.raises(AxcompError, match=words):
        read_table(file)


SURFACE = [["0", "0", "50", "100"]] + [
    [str(20 * j), *(f"{0.01 * i * j:.2f}" for i in range(3))] for j in range(5)
]


@pytest.mark.parametrize("mark", [";", ",", "\t"])
def test_a_matrix_whose_corner_is_zero_is_refused_with_the_key_for_a_table(
    tmp_path: Path, mark: str
) -> None:
    file = tmp_path / "plate.csv"
    file.write_text("".join(f"{mark.join(row)}\n" for row in SURFACE))
    with pytest.raises(AxcompError, match=r"down the side beside '0'.*header = \[\]"):
        read_table(file)
    assert read_table(file, lines=Lines.of(header=[])).rows == 6


def test_a_table_that_begins_with_zeros_is_no_matrix(tmp_path: Path) -> None:
    file = tmp_path / "runs.csv"
    file.write_text("".join(f"{20 * j};{j};{j + 0.1};{j + 0.2}\n" for j in range(6)))
    assert read_table(file).format == "CSV"


def test_a_matrix_of_a_surface_is_read_cell_by_cell_without_empty_ones(
    tmp_path: Path,
) -> None:
    path = tmp_path / "plate.csv"
    path.write_text("dz [um]\ny\\x,0,100\n-5,1.5,\n5,-2,3\n")
    table = read_table(path)
    found = {column.role: column.values.tolist() for column in table.columns}
    assert found == {
        "X.position": [0.0, 0.0, 100.0],
        "Y.position": [-5.0, 5.0, 5.0],
        "Z.error": [1.5, -2.0, 3.0],
    }
    assert [column.unit for column in table.columns] == ["mm", "mm", "um"]
    assert table.skipped[-1].reason == "not probed: X 100, Y -5"


def test_categories_of_a_parquet_file_are_words_and_numbers(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    way = pa.array(["up", "down", "up"]).dictionary_encode()
    run = pa.array([1, 2, 2]).dictionary_encode()
    pq.write_table(pa.table({"direction": way, "run": run}), tmp_path / "a.parquet")
    table = read_table(tmp_path / "a.parquet")
    assert table.column("direction").text == ("up", "down", "up")
    assert table.column("run").values.tolist() == [1.0, 2.0, 2.0]
    assert not table.skipped


def test_names_stand_above_rows_that_are_left_out(tmp_path: Path) -> None:
    rows = "".join(f"{10 * k};{k % 5}\n" for k in range(9))
    (tmp_path / "a.csv").write_text(f"Laser\nTarget [mm];Error [um]\n{rows}")
    table = read_table(tmp_path / "a.csv", lines=Lines((), None, (5, 11)))
    assert [column.name for column in table.columns] == ["Target", "Error"]
    assert table.column("Target").values.tolist() == [20, 30, 40, 50, 60, 70, 80]


def test_rows_of_a_file_without_lines_can_be_left_out(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    cells = pa.table({"x": [0.0, 1.0, 2.0, 3.0], "dz": [0.1, None, 0.3, 0.4]})
    pq.write_table(cells, tmp_path / "a.parquet")
    table = read_table(tmp_path / "a.parquet")
    with pytest.raises(CellError, match=r"row 2, column 'dz'.*skip = \[2\]"):
        table.numbers(table.column("dz"))
    table = read_table(tmp_path / "a.parquet", lines=Lines((2,), None, (1, 3)))
    assert table.numbers(table.column("dz")).tolist() == [0.1, 0.3]
    assert table.lines.tolist() == [1, 3]
    assert [each.line for each in table.skipped] == [2, 4]
    with pytest.raises(MeasurementError, match="header is a key for text tables"):
        read_table(tmp_path / "a.parquet", lines=Lines((), (1,)))

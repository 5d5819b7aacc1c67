"""Columns get a role and the library's units; what does not fit is named."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from axcomp.data.errors import AxcompError
from axcomp.data.measurements import (
    UNITS,
    CellError,
    ColumnError,
    ColumnSpec,
    DirectionUnknown,
    LineError,
    MeasurementError,
    MissingRole,
    RoleError,
    Table,
    UnitError,
    derive_error,
    find_role,
    find_unit,
    measurement,
    read_table,
    reduce_length,
    wrap_degrees,
)


def table_of(folder: Path, text: str):
    path = folder / "m.csv"
    path.write_text(text, encoding="utf-8")
    return read_table(path)


@pytest.mark.parametrize(
    ("unit", "value", "library"),
    [
        ("m", 1.5, 1500.0),
        ("mm", 1.5, 1.5),
        ("um", 12.3, 0.0123),
        ("0.1um", 123.0, 0.0123),
        ("deg", 90.0, 90.0),
        ("rad", np.pi, 180.0),
        ("0.0001deg", 12345.0, 1.2345),
        ("m/s", 0.5, 500.0),
        ("um/s2", 7.0, 0.007),
        ("s", 2.0, 2.0),
        ("ms", 2.0, 0.002),
        ("degC", 20.0, 20.0),
        ("K", 293.15, 20.0),
        ("A", 1.0, 1.0),
        ("%", 30.0, 30.0),
    ],
)
def test_units_convert_to_the_library_unit(
    unit: str, value: float, library: float
) -> None:
    found = UNITS[unit].to_library(np.array([value]))
    # One correctly rounded operation; K rounds once more on a sum of size 300.
    np.testing.assert_allclose(found, [library], rtol=1e-15, atol=6e-14)


@given(value=st.integers(-(10**9), 10**9))
def test_micrometres_are_exact(value: int) -> None:
    found = UNITS["um"].to_library(np.array([float(value)]))
    assert found[0] == float(f"{value}e-3")  # what the decimal number itself rounds to


@pytest.mark.parametrize(
    ("name", "per_second"),
    [
        ("mm/min", 0.5),
        ("m/min", 500.0),
        ("in/min", 12.7),
        ("deg/min", 0.5),
        ("rpm", 180.0),
    ],
)
def test_feeds_and_speeds_are_of_a_minute(name: str, per_second: float) -> None:
    assert UNITS[name].to_library(np.array([30.0]))[0] == pytest.approx(per_second)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("µm", "um"),
        ("\N{GREEK SMALL LETTER MU}m", "um"),
        ("MM", "mm"),
        ("°", "deg"),
        ("°C", "degC"),
        ("mm/s^2", "mm/s2"),
        ("mm/s²", "mm/s2"),
        ("mm/min", "mm/min"),
        ("1/min", "rpm"),
        ("N·m", "Nm"),
        ("nm", "nm"),
        ("NM", None),
        ("Inch", "in"),
        ("mil", "thou"),
        ("µin", "uin"),
        ("°F", "degF"),
        ("1/100 mm", "0.01mm"),
        ("0,1 µm", "0.1um"),
        ("ppm", None),
        ("furlong", None),
        ("", None),
    ],
)
def test_spellings_of_units(text: str, name: str | None) -> None:
    found = find_unit(text)
    assert (found.name if found else None) == name


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("x [cm]", 10.0),
        ("x/cm", 10.0),
        ("x_inch", 25.4),
        ("x_Zoll", 25.4),
        ("x [1/10 mm]", 0.1),
        ("x [ft]", 304.8),
    ],
)
def test_positions_are_read_in_the_unit_that_their_name_says(
    tmp_path: Path, header: str, factor: float
) -> None:
    data = measurement(table_of(tmp_path, f"{header},dx [um]\n0,1\n2,3\n4,1\n"))
    places = data.require("X.position")
    np.testing.assert_allclose(places, factor * np.array([0.0, 2.0, 4.0]))


def test_mapped_columns_come_in_library_units(tmp_path: Path) -> None:
    table = table_of(tmp_path, "x,y,dz,T\n0,1,5,293.15\n1,2,-5,294.15\n")
    data = measurement(
        table,
        {
            "X.position": ColumnSpec("x", "m"),
            "Y.position": ColumnSpec("y"),
            "Z.error": ColumnSpec("dz", "um"),
            "temperature.frame": ColumnSpec("T", "K"),
        },
    )
    assert data.values["X.position"].tolist() == [0.0, 1000.0]
    assert data.require("Z.error").tolist() == [0.005, -0.005]
    assert data.get("temperature.frame") == pytest.approx([20.0, 21.0], abs=1e-12)
    assert data.get("run") is None
    assert data.axes == ("X", "Y", "Z")
    assert data.units["Z.error"] == "mm"


def test_roles_that_are_column_names_need_no_mapping(tmp_path: Path) -> None:
    text = "time,X.position,X.error [um],temperature.frame\n0,1,5,20\n1,2,-5,21\n"
    data = measurement(table_of(tmp_path, text))
    assert list(data.values) == ["time", "X.position", "X.error", "temperature.frame"]
    assert data.values["X.error"].tolist() == [0.005, -0.005]


def test_laser_table_takes_the_axis(tmp_path: Path) -> None:
    table = table_of(tmp_path, "target,error_um,run,direction\n0,1,1,1\n9,2,1,-1\n")
    data = measurement(table, axis="Y")
    assert data.values["Y.error"].tolist() == [0.001, 0.002]
    assert data.values["run"].tolist() == [1, 1]
    assert data.values["Y.direction"].tolist() == [1, -1]
    with pytest.raises(MeasurementError, match=r"found 'target' without an axis"):
        measurement(table)


def test_axis_does_not_rename_roles_that_a_table_states(tmp_path: Path) -> None:
    table = table_of(tmp_path, "X.position,Y.position,Z.error\n1,2,3\n4,5,6\n")
    assert list(measurement(table, axis="X").values)[-1] == "Z.error"


def test_increments_need_the_increment_of_the_axis(tmp_path: Path) -> None:
    table = table_of(tmp_path, "x,dx\n1000,5\n2000,6\n")
    columns = {
        "X.position": ColumnSpec("x", "inc"),
        "X.error": ColumnSpec("dx", "um"),
    }
    data = measurement(table, columns, increments={"X": 0.002})
    assert data.values["X.position"].tolist() == [2.0, 4.0]
    with pytest.raises(MeasurementError, match="no increment of axis X"):
        measurement(table, columns)


@pytest.mark.parametrize(
    ("role", "unit", "match"),
    [
        ("X.position", "furlong", r"found unit 'furlong', expected mm, um.*nearest"),
        ("X.position", "s", r"X.position in column 'x': found unit 's', expected mm"),
        ("time", "mm", r"found unit 'mm', expected s, ms, .*\(nearest: ms\)"),
        ("temperature.frame", "um", r"found unit 'um', expected degC, .*K"),
        ("X.velocity", "mm", r"found unit 'mm', expected mm/s.*nearest: mm/s"),
        ("X.position", "umm", r"nearest: um"),
    ],
)
def test_unit_that_does_not_fit_names_the_accepted_ones(
    tmp_path: Path, role: str, unit: str, match: str
) -> None:
    table = table_of(tmp_path, "x,y\n1,2\n3,4\n")
    with pytest.raises(UnitError, match=match):
        measurement(table, {role: ColumnSpec("x", unit)})


def test_unit_against_that_of_the_file_is_refused(tmp_path: Path) -> None:
    table = table_of(tmp_path, "x [mm],dz [um]\n1,2\n3,4\n")
    with pytest.raises(UnitError, match=r"the file says um.*found unit 'mm'"):
        measurement(table, {"Z.error": ColumnSpec("dz", "mm")})
    data = measurement(table, {"Z.error": ColumnSpec("dz", "µm")})
    assert data.values["Z.error"].tolist() == [0.002, 0.004]


def test_one_letter_endings_count_only_where_they_fit(tmp_path: Path) -> None:
    table = table_of(tmp_path, "t_s,pos_s,x_m\n1,2,3\n3,4,5\n")
    data = measurement(
        table, {"time": ColumnSpec("t_s"), "X.position": ColumnSpec("pos_s")}
    )
    assert data.units == {"time": "s", "X.position": "mm"}
    with pytest.raises(UnitError, match=r"metres, or 'measured'"):
        measurement(table, {"X.actual": ColumnSpec("x_m")})
    data = measurement(table, {"X.actual": ColumnSpec("x_m", "mm")})
    assert data.values["X.actual"].tolist() == [3, 5]


def test_one_axis_has_lengths_or_angles_not_both(tmp_path: Path) -> None:
    table = table_of(tmp_path, "c,e\n1,2\n3,4\n")
    columns = {"C.position": ColumnSpec("c", "deg"), "C.error": ColumnSpec("e", "um")}
    with pytest.raises(
        UnitError, match=r"C.error in column 'e': found unit 'um', expected deg"
    ):
        measurement(table, columns)
    with pytest.raises(UnitError, match=r"found unit 'um', expected deg"):
        measurement(table, {"C.error": ColumnSpec("e", "um")}, rotary=["C"])
    with pytest.raises(UnitError, match=r"C.position.*found unit 'deg', expected mm"):
        measurement(table, columns, rotary=[])
    data = measurement(table, {**columns, "C.error": ColumnSpec("e")})
    assert data.units["C.error"] == "deg"
    data = measurement(table, {"C.error": ColumnSpec("e")}, rotary=["C"])
    assert data.units["C.error"] == "deg"


@pytest.mark.parametrize("rotary", [None, []])
def test_the_speed_of_a_motor_is_refused_for_an_axis_in_mm(
    tmp_path: Path, rotary: list[str] | None
) -> None:
    table = table_of(tmp_path, "x [mm],n [rpm]\n1,2\n3,4\n")
    columns = {"X.position": ColumnSpec("x"), "X.velocity": ColumnSpec("n")}
    with pytest.raises(MeasurementError, match=r"'n': found rpm.*leave the column out"):
        measurement(table, columns, rotary=rotary)


@pytest.mark.parametrize(
    ("role", "nearest"),
    [
        ("X.positon", "X.position"),
        ("X.err", "X.error"),
        ("tme", "time"),
        ("temperature", "temperature.<sensor>"),
        ("runs", "run"),
    ],
)
def test_unknown_role_names_the_nearest(
    tmp_path: Path, role: str, nearest: str
) -> None:
    table = table_of(tmp_path, "x,y\n1,2\n3,4\n")
    with pytest.raises(RoleError) as caught:
        measurement(table, {role: ColumnSpec("x")})
    assert caught.value.nearest == nearest
    assert f"found role '{role}'" in str(caught.value)


def test_bad_cell_stops_only_what_uses_it(tmp_path: Path) -> None:
    text = "X.position,X.error,Y.error\n1,2,nan\n3,4,5\n"
    data = measurement(table_of(tmp_path, text))
    assert derive_error(data, "X").tolist() == [2, 4]
    assert "Y.error" in data.values
    with pytest.raises(CellError, match=r"m.csv:2: column 'Y.error': found 'nan'"):
        derive_error(data, "Y")


@pytest.mark.parametrize(
    ("role", "cell", "match"),
    [
        ("run", "1.5", r":3: column 'k': found '1.5', expected a whole number"),
        ("X.direction", "0", r":3: column 'k': found '0', expected \+1 or -1"),
        ("X.direction", "2", r"expected \+1 or -1"),
    ],
)
def test_counts_and_directions_are_checked(
    tmp_path: Path, role: str, cell: str, match: str
) -> None:
    table = table_of(tmp_path, f"x,k\n1,1\n2,{cell}\n")
    data = measurement(table, {role: ColumnSpec("k")})
    with pytest.raises(CellError, match=match):
        data.require(role)


def test_directions_and_runs_may_be_words(tmp_path: Path) -> None:
    table = table_of(tmp_path, "x,way,lap\n1,up,b\n2,Down,a\n3,bwd,b\n")
    columns = {"X.direction": ColumnSpec("way"), "run": ColumnSpec("lap")}
    data = measurement(table, columns)
    assert data.values["X.direction"].tolist() == [1, -1, -1]
    assert data.values["run"].tolist() == [1, 2, 1]


def test_missing_role_says_what_for(tmp_path: Path) -> None:
    data = measurement(table_of(tmp_path, "X.position,y\n1,2\n3,4\n"))
    with pytest.raises(MissingRole, match=r"expected 'X.error' for the plane fit"):
        data.require("X.error", "for the plane fit")
    with pytest.raises(MissingRole, match=r"expected 'X.error' or 'X.actual' and"):
        derive_error(data, "X")


@pytest.mark.parametrize("actual", ["nan", "10.0"])
@pytest.mark.parametrize("factor", [1.0, -1.0, 0.1, 25.4])
def test_an_error_that_contradicts_the_positions_beside_it_is_refused(
    tmp_path: Path, factor: float, actual: str
) -> None:
    # Another zero is none, nor is a cell of the position that the error does without.
    errors = [0.012, -0.004, 0.007, 0.001, -0.009, 0.003, 0.011, -0.002, 0.005]
    rows = [f"{k},{k + e},{factor * e + 0.02}\n" for k, e in enumerate(errors)]
    text = "X.position,X.actual,X.error\n" + "".join(rows) + f"10,{actual},0.02\n"
    data = measurement(table_of(tmp_path, text))
    if factor == 1.0 or actual == "nan":
        assert derive_error(data, "X")[0] == pytest.approx(factor * 0.012 + 0.02)
        return
    remedy = "sign = -1" if factor < 0 else "the unit"
    words = (
        f"found 'X.error' {factor:.3g} times 'X.actual' − 'X.position', expected once"
    )
    with pytest.raises(MeasurementError, match=f"{words}: state {remedy}"):
        derive_error(data, "X")


@pytest.mark.parametrize(
    ("factor", "time", "fails"),
    [(-1.0, "", True), (1.0, "", False), (-0.01, "", False), (-1.0, "time", False)],
)
def test_an_error_that_is_command_less_encoder_is_refused_at_standstill(
    tmp_path: Path, factor: float, time: str, fails: bool
) -> None:
    errors = [0.012, -0.004, 0.007, 0.001, -0.009, 0.003, 0.011, -0.002, 0.005]
    rows = [f"{k},{k + e},{factor * e + 0.02},{k}\n" for k, e in enumerate(errors)]
    text = f"X.position,X.encoder,X.error,{time or 'note'}\n" + "".join(rows)
    data = measurement(table_of(tmp_path, text))
    if not fails:
        assert derive_error(data, "X")[0] == pytest.approx(factor * 0.012 + 0.02)
        return
    with pytest.raises(MeasurementError, match=r"'X.encoder' − 'X.position', expected"):
        derive_error(data, "X")


@pytest.mark.parametrize(
    ("step", "unit", "said"),
    [("4", "", True), ("0.004", "", False), ("4", " [ms]", False)],
)
def test_a_clock_that_may_be_in_ms_is_told_what_it_is_taken_in(
    tmp_path: Path, step: str, unit: str, said: bool
) -> None:
    rows = "".join(f"{float(step) * k},{k}\n" for k in range(9))
    data = measurement(table_of(tmp_path, f"time{unit},X.position [mm]\n{rows}"))
    words = "Column 'time' states no unit: it is taken in s, not in ms."
    assert (words in data.remarks) == said
    scale = 1e-3 if unit else 1.0
    assert data.values["time"][1] == pytest.approx(scale * float(step))


@pytest.mark.parametrize(("unit", "said"), [("", True), (" [degF]", False)])
def test_a_temperature_without_a_unit_is_told_to_be_in_degrees_celsius(
    tmp_path: Path, unit: str, said: bool
) -> None:
    text = f"X.position [mm],Temperatur{unit}\n0,68\n1,77\n"
    columns = {
        "X.position": ColumnSpec("X.position"),
        "temperature.frame": ColumnSpec("Temperatur"),
    }
    data = measurement(table_of(tmp_path, text), columns)
    words = "Column 'Temperatur' states no unit: it is taken in degC."
    assert (words in data.remarks) == said


def test_readings_of_targets_are_not_asked_for_their_clock(tmp_path: Path) -> None:
    # 50 mm in 4 ms: no axis does that.
    rows = "".join(f"{4 * k},{50 * (k % 9)}\n" for k in range(20))
    data = measurement(table_of(tmp_path, f"time,X.position [mm]\n{rows}"))
    assert not any("not in ms" in remark for remark in data.remarks)


@pytest.mark.parametrize("start", [1.79e12, 1.33e17])
def test_milliseconds_since_1970_are_no_seconds(tmp_path: Path, start: float) -> None:
    rows = "".join(f"{start + 1000 * k:.0f},{k}\n" for k in range(9))
    table = table_of(tmp_path, f"time,X.position\n{rows}")
    with pytest.raises(MeasurementError, match="without a unit, expected s: state"):
        measurement(table)


def test_error_is_actual_minus_commanded(tmp_path: Path) -> None:
    data = measurement(table_of(tmp_path, "X.position,X.actual\n1,1.25\n3,2.5\n"))
    assert derive_error(data, "X").tolist() == [0.25, -0.5]


def test_rows_in_motion_are_refused_without_an_error_column(tmp_path: Path) -> None:
    text = "X.position,X.actual,X.velocity\n1,1.25,0\n3,2.5,10\n"
    data = measurement(table_of(tmp_path, text))
    with pytest.raises(MeasurementError, match=r"line 3: found X moving at 10"):
        derive_error(data, "X")


def test_rotary_errors_are_wrapped(tmp_path: Path) -> None:
    text = "C.position,C.actual\n0,359.75\n359.5,0.25\n180,0\n"
    data = measurement(table_of(tmp_path, text), rotary=["C"])
    assert derive_error(data, "C").tolist() == [-0.25, 0.75, -180.0]


@given(angle=st.integers(-3600, 3600), turns=st.integers(-5, 5))
def test_wrapping_ignores_whole_turns(angle: int, turns: int) -> None:
    one = wrap_degrees(np.array([angle / 4.0]))
    other = wrap_degrees(np.array([angle / 4.0 + 360.0 * turns]))
    assert one[0] == other[0]  # quarters of a degree are exact in binary
    assert -180.0 <= one[0] < 180.0


def test_length_is_reduced_to_the_reference_temperature() -> None:
    position = np.array([0.0, 500.0, 1000.0])
    # Steel at 23 °C is 11.5 µm/m/K · 3 K = 34.5 µm/m too long: that is what one sees.
    seen = np.array([0.0, 0.01725, 0.0345])
    reduced = reduce_length(seen, position, expansion=11.5, material_temperature=23.0)
    np.testing.assert_allclose(reduced, 0.0, atol=1e-17)  # one product of rounding
    kept = reduce_length(
        seen,
        position,
        expansion=11.5,
        material_temperature=23.0,
        already_compensated=True,
    )
    np.testing.assert_array_equal(kept, seen)


def test_reduction_grows_from_the_datum_with_each_temperature() -> None:
    reduced = reduce_length(
        np.zeros(2),
        np.array([300.0, 300.0]),
        expansion=10.0,
        material_temperature=np.array([19.0, 22.0]),
        datum=100.0,
    )
    # 10 µm/m/K · 0.2 m · (−1 K, 2 K), taken off.
    np.testing.assert_allclose(reduced, [0.002, -0.004], rtol=1e-12)


@pytest.mark.parametrize(
    "error",
    [
        CellError("f.csv", 3, "x", "abc", "a number"),
        CellError("f.parquet", 3, "x", "nan", "a number", True),
        LineError("f", 3, "this", "that"),
        ColumnError("f", "x", ("a", "b"), "a"),
        UnitError("f", "x", "s", ("mm",), "mm"),
        RoleError("f", "x", "y", "z"),
        MissingRole("f", "x", "why", ("a",)),
        DirectionUnknown("f", "because"),
        MeasurementError("f", "because"),
    ],
)
def test_errors_survive_pickling(error: AxcompError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert (again.args, str(again)) == (error.args, str(error))


@pytest.mark.parametrize("text", ["X.position", "time", "temperature.bed", "C2.error"])
def test_roles_read_back_as_written(text: str) -> None:
    assert str(find_role(text)) == text


def turning(path: Path, angles: np.ndarray) -> Table:
    rows = "".join(f"{0.01 * k:.2f},{angle:.3f}\n" for k, angle in enumerate(angles))
    path.write_text("time [s],C.position [deg]\n" + rows)
    return read_table(path)


def test_an_angle_that_begins_anew_in_motion_is_of_an_axis_that_goes_round(
    tmp_path: Path,
) -> None:
    table = turning(tmp_path / "c.csv", np.mod(np.arange(0.0, 500.0, 1.3), 360.0))
    with pytest.raises(
        MeasurementError, match=r"358.* in motion, .* that C goes round"
    ):
        measurement(table)
    wound = measurement(table, turns={"C": 360.0}).require("C.position")
    np.testing.assert_allclose(np.diff(wound), 1.3, atol=1e-9)


def test_targets_that_begin_anew_with_each_run_are_no_turn(tmp_path: Path) -> None:
    table = turning(tmp_path / "c.csv", np.tile(np.arange(0.0, 361.0, 5.0), 3))
    assert measurement(table).require("C.position").max() == 360.0


def test_units_behind_a_slash_make_no_surface_of_a_table(tmp_path: Path) -> None:
    table = table_of(tmp_path, "t/s;x/mm;dx/um\n0;0;1\n1;50;2\n2;100;1\n")
    assert [(column.name, column.unit) for column in table.columns] == [
        ("t", "s"),
        ("x", "mm"),
        ("dx", "um"),
    ]

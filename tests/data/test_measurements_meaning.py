"""What titles, headings and words of a table say of its columns, and how it is written."""

import re
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    ColumnSpec,
    LineError,
    Measurement,
    MeasurementError,
    measurement,
    read_table,
)


def read(folder: Path, text: str | bytes, axis: str | None = "X") -> Measurement:
    path = folder / "file.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return measurement(read_table(path), axis=axis)


BODY = "0;0;1;0;1\n10;1;2;1;2\n20;2;3;2;3\n"


@pytest.mark.parametrize(
    "top",
    [
        "pos [mm];+1 [um];-1 [um];+2 [um];-2 [um]\n",
        "Run;1;1;2;2\nDirection;+;-;+;-\nTarget [mm];um;um;um;um\n",
        "Target;1;1;2;2\n;up;down;up;down\nmm;µm;µm;µm;µm\n",
        "Ziel Nr.;;;;\nSoll [mm];hin1 [um];rueck1 [um];hin2 [um];rueck2 [um]\n",
        "Soll [mm];Hinlauf 1 [um];Rücklauf 1 [um];Hinlauf 2 [um];Rücklauf 2 [um]\n",
        "Soll [mm];up 1 [um];dn 1 [um];up 2 [um];dn 2 [um]\n",
        "Soll [mm];out 1 [um];back 1 [um];out 2 [um];back 2 [um]\n",
        "Soll [mm];Hub 1 [um];Rücklauf 1 [um];Hub 2 [um];Rücklauf 2 [um]\n",
        "Soll [mm];↑ [µm];↓ [µm];↑ [µm];↓ [µm]\n",
        "Position;Lauf 1 - hin;Lauf 1 - rück;Lauf 2 - hin;Lauf 2 - rück\n"
        "[mm];[µm];[µm];[µm];[µm]\n",
        "Unit:;um;;;\nTarget;Run 1 Forward;Run 1 Reverse;Run 2 Forward;Run 2 Reverse\n",
    ],
)
def test_headings_give_runs_and_directions(tmp_path: Path, top: str) -> None:
    found = read(tmp_path, top + BODY)
    assert found.format == "run table (wide)"
    errors = np.array([0, 1, 2, 3, 2, 1] * 2) / 1000.0
    np.testing.assert_array_equal(found.require("X.error"), errors)
    assert found.require("run").tolist() == [1] * 6 + [2] * 6
    assert found.require("X.direction").tolist() == [1, 1, 1, -1, -1, -1] * 2


@pytest.mark.parametrize(
    ("words", "signs"),
    [
        ("vorwärts rückwärts", "+-"),
        ("hin zurück", "+-"),
        ("ab auf", "-+"),
        ("↑ ↓", "+-"),
        ("Forward Backward", "+-"),
        ("DOWN UP", "-+"),
        ("-> <-", "+-"),
        ("− +", "-+"),
    ],
)
def test_words_and_signs_are_directions(tmp_path: Path, words: str, signs: str) -> None:
    one, two = words.split()
    text = f"Soll;Ist;Richtung\n0;0,1;{one}\n10;10,1;{one}\n10;10,2;{two}\n"
    found = read(tmp_path, text).require("X.direction").tolist()
    assert found == [1 if signs[k] == "+" else -1 for k in (0, 0, 1)]


def test_a_direction_that_is_none_is_named_with_its_line(tmp_path: Path) -> None:
    found = read(tmp_path, "Soll;Ist;Richtung\n0;0,1;hin\n10;10,1;quer\n")
    with pytest.raises(MeasurementError, match=r":3: column 'Richtung': found 'quer'"):
        found.require("X.direction")


@pytest.mark.parametrize(
    ("text", "roles"),
    [
        ("Straightness of Y along X\nPosition;Error\n0;1\n9;2\n", "X.position Y.error"),
        (
            "Geradheitsmessung Y über X\nPosition;Lauf 1;Lauf 2\n0;1;2\n9;2;3\n",
            "X.position Y.error run",
        ),
        ("EXZ\nZ position;deviation\n0;1\n9;2\n", "Z.position X.error"),
        (
            "Straightness of X axis in Z direction\nPosition;Error\n0;1\n9;2\n",
            "X.position Z.error",
        ),
        (
            "Geradheit\nAchse;X;\nX;EYX;EZX\n0;1;2\n9;2;3\n",
            "X.position Y.error Z.error",
        ),
        ("X [mm];Y [mm];dZ [µm]\n0;1;2\n9;2;3\n", "X.position Y.position Z.error"),
        ("Z Soll;Z Ist\n0;0,1\n9;9,1\n", "Z.position Z.actual"),
        ("Axis: Y\nTarget;Error\n0;1\n9;2\n", "Y.position Y.error"),
    ],
)
def test_names_and_titles_say_the_axes(tmp_path: Path, text: str, roles: str) -> None:
    assert " ".join(read(tmp_path, text, None).values) == roles


def test_straightness_without_its_axes_is_not_taken_for_a_laser_table(
    tmp_path: Path,
) -> None:
    with pytest.raises(MeasurementError, match="without a role, expected the job to"):
        read(tmp_path, "Straightness\nPosition;Error\n0;1\n9;2\n")


def test_what_is_taken_for_granted_is_said(tmp_path: Path) -> None:
    found = read(tmp_path, "Axis: Y\nRichtung: rück\nTarget;Error\n0;1\n9;2\n")
    assert found.require("X.direction").tolist() == [-1, -1]
    said = " ".join(found.remarks)
    assert "Line 1 says that the axis is Y." in said
    assert "The file is of axis Y, and is taken for X." in said
    assert "Line 2 says 'rück': direction -1 in all rows." in said
    assert "Column 'Error' states no unit: it is taken in mm." in said


@pytest.mark.parametrize(
    ("rows", "seconds"),
    [
        ("11/20/2026;10:15:00 AM\n11/20/2026;12:15:00 PM\n", [0.0, 7200.0]),
        ("20.11.26;10:15:00,5\n20.11.26;10:15:01\n", [0.0, 0.5]),
        ("2026-11-20;23:59:59\n2026-11-21;00:00:01\n", [0.0, 2.0]),
    ],
)
def test_date_and_time_in_two_columns_are_one_clock(
    tmp_path: Path, rows: str, seconds: list[float]
) -> None:
    rows = "".join(f"{row};1,5\n" for row in rows.splitlines())
    found = read(tmp_path, f"Datum;Uhrzeit;T [°C]\n{rows}")
    assert found.require("time").tolist() == seconds
    assert found.require("temperature.t").tolist() == [1.5, 1.5]


def test_times_alone_go_on_past_midnight(tmp_path: Path) -> None:
    text = "Zeit;T [°C]\n23:59:50;1\n00:00:10;2\n00:00:40;2\n"
    assert read(tmp_path, text).require("time").tolist() == [0.0, 20.0, 50.0]


def test_a_unit_that_the_library_lacks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"found unit 'ppm', .*convert the col"):
        read(tmp_path, "Target [mm],Error [ppm]\n0,1\n1,2\n")


def test_the_form_of_a_table_is_recorded(tmp_path: Path) -> None:
    text = "Laser\n\nSoll;Abweichung\nmm;µm\n1.000,5;2,5\n2.000,5;3,5\n\nMittel;3,0\n"
    found = read(tmp_path, text.encode("cp1252"))
    form = found.form
    assert form is not None
    assert (form.separator, form.decimal, form.thousands) == (";", ",", ".")
    assert (form.titles, form.header, form.units, form.first) == ((1,), (3,), 4, 5)
    assert form.encoding == "cp1252"
    assert [(s.line, s.reason) for s in found.skipped] == [
        (1, "title"),
        (8, "below the rows"),
    ]
    assert found.require("X.position").tolist() == [1000.5, 2000.5]


def test_a_row_of_another_pattern_above_the_header_is_named(tmp_path: Path) -> None:
    with pytest.raises(LineError, match=r"csv:1: found '0,1 0,2'.*skip = \[1\]"):
        read(tmp_path, "0,1 0,2\nSoll;Ist\n0;0,1\n10;10,1\n20;20,1\n")


@pytest.mark.parametrize("encoding", ["cp850", "cp1252", "utf-16-le", "utf-16"])
def test_umlauts_of_all_systems_are_read(tmp_path: Path, encoding: str) -> None:
    text = "Soll;Ist;Richtung\n0;0,1;rückwärts\n10;10,1;rückwärts\n"
    found = read(tmp_path, text.encode(encoding))
    assert found.require("X.direction").tolist() == [-1, -1]


@pytest.mark.parametrize("encoding", ["cp850", "cp437", "cp1252", "utf-8"])
def test_micrometres_of_all_systems_are_read(tmp_path: Path, encoding: str) -> None:
    text = "Soll [mm];Abweichung [µm]\n0;0,5\n10;1,5\n20;2,5\n"
    found = read(tmp_path, text.encode(encoding))
    assert found.require("X.error").tolist() == pytest.approx([5e-4, 15e-4, 25e-4])


def test_blocks_below_one_another_are_runs(tmp_path: Path) -> None:
    """Each with a line that names run and direction, its header and its units again."""
    block = "{name}\nTarget;Error\nmm;um\n0;{k}\n10;{k}\n20;{k}\n\n"
    names = ("Run 1 (forward)", "Run 1 (reverse)", "Run 2 (forward)", "Run 2 (reverse)")
    text = "".join(block.format(name=name, k=k) for k, name in enumerate(names))
    found = read(tmp_path, f"Laser\n\n{text}")
    assert found.require("X.error").tolist() == [
        k / 1000.0 for k in range(4) for _ in range(3)
    ]
    assert found.require("run").tolist() == [1] * 6 + [2] * 6
    assert found.require("X.direction").tolist() == ([1] * 3 + [-1] * 3) * 2


def test_decimal_commas_between_commas_are_not_guessed(tmp_path: Path) -> None:
    with pytest.raises(
        LineError, match=r"2 names above 4 cells .* expected semicolons"
    ):
        read(tmp_path, "Soll,Abweichung\n0,0,1,5\n10,0,2,5\n")


@pytest.mark.parametrize(
    "text",
    [
        "Zeit;T1\nhh:mm:ss;°C\n10:00:00;20,5\n10:00:30;20,5\n",
        "DATUM:;ZEIT:;T1: °C\n20.11.26;10:15:00;+0020,5\n20.11.26;10:15:30;+0020,5\n",
    ],
)
def test_loggers_say_units_in_their_own_ways(tmp_path: Path, text: str) -> None:
    found = read(tmp_path, text)
    assert found.require("time").tolist() == [0.0, 30.0]
    assert found.require("temperature.t1").tolist() == [20.5, 20.5]


def test_stamps_without_a_header_are_the_time(tmp_path: Path) -> None:
    found = read(tmp_path, "2026-11-20 10:00:00;20,1\n2026-11-20 10:01:00;20,2\n")
    assert found.require("time").tolist() == [0.0, 60.0]


def test_a_run_that_counts_the_rows_is_no_run(tmp_path: Path) -> None:
    rows = "".join(f"{k + 1};{10 * (k % 5)};{k}\n" for k in range(10))
    found = read(tmp_path, "Messung Nr.;Soll [mm];Abweichung [µm]\n" + rows)
    assert "run" not in found.values
    assert any("counts the rows" in remark for remark in found.remarks)


TURNS = "Target [deg];Error [arcsec];Direction\n"


def test_the_order_of_targets_tells_which_direction_is_positive(tmp_path: Path) -> None:
    there = "".join(f"{k};{k};CCW\n" for k in range(5))
    back = "".join(f"{k};{k};CW\n" for k in range(4, -1, -1))
    found = read(tmp_path, TURNS + there + back, axis="C")
    assert found.require("C.direction").tolist() == [1] * 5 + [-1] * 5
    assert found.require("C.error")[4] == pytest.approx(4.0 / 3600.0)


@pytest.mark.parametrize("unit", ["m°", "mdeg", "0.001°", "1/1000°", "0,001 deg"])
def test_thousandths_of_a_degree_are_read(tmp_path: Path, unit: str) -> None:
    text = f"Target [deg];Error [{unit}]\n0;0\n90;12.5\n"
    assert read(tmp_path, text, axis="C").require("C.error").tolist() == [0.0, 0.0125]


def test_directions_that_no_order_tells_are_left_to_the_job(tmp_path: Path) -> None:
    alone = read(tmp_path, TURNS + "".join(f"{k};{k};CW\n" for k in range(5)), axis="C")
    assert "C.direction" not in alone.values
    rows = "".join(f"{k};{k};CW\n{k};{k};CCW\n" for k in range(5))
    found = read(tmp_path, TURNS + rows, axis="C")
    assert "C.direction" not in found.values
    key = '{ column = "Direction", positive = "CW" } says which is +'
    assert any(key in remark for remark in found.remarks)
    table = read_table(tmp_path / "file.csv")
    stated = {"C.direction": ColumnSpec("Direction", positive="CW")}
    assert measurement(table, stated).require("C.direction").tolist() == [1, -1] * 5


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Ist - Soll", "error"),
        *((name, None) for name in ("Soll-Ist", "Korrektur", "Komp.", "Offset value")),
        ("Pitch error comp", None),
        ("Fehlerkorrektur", None),
        ("Abweichung (Sollposition - Istposition)", None),
        ("Error (cmd - meas)", None),
        ("Sollposition - Istposition", None),
        ("Abweichung (invertiert)", None),
        ("Deviation (sign reversed)", None),
        ("Error x(-1)", None),
    ],
)
def test_targets_less_readings_and_corrections_are_no_errors_by_themselves(
    tmp_path: Path, name: str, role: str | None
) -> None:
    path = tmp_path / "file.csv"
    path.write_text(f"Soll [mm];{name} [um]\n0;1\n10;-2\n")
    table = read_table(path)
    assert table.columns[1].role == role
    if role is None:
        with pytest.raises(
            MeasurementError, match=rf'"{re.escape(name)} \[um\]", sign = -1 }}'
        ):
            measurement(table, axis="X")
    for sign in (-1, 1):
        stated = {"X.error": ColumnSpec(f"{name} [um]", sign=sign)}
        found = measurement(table, stated).require("X.error").tolist()
        assert found == [0.001 * sign, -0.002 * sign]
    # Named in a job without its sign: whoever did so may not have thought of it.
    unstated = {"X.error": ColumnSpec(f"{name} [um]")}
    if role is None:
        with pytest.raises(MeasurementError, match="state sign = -1 of the column"):
            measurement(table, unstated)
    else:
        measurement(table, unstated)


@pytest.mark.parametrize(
    ("title", "asked"),
    [
        ("Abweichung Soll - Ist in µm", True),
        ("Target minus actual [um]", True),
        ("Error = Target position - Actual position", True),
        ("Abweichung: Sollposition abzüglich Istposition", True),
        ("Abweichung = Sollwert - gemessener Wert", True),
        ("Korrekturwerte in µm", True),
        ("Korrekturwerte", True),
        ("Pitch error compensation data", True),
        ("Compensation table: achskw1.lis", False),  # what was on
        ("Correction values off", False),
        ("Abweichung nach Korrektur [µm]", False),
        ("Soll-Ist-Vergleich", False),
        ("Abweichung Ist - Soll in µm", False),
    ],
)
@pytest.mark.parametrize("names", ["Soll [mm];1 auf;1 ab", "X [mm];Fehler;T [°C]"])
def test_a_title_of_another_sign_leaves_the_errors_to_the_job(
    tmp_path: Path, title: str, asked: bool, names: str
) -> None:
    path = tmp_path / "file.csv"
    path.write_text(f"{title}\n{names}\n0;1;2\n10;-2;1\n20;-4;3\n")
    table = read_table(path)
    assert bool(table.advice) == asked
    if not asked:
        return
    with pytest.raises(MeasurementError, match=r"sign = -1"):
        measurement(table, axis="X")
    stated = {f"X.{kind}": spec for kind, spec in table.advice.items()}
    error = measurement(table, stated).require("X.error")
    unit = 1.0 if "um" not in title and "µm" not in title else 1e-3
    assert error[:3].tolist() == [-1.0 * unit, 2.0 * unit, 4.0 * unit]


def test_a_title_of_corrections_is_also_that_of_values_that_name_nothing(
    tmp_path: Path,
) -> None:
    path = tmp_path / "file.csv"
    path.write_text("Korrekturwerte\nSoll [mm];Wert [um]\n0;1\n10;-2\n20;-4\n")
    assert read_table(path).advice["error"] == ColumnSpec("Wert [um]", "um", sign=-1)


@pytest.mark.parametrize(
    "cells", ["0:00:00 30:15:00 -0:30:36", "0°00'00\" 30°15'00\" -0°30'36\""]
)
def test_degrees_minutes_and_seconds_are_angles(tmp_path: Path, cells: str) -> None:
    path = tmp_path / "file.csv"
    rows = "".join(f"{cell};{k}\n" for k, cell in enumerate(cells.split()))
    path.write_text(f"Target [deg];Deviation [asec]\n{rows}", encoding="utf-8")
    found = measurement(read_table(path), axis="C")
    assert found.require("C.position").tolist() == pytest.approx([0.0, 30.25, -0.51])
    assert found.require("C.error").tolist() == pytest.approx([0.0, 1 / 3600, 2 / 3600])


def test_trims_of_linuxcnc_are_the_negative_of_errors(tmp_path: Path) -> None:
    path = tmp_path / "x.comp"
    path.write_text("0 0.001 -0.002\n10 0.002 -0.001\n20 0.003 -0.003\n")
    table = read_table(path)
    with pytest.raises(MeasurementError, match=r"column = \"2\", sign = -1, run = 1"):
        measurement(table, axis="X")
    stated = {f"X.{kind}": spec for kind, spec in table.advice.items()}
    found = measurement(table, stated)
    assert found.require("X.error").tolist() == [-1e-3, -2e-3, -3e-3, 3e-3, 1e-3, 2e-3]
    assert found.require("X.direction").tolist() == [1] * 3 + [-1] * 3


def test_a_repeated_block_of_triplets_is_named(tmp_path: Path) -> None:
    block = "0 0.01 -0.01\n10 10.01 9.99\n20 20.01 19.99\n"
    with pytest.raises(LineError, match=r"csv:4: .*0 a second time.*rows = \[1, 3\]"):
        read(tmp_path, 2 * block)


def test_the_job_counts_the_points_of_a_centroid_table(tmp_path: Path) -> None:
    path = tmp_path / "cnc7x.tab"
    path.write_text("4 -3000\n0\n-32\n-38\n-47\n")
    table = read_table(path)
    assert table.advice["position"].interval == -1000.0
    stated = {
        "X.position": ColumnSpec("", "mm", value=0.0, interval=-40.0),
        "X.error": table.advice["error"],
    }
    found = measurement(table, stated, increments={"X": 1e-4})
    assert found.require("X.position").tolist() == [0.0, -40.0, -80.0, -120.0]
    np.testing.assert_allclose(found.require("X.error"), [0.0, 32e-4, 38e-4, 47e-4])


def test_a_value_that_the_job_states_stands_beside_the_roles_that_a_file_names(
    tmp_path: Path,
) -> None:
    path = tmp_path / "laser.csv"
    path.write_text("Soll [mm];Fehler [um]\n0;1\n10;2\n")
    stated = {"temperature.bed": ColumnSpec("", value=23.0)}
    found = measurement(read_table(path), stated, axis="X")
    assert found.require("X.error").tolist() == [1e-3, 2e-3]
    assert found.require("temperature.bed").tolist() == [23.0, 23.0]


@pytest.mark.parametrize("top", ["Error x 0.1 um\n", "Abweichung in 1/10 µm\n"])
def test_tenths_of_a_unit_are_no_whole_units(tmp_path: Path, top: str) -> None:
    found = read(tmp_path, top + "Soll [mm];Fehler\n0;1\n10;2\n")
    assert found.require("X.error").tolist() == [1e-4, 2e-4]


def test_a_unit_of_a_title_that_nobody_knows_leaves_no_default(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="found unit 'Striche'"):
        read(tmp_path, "Einheit: Striche\nSoll [mm];Fehler\n0;1\n10;2\n")


@pytest.mark.parametrize(
    "title", ["Messrichtung: negativ", "Run 1 reverse", "# Dir.: -"]
)
def test_a_title_is_the_direction_of_all_rows(tmp_path: Path, title: str) -> None:
    rows = "".join(f"{k};{k}\n" for k in range(10))
    found = read(tmp_path, f"{title}\nPosition [mm];Fehler [µm]\n{rows}")
    assert set(found.require("X.direction").tolist()) == {-1}


@pytest.mark.parametrize(
    ("title", "names"),
    [
        (
            "Achse X, Abweichung in Richtung Z, Geradheit",
            "Position [mm];Geradheit [µm]",
        ),
        ("Straightness", "X (mm);Vertical Z (um)"),
        ("2026", "X [mm];Z [µm]"),
    ],
)
def test_what_deviates_across_a_motion_is_the_error_of_another_axis(
    tmp_path: Path, title: str, names: str
) -> None:
    found = read(tmp_path, f"{title}\n{names}\n0;1\n10;2\n20;3\n", axis=None)
    assert found.require("X.position").tolist() == [0.0, 10.0, 20.0]
    assert found.require("Z.error").tolist() == [0.001, 0.002, 0.003]


def test_readings_of_laser_and_encoder_are_not_taken_for_each_other(
    tmp_path: Path,
) -> None:
    found = read(tmp_path, "t [s];Soll X;Ist X;Laser X\n0;1;2;3\n1;2;3;4\n", axis=None)
    assert "X.actual" not in found.values


def test_an_ending_of_a_temperature_is_no_axis(tmp_path: Path) -> None:
    rows = "".join(f"2026-11-20 10:00:0{k},{20 + k},{k}\n" for k in range(5))
    found = read(tmp_path, "time,T_spindle_C,dz_um\n" + rows, axis=None)
    assert found.require("temperature.t_spindle").tolist() == [20, 21, 22, 23, 24]


def test_inches_are_exact_and_said(tmp_path: Path) -> None:
    found = read(tmp_path, "Target (in),Error (mil)\n0,0\n1,1\n")
    assert found.require("X.position").tolist() == [0.0, 25.4]
    assert found.require("X.error").tolist() == [0.0, 0.0254]
    said = "In inches, of which one is 25.4 mm: 'Target', 'Error'."
    assert said in found.remarks


@pytest.mark.parametrize(
    ("name", "role"), [("X Ist-Soll", "X.error"), ("X Soll-Ist", None)]
)
def test_a_difference_with_its_axis_is_an_error_where_the_target_is_taken_off(
    tmp_path: Path, name: str, role: str | None
) -> None:
    path = tmp_path / "file.csv"
    path.write_text(f"X Soll [mm];{name} [mm];X Ist [mm]\n0;1;1\n10;-2;8\n")
    assert read_table(path).columns[1].role == role


def test_inches_behind_a_slash_are_inches(tmp_path: Path) -> None:
    found = read(tmp_path, "Soll/in;Abweichung/in\n0;0\n1;0,001\n2;0,002\n")
    np.testing.assert_allclose(found.require("X.error"), [0.0, 0.0254, 0.0508])


@pytest.mark.parametrize("name", ["error in", "error_in", "Abweichung in"])
def test_an_error_that_may_be_in_inches_is_asked_for(tmp_path: Path, name: str) -> None:
    with pytest.raises(
        MeasurementError, match=r"unit 'in\?', expected mm.*nearest: in"
    ):
        read(tmp_path, f"Target [mm];{name}\n0;0\n9;0,001\n")


def test_units_in_brackets_belong_to_the_names_that_they_stand_under(
    tmp_path: Path,
) -> None:
    rows = "".join(f"1   FWD  {10.0 * k:8.1f}  {k:8.2f}\n" for k in range(5))
    head = "Run Dir     Target      Dev.\n              [mm]      [um]\n"
    found = read(tmp_path, f"POSITIONING  AXIS X\n{head}{rows}")
    assert found.require("X.error").tolist() == [0.0, 0.001, 0.002, 0.003, 0.004]


def test_empty_columns_of_a_sheet_are_no_columns(tmp_path: Path) -> None:
    found = read(tmp_path, "Target [mm];Error [um];;\n0;1;;\n9;2;;\n")
    assert found.require("X.error").tolist() == [0.001, 0.002]


def test_a_last_line_without_the_empty_cells_of_the_others_was_cut_off(
    tmp_path: Path,
) -> None:
    with pytest.raises(LineError, match=r"found 2 cells in the last line \('9;2'\)"):
        read(tmp_path, "Target [mm];Error [um];;\n0;1;;\n5;3;;\n9;2")


@pytest.mark.parametrize("cell", ["0,66-", "(0,66)"])
def test_a_minus_of_a_book_keeper_is_named_with_its_line(
    tmp_path: Path, cell: str
) -> None:
    text = f"Target [mm];Error [um]\n0;{cell}\n9;2,5\n10;3,1\n11;2,5\n"
    with pytest.raises(MeasurementError, match=r":2: column 'Error': found '.*0,66"):
        read(tmp_path, text).require("X.error")


def test_degrees_and_minutes_are_asked_for_as_decimal_degrees(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="expected decimal degrees"):
        read(tmp_path, "Target;Error [arcsec]\n0°30';1\n1°00';2\n").require(
            "X.position"
        )


def test_an_error_without_unit_beside_inches_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_text("pos,err\n0,1\n1,2\n2,3\n")
    columns = {"X.position": ColumnSpec("pos", "in"), "X.error": ColumnSpec("err")}
    with pytest.raises(MeasurementError, match="'err': found no unit, and inches"):
        measurement(read_table(path), columns)
    columns["X.error"] = ColumnSpec("err", "thou")
    found = measurement(read_table(path), columns)
    np.testing.assert_allclose(found.require("X.error"), [0.0254, 0.0508, 0.0762])


TWO_RUNS = "0;1;2\n10;2;4\n20;3;5\n"


@pytest.mark.parametrize(
    ("names", "runs", "sides"),
    [
        ("X Target;Reading;Reading 2;Reading 3", [1, 2, 3], [None] * 3),
        ("X Target;Reading;Reading.1;Reading.2", [0, 1, 2], [None] * 3),
        ("X Pos;Dev+ (um);Dev- (um)", [1, 1], [1, -1]),
    ],
)
def test_readings_of_a_kind_side_by_side_are_runs(
    tmp_path: Path, names: str, runs: list[int], sides: list[int | None]
) -> None:
    path = tmp_path / "file.csv"
    cells = names.count(";")
    rows = "".join(f"{10 * k}" + f";{10 * k}.01" * cells + "\n" for k in range(4))
    path.write_text(f"{names}\n{rows}")
    table = read_table(path)
    assert table.axis == "X"
    assert [column.run for column in table.columns[1:]] == runs
    assert [column.direction for column in table.columns[1:]] == sides


def test_an_error_beside_that_of_another_sensor_is_no_run(tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_text("X Target;Error;Error 4\n0;1;2\n10;2;3\n20;2;2\n")
    assert all(column.run is None for column in read_table(path).columns)


@pytest.mark.parametrize(
    ("top", "roles"),
    [
        ("X [mm];Z hin 1 [µm];Z rück 1 [µm]\n", ["X.position", "Z.error", "Z.error"]),
        ("X Soll [mm];Z Lauf 1 [µm];Z Lauf 2 [µm]\n", ["X.position"] + ["Z.error"] * 2),
        (
            "Achse: X\nSoll [mm];Y up 1 [um];Y down 1 [um]\n",
            ["X.position", "Y.error", "Y.error"],
        ),
    ],
)
def test_runs_of_an_axis_other_than_that_of_the_targets_are_a_straightness(
    tmp_path: Path, top: str, roles: list[str]
) -> None:
    (tmp_path / "file.csv").write_text(top + TWO_RUNS)
    table = read_table(tmp_path / "file.csv")
    assert [column.role for column in table.columns] == roles
    assert table.across


def test_runs_across_the_axis_that_moves_are_in_the_order_of_measurement(
    tmp_path: Path,
) -> None:
    found = read(tmp_path, "X [mm];Z up 1 [um];Z down 1 [um]\n" + TWO_RUNS, axis=None)
    assert found.require("X.position").tolist() == [0, 10, 20, 20, 10, 0]


@pytest.mark.parametrize(
    ("top", "axis"),
    [
        ("Y Soll [mm];Y auf 1 [µm];Y ab 1 [µm]\n", "Y"),
        ("Soll [mm];Z up [um];Z down [um]\n", "Z"),
        ("B [deg];B up 1 [arcsec];B down 1 [arcsec]\n", "B"),
        ("Soll [mm];A 1 up [um];A 1 down [um]\n", None),  # the letter of a run
    ],
)
def test_names_of_runs_say_their_axis(
    tmp_path: Path, top: str, axis: str | None
) -> None:
    (tmp_path / "file.csv").write_text(top + TWO_RUNS)
    table = read_table(tmp_path / "file.csv")
    assert table.axis == axis
    assert table.format == "run table (wide)"


def test_readings_of_two_axes_side_by_side_are_no_runs_of_one(tmp_path: Path) -> None:
    (tmp_path / "file.csv").write_text("X [mm];Y up [um];Z up [um]\n" + TWO_RUNS)
    table = read_table(tmp_path / "file.csv")
    assert all(column.run is None for column in table.columns)


@pytest.mark.parametrize("words", ["Mittel auf;Mittel ab", "mean up;Mittelwert ↓"])
def test_a_mean_beside_the_runs_is_none_of_them(tmp_path: Path, words: str) -> None:
    runs = "1 auf [um];1 ab [um];2 auf [um];2 ab [um]"
    rows = "0;0;1;2;3;1;2\n10;1;2;3;4;2;3\n20;2;3;4;5;3;4\n"
    found = read(tmp_path, f"Soll [mm];{runs};{words}\n{rows}")
    assert found.require("run").tolist() == [1] * 6 + [2] * 6
    alone = read(tmp_path, f"Soll [mm];{words}\n0;1;2\n10;2;3\n20;3;4\n")
    assert alone.require("X.direction").tolist() == [1, 1, 1, -1, -1, -1]


@pytest.mark.parametrize(
    ("separator", "mark", "quote"), [(",", ",", '"'), (";", ",", ""), (";", ".", "")]
)
def test_targets_of_which_only_zero_has_no_mark_are_thousands(
    tmp_path: Path, separator: str, mark: str, quote: str
) -> None:
    rows = [
        ("0", "-1", "+"),
        *((f"{quote}{k}{mark}000{quote}", f"{k}", "+") for k in range(1, 6)),
    ]
    lines = [
        separator.join(row) for row in [("Target [mm]", "Error [um]", "Dir"), *rows]
    ]
    (tmp_path / "file.csv").write_text("\n".join(lines) + "\n")
    table = read_table(tmp_path / "file.csv")
    assert table.columns[0].values.tolist() == [0.0, 1e3, 2e3, 3e3, 4e3, 5e3]
    # With less than one before the mark it is that of decimals.
    (tmp_path / "file.csv").write_text(
        "\n".join(lines).replace(f"1{mark}000", f"0{mark}500")
    )
    assert read_table(tmp_path / "file.csv").columns[0].values[-1] == 5.0


def test_runs_behind_targets_of_their_own_stand_at_those(tmp_path: Path) -> None:
    top = "Vorwärts;;Rückwärts;\nSoll [mm];Abw. [µm];Soll [mm];Abw. [µm]\n"
    rows = "0;1;300;8\n100;2;200;7\n200;3;100;6\n300;4;0;5\n"
    (tmp_path / "file.csv").write_text(top + rows)
    table = read_table(tmp_path / "file.csv")
    assert [column.direction for column in table.columns] == [None, 1, None, -1]
    assert table.columns[3].values.tolist() == [5.0, 6.0, 7.0, 8.0]
    # Other places are no targets of the same table.
    (tmp_path / "file.csv").write_text(top + rows.replace("300;8", "310;8"))
    assert read_table(tmp_path / "file.csv").columns[3].direction is None


def surface(corner: str, title: str = "") -> str:
    rows = "".join(f"{30 * k};{k};{k + 1};{k + 2};{k + 3}\n" for k in range(4))
    return f"{title}{corner};0;40;80;120\n{rows}"


@pytest.mark.parametrize("corner", ["X/Y", "Y↓ X→", "Z", ""])
def test_a_surface_whose_corner_does_not_say_which_axis_goes_down_is_refused(
    tmp_path: Path, corner: str
) -> None:
    with pytest.raises(MeasurementError, match=r":2: .* expected .*: Y\\X"):
        read(tmp_path, surface(corner, "dZ [um]\n"), axis=None)


def test_a_surface_whose_corner_is_a_fraction_has_the_lower_axis_down_the_side(
    tmp_path: Path,
) -> None:
    found = read(tmp_path, surface("Y/X"), axis=None)
    assert found.require("Y.position").max() == 90.0
    assert found.require("X.position").max() == 120.0


@pytest.mark.parametrize("corner", ["Soll [mm]", "run/target mm"])
def test_numbers_of_runs_along_an_edge_make_no_surface(
    tmp_path: Path, corner: str
) -> None:
    head, *rows = surface(corner).splitlines()
    if corner == "Soll [mm]":
        head = f"{corner};1;2;3;4"
    else:
        rows = [f"{k};{row.partition(';')[2]}" for k, row in enumerate(rows, 1)]
    found = read(tmp_path, "\n".join(["X axis deviation um", head, *rows]) + "\n")
    assert len(np.unique(found.require("run"))) == 4

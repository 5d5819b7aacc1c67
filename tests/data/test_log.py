"""Controller logs: what their columns are called, their units, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import CellError, MeasurementError, log_name, read_log

HEAD = "time,A1.position,A3.cross\n"
ROWS = "0.000,10,0.001\n0.001,11,0.002\n0.002,12,0.003\n"


def written(folder: Path, text: str) -> Path:
    file = folder / "log.csv"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("text", "axis", "compensation", "filtered", "increments"),
    [
        ("A3.cross", "A3", "cross", True, False),
        ("Z.offset", "Z", "offset", True, False),
        ("V.A.CROSS_COMP_CURR.Z", "Z", "cross", True, False),
        ("v.a.lead_comp_curr.A2", "A2", "leadscrew", True, False),
        ("V. A. TEMP_COMP_CURR. X", "X", "temperature", True, False),
        ("V.A.BACKLASH_COMP_CURR[0]", None, "backlash", True, False),
        ("CROSSC::actual_offset", None, "cross", True, True),
        ("A3.CC2::correction", "A3", "plane", True, True),
        ("Axis_3.LSEC::sum epsilon", "A3", "leadscrew", True, True),
        ("TEMPC::actual_offset[2]", "A2", "temperature", True, True),
        ("BC::actual backlash", None, "backlash", True, True),
        ("CROSSTALK::end_offset.A1", "A1", "crosstalk", False, True),
    ],
)
def test_a_column_is_known_by_its_name(
    text: str, axis: str | None, compensation: str, filtered: bool, increments: bool
) -> None:
    found = log_name(text)
    assert found is not None
    assert (found.axis, found.compensation) == (axis, compensation)
    assert (found.filtered, found.increments) == (filtered, increments)


@pytest.mark.parametrize(
    "text", ["A3.position", "CROSSC::delta_offset", "CROSSC::activated", "A3.power"]
)
def test_what_is_no_offset_is_not_taken_for_one(text: str) -> None:
    assert log_name(text) is None


def test_a_state_is_told_from_an_offset() -> None:
    found = log_name("A2.CROSSC::f_is_active")
    assert found is not None
    assert (found.axis, found.compensation, found.is_state) == ("A2", "cross", True)


def test_role_of_a_compensation_that_is_named_besides_is_known() -> None:
    assert log_name("A3.twist") is None
    found = log_name("A3.twist", ("twist",))
    assert found is not None
    assert (found.axis, found.compensation) == ("A3", "twist")


def test_a_log_has_motion_offsets_and_its_cycle_time(tmp_path: Path) -> None:
    log = read_log(written(tmp_path, HEAD + ROWS))
    # Stamps of 1 ms, exact to their rounding in binary.
    assert log.cycle == pytest.approx(1e-3, rel=1e-12)
    assert [one.compensation for one in log.offsets] == ["cross"]
    np.testing.assert_array_equal(log.motion.require("A1.position"), [10, 11, 12])


def test_objects_count_in_increments_and_headers_may_state_units(
    tmp_path: Path,
) -> None:
    text = "A1.position,A3.CROSSC::actual_offset,A3.plane [um]\n0,5,7\n1,-5,8\n"
    log = read_log(written(tmp_path, text), increment=2e-4)
    cross, plane = log.offsets
    # One multiplication each: the last bit may differ.
    np.testing.assert_allclose(cross.values, [1e-3, -1e-3], rtol=1e-15)
    np.testing.assert_allclose(plane.values, [7e-3, 8e-3], rtol=1e-15)
    assert (cross.step, plane.step) == (2e-4, 0.0)


def test_increments_of_unknown_worth_are_refused(tmp_path: Path) -> None:
    text = "A1.position,CROSSC::actual_offset\n0,5\n1,6\n"
    with pytest.raises(MeasurementError, match=r"increments, .*--increment"):
        read_log(written(tmp_path, text))


def test_a_cell_that_is_no_number_is_named_with_its_line(tmp_path: Path) -> None:
    text = HEAD + ROWS.replace("0.002,12,0.003", "0.002,12,NaN")
    with pytest.raises(CellError, match=r"log\.csv:4: column 'A3\.cross'.*finite"):
        read_log(written(tmp_path, text))
    text = HEAD + ROWS.replace("0.001,11", "0.001,nan")
    with pytest.raises(CellError, match=r"log\.csv:3: column 'A1\.position'"):
        read_log(written(tmp_path, text))


def test_a_step_of_time_that_is_no_cycle_is_named_with_its_line(tmp_path: Path) -> None:
    text = HEAD + ROWS + "0.007,13,0.004\n"
    with pytest.raises(CellError, match=r"log\.csv:5: .*0\.007.*0\.003, a cycle of 1"):
        read_log(written(tmp_path, text))


def test_a_cycle_time_that_disagrees_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="cycle time of 1 ms, expected 2 ms"):
        read_log(written(tmp_path, HEAD + ROWS), cycle=2e-3)


def test_two_columns_of_one_compensation_are_refused(tmp_path: Path) -> None:
    text = "A1.position,A3.cross,V.A.CROSS_COMP_CURR.A3\n0,1,1\n1,2,2\n"
    with pytest.raises(MeasurementError, match=r"found 'A3\.cross' and .*one of them"):
        read_log(written(tmp_path, text))


def test_a_log_without_positions_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"expected a position such as A1\.pos"):
        read_log(written(tmp_path, "time,A3.cross\n0,1\n0.001,2\n"))


def test_columns_without_a_meaning_are_listed(tmp_path: Path) -> None:
    text = "A1.position,A3.cross,CROSSC::delta_offset\n0,1,0\n1,2,1\n"
    assert read_log(written(tmp_path, text)).ignored == ("CROSSC::delta_offset",)

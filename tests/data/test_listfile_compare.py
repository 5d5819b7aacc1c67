"""Offset curves of lists, and what changed between two of them."""

import math
import re

import pytest

from axcomp.data.lists import ListFile, check, compare, offset_curves
from axcomp.data.lists._curves import SIGNS


def parse(text: str) -> ListFile:
    return ListFile.parse(text.encode())


SCREW = """\
kopf.achs_nr 2
kw.ssfk.unit 1
kw.ssfk.interval 100000
kw.ssfk.kw_startpos -100000
kw.ssfk.kw_nr_max 3
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 50
kw.ssfk.table[2].pos -20
"""
PLANE = """\
kopf.achs_nr 3
kw.crosscomp2.unit 1
kw.crosscomp2.interval 100000
kw.crosscomp2.last_index_master1 2
kw.crosscomp2.last_index_master2 1
kw.crosscomp2.start_position_master1 -100000
kw.crosscomp2.start_position_master2 500000
kw.crosscomp2.master1_ax_nr 1
kw.crosscomp2.master2_ax_nr 2
kw.crosscomp2.table[0][0].correction 10
kw.crosscomp2.table[0][1].correction 20
kw.crosscomp2.table[0][2].correction 30
kw.crosscomp2.table[1][0].correction -10
kw.crosscomp2.table[1][2].correction -30
"""


CROSS = """\
kopf.achs_nr 2
kw.crosscomp.unit 1
kw.crosscomp.last_index 1
kw.crosscomp.master_ax_nr 1
kw.crosscomp.table[0].setpoint 0
kw.crosscomp.table[0].correction 5
kw.crosscomp.table[1].setpoint 100000
kw.crosscomp.table[1].correction 10
"""


def test_signs_are_the_default_conventions_of_the_models() -> None:
    from axcomp.models import Conventions

    assert SIGNS == {
        "cross": Conventions().cross_sign,
        "plane": Conventions().plane_sign,
        "leadscrew": Conventions().leadscrew_sign,
    }


def test_leadscrew_offset_is_the_negative_entry_in_microns() -> None:
    (curve,) = offset_curves(parse(SCREW))
    assert curve.nodes == ((-10.0, 0.0, 10.0),)
    assert curve.masters == (2,)
    # Entries of 0.1 µm, each an error: exact in binary but for the scale.
    assert curve.offsets[0] == pytest.approx((0.0, -5.0, 2.0), rel=1e-15)


def test_bilateral_leadscrew_has_a_curve_per_direction() -> None:
    text = SCREW + "kw.ssfk.bilateral 1\nkw.ssfk.table[1].neg 7\n"
    positive, negative = offset_curves(parse(text))
    assert (positive.branch, negative.branch) == ("positive", "negative")
    assert negative.entries == ((None, 7, None),)
    assert negative.missing == 2


def test_plane_has_master_2_along_the_first_index() -> None:
    (plane,) = offset_curves(parse(PLANE))
    assert plane.nodes == ((-10.0, 0.0, 10.0), (50.0, 60.0))
    assert plane.masters == (1, 2)
    assert plane.entries == ((10, 20, 30), (-10, None, -30))
    (row,) = plane.sample(((5.0, 99.0), (50.0,)))
    # Halfway between 2 and 3 µm, and held at the edge; sums of two floats.
    assert row == pytest.approx((2.5, 3.0), rel=1e-12)


def test_cross_table_ends_at_its_last_index() -> None:
    text = (
        "kw.crosscomp.last_index 1\n"
        "kw.crosscomp.table[0].setpoint 100\nkw.crosscomp.table[0].correction 1\n"
        "kw.crosscomp.table[1].setpoint 200\nkw.crosscomp.table[1].correction 2\n"
        "kw.crosscomp.table[2].setpoint 300\nkw.crosscomp.table[2].correction 3\n"
    )
    (curve,) = offset_curves(parse(text))
    assert curve.entries == ((1, 2),)
    assert not curve.metric
    assert curve.nodes == ((100.0, 200.0),)


def test_mistyped_index_does_not_fill_the_memory() -> None:
    text = "kw.crosscomp2.table[999999999][999999999].correction 1\n"
    (plane,) = offset_curves(parse(text))
    assert math.prod(len(axis) for axis in plane.nodes) <= 4_000_000
    assert not plane.ascending


@pytest.mark.parametrize(
    "text",
    [
        SCREW + "# comment\n",
        SCREW.replace("unit 1", "unit TRUE").replace(" 50\n", "   0050 (c)\n"),
        "\r\n".join(reversed(SCREW.splitlines())),
        SCREW.upper(),
    ],
)
def test_another_spelling_is_no_change(text: str) -> None:
    found = compare(parse(SCREW), parse(text))
    assert (found.changed, found.curves, found.action) == ((), (), "none")


def test_changes_are_named_with_old_and_new_value() -> None:
    new = SCREW.replace("[1].pos 50", "[1].pos 51").replace("kw.ssfk.unit 1\n", "")
    found = compare(parse(SCREW), parse(new + 'kopf.log_achs_name "Y 2"\n'))
    shown = {(change.name, change.old, change.new) for change in found.changed}
    assert shown == {
        ("kw.ssfk.table[1].pos", 50, 51),
        ("kopf.log_achs_name", None, "Y 2"),
        ("kw.ssfk.unit", 1, None),
    }
    assert found.action == "reload"


@pytest.mark.parametrize("value", ["12,5", "0x1F", "99999999999999999999"])
def test_a_new_value_that_cannot_be_loaded_is_a_fault(value: str) -> None:
    found = compare(
        parse(SCREW), parse(SCREW.replace("[1].pos 50", f"[1].pos {value}"))
    )
    (fault,) = found.faults
    assert "kw.ssfk.table[1].pos" in fault
    assert value in fault
    assert not compare(
        parse(SCREW), parse(SCREW.replace("[1].pos 50", "[1].pos 51"))
    ).faults


@pytest.mark.parametrize(
    ("end", "is_cut"),
    [("kw.ssfk.tab", True), ("kw.ssfk.tab\n", False), ("own.entry", False)],
)
def test_a_list_that_ends_in_an_entry_is_cut_off(end: str, is_cut: bool) -> None:
    errors = [each for each in check([parse(SCREW + end)]) if each.level == "error"]
    assert any("the file is cut off" in each.message for each in errors) == is_cut


def test_largest_change_of_the_offset_is_found_between_different_nodes() -> None:
    # Half the interval, linear in between but for one node at 5 mm.
    halves = SCREW.replace("interval 100000", "interval 50000")
    halves = halves.replace("nr_max 3", "nr_max 5")
    values = (0, 25, 50, 45, -20)
    lines = [line for line in halves.splitlines() if "table" not in line]
    lines += [f"kw.ssfk.table[{k}].pos {value}" for k, value in enumerate(values)]
    found = compare(parse(SCREW), parse("\n".join(lines)))
    (curve,) = found.curves
    # At 5 mm the old table has +1.5 µm of error, the new one +4.5 µm.
    assert curve.largest == pytest.approx(-3.0, abs=1e-6)  # rounded to a picometre
    assert curve.at == (5.0,)


def test_unilateral_table_stands_for_both_directions() -> None:
    lines = "kw.ssfk.bilateral 1\n" + "".join(
        f"kw.ssfk.table[{k}].neg {value}\n" for k, value in enumerate((0, 50, -10))
    )
    found = compare(parse(SCREW), parse(SCREW + lines))
    by_branch = {curve.branch: curve for curve in found.curves}
    assert by_branch["positive"].largest == 0
    # −10 instead of −20: the offset falls from 2 to 1 µm, rounded to a picometre.
    assert by_branch["negative"].largest == pytest.approx(-1.0, abs=1e-6)


def test_plane_change_is_found_where_it_is() -> None:
    new = PLANE.replace("[1][2].correction -30", "[1][2].correction 70")
    (curve,) = compare(parse(PLANE), parse(new)).curves
    assert (curve.largest, curve.at, curve.unit) == (10.0, (10.0, 60.0), "µm")


@pytest.mark.parametrize(
    ("text", "change", "note"),
    [
        (SCREW, ("achs_nr 2", "achs_nr 4"), "another axis is compensated"),
        (CROSS, ("achs_nr 2", "achs_nr 4"), "another axis is compensated"),
        (
            CROSS,
            ("ax_nr 1", "ax_nr 3"),
            "the position of another axis enters the table",
        ),
        (PLANE, ("master2_ax_nr 2", "master2_ax_nr 3"), "the position of another axis"),
    ],
)
def test_a_table_of_other_axes_is_not_the_same_as_before(
    text: str, change: tuple[str, str], note: str
) -> None:
    (curve,) = compare(parse(text), parse(text.replace(*change))).curves
    assert curve.largest is None
    assert note in str(curve)


def test_a_plane_with_its_masters_exchanged_adds_the_same() -> None:
    ways = str.maketrans("12", "21")
    new = re.sub(r"(interval|master)([12])", lambda m: m[0].translate(ways), PLANE)
    new = re.sub(r"\[(.)\]\[(.)\]", r"[\2][\1]", new)
    (curve,) = compare(parse(PLANE), parse(new)).curves
    assert str(curve) == "plane: the controller adds the same as before"


def test_new_and_removed_tables_are_compared_with_nothing() -> None:
    header = parse("kopf.achs_nr 2\n")
    (there,) = compare(header, parse(SCREW)).curves
    (gone,) = compare(parse(SCREW), header).curves
    assert (there.largest, there.note) == (-5.0, "new table")
    assert (gone.largest, gone.note) == (5.0, "table removed")


def test_increments_and_microns_are_not_compared() -> None:
    (curve,) = compare(parse(SCREW), parse(SCREW.replace("unit 1", "unit 0"))).curves
    assert curve.largest is None
    assert "increments" in curve.note


@pytest.mark.parametrize(
    ("line", "number"),
    [
        ("kw.ssfk.max_points 2000", "110638"),
        ("kw.crosscomp.max_points 2000", "110639"),
        ("kw.crosscomp2.max_points 20000", "110640"),
        ("frict_comp.max_points 30", "110641"),
        ("kw.crosstalk.max_points 12", "max_points changes from 0 to 12"),
    ],
)
def test_reserved_memory_needs_a_restart(line: str, number: str) -> None:
    found = compare(parse(SCREW), parse(f"{SCREW}{line}\n"))
    assert found.action == "restart"
    assert number in found.reasons[0]


@pytest.mark.parametrize("value", ["1500", "0"])
def test_writing_the_default_size_out_needs_no_restart(value: str) -> None:
    found = compare(parse(SCREW), parse(f"{SCREW}kw.ssfk.max_points {value}\n"))
    assert found.action == "reload"


def test_axis_and_start_up_lists_need_a_restart() -> None:
    for text in ("lr_param.temp_comp {}\n", "zahl_kw {}\n"):
        found = compare(parse(text.format(0)), parse(text.format(1)))
        assert found.action == "restart"
        assert "at run time" in found.reasons[0]


def test_another_axis_number_needs_a_restart() -> None:
    new = SCREW.replace("achs_nr 2", "achs_nr 4")
    assert compare(parse(SCREW), parse(new)).action == "restart"

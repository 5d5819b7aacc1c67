"""The rules of `check` between the lists of one machine."""

import pytest

from axcomp.data.lists import Finding, ListFile
from axcomp.data.lists._check import check

Brief = tuple[str, str, str | None, int | None]


def lines(entries: dict[str, object]) -> bytes:
    return "".join(f"{name} {value}\n" for name, value in entries.items()).encode()


def cross(number: int = 3, master: int = 1, **more: object) -> dict[str, object]:
    return {
        "kopf.achs_nr": number,
        "kw.crosscomp.unit": 1,
        "kw.crosscomp.master_ax_nr": master,
        "kw.crosscomp.last_index": 1,
        "kw.crosscomp.table[0].setpoint": 0,
        "kw.crosscomp.table[0].correction": 1,
        "kw.crosscomp.table[1].setpoint": 10_000,
        "kw.crosscomp.table[1].correction": 2,
        **more,
    }


def leadscrew(number: int = 3, bilateral: int = 1) -> dict[str, object]:
    return {
        "kopf.achs_nr": number,
        "kw.ssfk.unit": 1,
        "kw.ssfk.interval": 10_000,
        "kw.ssfk.kw_nr_max": 1,
        "kw.ssfk.bilateral": bilateral,
        "kw.ssfk.set_pos_without_comp": 1,
        "kw.ssfk.table[0].pos": 1,
        **({"kw.ssfk.table[0].neg": 1} if bilateral else {}),
    }


def axis(number: int | None = 3, **switches: object) -> dict[str, object]:
    head: dict[str, object] = {} if number is None else {"kopf.achs_nr": number}
    return head | {f"lr_param.{name}": value for name, value in switches.items()}


def startup(*axes: int) -> dict[str, object]:
    entries: dict[str, object] = {"zahl_kw": len(axes)}
    for i, number in enumerate(axes):
        entries[f"achs_kw_log_ax_nr[{i}]"] = number
        entries[f"achs_kw[{i}]"] = rf"..\listen\achskw{number}.lis"
    return entries


@pytest.mark.parametrize(
    ("numbers", "exchanged"), [((3, 4), False), ((4, 3), True), ((1, 2), False)]
)
def test_lists_that_hold_the_axis_of_each_other_s_name_are_doubted(
    numbers: tuple[int, int], exchanged: bool
) -> None:
    files = {
        f"achskw{k}.lis": leadscrew(n) for k, n in zip((3, 4), numbers, strict=True)
    }
    found = [one for one in findings(files) if "exchanged" in one.message]
    assert len(found) == 2 * exchanged
    assert all(one.level == "warning" for one in found)


def findings(files: dict[str, dict[str, object]], **options: object) -> list[Finding]:
    parsed = [ListFile.parse(lines(entries), name) for name, entries in files.items()]
    return check(parsed, **options)  # type: ignore[arg-type]


def serious(files: dict[str, dict[str, object]], **options: object) -> list[Brief]:
    return [
        (f.file, f.level, f.id, f.number)
        for f in findings(files, **options)
        if f.level != "info"
    ]


def test_lists_that_agree_give_neither_error_nor_warning() -> None:
    files = {
        "listen/achskw1.lis": leadscrew(1),
        "listen/achskw3.lis": cross(3, 1),
        "achsmds1.lis": axis(1, ssfk=1),
        "achsmds3.lis": axis(3, crosscomp=1),
        "hochlauf.lis": startup(1, 3),
    }
    assert serious(files) == []
    assert [f for f in findings(files) if "master" in f.message] == []


@pytest.mark.parametrize("value", [None, 0])
def test_switch_that_is_off_is_named(value: int | None) -> None:
    switches = {} if value is None else {"crosscomp": value}
    files = {"achskw3.lis": cross(), "achsmds3.lis": axis(3, ssfk=0, **switches)}
    assert serious(files) == [("achsmds3.lis", "warning", "P-AXIS-00047", None)]


def test_switch_that_an_export_turned_off_is_not_asked_for() -> None:
    files = {
        "achskw3.lis": cross(3, 3) | leadscrew(),
        "achsmds3.lis": axis(3, ssfk=1, crosscomp=1),
        "achsmds3.add.lis": axis(3, crosscomp=0, **{"ext_comp.err_limit": 5}),
    }
    (found,) = [f for f in findings(files) if f.id == "P-AXIS-00047"]
    assert found.level == "info"
    assert str(found.expected).startswith("0 if the external compensation")
    del files["achsmds3.add.lis"]["lr_param.ext_comp.err_limit"]
    (found,) = [f for f in findings(files) if f.id == "P-AXIS-00047"]
    assert (found.level, found.expected) == ("warning", "1")


@pytest.mark.parametrize(
    ("entries", "id"),
    [
        (
            {
                "kw.crosscomp2.unit": 1,
                "kw.crosscomp2.interval": 10_000,
                "kw.crosscomp2.master1_ax_nr": 1,
                "kw.crosscomp2.master2_ax_nr": 2,
                "kw.crosscomp2.table[0][0].correction": 1,
            },
            "P-AXIS-00174",
        ),
        (leadscrew(), "P-AXIS-00175"),
        (
            {
                "frict_comp.mode": 3,
                "frict_comp.table_entries": 1,
                "frict_comp.table[0].in": 1,
                "frict_comp.table[0].out": 1,
            },
            "P-AXIS-00522",
        ),
        (
            {
                "kw.crosstalk.master_dyn_ax_nr": 1,
                "kw.crosstalk.acceleration": 1000,
                "kw.crosstalk.deceleration": -1000,
                "kw.crosstalk.position[0].correction_accelerate_dir_pos": 1,
                "kw.crosstalk.position[0].correction_decelerate_dir_pos": 1,
            },
            "P-AXIS-00789",
        ),
    ],
)
def test_each_compensation_has_its_switch(entries: dict[str, object], id: str) -> None:
    files = {
        "achskw3.lis": {"kopf.achs_nr": 3, **entries},
        "achsmds3.lis": axis(3, temp_comp=0),
    }
    assert serious(files) == [("achsmds3.lis", "warning", id, None)]


def test_temperature_values_need_their_switch() -> None:
    entries = axis(3, temp_comp_offset_0=0, temp_comp_coefficient="12.5")
    assert serious({"achsmds3.lis": entries}) == [
        ("achsmds3.lis", "warning", "P-AXIS-00271", None)
    ]
    # Zero correction is the cold state that a job writes: nothing to switch on.
    assert serious({"achsmds3.lis": axis(3, temp_comp_coefficient=0)}) == []


def test_switch_without_a_table_is_refused() -> None:
    files = {"achskw3.lis": cross(), "achsmds3.lis": axis(3, crosscomp=1, ssfk=1)}
    assert serious(files) == [("achsmds3.lis", "error", "P-AXIS-00175", 70083)]


@pytest.mark.parametrize(
    ("mode", "switch", "idle"),
    [(None, 1, True), (0, 1, True), (3, 1, False), (0, 0, False)],
)
def test_friction_table_that_its_own_mode_leaves_off_is_named(
    mode: int | None, switch: int, idle: bool
) -> None:
    entries = {
        "kopf.achs_nr": 3,
        "frict_comp.table_entries": 1,
        "frict_comp.table[0].in": 1,
        "frict_comp.table[0].out": 1,
        **({} if mode is None else {"frict_comp.mode": mode}),
    }
    files = {"achskw3.lis": entries, "achsmds3.lis": axis(3, frict_comp=switch)}
    named = [("achskw3.lis", "warning", "P-COMP-00041", None)]
    assert serious(files) == (named if idle else [])


def test_switch_without_a_list_is_doubted() -> None:
    files = {
        "achskw3.lis": cross(),
        "achsmds3.lis": axis(3, crosscomp=1),
        "achsmds4.lis": axis(4, crosscomp=1),
    }
    (found,) = [f for f in findings(files) if f.level != "info"]
    assert (found.file, found.level, found.id) == (
        "achsmds4.lis",
        "warning",
        "P-AXIS-00047",
    )
    assert "gantry partner" in found.message


def test_gantry_partner_needs_a_list_of_its_own() -> None:
    files = {"achskw3.lis": cross(3)}
    expected = [("achskw3.lis", "warning", "P-COMP-00001", None)]
    assert serious(files, gantry=[(3, 4)]) == expected
    assert serious(files, gantry=[(4, 3)]) == expected
    assert serious({**files, "achskw4.lis": leadscrew(4)}, gantry=[(3, 4)]) == expected
    assert serious({**files, "achskw4.lis": cross(4)}, gantry=[(3, 4)]) == []


def test_two_lists_for_one_axis_are_refused() -> None:
    files = {"achskw3.lis": cross(3), "copy.lis": cross(3)}
    assert serious(files) == [("copy.lis", "error", "P-COMP-00001", None)]


def test_two_masters_for_one_cross_table_are_refused() -> None:
    files = {"achskw3.lis": cross(3, 1), "copy.lis": cross(3, 2)}
    assert ("copy.lis", "error", "P-COMP-00005", 70246) in serious(files)
    twice = lines(cross(3, 1)) + b"kw.crosscomp.slave_ax_nr 2\n"
    found = check([ListFile.parse(twice, "achskw3.lis")])
    assert ("error", "P-COMP-00005", 70246) in [
        (f.level, f.id, f.number) for f in found
    ]


def test_backlash_beside_a_bilateral_table_is_compensated_twice() -> None:
    entries = {**axis(3, ssfk=1, anwahl_losekomp=1), "getriebe[0].lose": 50}
    files = {"achskw3.lis": leadscrew(3), "achsmds3.lis": entries}
    assert serious(files) == [("achsmds3.lis", "warning", "P-AXIS-00021", None)]
    files["achskw3.lis"] = leadscrew(3, bilateral=0)
    assert serious(files) == []


def test_backlash_switched_off_beside_a_bilateral_table_is_right() -> None:
    entries = {**axis(3, ssfk=1, anwahl_losekomp=0), "getriebe[0].lose": 50}
    assert serious({"achskw3.lis": leadscrew(3), "achsmds3.lis": entries}) == []


def test_backlash_of_zero_that_is_switched_on_is_doubted() -> None:
    assert serious({"achsmds3.lis": axis(3, anwahl_losekomp=1)}) == [
        ("achsmds3.lis", "warning", "P-AXIS-00103", None)
    ]


@pytest.mark.parametrize(
    ("count", "interval", "doubted"),
    [
        (37, 100_000, False),  # 0 to 360°
        (36, 100_000, True),  # to 350°
        (19, 100_000, True),  # to 180°
        (8, 514_285, False),  # sevenths of the turn, rounded down
    ],
)
def test_modulo_table_goes_over_the_whole_range_of_its_axis(
    count: int, interval: int, doubted: bool
) -> None:
    entries = leadscrew(3, bilateral=0) | {"kw.ssfk.modulo": 1}
    entries |= {"kw.ssfk.kw_nr_max": count, "kw.ssfk.interval": interval}
    entries |= {f"kw.ssfk.table[{k}].pos": k % (count - 1) for k in range(count)}
    found = serious({"achskw3.lis": entries}, modulo={3: (0.0, 360.0)})
    assert found == [("achskw3.lis", "warning", "P-COMP-00022", None)][: int(doubted)]
    assert serious({"achskw3.lis": entries}, modulo={4: (0.0, 360.0)}) == []
    entries["kw.ssfk.modulo"] = 0
    assert serious({"achskw3.lis": entries}, modulo={3: (0.0, 360.0)}) == []


def test_axis_numbers_of_list_and_start_up_list_must_agree() -> None:
    files = {"listen/ACHSKW3.lis": cross(4), "hochlauf.lis": startup(1, 3)}
    assert serious(files) == [("listen/ACHSKW3.lis", "error", "P-COMP-00001", 110229)]


def named(*paths: str) -> dict[str, object]:
    """Return a start-up list of axes 3, 4, … with these files."""
    entries = startup(*range(3, 3 + len(paths)))
    return entries | {f"achs_kw[{i}]": path for i, path in enumerate(paths)}


@pytest.mark.parametrize("folder", ["", "D:/copy/"])
def test_lists_of_one_name_are_told_apart_by_their_folders(folder: str) -> None:
    files = {
        f"{folder}a/achskw.lis": cross(3),
        f"{folder}B/achskw.lis": cross(4),
        "hochlauf.lis": named(r"..\A\achskw.lis", r"..\b\ACHSKW.lis"),
    }
    assert serious(files) == []
    files[f"{folder}a/achskw.lis"] = cross(5)
    assert serious(files) == [
        (f"{folder}a/achskw.lis", "error", "P-COMP-00001", 110229)
    ]


def test_lists_of_one_name_in_other_folders_may_be_either() -> None:
    files = {
        "1/achskw.lis": cross(3),
        "2/achskw.lis": cross(5),
        "hochlauf.lis": named(r"a\achskw.lis", r"b\achskw.lis"),
    }
    assert serious(files) == [("2/achskw.lis", "error", "P-COMP-00001", 110229)]


@pytest.mark.parametrize(
    "other",
    [r"..\listen\ACHSKW3.LIS", "../listen/achskw3.lis", r"..\x\..\listen\achskw3.lis"],
)
def test_a_file_named_for_two_axes_is_found_however_it_is_spelt(other: str) -> None:
    files = {"hochlauf.lis": named(r"..\listen\achskw3.lis", other)}
    assert serious(files) == [("hochlauf.lis", "error", None, 110229)]


def test_axis_numbers_of_list_and_axis_list_must_agree() -> None:
    files = {"achskw3.lis": cross(4), "achsmds3.lis": axis(3, crosscomp=0)}
    assert serious(files) == [("achskw3.lis", "error", "P-COMP-00001", 110229)]


def test_number_in_a_name_of_the_users_own_is_no_axis() -> None:
    files = {"y2.lis": cross(4), "achsmds2.lis": axis(2, crosscomp=0)}
    assert serious(files) == []


def test_list_that_the_start_up_list_does_not_name_is_doubted() -> None:
    files = {"achskw3.lis": cross(3), "hochlauf.lis": startup(1)}
    assert serious(files) == [("hochlauf.lis", "warning", None, None)]


def test_start_up_list_names_each_axis_once_and_counts_right() -> None:
    entries = startup(1, 3)
    entries["achs_kw_log_ax_nr[1]"] = 1
    entries["zahl_kw"] = 3
    assert serious({"hochlauf.lis": entries}) == [
        ("hochlauf.lis", "warning", None, None),
        ("hochlauf.lis", "error", None, 110229),
    ]


def test_master_that_no_list_knows_is_an_info() -> None:
    files = {"achskw3.lis": cross(3, 9), "achsmds3.lis": axis(3, crosscomp=1)}
    assert serious(files) == []
    told = [f.message for f in findings(files)]
    assert (
        "none of the lists belongs to axis 9, a master of the cross compensation"
        in told
    )


def test_axis_list_without_a_number_takes_it_from_its_name() -> None:
    files = {"achskw3.lis": cross(3), "achsmds3.add.lis": axis(None, crosscomp=1)}
    assert serious(files) == []
    files["achsmds3.add.lis"] = axis(None, crosscomp=0)
    assert serious(files) == [("achsmds3.add.lis", "warning", "P-AXIS-00047", None)]


def test_fragment_adds_to_the_list_that_it_is_meant_for() -> None:
    files = {
        "achskw3.lis": cross(3),
        "achsmds3.lis": axis(3, crosscomp=0),
        "achsmds3.add.lis": axis(3, crosscomp=1),
        "hochlauf.add.lis": {
            "achs_kw_log_ax_nr[7]": 3,
            "achs_kw[7]": "achskw3.lis",
        },
    }
    assert serious(files) == []


def test_fragment_need_not_repeat_what_the_axis_list_switches_on() -> None:
    both = {**cross(3), "kw.ssfk.kw_nr_max": 2, "kw.ssfk.interval": 10_000}
    both |= {"kw.ssfk.unit": 1, "kw.ssfk.kw_startpos": 0}
    both |= {"kw.ssfk.table[0].pos": 1, "kw.ssfk.table[1].pos": 2}
    # Written for a new leadscrew table beside a cross table that is long in use.
    files = {"achskw3.lis": both, "achsmds3.add.lis": axis(None, ssfk=1)}
    assert serious(files) == []
    files["achsmds3.lis"] = axis(3, ssfk=0)
    assert serious(files) == [("achsmds3.lis", "warning", "P-AXIS-00047", None)]


def test_external_compensation_needs_a_limit() -> None:
    switch = "configuration.position_controller.enable_external_compensation_ifc"
    files = {
        "achsmds3.lis": axis(3, **{"ext_comp.warn_limit": 5}),
        "hochlauf.lis": {switch: 1},
    }
    assert serious(files) == [("achsmds3.lis", "warning", "P-AXIS-00744", 70585)]
    files["achsmds3.lis"] = axis(3, **{"ext_comp.err_limit": 5})
    assert serious(files) == []


def test_findings_come_in_the_order_of_files_and_lines() -> None:
    files = {
        "achskw4.lis": cross(
            4, **{"kw.crosscomp.n_cycles": 99, "kopf.log_achs_name": "A B"}
        ),
        "achskw3.lis": cross(3, 0),
    }
    places = [(f.file, f.line) for f in findings(files) if f.level != "info"]
    assert places == [("achskw4.lis", 9), ("achskw4.lis", 10), ("achskw3.lis", 3)]

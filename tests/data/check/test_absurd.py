"""Forty lists with one planted absurdity each: every one is found, and nothing in sound ones."""

import re

import pytest

from axcomp.data.lists import Finding, ListFile
from axcomp.data.lists._check import check

AXIS = """
kopf.achs_nr 3
lr_param.crosscomp 1
lr_param.crosscomp2 1
lr_param.ssfk 1
lr_param.frict_comp 1
lr_param.crosstalk 1
lr_param.temp_comp 1
lr_param.temp_comp_offset_0 40
lr_param.temp_comp_coefficient 12.5
lr_param.temp_comp_n_cycles 10
lr_param.anwahl_losekomp 1
getriebe[0].lose 120
lr_param.n_backlash_cyc 5
lr_param.prog_movement_requires_compensations LEAD | CROSS | TEMP
"""
LIST = """
kopf.achs_nr 3
kw.crosscomp.unit 1
kw.crosscomp.master_ax_nr 1
kw.crosscomp.last_index 2
kw.crosscomp.n_cycles 20
kw.crosscomp.table[0].setpoint 0
kw.crosscomp.table[1].setpoint 1000000
kw.crosscomp.table[2].setpoint 2000000
kw.crosscomp.table[0].correction 0
kw.crosscomp.table[1].correction -120
kw.crosscomp.table[2].correction 340
kw.crosscomp2.unit 1
kw.crosscomp2.interval 1000000
kw.crosscomp2.last_index_master1 1
kw.crosscomp2.last_index_master2 1
kw.crosscomp2.master1_ax_nr 1
kw.crosscomp2.master2_ax_nr 2
kw.crosscomp2.table[0][0].correction 10
kw.crosscomp2.table[0][1].correction -40
kw.crosscomp2.table[1][0].correction 25
kw.crosscomp2.table[1][1].correction 0
kw.ssfk.unit 1
kw.ssfk.interval 0
kw.ssfk.kw_nr_max 3
kw.ssfk.bilateral 0
kw.ssfk.table[0].setpoint -1000000
kw.ssfk.table[1].setpoint 0
kw.ssfk.table[2].setpoint 1500000
kw.ssfk.table[0].pos 30
kw.ssfk.table[1].pos 0
kw.ssfk.table[2].pos -60
frict_comp.mode 3
frict_comp.table_entries 2
frict_comp.scaling_factor 1000
frict_comp.table[0].in 100
frict_comp.table[0].out 900
frict_comp.table[1].in 200000
frict_comp.table[1].out 400
kw.crosstalk.mode 1
kw.crosstalk.master_dyn_ax_nr 1
kw.crosstalk.velocity_dependent 1
kw.crosstalk.acceleration 5000
kw.crosstalk.deceleration -5000
kw.crosstalk.position[0].correction_accelerate_dir_pos 30
kw.crosstalk.position[0].correction_accelerate_dir_neg 30
kw.crosstalk.position[0].correction_decelerate_dir_pos -30
kw.crosstalk.position[0].correction_decelerate_dir_neg -30
"""
STARTUP = """
zahl_kw 1
achs_kw_log_ax_nr[0] 3
achs_kw[0] achskw3.lis
configuration.position_controller.enable_external_compensation_ifc 0
"""
SOUND = {"achskw3.lis": LIST, "achsmds3.lis": AXIS, "hochlauf.lis": STARTUP}
INTERFACE = "configuration.position_controller.enable_external_compensation_ifc"
DEMAND = "lr_param.prog_movement_requires_compensations"
NEGATIVES = "".join(f"kw.ssfk.table[{i}].neg {v}\n" for i, v in enumerate((30, 0, -60)))
BOTH_WAYS = f"kw.ssfk.bilateral 1\nkw.ssfk.set_pos_without_comp 1\n{NEGATIVES}"
BOTH_WAYS += "lr_param.anwahl_losekomp 0\n"
"""A table for both directions, beside which the backlash is off."""
EVEN = "kw.ssfk.interval 1000000\n" + "".join(
    f"kw.ssfk.table[{i}].setpoint -\n" for i in range(3)
)
"""Equidistant points: no setpoints."""

Planted = tuple[str, str, str]

ABSURD: list[Planted] = [
    # what the kernel reports, by its number
    ("setpoints that fall", "kw.crosscomp.table[1].setpoint 3000000", "error P-COMP-00006 70245"),
    ("a cross table of axis 0", "kw.crosscomp.master_ax_nr 0", "error P-COMP-00005 70246"),
    ("a cross table without a master", "kw.crosscomp.master_ax_nr -", "error P-COMP-00005 70246"),
    ("a cross table of 5000 points", "kw.crosscomp.last_index 5000", "error P-COMP-00004 70432"),
    ("200 cycles to switch a cross table", "kw.crosscomp.n_cycles 200", "error P-COMP-00026 70229"),
    ("200 cycles to switch a plane", "kw.crosscomp2.n_cycles 200", "error P-COMP-00027 70256"),
    ("a plane without a master", "kw.crosscomp2.master2_ax_nr -", "error P-COMP-00015 70182"),
    ("a plane of no width", "kw.crosscomp2.interval 0", "error P-COMP-00009 70430"),
    ("a plane of negative width", "kw.crosscomp2.interval -5", "error P-COMP-00009 70560"),
    ("a round plane", "kw.crosscomp2.grid ROUND", "error P-COMP-00031 70478"),
    ("a plane too large for its memory", "kw.crosscomp2.last_index_master1 200",
     "error P-COMP-00010 70610"),
    ("a leadscrew table of 9000 points", "kw.ssfk.kw_nr_max 9000", "error P-COMP-00020 110217"),
    ("a jump of 1 mm at reversal", f"{BOTH_WAYS}kw.ssfk.table[1].neg 9999",
     "warning P-COMP-00023 110474"),
    ("a change of 0.9 mm between points", "kw.ssfk.table[1].pos 9000",
     "warning P-COMP-00023 110476"),
    ("a position beyond SGN32", "kw.ssfk.table[2].setpoint 3000000000",
     "warning P-COMP-00025 110477"),
    ("a start beyond SGN32", f"{EVEN}kw.ssfk.kw_startpos 3000000000", "error P-COMP-00019 110477"),
    ("a leadscrew error of 4 mm", "kw.ssfk.table[1].pos 40000", "warning P-COMP-00023 110478"),
    ("a negative distance of points", "kw.ssfk.interval -10", "error P-COMP-00018 110479"),
    ("points 150 m apart", "kw.ssfk.table[2].setpoint 1500000000", "warning P-COMP-00025 110480"),
    ("leadscrew points that fall", "kw.ssfk.table[2].setpoint -5", "error P-COMP-00025 110590"),
    ("velocities that fall", "frict_comp.table[1].in 50", "error P-COMP-00046 110591"),
    ("an unknown friction mode", "frict_comp.mode 7", "error P-COMP-00041 110592"),
    ("crosstalk of axis 0", "kw.crosstalk.master_dyn_ax_nr 0", "error P-COMP-00063 70627"),
    ("crosstalk over two axes that are one", "kw.crosstalk.mode 3\nkw.crosstalk.max_points 1\n"
     "kw.crosstalk.master_pos1_ax_nr 2\nkw.crosstalk.master_pos2_ax_nr 2",
     "error P-COMP-00081 70658"),
    ("a deceleration that accelerates", "kw.crosstalk.deceleration 5000",
     "error P-COMP-00067 70659"),
    ("60 cycles for the backlash", "lr_param.n_backlash_cyc 60", "error P-AXIS-00243 110392"),
    ("99999 µm/m", "lr_param.temp_comp_coefficient 99999", "error P-AXIS-00274 70259"),
    ("a list of another axis", "achs_kw_log_ax_nr[0] 4", "error P-COMP-00001 110229"),
    ("an interface that is open without limits", f"{INTERFACE} 1", "warning P-AXIS-00744 70585"),
    ("limits of an interface that is closed", "lr_param.ext_comp.err_limit 500",
     "warning P-STUP-00110 70587"),
    # what the kernel takes, named as a warning
    ("a cross table of 500 mm", "kw.crosscomp.table[2].correction 5000000",
     "warning P-COMP-00007 None"),
    ("a plane with a spike of 0.5 mm", "kw.crosscomp2.table[1][0].correction 5000",
     "warning P-COMP-00016 None"),
    ("a thermal offset of 500 mm", "lr_param.temp_comp_offset_0 5000000",
     "warning P-AXIS-00273 None"),
    ("9999 µm/m", "lr_param.temp_comp_coefficient 9999", "warning P-AXIS-00274 None"),
    ("3 mm of backlash in one cycle", "getriebe[0].lose 30000\nlr_param.n_backlash_cyc -",
     "warning P-AXIS-00243 None"),
    ("friction that pushes", "frict_comp.table[1].out -400", "warning P-COMP-00047 None"),
    ("friction turned round by its scale", "frict_comp.scaling_factor -1000",
     "warning P-COMP-00045 None"),
    ("an axis that is its own master", "kw.crosscomp.master_ax_nr 3", "warning P-COMP-00005 None"),
    ("an axis shaken by itself", "kw.crosstalk.master_dyn_ax_nr 3", "warning P-COMP-00063 None"),
    ("a demand for what is off", f"lr_param.crosscomp2 0\n{DEMAND} PLANE",
     "warning P-AXIS-00465 None"),
]  # fmt: skip


OPEN = f"{INTERFACE} 1\nlr_param.ext_comp.err_limit 500\n"
FURTHER: list[Planted] = [
    ("limits of 0 mm/s²", f"{OPEN}lr_param.ext_comp.max_a 0", "warning P-AXIS-00745 70585"),
    ("limits of 1000 m/s²", f"{OPEN}lr_param.ext_comp.max_a 1000000",
     "warning P-AXIS-00745 None"),
    ("a warning after the stop", f"{OPEN}lr_param.ext_comp.warn_limit 900",
     "warning P-AXIS-00744 None"),
    ("0.1 mm over 1 µm of a leadscrew", "kw.ssfk.table[2].setpoint 10\nkw.ssfk.table[2].pos 1000",
     "warning P-COMP-00023 110476"),
    ("0.1 mm over 1 mm of a cross table", "kw.crosscomp.table[1].setpoint 10000\n"
     "kw.crosscomp.table[1].correction 1000", "warning P-COMP-00007 None"),
    ("0.1 mm over 1 mm of a plane", "kw.crosscomp2.interval 10000\n"
     "kw.crosscomp2.table[0][1].correction 1010", "warning P-COMP-00016 None"),
    ("0.1 mm over 1 mm along master 2", "kw.crosscomp2.grid RECTANGULAR\n"
     "kw.crosscomp2.interval1 1000000\nkw.crosscomp2.interval2 10000\n"
     "kw.crosscomp2.table[1][0].correction 1010", "warning P-COMP-00016 None"),
    ("points of a plane 0.1 µm apart", "kw.crosscomp2.interval 1", "warning P-COMP-00009 None"),
    ("points of a leadscrew 0.1 µm apart", EVEN.replace("1000000", "1"),
     "warning P-COMP-00018 None"),
    ("a point 200 m away", "kw.crosscomp.table[2].setpoint 2000000000",
     "warning P-COMP-00006 None"),
    ("a plane 200 m away", "kw.crosscomp2.start_position_master2 -2000000000",
     "warning P-COMP-00013 None"),
    ("a thermal zero 200 m away", "lr_param.temp_comp_position_0 2000000000",
     "warning P-AXIS-00272 None"),
    ("friction scaled to nothing", "frict_comp.scaling_factor 0", "warning P-COMP-00045 None"),
    ("friction beyond 16 bits", "frict_comp.table[0].out 40000", "warning P-COMP-00047 None"),
    ("points of a cross table 0.1 µm apart", "kw.crosscomp.table[1].setpoint 1",
     "warning P-COMP-00006 None"),
    ("points of a leadscrew in mm", "kw.ssfk.table[0].setpoint 0\nkw.ssfk.table[1].setpoint 100\n"
     "kw.ssfk.table[2].setpoint 200", "warning P-COMP-00025 None"),
    ("a distance of points in mm", EVEN.replace("1000000", "100"), "warning P-COMP-00018 None"),
    ("accelerations in m/s²", "kw.crosstalk.acceleration 5", "warning P-COMP-00066 None"),
    ("decelerations in m/s²", "kw.crosstalk.deceleration -5", "warning P-COMP-00067 None"),
    ("memory for 10⁹ points", "kw.crosscomp.max_points 1000000000", "warning P-COMP-00060 None"),
    ("a plane over its own axis", "kw.crosscomp2.master1_ax_nr 3", "warning P-COMP-00014 None"),
    ("a list for axis 0", "achs_kw_log_ax_nr[0] 0", "error None 110229"),
    ("one list for two axes", "zahl_kw 2\nachs_kw[1] achskw3.lis\nachs_kw_log_ax_nr[1] 4",
     "error None 110229"),
]  # fmt: skip


def planted(changes: str) -> dict[str, str]:
    """Return the sound lists with entries replaced, added, or (``-``) left out."""
    lists = dict(SOUND)
    for change in changes.strip().splitlines():
        name, _, value = change.partition(" ")
        files = [file for file, text in lists.items() if f"\n{name} " in text]
        axis = name.startswith(("lr_param.", "getriebe"))
        file = files[0] if files else "achsmds3.lis" if axis else "achskw3.lis"
        file = "hochlauf.lis" if name.startswith("achs_kw") else file
        line = "" if value == "-" else f"{change}\n"
        kept = re.sub(rf"^{re.escape(name)} .*\n", "", lists[file], flags=re.MULTILINE)
        lists[file] = kept + line
    return lists


def serious(lists: dict[str, str]) -> list[Finding]:
    """Return the errors and warnings of a machine's lists."""
    files = [ListFile.parse(text.encode(), name) for name, text in lists.items()]
    return [finding for finding in check(files) if finding.level != "info"]


def test_there_are_forty_of_them() -> None:
    assert len(ABSURD) == len({changes for _, changes, _ in ABSURD}) == 40


def test_sound_lists_have_no_finding() -> None:
    assert serious(SOUND) == []
    assert serious(planted(BOTH_WAYS)) == []
    assert serious(planted(EVEN)) == []


@pytest.mark.parametrize(
    ("changes", "expected"),
    [(changes, expected) for _, changes, expected in ABSURD + FURTHER],
    ids=[name for name, _, _ in ABSURD + FURTHER],
)
def test_absurdity_is_found_with_its_number_or_named(
    changes: str, expected: str
) -> None:
    found = serious(planted(changes))
    assert expected in [f"{one.level} {one.id} {one.number}" for one in found]


def test_increments_are_judged_where_their_length_is_known() -> None:
    lists = planted("kw.crosscomp.unit 0\nkw.crosscomp.table[2].correction 5000")
    files = [ListFile.parse(text.encode(), name) for name, text in lists.items()]

    def wild(increment: float | None) -> bool:
        found = check(files, increment=increment)
        return any("sound machine" in finding.message for finding in found)

    assert not wild(None)
    assert not wild(1e-6)  # 5 µm
    assert wild(1e-3)  # 5 mm


def test_demand_is_not_doubted_where_the_switch_may_stand_in_the_whole_list() -> None:
    added = {"achsmds3.add.lis": f"\n{DEMAND} LEAD\n"}
    assert serious(added) == []
    assert (
        serious({**added, "achsmds3.lis": "\nkopf.achs_nr 3\nlr_param.ssfk 1\n"}) == []
    )
    (found,) = serious({**added, "achsmds3.lis": "\nkopf.achs_nr 3\nlr_param.ssfk 0\n"})
    assert (found.file, found.id) == ("achsmds3.add.lis", "P-AXIS-00465")


def test_backlash_is_spread_by_whatever_list_of_the_axis_says_so() -> None:
    whole = "\nkopf.achs_nr 3\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 3000\n"
    added = {"achsmds3.add.lis": "\nlr_param.n_backlash_cyc 9\n"}
    assert [one.id for one in serious({"achsmds3.lis": whole})] == ["P-AXIS-00243"]
    assert serious({"achsmds3.lis": whole, **added}) == []


def test_open_interface_alone_is_a_remark_that_names_the_limits() -> None:
    text = STARTUP.replace(f"{INTERFACE} 0", f"{INTERFACE} 1")
    found = check([ListFile.parse(text.encode(), "hochlauf.lis")])
    assert [(one.level, one.number) for one in found] == [("info", 70585)]

"""The rules of `check` for a single list: one change to a complete one, one finding."""

from collections.abc import Callable

import pytest

Entries = dict[str, object]
Brief = tuple[str, str | None, int | None]

TEST = (
    "correction_accelerate_dir_pos",
    "correction_accelerate_dir_neg",
    "correction_decelerate_dir_pos",
    "correction_decelerate_dir_neg",
)
NO_TABLE: Entries = {
    f"kw.crosscomp2.table[{j}][{i}].correction": None
    for j in range(2)
    for i in range(3)
}

RULES: list[tuple[str, str | Entries, Entries, list[Brief]]] = [
    # types: never wrapped
    (
        "a value beyond SGN32",
        "cross",
        {"kw.crosscomp.table[1].correction": 2**31},
        [("error", "P-COMP-00007", None)],
    ),
    (
        "a value beyond SGN32 that would wrap to 5",
        "plane",
        {"kw.crosscomp2.table[1][1].correction": 2**32 + 5},
        [("error", "P-COMP-00016", None)],
    ),
    (
        "the largest SGN32, which the range leaves out",
        "cross",
        {"kw.crosscomp.table[1].correction": 2**31 - 1},
        [("error", "P-COMP-00007", None)],
    ),
    (
        "a negative axis number",
        "cross",
        {"kopf.achs_nr": -1},
        [("error", "P-COMP-00001", None)],
    ),
    (
        "axis number 0",
        "cross",
        {"kopf.achs_nr": 0},
        [("error", "P-COMP-00001", None)],
    ),
    (
        "hexadecimal, which is no list integer (S-08)",
        "cross",
        {"kw.crosscomp.n_cycles": "0x0A"},
        [("error", "P-COMP-00026", 70229)],
    ),
    (
        "a BOOLEAN of 2",
        "cross",
        {"kw.crosscomp.unit": 2},
        [("error", "P-COMP-00003", None)],
    ),
    # header
    (
        "no axis number",
        "cross",
        {"kopf.achs_nr": None},
        [("error", "P-COMP-00001", None)],
    ),
    (
        "a long name",
        "cross",
        {"kopf.log_achs_name": "SEVENTEEN_LETTERS"},
        [("warning", "P-COMP-00002", None)],
    ),
    # cross
    (
        "no cross master",
        "cross",
        {"kw.crosscomp.master_ax_nr": None},
        [("error", "P-COMP-00005", 70246)],
    ),
    (
        "cross master 0",
        "cross",
        {"kw.crosscomp.master_ax_nr": 0},
        [("error", "P-COMP-00005", 70246)],
    ),
    (
        "an axis that is its own master",
        "cross",
        {"kw.crosscomp.master_ax_nr": 3},
        [("warning", "P-COMP-00005", None)],
    ),
    (
        "too many cycles",
        "cross",
        {"kw.crosscomp.n_cycles": 21},
        [("error", "P-COMP-00026", 70229)],
    ),
    (
        "no unit: increments (S-14)",
        "cross",
        {"kw.crosscomp.unit": None},
        [("warning", "P-COMP-00003", None)],
    ),
    (
        "equal setpoints",
        "cross",
        {"kw.crosscomp.table[2].setpoint": 0},
        [("error", "P-COMP-00006", 70245)],
    ),
    (
        "a missing setpoint that 0 stands in for",
        "cross",
        {"kw.crosscomp.table[1].setpoint": None},
        [("warning", "P-COMP-00006", None)],
    ),
    (
        "a missing setpoint that 0 does not stand in for",
        "cross",
        {"kw.crosscomp.table[2].setpoint": None},
        [("error", "P-COMP-00006", 70245)],
    ),
    (
        "a missing correction (S-57)",
        "cross",
        {"kw.crosscomp.table[2].correction": None},
        [("warning", "P-COMP-00007", None)],
    ),
    (
        "an index beyond last_index",
        "cross",
        {"kw.crosscomp.table[3].correction": 1},
        [("error", "P-COMP-00007", None)],
    ),
    (
        "a second index, as one page prints it (S-58)",
        "cross",
        {"kw.crosscomp.table[0][0].correction": 1},
        [("warning", None, None)],
    ),
    # plane
    (
        "no plane master",
        "plane",
        {"kw.crosscomp2.master2_ax_nr": None},
        [("error", "P-COMP-00015", 70182)],
    ),
    (
        "twice the same plane master",
        "plane",
        {"kw.crosscomp2.master2_ax_nr": 1},
        [("warning", "P-COMP-00015", None)],
    ),
    (
        "an interval of 0",
        "plane",
        {"kw.crosscomp2.interval1": 0},
        [("error", "P-COMP-00032", 70430)],
    ),
    (
        "a negative interval",
        "plane",
        {"kw.crosscomp2.interval2": -5},
        [("error", "P-COMP-00033", 70560)],
    ),
    (
        "a missing interval",
        "plane",
        {"kw.crosscomp2.interval2": None},
        [("error", "P-COMP-00033", 70430)],
    ),
    (
        "one interval for a rectangular grid and none for each",
        "plane",
        {
            "kw.crosscomp2.interval": 1000,
            "kw.crosscomp2.interval1": None,
            "kw.crosscomp2.interval2": None,
        },
        [("error", "P-COMP-00032", 70430), ("error", "P-COMP-00033", 70430)],
    ),
    (
        "a square grid without its interval",
        "plane",
        {"kw.crosscomp2.grid": "QUADRATIC"},
        [("error", "P-COMP-00009", 70430)],
    ),
    (
        "an unknown grid",
        "plane",
        {"kw.crosscomp2.grid": "HEXAGONAL", "kw.crosscomp2.interval": 7000},
        [("error", "P-COMP-00031", 70478)],
    ),
    (
        "a plane without any table entry",
        "plane",
        NO_TABLE,
        [("error", "P-COMP-00016", 70183)],
    ),
    (
        "a missing plane entry",
        "plane",
        {"kw.crosscomp2.table[1][1].correction": None},
        [("warning", "P-COMP-00016", None)],
    ),
    # leadscrew
    (
        "setpoints that do not ascend",
        "leadscrew",
        {"kw.ssfk.table[1].setpoint": 1000},
        [("error", "P-COMP-00025", 110590)],
    ),
    (
        "an index of kw_nr_max (S-19)",
        "leadscrew",
        {"kw.ssfk.table[3].pos": 1},
        [("warning", "P-COMP-00023", None)],
    ),
    (
        "an index beyond kw_nr_max",
        "leadscrew",
        {"kw.ssfk.table[4].pos": 1},
        [("error", "P-COMP-00023", None)],
    ),
    (
        "a value beyond SGN16 (S-22)",
        "leadscrew",
        {"kw.ssfk.table[1].neg": 40000},
        [("warning", "P-COMP-00024", 110478)],
    ),
    (
        "a setpoint beyond SGN32 (S-22)",
        "leadscrew",
        {"kw.ssfk.table[2].setpoint": 2**31},
        [("warning", "P-COMP-00025", 110477)],
    ),
    (
        "no size beside a table",
        "leadscrew",
        {"kw.ssfk.kw_nr_max": None},
        [("error", "P-COMP-00020", 70083)],
    ),
    (
        "no table beside a size",
        {
            "kopf.achs_nr": 3,
            "kw.ssfk.unit": 1,
            "kw.ssfk.interval": 1000,
            "kw.ssfk.kw_nr_max": 4,
        },
        {},
        [("error", "P-COMP-00023", 70083)],
    ),
    (
        "a missing value for one direction",
        "leadscrew",
        {"kw.ssfk.table[2].neg": None},
        [("warning", "P-COMP-00024", None)],
    ),
    (
        "a modulo table whose ends differ (S-20)",
        "leadscrew",
        {"kw.ssfk.modulo": 1},
        [("warning", "P-COMP-00022", None), ("warning", "P-COMP-00022", None)],
    ),
    (
        "a modulo table with a gap (S-20)",
        "leadscrew",
        {
            "kw.ssfk.modulo": 1,
            "kw.ssfk.bilateral": 0,
            "kw.ssfk.table[2].pos": 0,
            "kw.ssfk.table[1].pos": None,
        },
        [("error", "P-COMP-00023", 70431)],
    ),
    # friction
    (
        "velocities that do not ascend",
        "friction",
        {"frict_comp.table[1].in": 1},
        [("error", "P-COMP-00046", 110591)],
    ),
    (
        "a negative velocity",
        "friction",
        {"frict_comp.table[0].in": -1},
        [("error", "P-COMP-00046", 110591)],
    ),
    (
        "a velocity of 0 (S-26)",
        "friction",
        {"frict_comp.table[0].in": 0},
        [("warning", "P-COMP-00046", 110591)],
    ),
    (
        "an unknown mode",
        "friction",
        {"frict_comp.mode": 2},
        [("error", "P-COMP-00041", 110592)],
    ),
    (
        "a mode without entries",
        {"kopf.achs_nr": 3, "frict_comp.mode": 3, "frict_comp.table_entries": 0},
        {},
        [("error", "P-COMP-00042", 110592)],
    ),
    (
        "a mode without a size",
        "friction",
        {"frict_comp.table_entries": None},
        [("error", "P-COMP-00042", 110592)],
    ),
    (
        "a delay of 249 cycles",
        "friction",
        {"frict_comp.delay_cycles": 249},
        [("error", "P-COMP-00058", None)],
    ),
    (
        "a long lookahead",
        "friction",
        {"frict_comp.reversal_lookahead": 5},
        [("error", "P-COMP-00044", None)],
    ),
    # crosstalk
    (
        "no master of the acceleration",
        "crosstalk",
        {"kw.crosstalk.master_dyn_ax_nr": None},
        [("error", "P-COMP-00063", 70622)],
    ),
    (
        "an acceleration of 0",
        "crosstalk",
        {"kw.crosstalk.acceleration": 0},
        [("error", "P-COMP-00066", 70659)],
    ),
    (
        "a positive deceleration",
        "crosstalk",
        {"kw.crosstalk.deceleration": 1000},
        [("error", "P-COMP-00067", 70659)],
    ),
    (
        "no deceleration",
        "crosstalk",
        {"kw.crosstalk.deceleration": None},
        [("error", "P-COMP-00067", 70659)],
    ),
    (
        "positions in the wrong order",
        "crosstalk",
        {"kw.crosstalk.position[2].ax_1": 50},
        [("error", "P-COMP-00085", 70660)],
    ),
    (
        "fewer than three tests in mode 2 (S-37)",
        "crosstalk",
        {
            "kw.crosstalk.max_points": 2,
            **{f"kw.crosstalk.position[2].{name}": None for name in (*TEST, "ax_1")},
        },
        [("warning", "P-COMP-00083", None)],
    ),
    (
        "a test without one of its four values",
        "crosstalk",
        {"kw.crosstalk.position[1].correction_decelerate_dir_neg": None},
        [("warning", "P-COMP-00090", None)],
    ),
    (
        "mode 3 with one adaptation axis for both",
        "crosstalk",
        {
            "kw.crosstalk.mode": 3,
            "kw.crosstalk.master_pos2_ax_nr": 2,
            **{f"kw.crosstalk.position[{i}].ax_2": 7 * (i == 1) for i in range(3)},
        },
        [("error", "P-COMP-00081", 70658)],
    ),
    (
        "mode 3 without its second axis",
        "crosstalk",
        {
            "kw.crosstalk.mode": 3,
            **{f"kw.crosstalk.position[{i}].ax_2": 7 * (i == 1) for i in range(3)},
        },
        [("error", "P-COMP-00081", 70657)],
    ),
    (
        "mode 3 with a place twice",
        "crosstalk",
        {
            "kw.crosstalk.mode": 3,
            "kw.crosstalk.master_pos2_ax_nr": 4,
            "kw.crosstalk.position[1].ax_1": 0,
            **{f"kw.crosstalk.position[{i}].ax_2": 0 for i in range(3)},
        },
        [("error", "P-COMP-00085", 70660)],
    ),
    (
        "mode 3 with its tests on one line",
        "crosstalk",
        {
            "kw.crosstalk.mode": 3,
            "kw.crosstalk.master_pos2_ax_nr": 4,
            **{f"kw.crosstalk.position[{i}].ax_2": 5 for i in range(3)},
        },
        [("warning", "P-COMP-00085", None)],
    ),
    (
        "mode 3 without an order",
        "crosstalk",
        {
            "kw.crosstalk.mode": 3,
            "kw.crosstalk.master_pos2_ax_nr": 4,
            "kw.crosstalk.position[0].ax_1": 500,
            "kw.crosstalk.position[0].ax_2": 7,
            "kw.crosstalk.position[1].ax_2": 9,
            "kw.crosstalk.position[2].ax_2": 3,
        },
        [("warning", "P-COMP-00085", 70660)],
    ),
    (
        "both forms of the list (S-41)",
        "crosstalk",
        {"kw.crosstalk.table[0].acceleration": 1000},
        [("error", "P-COMP-00066", None)],
    ),
    (
        "the older form without its master",
        "old_crosstalk",
        {"kw.crosstalk.master_ax_nr": None},
        [("error", "P-COMP-00063", 70622)],
    ),
    (
        "the older form with six points",
        "old_crosstalk",
        {
            "kw.crosstalk.last_index": 5,
            **{f"kw.crosstalk.table[{i}].acceleration": 2000 + i for i in range(2, 6)},
            **{f"kw.crosstalk.table[{i}].correction": 1 for i in range(2, 6)},
        },
        [("error", "P-COMP-00065", None)],
    ),
    # names
    (
        "a misspelt name",
        "leadscrew",
        {"kw.ssfk.intervall": 1},
        [("warning", None, None)],
    ),
    ("an entry that real lists hold", "leadscrew", {"kw.ssfk.res1": 0}, []),
    (
        "an entry of an axis list",
        "leadscrew",
        {"lr_param.ssfk": 1},
        [("warning", "P-AXIS-00175", None)],
    ),
]


@pytest.mark.parametrize(
    ("base", "changes", "expected"),
    [rule[1:] for rule in RULES],
    ids=[rule[0] for rule in RULES],
)
def test_list_is_refused_or_doubted_as_the_manuals_do(
    base: str | Entries,
    changes: Entries,
    expected: list[Brief],
    complete: Callable[[str], Entries],
    judge: Callable[[Entries], list[Brief]],
) -> None:
    assert judge(
        {**(complete(base) if isinstance(base, str) else base), **changes}
    ) == sorted(expected, key=str)

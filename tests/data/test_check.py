"""The rules of `check` for a single list, one by one."""

import dataclasses
import json

import pytest
from hypothesis import given, settings, strategies as st

from axcomp.data.lists import Finding, ListFile, new_list, registry
from axcomp.data.lists._check import check
from axcomp.data.lists._registry import BuildError
from axcomp.data.lists._remarks import REMARKS, RemarkCode

HEADER = {"kopf.achs_nr": 3}
CROSS = {
    **HEADER,
    "kw.crosscomp.unit": 1,
    "kw.crosscomp.master_ax_nr": 1,
    "kw.crosscomp.last_index": 2,
    **{f"kw.crosscomp.table[{i}].setpoint": 1000 * i - 1000 for i in range(3)},
    **{f"kw.crosscomp.table[{i}].correction": 5 * i for i in range(3)},
}
PLANE = {
    **HEADER,
    "kw.crosscomp2.unit": 1,
    "kw.crosscomp2.grid": "RECTANGULAR",
    "kw.crosscomp2.interval1": 10000,
    "kw.crosscomp2.interval2": 20000,
    "kw.crosscomp2.last_index_master1": 2,
    "kw.crosscomp2.last_index_master2": 1,
    "kw.crosscomp2.master1_ax_nr": 1,
    "kw.crosscomp2.master2_ax_nr": 2,
    **{
        f"kw.crosscomp2.table[{j}][{i}].correction": i - j
        for j in range(2)
        for i in range(3)
    },
}
LEADSCREW = {
    **HEADER,
    "kw.ssfk.unit": 1,
    "kw.ssfk.interval": 0,
    "kw.ssfk.kw_nr_max": 3,
    "kw.ssfk.bilateral": 1,
    "kw.ssfk.set_pos_without_comp": 1,
    **{f"kw.ssfk.table[{i}].setpoint": 500 * i for i in range(3)},
    **{f"kw.ssfk.table[{i}].pos": 3 * i for i in range(3)},
    **{f"kw.ssfk.table[{i}].neg": -3 * i for i in range(3)},
}
FRICTION = {
    **HEADER,
    "frict_comp.mode": 3,
    "frict_comp.table_entries": 2,
    "frict_comp.scaling_factor": 1000,
    "frict_comp.table[0].in": 1,
    "frict_comp.table[0].out": 10,
    "frict_comp.table[1].in": 500,
    "frict_comp.table[1].out": 7,
}
TEST = (
    "correction_accelerate_dir_pos",
    "correction_accelerate_dir_neg",
    "correction_decelerate_dir_pos",
    "correction_decelerate_dir_neg",
)
CROSSTALK = {
    **HEADER,
    "kw.crosstalk.mode": 2,
    "kw.crosstalk.master_dyn_ax_nr": 1,
    "kw.crosstalk.master_pos1_ax_nr": 2,
    "kw.crosstalk.max_points": 3,
    "kw.crosstalk.velocity_dependent": 1,
    "kw.crosstalk.acceleration": 1000,
    "kw.crosstalk.deceleration": -1000,
    **{f"kw.crosstalk.position[{i}].ax_1": 100 * i for i in range(3)},
    **{f"kw.crosstalk.position[{i}].{name}": i for i in range(3) for name in TEST},
}
OLD_CROSSTALK = {
    **HEADER,
    "kw.crosstalk.master_ax_nr": 1,
    "kw.crosstalk.last_index": 1,
    "kw.crosstalk.table[0].acceleration": -1000,
    "kw.crosstalk.table[0].correction": 4,
    "kw.crosstalk.table[1].acceleration": 1000,
    "kw.crosstalk.table[1].correction": -4,
}

Brief = tuple[str, str | None, int | None]


def write(entries: dict[str, object]) -> ListFile:
    lines = [f"{name} {value}" for name, value in entries.items() if value is not None]
    return ListFile.parse("\n".join([*lines, ""]).encode(), "achskw3.lis")


def brief(findings: list[Finding]) -> list[Brief]:
    return sorted(
        ((f.level, f.id, f.number) for f in findings if f.level != "info"), key=str
    )


def of(base: dict[str, int | str], **options: object) -> list[Brief]:
    return brief(check([write(dict(base))], **options))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "base",
    [CROSS, PLANE, LEADSCREW, FRICTION, CROSSTALK, OLD_CROSSTALK],
    ids=["cross", "plane", "leadscrew", "friction", "crosstalk", "old crosstalk"],
)
def test_complete_list_has_neither_error_nor_warning(
    base: dict[str, int | str],
) -> None:
    assert of(base) == []


@pytest.mark.parametrize(
    "base",
    [CROSS, PLANE, LEADSCREW, FRICTION, CROSSTALK],
    ids=["cross", "plane", "leadscrew", "friction", "crosstalk"],
)
def test_what_the_strict_writer_writes_is_clean(base: dict[str, int | str]) -> None:
    values = {**base, "kopf.log_achs_name": "Y AXIS"}
    for newline in ("\n", "\r\n"):
        file = new_list(values, comment=["made by a test", ""], newline=newline)
        assert brief(check([ListFile.parse(file.dumps(), "achskw3.lis")])) == []


RULES: list[tuple[str, dict[str, int | str], dict[str, object], list[Brief]]] = [
    # types: never wrapped
    (
        "a value beyond SGN32",
        CROSS,
        {"kw.crosscomp.table[1].correction": 2**31},
        [("error", "P-COMP-00007", None)],
    ),
    (
        "a value beyond SGN32 that would wrap to 5",
        PLANE,
        {"kw.crosscomp2.table[1][1].correction": 2**32 + 5},
        [("error", "P-COMP-00016", None)],
    ),
    (
        "the largest SGN32, which the range leaves out",
        CROSS,
        {"kw.crosscomp.table[1].correction": 2**31 - 1},
        [("error", "P-COMP-00007", None)],
    ),
    (
        "a negative axis number",
        CROSS,
        {"kopf.achs_nr": -1},
        [("error", "P-COMP-00001", None)],
    ),
    (
        "axis number 0",
        CROSS,
        {"kopf.achs_nr": 0},
        [("error", "P-COMP-00001", None)],
    ),
    (
        "hexadecimal, which is no list integer (S-08)",
        CROSS,
        {"kw.crosscomp.n_cycles": "0x0A"},
        [("error", "P-COMP-00026", 70229)],
    ),
    (
        "a BOOLEAN of 2",
        CROSS,
        {"kw.crosscomp.unit": 2},
        [("error", "P-COMP-00003", None)],
    ),
    # header
    (
        "no axis number",
        CROSS,
        {"kopf.achs_nr": None},
        [("error", "P-COMP-00001", None)],
    ),
    (
        "a long name",
        CROSS,
        {"kopf.log_achs_name": "SEVENTEEN_LETTERS"},
        [("warning", "P-COMP-00002", None)],
    ),
    # cross
    (
        "no cross master",
        CROSS,
        {"kw.crosscomp.master_ax_nr": None},
        [("error", "P-COMP-00005", 70246)],
    ),
    (
        "cross master 0",
        CROSS,
        {"kw.crosscomp.master_ax_nr": 0},
        [("error", "P-COMP-00005", 70246)],
    ),
    (
        "an axis that is its own master",
        CROSS,
        {"kw.crosscomp.master_ax_nr": 3},
        [("warning", "P-COMP-00005", None)],
    ),
    (
        "too many cycles",
        CROSS,
        {"kw.crosscomp.n_cycles": 21},
        [("error", "P-COMP-00026", 70229)],
    ),
    (
        "no unit: increments (S-14)",
        CROSS,
        {"kw.crosscomp.unit": None},
        [("warning", "P-COMP-00003", None)],
    ),
    (
        "equal setpoints",
        CROSS,
        {"kw.crosscomp.table[2].setpoint": 0},
        [("error", "P-COMP-00006", 70245)],
    ),
    (
        "a missing setpoint that 0 stands in for",
        CROSS,
        {"kw.crosscomp.table[1].setpoint": None},
        [("warning", "P-COMP-00006", None)],
    ),
    (
        "a missing setpoint that 0 does not stand in for",
        CROSS,
        {"kw.crosscomp.table[2].setpoint": None},
        [("error", "P-COMP-00006", 70245)],
    ),
    (
        "a missing correction (S-57)",
        CROSS,
        {"kw.crosscomp.table[2].correction": None},
        [("warning", "P-COMP-00007", None)],
    ),
    (
        "an index beyond last_index",
        CROSS,
        {"kw.crosscomp.table[3].correction": 1},
        [("error", "P-COMP-00007", None)],
    ),
    (
        "a second index, as one page prints it (S-58)",
        CROSS,
        {"kw.crosscomp.table[0][0].correction": 1},
        [("warning", None, None)],
    ),
    # plane
    (
        "no plane master",
        PLANE,
        {"kw.crosscomp2.master2_ax_nr": None},
        [("error", "P-COMP-00015", 70182)],
    ),
    (
        "twice the same plane master",
        PLANE,
        {"kw.crosscomp2.master2_ax_nr": 1},
        [("warning", "P-COMP-00015", None)],
    ),
    (
        "an interval of 0",
        PLANE,
        {"kw.crosscomp2.interval1": 0},
        [("error", "P-COMP-00032", 70430)],
    ),
    (
        "a negative interval",
        PLANE,
        {"kw.crosscomp2.interval2": -5},
        [("error", "P-COMP-00033", 70560)],
    ),
    (
        "a missing interval",
        PLANE,
        {"kw.crosscomp2.interval2": None},
        [("error", "P-COMP-00033", 70430)],
    ),
    (
        "one interval for a rectangular grid and none for each",
        PLANE,
        {
            "kw.crosscomp2.interval": 10,
            "kw.crosscomp2.interval1": None,
            "kw.crosscomp2.interval2": None,
        },
        [("error", "P-COMP-00032", 70430), ("error", "P-COMP-00033", 70430)],
    ),
    (
        "a square grid without its interval",
        PLANE,
        {"kw.crosscomp2.grid": "QUADRATIC"},
        [("error", "P-COMP-00009", 70430)],
    ),
    (
        "an unknown grid",
        PLANE,
        {"kw.crosscomp2.grid": "HEXAGONAL", "kw.crosscomp2.interval": 7},
        [("error", "P-COMP-00031", 70478)],
    ),
    (
        "a plane without any table entry",
        {name: value for name, value in PLANE.items() if "table" not in name},
        {},
        [("error", "P-COMP-00016", 70183)],
    ),
    (
        "a missing plane entry",
        PLANE,
        {"kw.crosscomp2.table[1][1].correction": None},
        [("warning", "P-COMP-00016", None)],
    ),
    # leadscrew
    (
        "setpoints that do not ascend",
        LEADSCREW,
        {"kw.ssfk.table[1].setpoint": 1000},
        [("error", "P-COMP-00025", 110590)],
    ),
    (
        "an index of kw_nr_max (S-19)",
        LEADSCREW,
        {"kw.ssfk.table[3].pos": 1},
        [("warning", "P-COMP-00023", None)],
    ),
    (
        "an index beyond kw_nr_max",
        LEADSCREW,
        {"kw.ssfk.table[4].pos": 1},
        [("error", "P-COMP-00023", None)],
    ),
    (
        "a value beyond SGN16 (S-22)",
        LEADSCREW,
        {"kw.ssfk.table[1].neg": 40000},
        [("warning", "P-COMP-00024", 110478)],
    ),
    (
        "a setpoint beyond SGN32 (S-22)",
        LEADSCREW,
        {"kw.ssfk.table[2].setpoint": 2**31},
        [("warning", "P-COMP-00025", 110477)],
    ),
    (
        "no size beside a table",
        LEADSCREW,
        {"kw.ssfk.kw_nr_max": None},
        [("error", "P-COMP-00020", 70083)],
    ),
    (
        "no table beside a size",
        {
            "kopf.achs_nr": 3,
            "kw.ssfk.unit": 1,
            "kw.ssfk.interval": 10,
            "kw.ssfk.kw_nr_max": 4,
        },
        {},
        [("error", "P-COMP-00023", 70083)],
    ),
    (
        "a missing value for one direction",
        LEADSCREW,
        {"kw.ssfk.table[2].neg": None},
        [("warning", "P-COMP-00024", None)],
    ),
    (
        "a modulo table whose ends differ (S-20)",
        LEADSCREW,
        {"kw.ssfk.modulo": 1},
        [("warning", "P-COMP-00022", None), ("warning", "P-COMP-00022", None)],
    ),
    (
        "a modulo table with a gap (S-20)",
        LEADSCREW,
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
        FRICTION,
        {"frict_comp.table[1].in": 1},
        [("error", "P-COMP-00046", 110591)],
    ),
    (
        "a negative velocity",
        FRICTION,
        {"frict_comp.table[0].in": -1},
        [("error", "P-COMP-00046", 110591)],
    ),
    (
        "a velocity of 0 (S-26)",
        FRICTION,
        {"frict_comp.table[0].in": 0},
        [("warning", "P-COMP-00046", 110591)],
    ),
    (
        "an unknown mode",
        FRICTION,
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
        FRICTION,
        {"frict_comp.table_entries": None},
        [("error", "P-COMP-00042", 110592)],
    ),
    (
        "a delay of 249 cycles",
        FRICTION,
        {"frict_comp.delay_cycles": 249},
        [("error", "P-COMP-00058", None)],
    ),
    (
        "a long lookahead",
        FRICTION,
        {"frict_comp.reversal_lookahead": 5},
        [("error", "P-COMP-00044", None)],
    ),
    # crosstalk
    (
        "no master of the acceleration",
        CROSSTALK,
        {"kw.crosstalk.master_dyn_ax_nr": None},
        [("error", "P-COMP-00063", 70622)],
    ),
    (
        "an acceleration of 0",
        CROSSTALK,
        {"kw.crosstalk.acceleration": 0},
        [("error", "P-COMP-00066", 70659)],
    ),
    (
        "a positive deceleration",
        CROSSTALK,
        {"kw.crosstalk.deceleration": 1000},
        [("error", "P-COMP-00067", 70659)],
    ),
    (
        "no deceleration",
        CROSSTALK,
        {"kw.crosstalk.deceleration": None},
        [("error", "P-COMP-00067", 70659)],
    ),
    (
        "positions in the wrong order",
        CROSSTALK,
        {"kw.crosstalk.position[2].ax_1": 50},
        [("error", "P-COMP-00085", 70660)],
    ),
    (
        "fewer than three tests in mode 2 (S-37)",
        CROSSTALK,
        {
            "kw.crosstalk.max_points": 2,
            **{f"kw.crosstalk.position[2].{name}": None for name in (*TEST, "ax_1")},
        },
        [("warning", "P-COMP-00083", None)],
    ),
    (
        "a test without one of its four values",
        CROSSTALK,
        {"kw.crosstalk.position[1].correction_decelerate_dir_neg": None},
        [("warning", "P-COMP-00090", None)],
    ),
    (
        "mode 3 with one adaptation axis for both",
        CROSSTALK,
        {
            "kw.crosstalk.mode": 3,
            "kw.crosstalk.master_pos2_ax_nr": 2,
            **{f"kw.crosstalk.position[{i}].ax_2": 0 for i in range(3)},
        },
        [("error", "P-COMP-00081", 70658)],
    ),
    (
        "mode 3 without its second axis",
        CROSSTALK,
        {
            "kw.crosstalk.mode": 3,
            **{f"kw.crosstalk.position[{i}].ax_2": 0 for i in range(3)},
        },
        [("error", "P-COMP-00081", 70657)],
    ),
    (
        "mode 3 with a place twice",
        CROSSTALK,
        {
            "kw.crosstalk.mode": 3,
            "kw.crosstalk.master_pos2_ax_nr": 4,
            "kw.crosstalk.position[1].ax_1": 0,
            **{f"kw.crosstalk.position[{i}].ax_2": 0 for i in range(3)},
        },
        [("error", "P-COMP-00085", 70660)],
    ),
    (
        "mode 3 without an order",
        CROSSTALK,
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
        CROSSTALK,
        {"kw.crosstalk.table[0].acceleration": 1000},
        [("error", "P-COMP-00066", None)],
    ),
    (
        "the older form without its master",
        OLD_CROSSTALK,
        {"kw.crosstalk.master_ax_nr": None},
        [("error", "P-COMP-00063", 70622)],
    ),
    (
        "the older form with six points",
        OLD_CROSSTALK,
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
        LEADSCREW,
        {"kw.ssfk.intervall": 1},
        [("warning", None, None)],
    ),
    ("an entry that real lists hold", LEADSCREW, {"kw.ssfk.res1": 0}, []),
    (
        "an entry of an axis list",
        LEADSCREW,
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
    base: dict[str, int | str], changes: dict[str, object], expected: list[Brief]
) -> None:
    assert brief(check([write({**base, **changes})])) == sorted(expected, key=str)


def cross(count: int, **sizes: int) -> dict[str, object]:
    return {
        **HEADER,
        "kw.crosscomp.unit": 1,
        "kw.crosscomp.master_ax_nr": 1,
        "kw.crosscomp.last_index": count - 1,
        **{f"kw.crosscomp.{name}": value for name, value in sizes.items()},
        **{f"kw.crosscomp.table[{i}].setpoint": i for i in range(count)},
        **{f"kw.crosscomp.table[{i}].correction": 0 for i in range(count)},
    }


@pytest.mark.parametrize(
    ("count", "sizes", "level"),
    [
        (1000, {}, None),
        (1001, {}, "warning"),  # default max_points 1001, but "maximum 1000 values"
        (1001, {"max_points": 0}, "warning"),
        (1001, {"max_points": 1001}, None),
        (1002, {}, "error"),
        (1002, {"max_points": 1001}, "error"),
        (3, {"max_points": 2}, "error"),
    ],
)
def test_cross_size_against_max_points(
    count: int, sizes: dict[str, int], level: str | None
) -> None:
    expected = [] if level is None else [(level, "P-COMP-00004", 70432)]
    assert brief(check([write(cross(count, **sizes))])) == expected


def test_single_cross_point_is_doubted() -> None:
    assert brief(check([write(cross(1))])) == [("warning", "P-COMP-00004", None)]


def plane(width: int, height: int, **sizes: int) -> dict[str, object]:
    return {
        **HEADER,
        "kw.crosscomp2.unit": 1,
        "kw.crosscomp2.interval": 10,
        "kw.crosscomp2.last_index_master1": width - 1,
        "kw.crosscomp2.last_index_master2": height - 1,
        "kw.crosscomp2.master1_ax_nr": 1,
        "kw.crosscomp2.master2_ax_nr": 2,
        **{f"kw.crosscomp2.{name}": value for name, value in sizes.items()},
        **{
            f"kw.crosscomp2.table[{j}][{i}].correction": i + j
            for j in range(height)
            for i in range(width)
        },
    }


@pytest.mark.parametrize(
    ("width", "height", "sizes", "expected"),
    [
        (101, 101, {}, []),
        (5, 4, {"max_points": 20}, []),
        # (4 + 1) · (3 + 1) = 20 > 19, but 4 · 3 ≤ 19: one of two statements (S-15)
        (5, 4, {"max_points": 19}, [("warning", "P-COMP-00061", 70610)]),
        (5, 4, {"max_points": 12}, [("warning", "P-COMP-00061", 70610)]),
        (5, 4, {"max_points": 11}, [("error", "P-COMP-00061", 70610)]),
        (102, 2, {}, [("error", "P-COMP-00010", 70610)]),
        (102, 2, {"max_points": 204}, []),
        (2, 102, {"max_points": 0}, [("error", "P-COMP-00011", 70610)]),
    ],
)
def test_plane_size_against_max_points(
    width: int, height: int, sizes: dict[str, int], expected: list[Brief]
) -> None:
    assert brief(check([write(plane(width, height, **sizes))])) == expected


def test_older_build_has_no_max_points() -> None:
    file = write(plane(102, 2, max_points=204))
    assert brief(check([file], build="V3.1.3079.06")) == []
    assert brief(check([file], build="V3.1.3077.0")) == [
        ("error", "P-COMP-00010", 70610),
        ("warning", "P-COMP-00061", None),
    ]


@pytest.mark.parametrize(
    ("size", "points", "level"),
    [(1499, None, None), (1500, None, "error"), (5, 6, None), (6, 6, "error")],
)
def test_leadscrew_size_against_max_points(
    size: int, points: int | None, level: str | None
) -> None:
    entries: dict[str, object] = {
        **HEADER,
        "kw.ssfk.unit": 1,
        "kw.ssfk.interval": 100,
        "kw.ssfk.kw_nr_max": size,
        "kw.ssfk.max_points": points,
        **{f"kw.ssfk.table[{i}].pos": 1 for i in range(size)},
    }
    expected = [] if level is None else [(level, "P-COMP-00020", 110217)]
    assert brief(check([write(entries)])) == expected


@pytest.mark.parametrize(
    ("size", "level"), [(19, None), (20, "warning"), (21, "error")]
)
def test_friction_size_against_max_points(size: int, level: str | None) -> None:
    entries: dict[str, object] = {
        **HEADER,
        "frict_comp.mode": 3,
        "frict_comp.table_entries": size,
        **{f"frict_comp.table[{i}].in": i + 1 for i in range(size)},
        **{f"frict_comp.table[{i}].out": 1 for i in range(size)},
    }
    expected = [] if level is None else [(level, "P-COMP-00042", 110592)]
    assert brief(check([write(entries)])) == expected


@pytest.mark.parametrize(
    ("count", "level"), [(14, None), (15, "warning"), (16, "error")]
)
def test_number_of_crosstalk_tests(count: int, level: str | None) -> None:
    entries: dict[str, object] = {
        **CROSSTALK,
        "kw.crosstalk.mode": 3,
        "kw.crosstalk.master_pos2_ax_nr": 4,
        "kw.crosstalk.max_points": count,
        **{f"kw.crosstalk.position[{i}].ax_1": 10 * i for i in range(count)},
        **{f"kw.crosstalk.position[{i}].ax_2": 0 for i in range(count)},
        **{
            f"kw.crosstalk.position[{i}].{name}": 1
            for i in range(count)
            for name in TEST
        },
    }
    expected = [] if level is None else [(level, "P-COMP-00083", None)]
    assert brief(check([write(entries)])) == expected


def test_swapped_plane_indices_are_named() -> None:
    entries = plane(5, 3)
    turned = {
        f"kw.crosscomp2.table[{i}][{j}].correction": 1
        for j in range(3)
        for i in range(5)
    }
    kept = {name: value for name, value in entries.items() if "table" not in name}
    findings = check([write({**kept, **turned})])
    beyond = next(finding for finding in findings if finding.level == "error")
    assert "are the indices swapped?" in beyond.message
    lacking = next(finding for finding in findings if finding.level == "warning")
    assert "lacks 6 of 15 entries" in lacking.message


def test_plane_size_behind_its_table_is_doubted() -> None:
    entries = plane(2, 2)
    size = entries.pop("kw.crosscomp2.last_index_master1")
    entries["kw.crosscomp2.last_index_master1"] = size
    assert brief(check([write(entries)])) == [("warning", "P-COMP-00010", None)]


def test_idle_structure_is_left_in_peace() -> None:
    entries = {**HEADER, "kw.crosscomp.max_points": 1, "kw.crosscomp.unit": 1}
    entries |= {"kw.crosscomp.master_ax_nr": 0, "kw.ssfk.kw_nr_max": 0}
    entries |= {"kw.crosscomp2.interval": 0, "frict_comp.mode": 0}
    assert brief(check([write(dict(entries))])) == []


def test_friction_that_is_switched_off_may_lack_its_size() -> None:
    entries = {**FRICTION, "frict_comp.mode": 0, "frict_comp.table_entries": 0}
    findings = brief(check([write(dict(entries))]))
    assert {row[1] for row in findings} == {"P-COMP-00046", "P-COMP-00047"}
    kept = {name: value for name, value in entries.items() if "table[" not in name}
    assert brief(check([write(dict(kept))])) == []


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("lr_param.n_backlash_cyc 0", []),
        ("lr_param.n_backlash_cyc 19", []),
        ("lr_param.n_backlash_cyc 20", [("error", "P-AXIS-00243", 110392)]),
        ("lr_param.temp_comp_n_cycles 0", []),
        ("lr_param.temp_comp_n_cycles 20", [("warning", "P-AXIS-00275", 110362)]),
        ("lr_param.temp_comp_n_cycles 21", [("error", "P-AXIS-00275", 110362)]),
        ("lr_param.temp_comp_coefficient 10000.5", [("error", "P-AXIS-00274", 70259)]),
        ("lr_param.temp_comp_coefficient nan", [("error", "P-AXIS-00274", 70259)]),
        ("getriebe[0].lose 40000", [("error", "P-AXIS-00103", None)]),
        ("lr_param.anwahl_losekomp 3", [("error", "P-AXIS-00021", None)]),
        (
            "lr_param.prog_movement_requires_compensations WARP",
            [("error", "P-AXIS-00465", None)],
        ),
        ("lr_param.prog_movement_requires_compensations 0x1F", []),
        ("some.other.parameter of_the_axis", []),
    ],
)
def test_axis_parameters_are_judged(entry: str, expected: list[Brief]) -> None:
    text = f"kopf.achs_nr 3\ngetriebe[0].lose 5\n{entry}\nlr_param.temp_comp 1\n"
    found = check([ListFile.parse(text.encode(), "achsmds3.lis")])
    # One case gives getriebe[0].lose a second time, which is not the point here.
    repeated = ("warning", "P-AXIS-00103", None)
    assert [row for row in brief(found) if row != repeated] == expected


def test_error_limit_above_the_warning_limit_is_advised() -> None:
    text = "lr_param.ext_comp.warn_limit 100\nlr_param.ext_comp.err_limit 50\n"
    found = check([ListFile.parse(text.encode(), "achsmds3.lis")])
    assert [f.id for f in found if f.level == "info"] == [
        None,
        "P-AXIS-00744",
    ]


@pytest.mark.parametrize(
    ("line", "level", "id"),
    [
        ("kw.ssfk.interval", "error", "P-COMP-00018"),
        ("kw.ssfk.interval 5#five", "error", "P-COMP-00018"),
        ("kw.ssfk.interval five", "error", "P-COMP-00018"),
        ("kw.ssfk.interval\u00a05", "warning", "P-COMP-00018"),
        ("kw.ssfk.interval 5 five", None, None),
        ("kw.ssfk.interval 5 (five", None, None),
        ("kw.ssfk.interval 5 /* five", None, None),
        ("kw.ssfk. interval 5", "warning", "P-COMP-00018"),
        ("kopf.log_achs_name AXIS 3", "warning", "P-COMP-00002"),
        ('kopf.log_achs_name "AXIS 3" (quoted)', None, None),
        ('kopf.log_achs_name "AXIS 3" # quoted', "warning", "P-COMP-00002"),
        ("kopf.achs_nr 3", "warning", "P-COMP-00001"),  # stands twice
        ("?!", "error", None),
    ],
)
def test_anomaly_of_the_text_is_reported(
    line: str, level: str | None, id: str | None
) -> None:
    text = f"kopf.achs_nr 3\n{line}\nkw.ssfk.kw_nr_max 0\n"
    findings = check([ListFile.parse(text.encode(), "achskw3.lis")])
    expected = [] if level is None else [(level, id, None)]
    numberless = [(f.level, f.id, None) for f in findings if f.level != "info"]
    assert numberless == expected


def test_quoted_text_needs_a_build_that_knows_quotes() -> None:
    text = b'kopf.achs_nr 3\nkopf.log_achs_name "Y AXIS"\n'
    file = ListFile.parse(text, "achskw3.lis")
    assert brief(check([file], build="V3.1.3081.0")) == []
    assert brief(check([file], build="V3.1.3080.9")) == [
        ("warning", "P-COMP-00002", None)
    ]


def test_build_that_is_none_is_refused() -> None:
    with pytest.raises(
        BuildError, match=r"build 'newest': expected a name such as V3\.1"
    ):
        check([], build="newest")


def test_increments_are_named_unless_their_length_is_known() -> None:
    entries = {**LEADSCREW, "kw.ssfk.unit": 0}
    told = [f.message for f in check([write(dict(entries))])]
    assert any("encoder increments" in message for message in told)
    assert check([write(dict(entries))], increment=1e-6) == []


def test_empty_file_is_an_error() -> None:
    (finding,) = check([ListFile.parse(b"", "empty.lis")])
    assert (finding.level, finding.message) == ("error", "the list holds no entry")


def test_file_that_is_no_list_is_doubted() -> None:
    (finding,) = check([ListFile.parse(b"name value\n", "notes.txt")])
    assert finding.level == "warning"


def test_finding_is_one_line_that_says_where_and_what() -> None:
    (finding,) = check([write({**CROSS, "kw.crosscomp.n_cycles": 21})])[1:]
    assert str(finding) == (
        "achskw3.lis:11:23: error: kw.crosscomp.n_cycles = 21 is not allowed, expected "
        "0 ≤ x ≤ 20 (P-COMP-00026, controller error 70229)"
    )
    assert json.loads(json.dumps(dataclasses.asdict(finding))) == {
        "file": "achskw3.lis",
        "line": 11,
        "column": 23,
        "level": "error",
        "id": "P-COMP-00026",
        "number": 70229,
        "message": "kw.crosscomp.n_cycles = 21 is not allowed, expected 0 ≤ x ≤ 20",
        "found": "21",
        "expected": "0 ≤ x ≤ 20",
    }


def test_many_findings_of_one_sort_are_counted() -> None:
    entries = cross(500)
    for i in range(500):
        entries[f"kw.crosscomp.table[{i}].correction"] = 2**40
    findings = [f for f in check([write(entries)]) if f.level == "error"]
    assert len(findings) == 11
    assert findings[-1].found == "490 values"


def test_many_unknown_names_are_counted() -> None:
    text = "kopf.achs_nr 3\n" + "".join(f"kw.other{i}.unit 1\n" for i in range(500))
    findings = check([ListFile.parse(text.encode(), "achskw3.lis")])
    assert len(findings) == 51
    assert findings[-1].message == "450 further unknown names from here on"


def test_misspelt_switch_is_found_among_the_entries_of_other_manuals() -> None:
    others = "".join(f"lr_param.other_{i} 1\nkenngr.x{i} 2\n" for i in range(300))
    text = f"kopf.achs_nr 3\nlr_param.ssfk 1\n{others}lr_param.croscomp 1\n"
    (finding,) = check([ListFile.parse(text.encode(), "achsmds3.lis")])
    assert finding.level == "info"
    assert finding.message.endswith("did you mean lr_param.crosscomp?")


def test_every_remark_of_the_text_has_a_rule() -> None:
    assert set(REMARKS) == set(RemarkCode)


def test_absurd_sizes_cost_no_time_and_no_memory() -> None:
    # A table that was really laid out would need 16 GiB.
    for base, changes in (
        (CROSS, {"kw.crosscomp.last_index": 2**31 - 1}),
        (
            PLANE,
            {
                "kw.crosscomp2.last_index_master1": 2**31 - 1,
                "kw.crosscomp2.last_index_master2": 2**31 - 1,
            },
        ),
        (LEADSCREW, {"kw.ssfk.kw_nr_max": 2**31 - 1}),
    ):
        assert any(f.level == "error" for f in check([write({**base, **changes})]))


NAMES = st.sampled_from(
    [
        *(row.key.replace("[]", "[1]") for row in registry().rows if row.key),
        *registry().aliases,
        "kw.ssfk.res1",
        "End",
        "",
    ]
)
VALUES = st.one_of(
    st.integers().map(str),
    st.sampled_from(["0", "1", "2", "TRUE"]),
    st.text(max_size=8),
)
TEXTS = st.lists(st.tuples(NAMES, VALUES).map(" ".join), max_size=30).map("\n".join)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(TEXTS, TEXTS)
def test_any_text_gives_findings_and_no_exception(first: str, second: str) -> None:
    files = [
        ListFile.parse(first.encode(errors="surrogatepass"), "achskw1.lis"),
        ListFile.parse(second.encode(errors="surrogatepass"), "achsmds1.lis"),
    ]
    for finding in check(files, build="V3.1.3079.32", gantry=[(1, 2)]):
        assert finding.line >= 1
        assert finding.column >= 1
        assert "\n" not in str(finding)

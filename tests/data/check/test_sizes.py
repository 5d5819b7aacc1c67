"""How many entries a table may have: `max_points`, last indices, and older builds."""

from collections.abc import Callable

import pytest

from axcomp.data.lists import ListFile
from axcomp.data.lists._check import check

Entries = dict[str, object]
Brief = tuple[str, str | None, int | None]
Complete = Callable[[str], Entries]
Write = Callable[[Entries], ListFile]
Judge = Callable[..., list[Brief]]

TEST = (
    "correction_accelerate_dir_pos",
    "correction_accelerate_dir_neg",
    "correction_decelerate_dir_pos",
    "correction_decelerate_dir_neg",
)


def cross(count: int, **sizes: int) -> dict[str, object]:
    return {
        "kopf.achs_nr": 3,
        "kw.crosscomp.unit": 1,
        "kw.crosscomp.master_ax_nr": 1,
        "kw.crosscomp.last_index": count - 1,
        **{f"kw.crosscomp.{name}": value for name, value in sizes.items()},
        **{f"kw.crosscomp.table[{i}].setpoint": 1000 * i for i in range(count)},
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
    count: int, sizes: dict[str, int], level: str | None, judge: Judge
) -> None:
    expected = [] if level is None else [(level, "P-COMP-00004", 70432)]
    assert judge(cross(count, **sizes)) == expected


def test_single_cross_point_is_doubted(judge: Judge) -> None:
    assert judge(cross(1)) == [("warning", "P-COMP-00004", None)]


def plane(width: int, height: int, **sizes: int) -> dict[str, object]:
    return {
        "kopf.achs_nr": 3,
        "kw.crosscomp2.unit": 1,
        "kw.crosscomp2.interval": 1000,
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
    width: int, height: int, sizes: dict[str, int], expected: list[Brief], judge: Judge
) -> None:
    assert judge(plane(width, height, **sizes)) == expected


def test_older_build_has_no_max_points(write: Write, judge: Judge) -> None:
    file = write(plane(102, 2, max_points=204))
    assert judge(file, build="V3.1.3079.06") == []
    assert judge(file, build="V3.1.3077.0") == [
        ("error", "P-COMP-00010", 70610),
        ("error", "P-COMP-00061", None),
    ]


@pytest.mark.parametrize(
    ("size", "points", "level"),
    [(1499, None, None), (1500, None, "error"), (5, 6, None), (6, 6, "error")],
)
def test_leadscrew_size_against_max_points(
    size: int, points: int | None, level: str | None, judge: Judge
) -> None:
    entries: dict[str, object] = {
        "kopf.achs_nr": 3,
        "kw.ssfk.unit": 1,
        "kw.ssfk.interval": 1000,
        "kw.ssfk.kw_nr_max": size,
        "kw.ssfk.max_points": points,
        **{f"kw.ssfk.table[{i}].pos": 1 for i in range(size)},
    }
    expected = [] if level is None else [(level, "P-COMP-00020", 110217)]
    assert judge(entries) == expected


@pytest.mark.parametrize(
    ("size", "level"), [(19, None), (20, "warning"), (21, "error")]
)
def test_friction_size_against_max_points(
    size: int, level: str | None, judge: Judge
) -> None:
    entries: dict[str, object] = {
        "kopf.achs_nr": 3,
        "frict_comp.mode": 3,
        "frict_comp.table_entries": size,
        **{f"frict_comp.table[{i}].in": i + 1 for i in range(size)},
        **{f"frict_comp.table[{i}].out": 1 for i in range(size)},
    }
    expected = [] if level is None else [(level, "P-COMP-00042", 110592)]
    assert judge(entries) == expected


@pytest.mark.parametrize(
    ("count", "level"), [(14, None), (15, "warning"), (16, "error")]
)
def test_number_of_crosstalk_tests(
    count: int, level: str | None, complete: Complete, judge: Judge
) -> None:
    entries: dict[str, object] = {
        **complete("crosstalk"),
        "kw.crosstalk.mode": 3,
        "kw.crosstalk.master_pos2_ax_nr": 4,
        "kw.crosstalk.max_points": count,
        **{f"kw.crosstalk.position[{i}].ax_1": 10 * i for i in range(count)},
        **{f"kw.crosstalk.position[{i}].ax_2": i * i for i in range(count)},
        **{
            f"kw.crosstalk.position[{i}].{name}": 1
            for i in range(count)
            for name in TEST
        },
    }
    expected = [] if level is None else [(level, "P-COMP-00083", None)]
    assert judge(entries) == expected


def test_swapped_plane_indices_are_named(write: Write) -> None:
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
    # A controller that counts them the other way round reads just that.
    findings = check([write({**kept, **turned})], plane_index="ij")
    assert {finding.level for finding in findings} == {"info"}


def test_plane_size_behind_its_table_is_doubted(judge: Judge) -> None:
    entries = plane(2, 2)
    size = entries.pop("kw.crosscomp2.last_index_master1")
    entries["kw.crosscomp2.last_index_master1"] = size
    assert judge(entries) == [("warning", "P-COMP-00010", None)]

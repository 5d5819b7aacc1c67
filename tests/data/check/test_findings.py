"""What `check` says of a single list as a whole, and how it says it."""

import dataclasses
import json
import tracemalloc
from collections.abc import Callable

import pytest
from hypothesis import given, settings, strategies as st

from axcomp.data.lists import ListFile, new_list, registry
from axcomp.data.lists._check import check
from axcomp.data.lists._registry import BuildError
from axcomp.data.lists._remarks import REMARKS, RemarkCode

Entries = dict[str, object]
Brief = tuple[str, str | None, int | None]
Complete = Callable[[str], Entries]
Write = Callable[[Entries], ListFile]
Judge = Callable[..., list[Brief]]


@pytest.mark.parametrize(
    "base",
    ["cross", "plane", "leadscrew", "friction", "crosstalk", "old_crosstalk"],
)
def test_complete_list_has_neither_error_nor_warning(
    base: str, complete: Complete, judge: Judge
) -> None:
    assert judge(complete(base)) == []


@pytest.mark.parametrize(
    "base", ["cross", "plane", "leadscrew", "friction", "crosstalk"]
)
def test_what_the_strict_writer_writes_is_clean(
    base: str, complete: Complete, judge: Judge
) -> None:
    values = {
        key: value
        for key, value in complete(base).items()
        if isinstance(value, int | str)
    }
    values["kopf.log_achs_name"] = "Y AXIS"
    for newline in ("\n", "\r\n"):
        file = new_list(values, comment=["made by a test", ""], newline=newline)
        assert judge(ListFile.parse(file.dumps(), "achskw3.lis")) == []


def test_idle_structure_is_left_in_peace(judge: Judge) -> None:
    entries: Entries = {
        "kopf.achs_nr": 3,
        "kw.crosscomp.max_points": 1,
        "kw.crosscomp.unit": 1,
    }
    entries |= {"kw.crosscomp.master_ax_nr": 0, "kw.ssfk.kw_nr_max": 0}
    entries |= {"kw.crosscomp2.interval": 0, "frict_comp.mode": 0}
    assert judge(entries) == []


def test_friction_that_is_switched_off_may_lack_its_size(
    complete: Complete, judge: Judge
) -> None:
    entries = {
        **complete("friction"),
        "frict_comp.mode": 0,
        "frict_comp.table_entries": 0,
    }
    findings = judge(entries)
    assert {row[1] for row in findings} == {"P-COMP-00046", "P-COMP-00047"}
    kept = {name: value for name, value in entries.items() if "table[" not in name}
    assert judge(kept) == []


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
        ("lr_param.prog_movement_requires_compensations 0x4", []),
        ("some.other.parameter of_the_axis", []),
    ],
)
def test_axis_parameters_are_judged(
    entry: str, expected: list[Brief], judge: Judge
) -> None:
    text = f"kopf.achs_nr 3\ngetriebe[0].lose 5\n{entry}\nlr_param.temp_comp 1\n"
    file = ListFile.parse(text.encode(), "achsmds3.lis")
    # One case gives getriebe[0].lose a second time, which is not the point here.
    repeated = ("warning", "P-AXIS-00103", None)
    assert [row for row in judge(file) if row != repeated] == expected


@pytest.mark.parametrize(
    ("line", "level", "id"),
    [
        ("kw.ssfk.interval", "error", "P-COMP-00018"),
        ("kw.ssfk.interval 5#five", "error", "P-COMP-00018"),
        ("kw.ssfk.interval five", "error", "P-COMP-00018"),
        ("kw.ssfk.interval\u00a05", "warning", "P-COMP-00018"),
        ("kw.ssfk.interval 5 five", None, None),
        ("kw.ssfk.interval 5 (five", None, None),
        ("kw.ssfk.interval 5 # 5", None, None),
        ("kw.ssfk.interval 5 000", "warning", "P-COMP-00018"),
        ("kw.ssfk.interval 5\u00a0000", "warning", "P-COMP-00018"),
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


@pytest.mark.parametrize(
    ("behind", "doubted"),
    [(" 250", True), ("\t 250 # µm", True), (" \u00a0250", True), (" µm 250", False)],
)
def test_digits_behind_a_value_of_a_table_are_doubted(
    behind: str, doubted: bool, complete: Complete, write: Write
) -> None:
    changed = {"kw.crosscomp.table[1].correction": f"-1{behind}"}
    findings = check([write({**complete("cross"), **changed})])
    found = [(f.level, f.id) for f in findings if "digits" in f.message]
    assert found == [("warning", "P-COMP-00007")][: int(doubted)]


def test_quoted_text_needs_a_build_that_knows_quotes(judge: Judge) -> None:
    text = b'kopf.achs_nr 3\nkopf.log_achs_name "Y AXIS"\n'
    file = ListFile.parse(text, "achskw3.lis")
    assert judge(file, build="V3.1.3081.0") == []
    assert judge(file, build="V3.1.3080.9") == [("warning", "P-COMP-00002", None)]


def test_build_that_is_none_is_refused() -> None:
    with pytest.raises(
        BuildError, match=r"build 'newest': expected a name such as V3\.1"
    ):
        check([], build="newest")


def test_increments_are_named_unless_their_length_is_known(
    complete: Complete, write: Write
) -> None:
    entries = {**complete("leadscrew"), "kw.ssfk.unit": 0}
    told = [f.message for f in check([write(entries)])]
    assert any("encoder increments" in message for message in told)
    assert check([write(entries)], increment=1e-4) == []


def test_empty_file_is_an_error() -> None:
    (finding,) = check([ListFile.parse(b"", "empty.lis")])
    assert (finding.level, finding.message) == ("error", "the list holds no entry")


def test_file_that_is_no_list_is_doubted() -> None:
    (finding,) = check([ListFile.parse(b"name value\n", "notes.txt")])
    assert finding.level == "warning"


def test_finding_is_one_line_that_says_where_and_what(
    complete: Complete, write: Write
) -> None:
    (finding,) = check([write({**complete("cross"), "kw.crosscomp.n_cycles": 21})])[1:]
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


def test_many_findings_of_one_sort_are_counted(write: Write) -> None:
    entries: Entries = {"kopf.achs_nr": 3, "kw.crosscomp.unit": 1}
    entries |= {"kw.crosscomp.master_ax_nr": 1, "kw.crosscomp.last_index": 499}
    for i in range(500):
        entries[f"kw.crosscomp.table[{i}].setpoint"] = 1000 * i
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


def test_absurd_sizes_cost_no_time_and_no_memory(
    complete: Complete, write: Write
) -> None:
    # A table that was really laid out would need 16 GiB; what is found takes 0.3 MB.
    tracemalloc.start()
    for base, changes in (
        (complete("cross"), {"kw.crosscomp.last_index": 2**31 - 1}),
        (
            complete("plane"),
            {
                "kw.crosscomp2.last_index_master1": 2**31 - 1,
                "kw.crosscomp2.last_index_master2": 2**31 - 1,
            },
        ),
        (complete("leadscrew"), {"kw.ssfk.kw_nr_max": 2**31 - 1}),
        (complete("friction"), {"frict_comp.table_entries": 2**31 - 1}),
        (complete("old_crosstalk"), {"kw.crosstalk.last_index": 2**31 - 1}),
    ):
        assert any(f.level == "error" for f in check([write({**base, **changes})]))
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


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


@settings(max_examples=50, deadline=None, derandomize=True)
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

"""The strict writer: what it writes satisfies every reading of the manuals."""

import math

import pytest
from hypothesis import given, settings, strategies as st

from axcomp.data.lists import (
    EntryValueError,
    ListFile,
    UnknownEntryError,
    check,
    new_list,
)

SEEDED = settings(deadline=None, derandomize=True)

CROSS: dict[str, str | int | float | bool] = {
    "kw.crosscomp.unit": True,
    "kw.crosscomp.master_ax_nr": 1,
    "kw.crosscomp.table[0].setpoint": -100_000,
    "kw.crosscomp.table[0].correction": -12,
    "kw.crosscomp.table[1].setpoint": 0,
    "kw.crosscomp.table[1].correction": 3,
    "kw.crosscomp.last_index": 1,
    "kopf.achs_nr": 3,
    "kopf.log_achs_name": "Z AXIS",
}


def test_new_list_is_strict() -> None:
    found = new_list(CROSS, comment=["Anlage Süd, 0.1 µm", "", "two\nlines"])
    assert found.dumps().decode("ascii") == (
        "# Anlage Sud, 0.1 um\n"
        "# \n"
        "# two\n"
        "# lines\n"
        "\n"
        "kopf.achs_nr                      3\n"
        'kopf.log_achs_name                "Z AXIS"\n'
        "\n"
        "kw.crosscomp.unit                 1\n"
        "kw.crosscomp.master_ax_nr         1\n"
        "kw.crosscomp.last_index           1\n"
        "\n"
        "kw.crosscomp.table[0].setpoint    -100000\n"
        "kw.crosscomp.table[0].correction  -12\n"
        "kw.crosscomp.table[1].setpoint    0\n"
        "kw.crosscomp.table[1].correction  3\n"
        "\n"
        "# Ende\n"
    )


def test_new_list_has_no_remark_and_no_warning() -> None:
    found = ListFile.parse(new_list(CROSS, comment=["x"], newline="\r\n").dumps())
    assert found.remarks == ()
    assert [f for f in check([found]) if f.level != "info"] == []


def test_new_list_reads_back_as_it_was_given() -> None:
    values: dict[str, str | int | float | bool] = {
        f"kw.crosscomp2.table[{j}][{i}].correction": (i - 3) * (j + 1)
        for j in range(4)
        for i in range(7)
    }
    found = ListFile.parse(new_list(values).dumps())
    table = found.table("kw.crosscomp2", "correction")
    assert table == {(j, i): (i - 3) * (j + 1) for j in range(4) for i in range(7)}


def test_other_spellings_become_canonical() -> None:
    found = new_list({"KOPF.log_achs_nr": 3, "Kw.ssfk.table[ 01].pos": 5})
    assert "kopf.achs_nr " in found.dumps().decode()
    assert "kw.ssfk.table[1].pos " in found.dumps().decode()


@pytest.mark.parametrize(
    "values",
    [
        {"kopf.achs_nr": 3, "kopf.log_achs_nr": 3},
        {"kw.ssfk.table[1].pos": 3, "kw.ssfk.table[01].pos": 3},
        {
            "kw.ssfk.table[0].pos": 1,
            "kw.ssfk.table[1].pos": 3,
            "KW.ssfk.table[1].pos": 3,
        },
    ],
)
def test_entry_given_twice_is_refused(values: dict[str, int]) -> None:
    with pytest.raises(UnknownEntryError, match="each entry once"):
        new_list(values)


@pytest.mark.parametrize(
    "name",
    [
        "kw.ssfk.res1",
        "kw.ssfk.table[].pos",
        "kw.ssfk.table[1][2].pos",
        "kw.ssfk.table[1].size",
        "kw.ssfk.table[-1].pos",
        "",
    ],
)
def test_name_that_no_manual_has_is_refused(name: str) -> None:
    with pytest.raises(UnknownEntryError, match="new list"):
        new_list({"kw.ssfk.table[0].pos": 1, name: 1})


def test_integer_outside_its_type_is_refused_by_name() -> None:
    values: dict[str, str | int | float | bool] = {
        f"kw.ssfk.table[{k}].pos": k for k in range(100)
    }
    values["kw.ssfk.table[57].pos"] = 2**31
    with pytest.raises(EntryValueError, match=r"table\[57\]\.pos: found 2147483648"):
        new_list(values)


def test_new_list_is_ascii_only() -> None:
    with pytest.raises(EntryValueError, match="ascii"):
        new_list({"kopf.log_achs_name": "Süd"})


@SEEDED
@given(st.text(max_size=16))
def test_any_name_of_an_axis_reads_back_or_is_refused(name: str) -> None:
    try:
        found = new_list({"kopf.log_achs_name": name})
    except EntryValueError:
        return
    again = ListFile.parse(found.dumps())
    assert again.text("kopf.log_achs_name") == name
    assert again.remarks == ()


@SEEDED
@given(st.floats(min_value=-10_000, max_value=10_000), st.integers(-(2**31), 2**31 - 2))
def test_any_number_reads_back(real: float, whole: int) -> None:
    name = "lr_param.temp_comp_coefficient"
    found = ListFile.parse(new_list({name: real, "kw.ssfk.kw_startpos": whole}).dumps())
    text = found.text(name)
    assert text is not None
    # Written with all digits of the shortest text that gives the number back.
    assert math.isclose(float(text), real, rel_tol=0.0, abs_tol=0.0)
    assert "e" not in text
    assert found.integer("kw.ssfk.kw_startpos") == whole

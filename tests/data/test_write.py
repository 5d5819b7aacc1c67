"""Editing lists: only what is named changes; what does not fit is refused."""

import pytest

from axcomp.data.lists import EntryValueError, ListFile, UnknownEntryError


def parse(text: str) -> ListFile:
    return ListFile.parse(text.encode(), "achskw3.lis")


def edited(text: str, values: dict[str, str | int | float | bool]) -> str:
    return parse(text).replace(values).dumps().decode()


@pytest.mark.parametrize(
    ("before", "values", "after"),
    [
        ("kw.ssfk.unit  0  (c)\n", {"kw.ssfk.unit": True}, "kw.ssfk.unit  1  (c)\n"),
        ("KW.SSFK.Unit 0\r\n", {"kw.ssfk.unit": 1}, "KW.SSFK.Unit 1\r\n"),
        ("kopf.log_achs_nr 2", {"kopf.achs_nr": 5}, "kopf.log_achs_nr 5"),
        (
            "kopf.log_achs_name Z (c)\n",
            {"kopf.log_achs_name": "Y AXIS"},
            'kopf.log_achs_name "Y AXIS" (c)\n',
        ),
        (
            "kopf.log_achs_name \u2033A\u2033\n",
            {"kopf.log_achs_name": "B"},
            "kopf.log_achs_name B\n",
        ),
        (
            "kw.ssfk.table[ 1].pos 5\nkw.ssfk.table[1].pos 6\n",
            {"kw.ssfk.table[1].pos": 7},
            "kw.ssfk.table[ 1].pos 5\nkw.ssfk.table[1].pos 7\n",
        ),
        (
            "lr_param.temp_comp_coefficient 1\n",
            {"lr_param.temp_comp_coefficient": 0.00001},
            "lr_param.temp_comp_coefficient 0.00001\n",
        ),
        # An entry without a value, and a comment glued to one, get their blank.
        ("kw.ssfk.unit\n", {"kw.ssfk.unit": 1}, "kw.ssfk.unit 1\n"),
        ("kw.ssfk.unit (c)\n", {"kw.ssfk.unit": 1}, "kw.ssfk.unit 1 (c)\n"),
        ("kw.ssfk.unit 0/*c*/\n", {"kw.ssfk.unit": 1}, "kw.ssfk.unit 1 /*c*/\n"),
    ],
)
def test_only_the_characters_of_a_value_change(
    before: str, values: dict[str, str | int | float | bool], after: str
) -> None:
    assert edited(before, values) == after


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("kw.crosstalk.velocity_dependent TRUE\n", True),
        ("kw.crosstalk.velocity_dependent TRUE\n", 1),
        ("kw.ssfk.interval 007\n", 7),
        ("kopf.log_achs_name Y AXIS (c)\n", "Y AXIS"),
    ],
)
def test_value_that_stands_there_already_changes_nothing(
    text: str, value: str | int | bool
) -> None:
    assert edited(text, {text.partition(" ")[0]: value}) == text


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("kw.ssfk.table[0].pos", 2**31, r"pos: found 2147483648, expected SGN32"),
        ("kw.ssfk.table[0].pos", -(2**31) - 1, "expected SGN32"),
        ("kw.ssfk.table[0].pos", True, "expected SGN32"),
        ("kw.ssfk.table[0].pos", 1.5, "found 1.5, expected SGN32"),
        ("kw.ssfk.table[0].pos", "0x10", "expected SGN32"),
        ("kopf.achs_nr", 0, "UNS16, 0 < x < 65535"),
        ("kopf.achs_nr", 70_000, "UNS16"),
        ("kw.ssfk.unit", 2, "BOOLEAN, 0 or 1"),
        ("kopf.log_achs_name", 'a"b', "STRING"),
        ("kopf.log_achs_name", "a\nb", "STRING"),
        ("kopf.log_achs_name", "x" * 17, "at most 16 characters"),
        ("kopf.log_achs_name", 5, "STRING"),
        ("kw.crosscomp2.grid", "SQUARE", "one of QUADRATIC, RECTANGULAR"),
        ("lr_param.temp_comp_coefficient", float("nan"), "REAL64"),
        ("lr_param.temp_comp_coefficient", 1e9, "REAL64"),
    ],
)
def test_value_that_does_not_fit_is_refused(
    name: str, value: str | int | float | bool, match: str
) -> None:
    found = parse(f"{name} 1\n")
    with pytest.raises(EntryValueError, match=match) as caught:
        found.replace({name: value})
    assert str(caught.value).startswith(f"achskw3.lis: {name}: ")


def test_text_that_the_encoding_lacks_is_refused() -> None:
    with pytest.raises(EntryValueError, match=r"encoding of the list \(ascii\)"):
        parse("kopf.log_achs_name Z\n").replace({"kopf.log_achs_name": "Süd"})
    wide = ListFile.parse("# ü\nkopf.log_achs_name Z\n".encode("latin-1"))
    changed = wide.replace({"kopf.log_achs_name": "Süd"})
    assert changed.dumps() == "# ü\nkopf.log_achs_name Süd\n".encode("latin-1")
    with pytest.raises(EntryValueError, match="latin-1"):
        wide.replace({"kopf.log_achs_name": "Ω"})


def test_replacing_an_entry_that_is_not_there_is_refused() -> None:
    with pytest.raises(UnknownEntryError, match=r"kw\.ssfk\.unit: expected the name"):
        parse("kopf.achs_nr 1\n").replace({"kw.ssfk.unit": 1})


def test_unknown_entries_of_the_list_can_be_changed() -> None:
    text = "kw.ssfk.res1 5\nfrict_comp.file_path a.csv\n"
    values: dict[str, str | int | float | bool] = {
        "kw.ssfk.res1": 6,
        "frict_comp.file_path": "b (2).csv",
    }
    expected = 'kw.ssfk.res1 6\nfrict_comp.file_path "b (2).csv"\n'
    assert edited(text, values) == expected


LIST = """\
# head
kopf.achs_nr            3
kw.ssfk.unit            1   (0.1 um)
kw.ssfk.kw_nr_max       2
kw.ssfk.table[0].pos    5
kw.ssfk.table[2].pos    7
Ende
"""


def added(values: dict[str, str | int | float | bool], text: str = LIST) -> list[str]:
    """Return the lines of the merged list, added ones marked with +."""
    old = text.splitlines()
    new = parse(text).merge(values).dumps().decode().splitlines()
    assert [line for line in new if line in old] == old
    return [line if line in old else f"+{line}" for line in new]


def test_merge_replaces_what_is_there() -> None:
    merged = parse(LIST).merge({"kw.ssfk.unit": 0, "kw.ssfk.table[2].pos": 8})
    expected = LIST.replace("1   (0.1", "0   (0.1").replace("    7", "    8")
    assert merged.dumps().decode() == expected


def test_added_table_entry_goes_behind_the_next_smaller_index() -> None:
    lines = added({"kw.ssfk.table[1].pos": 6, "kw.ssfk.table[3].pos": 9})
    assert lines[4:8] == [
        "kw.ssfk.table[0].pos    5",
        "+kw.ssfk.table[1].pos    6",
        "kw.ssfk.table[2].pos    7",
        "+kw.ssfk.table[3].pos    9",
    ]


def test_added_size_goes_before_the_table() -> None:
    lines = added({"kw.ssfk.max_points": 100})
    assert lines[3:5] == ["kw.ssfk.kw_nr_max       2", "+kw.ssfk.max_points      100"]
    only_table = "kw.ssfk.table[0].pos 5\n"
    assert added({"kw.ssfk.unit": 1}, only_table)[0] == "+kw.ssfk.unit         1"


def test_added_structure_goes_before_the_closing_line() -> None:
    for closing in ("Ende", "END", "# Ende", "#End\n\n"):
        text = LIST.replace("Ende\n", f"{closing}\n")
        lines = added({"kw.crosscomp.unit": 1}, text)
        assert lines[lines.index(closing.strip()) - 1].startswith("+kw.crosscomp.unit ")


def test_added_column_goes_behind_the_table() -> None:
    lines = added({"kw.ssfk.table[0].neg": 1, "kw.ssfk.table[1].neg": 2})
    assert lines[6:8] == ["+kw.ssfk.table[0].neg    1", "+kw.ssfk.table[1].neg    2"]


def test_added_header_goes_to_the_top() -> None:
    lines = added({"kopf.achs_nr": 3}, "# c\nkw.ssfk.unit 1\n")
    assert lines[:2] == ["# c", "+kopf.achs_nr 3"]


def test_added_lines_have_the_line_ends_and_the_comment_asked_for() -> None:
    found = ListFile.parse(b"kw.ssfk.unit 1\r\nkw.ssfk.interval 5")
    merged = found.merge({"kw.ssfk.kw_nr_max": 2}, comment="neu µm")
    expected = (
        b"kw.ssfk.unit 1\r\nkw.ssfk.interval 5\r\n# neu um\r\nkw.ssfk.kw_nr_max 2\r\n"
    )
    assert merged.dumps() == expected


def test_added_line_never_splits_a_wrapped_comment() -> None:
    text = "kw.crosscomp.last_index 9 /* last\nindex */\nkopf.achs_nr 1\n"
    assert added({"kw.crosscomp.unit": 1}, text)[2] == "+kw.crosscomp.unit       1"


def test_merge_into_an_empty_list_gives_the_entries() -> None:
    merged = ListFile.parse(b"").merge({"kopf.achs_nr": 3})
    assert merged.dumps() == b"kopf.achs_nr  3\n"


@pytest.mark.parametrize("name", ["kw.ssfk.res1", "kw.ssfk.table.pos", "no name"])
def test_only_entries_of_the_manuals_are_added(name: str) -> None:
    with pytest.raises(UnknownEntryError, match="parameter in the manuals"):
        parse(LIST).merge({name: 1})


def test_merged_values_are_read_back() -> None:
    values: dict[str, str | int | float | bool] = {
        f"kw.ssfk.table[{k}].{name}": k * sign
        for k in range(30)
        for name, sign in (("pos", 3), ("neg", -2))
    }
    merged = parse(LIST).merge(values | {"kw.ssfk.kw_nr_max": 30})
    assert merged.table("kw.ssfk", "pos") == {k: 3 * k for k in range(30)}
    assert merged.table("kw.ssfk", "neg") == {k: -2 * k for k in range(30)}
    assert [r.code for r in merged.remarks] == ["end-line"]
    rows = merged.columns["kw.ssfk.table[].pos"].indices
    assert rows == sorted(rows)


def test_remove_takes_whole_lines() -> None:
    found = parse(LIST + "KW.ssfk.table[ 2].pos 9 # again\n")
    shrunk = found.remove(["kw.ssfk.table[2].pos", "kw.ssfk.table[9].pos"])
    assert shrunk.dumps().decode() == LIST.replace("kw.ssfk.table[2].pos    7\n", "")


def test_errors_survive_pickling() -> None:
    import pickle

    for error in (
        EntryValueError("a.lis", "kw.ssfk.unit", "2", "0 or 1"),
        UnknownEntryError("a.lis", "x", "a name"),
    ):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again)) == (type(error), str(error))

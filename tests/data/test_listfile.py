"""Reading lists: what a line says, what is odd about it, typed access."""

import pickle

import pytest

from axcomp.data.lists import ListFile, TextRemark

CROSS = """\
# ****************************************
# Axis compensation data for Z-axis
# ****************************************

kopf.achs_nr                          3
kopf.log_achs_name                    Z
kw.crosscomp.last_index               99  /*Last valid index of the table*/
kw.crosscomp.master_ax_nr             1   /*Log. ax. number of the master axis*/
kw.crosscomp.unit                     1   /*0:Incr. 1:Metric in 0.1 µm*/
kw.crosscomp.n_cycles                 10
#
kw.crosscomp.table[0].setpoint        10735
kw.crosscomp.table[0].correction      3
kw.crosscomp.table[1].setpoint        11523
kw.crosscomp.table[1].correction      5
:
:
kw.crosscomp.table[99].setpoint       10000000  /*at 1000 mm of axis 3*/
kw.crosscomp.table[99].correction     1000      /*corr. of 0.1 mm for axis 1*/
"""
"""TF5200 axis compensation parameters, 3.1.7."""


def parse(text: str) -> ListFile:
    return ListFile.parse(text.encode())


def codes(text: str) -> list[str]:
    return [remark.code for remark in parse(text).remarks]


def test_printed_list_reads_and_names_every_line_it_leaves_out() -> None:
    found = parse(CROSS)
    assert found.kind == "compensation"
    assert found.integer("kopf.achs_nr") == 3
    assert found.text("kopf.log_achs_name") == "Z"
    assert found.integer("kw.crosscomp.n_cycles") == 10
    assert found.table("kw.crosscomp", "correction") == {0: 3, 1: 5, 99: 1000}
    assert found.integer("kw.crosscomp.table[99].setpoint") == 10_000_000
    assert [(remark.line, remark.code) for remark in found.remarks] == [
        (11, "bare-hash"),
        (16, "unreadable-line"),
        (17, "unreadable-line"),
    ]


def test_entry_knows_where_name_and_value_stand() -> None:
    entry = parse("# x\n  Kw.ssfk.table[ 2].Pos\t -102 (third)\n").entries[0]
    assert entry.name == "kw.ssfk.table[2].pos"
    assert entry.written == "Kw.ssfk.table[ 2].Pos"
    assert entry.key == "kw.ssfk.table[].pos"
    assert entry.indices == (2,)
    assert (entry.line, entry.column, entry.value_column) == (2, 3, 26)
    assert entry.value == "-102"


def test_blanks_in_indices_are_part_of_the_name() -> None:
    found = parse("kw.crosscomp2.table[ 0][ 10].correction          -3\n")
    assert found.table("kw.crosscomp2", "correction") == {(0, 10): -3}
    assert found.integer("kw.crosscomp2.table[0][10].correction") == -3
    assert found.remarks == ()


@pytest.mark.parametrize(
    "comment", ["Comment", "# Comment", "( Comment", "/* Comment", "/* a */ # b ( c"]
)
def test_comment_of_any_style_follows_a_number(comment: str) -> None:
    found = parse(f"kw.ssfk.kw_nr_max 1 {comment}\n")
    assert found.integer("kw.ssfk.kw_nr_max") == 1
    assert found.remarks == ()


@pytest.mark.parametrize(
    ("value", "column"), [("1#c", 15), ("1(c)", 15), ("1/*c*/", 15), ("TRUE#c", 18)]
)
def test_comment_glued_to_a_number_makes_it_unreadable(value: str, column: int) -> None:
    found = parse(f"kw.ssfk.unit {value}\n")
    assert found.boolean("kw.ssfk.unit") is None
    assert found.integer("kw.ssfk.unit") is None
    assert found.remarks == (TextRemark(1, column, "glued-comment", value),)


@pytest.mark.parametrize(
    ("line", "value", "code"),
    [
        ("STRING_2 (Comment: brackets required)", "STRING_2", None),
        ("STRING_2(Comment)", "STRING_2", None),
        ("Y AXIS", "Y AXIS", "unquoted-blank"),
        ("Y AXIS (second)", "Y AXIS", "unquoted-blank"),
        ("Z # Comment", "Z", "quote-comment"),
        ("Z /* Comment */", "Z", "quote-comment"),
        ('"A ( # /*)_B"', "A ( # /*)_B", None),
        ('" A  " (trailing blanks go, leading ones stay)', " A", None),
        ('"A" # Comment', "A", "quote-comment"),
        ("\u2033A (2)\u2033 (c)", "A (2)", "typographic-quote"),
        ("\u201eA B\u201c", "A B", "typographic-quote"),
        ('"A B', "A B", "unterminated-quote"),
    ],
)
def test_text_ends_where_the_manuals_say(
    line: str, value: str, code: str | None
) -> None:
    found = parse(f"kopf.log_achs_name {line}\n")
    assert found.text("kopf.log_achs_name") == value
    assert [remark.code for remark in found.remarks] == ([code] if code else [])


def test_quote_without_a_blank_before_it_is_read() -> None:
    found = parse("beispiel[1].bezeichnung\u2033 STRING_(2)\u2033 (comment)\n")
    assert found.text("beispiel[1].bezeichnung") == " STRING_(2)"
    assert {remark.code for remark in found.remarks} == {
        "glued-quote",
        "typographic-quote",
    }


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("Kw.ssfk.unit 1\n", "case"),
        ("kw.crosstalk.velocity_dependent TRUE\n", "true-false"),
        ("lr_param. n_backlash_cyc 10\n", "name-blank"),
        ("kw.ssfk.unit\u00a01\n", "no-break-space"),
        ("kopf.log_achs_nr 2\n", "alias"),
        ("kw.crosscomp.slave_ax_nr 2\n", "legacy"),
        ("kw.ssfk.unit\n", "no-value"),
        ("kw.ssfk.unit (1)\n", "no-value"),
        ("End\n", "end-line"),
        ("Ende", "end-line"),
        ("ENDE # done\n", "end-line"),
        ("#\n", "bare-hash"),
        ("#text\n", "bare-hash"),
        ("...\n", "unreadable-line"),
        ("\u2026\n", "unreadable-line"),
        ("kw.ssfk.unit=1\n", "unreadable-line"),
        ("1 kw.ssfk.unit\n", "unreadable-line"),
        ("// kw.ssfk.unit 1\n", "unreadable-line"),
        ("/* kw.ssfk.unit */\n", "comment-line"),
        ("( a comment\n", "comment-line"),
        ("/* a */ kw.ssfk.unit 1\n", "unreadable-line"),
        ("kw.ssfk.unit 1\nkw.ssfk.unit 0\n", "repeated"),
    ],
)
def test_each_anomaly_has_its_remark(text: str, code: str) -> None:
    assert codes(text) == [code]


def test_comment_over_a_whole_line_needs_no_remark() -> None:
    assert codes("# a\n   # b\n# End\n\n \t\n") == []


def test_reading_goes_on_behind_bad_lines_and_closing_lines() -> None:
    found = parse("?\nkw.ssfk.unit 1\nEnde\nkw.ssfk.interval 5\n")
    assert found.integer("kw.ssfk.interval") == 5
    assert [remark.line for remark in found.remarks] == [1, 3, 4]


def test_the_first_closing_line_ends_a_list() -> None:
    found = parse("kw.ssfk.unit 1\nEnde\nkw.ssfk.interval 5\nEnde\n")
    assert "behind-end" in [remark.code for remark in found.remarks]


def test_last_of_repeated_entries_counts() -> None:
    found = parse("kw.ssfk.table[0].pos 1\nKW.ssfk.table[ 0].pos 2\n")
    assert found.table("kw.ssfk", "pos") == {0: 2}
    assert len(found.entries) == 2
    assert (found.remarks[0].line, found.remarks[0].code) == (1, "repeated")


@pytest.mark.parametrize(
    "text", ["+5", "0x10", "1e3", "1.0", "5,", '"5"', "--5", "\u0665", ""]
)
def test_integers_are_decimal_only(text: str) -> None:
    found = parse(f"kw.ssfk.interval {text}\n")
    assert found.integer("kw.ssfk.interval") is None
    assert found.table("kw.ssfk", "pos") == {}


def test_integers_beyond_every_type_are_read_not_wrapped() -> None:
    found = parse("kw.ssfk.table[0].pos 99999999999999999999\n")
    assert found.integer("kw.ssfk.table[0].pos") == 99_999_999_999_999_999_999
    assert parse(f"kw.ssfk.interval {'9' * 5000}\n").integer("kw.ssfk.interval")


def test_comment_that_wraps_onto_the_next_line_is_no_entry() -> None:
    # As the ISG manual prints it in 3.1.7.
    found = parse(
        "kw.crosscomp.last_index 99 /*Last valid index of the\ntable*/\n"
        "kw.crosscomp.table[99].correction 1000 /*corr. of 0.1 mm for\naxis 1*/\n"
    )
    assert len(found.entries) == 2
    assert [(r.line, r.code) for r in found.remarks] == [
        (2, "comment-line"),
        (4, "comment-line"),
    ]


def test_open_comment_never_swallows_an_entry() -> None:
    found = parse("kw.ssfk.unit 1 /* open\nkw.ssfk.interval 5\nend of it */\n")
    assert found.integer("kw.ssfk.interval") == 5


def test_names_resolve_in_any_case_and_by_alias() -> None:
    found = parse("kopf.log_achs_nr 2\n")
    assert found.integer("KOPF.ACHS_NR") == 2
    assert found.integer("kopf.log_achs_nr") == 2
    assert found.get("kw.ssfk.unit") is None
    assert found.get("no name!") is None


def test_unknown_entries_are_kept() -> None:
    found = parse("kw.ssfk.res1 7\nfrict_comp.file_path C:\\x\\y.csv (c)\n")
    assert found.integer("kw.ssfk.res1") == 7
    assert found.text("frict_comp.file_path") == "C:\\x\\y.csv"


def test_path_of_a_start_up_list_is_its_whole_text() -> None:
    text = "zahl_kw 1\nachs_kw_log_ax_nr[0] 6\nachs_kw[0] ..\\listen\\achskw6.lis\n"
    found = parse(text)
    assert found.kind == "startup"
    assert found.text("achs_kw[0]") == "..\\listen\\achskw6.lis"
    assert found.integer("achs_kw_log_ax_nr[0]") == 6


def test_bit_names_are_one_value() -> None:
    name = "lr_param.prog_movement_requires_compensations"
    found = parse(f"{name} LEAD | CROSS (both)\n")
    assert found.kind == "axis"
    assert found.text(name) == "LEAD | CROSS"


@pytest.mark.parametrize(
    ("raw", "encoding"),
    [
        (b"# plain\n", "ascii"),
        ("# µm\n".encode(), "utf-8"),
        ("# µm\n".encode("latin-1"), "latin-1"),
        (b"# \x84quotes\x93\n", "latin-1"),
        ("\ufeff# µm\n".encode(), "utf-8"),
    ],
)
def test_encoding_is_named_and_kept(raw: bytes, encoding: str) -> None:
    found = ListFile.parse(raw)
    assert found.encoding == encoding
    assert found.dumps() == raw
    odd = [remark for remark in found.remarks if remark.code == "encoding"]
    assert bool(odd) == (encoding == "latin-1")


def test_byte_order_mark_does_not_hide_the_first_entry() -> None:
    found = ListFile.parse("\ufeffkopf.achs_nr 3\n".encode())
    assert found.integer("kopf.achs_nr") == 3
    assert found.entries[0].column == 2


def test_utf_16_is_named_as_what_it_is() -> None:
    found = ListFile.parse("kopf.achs_nr 3\n".encode("utf-16"))
    assert found.remarks[0].text == "starts like UTF-16"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_are_kept_and_counted(end: str) -> None:
    found = parse(f"# a{end}kw.ssfk.unit 1{end}kw.ssfk.interval 2")
    assert found.newline == end
    assert [entry.line for entry in found.entries] == [2, 3]
    assert found.integer("kw.ssfk.unit") == 1


def test_mixed_line_ends_are_kept() -> None:
    raw = b"kw.ssfk.table[0].pos 1\r\nkw.ssfk.table[1].pos 2\rkw.ssfk.table[2].pos 3\n"
    found = ListFile.parse(raw)
    assert found.dumps() == raw
    assert found.table("kw.ssfk", "pos") == {0: 1, 1: 2, 2: 3}
    assert found.columns["kw.ssfk.table[].pos"].lines == [1, 2, 3]


def test_header_alone_reads_as_compensation_list() -> None:
    assert parse("kopf.achs_nr 1\n").kind == "compensation"
    assert parse("kopf.achs_nr 1\nlr_param.temp_comp 1\n").kind == "axis"
    assert parse("hello world\n").kind == "unknown"
    assert parse("").kind == "unknown"


def test_list_survives_pickling() -> None:
    found = parse(CROSS)
    assert found.integer("kopf.achs_nr") == 3
    again = pickle.loads(pickle.dumps(found))
    assert again == found
    assert again.dumps() == found.dumps()

"""What holds for any list whatever: lossless, total, and the same on both paths."""

import math

import pytest
from hypothesis import example, given, settings, strategies as st

from axcomp.data.errors import AxcompError
from axcomp.data.lists import ListFile, check
from axcomp.data.lists._grammar import read_line

# Seeded, and without a time limit per example: the first one loads the registry.
SEEDED = settings(deadline=None, derandomize=True)

NAMES = (
    "kopf.achs_nr",
    "kopf.log_achs_name",
    "kw.crosscomp.unit",
    "Kw.crosscomp.table[ 3].setpoint",
    "kw.crosscomp2.table[0][12].correction",
    "kw.crosscomp2.table[ 10][ 3].correction",
    "kw.ssfk.table[2].pos",
    "kw.ssfk.table[0000002].neg",
    "lr_param. n_backlash_cyc",
    "lr_param.prog_movement_requires_compensations",
    "achs_kw[0]",
    "kw.ssfk.res1",
    "kw..ssfk",
    "kw.ssfk.table[12345678901].pos",
    "Ende",
    "",
)
VALUES = (
    *("0", "1", "-3", "007", "99999999999999999999", "+5", "0x1F", "1.5e3"),
    *("TRUE", "false", "LEAD | CROSS", "Y AXIS", '"a (b)"', "\u2033x\u2033"),
    *('"open', "..\\l\\a.lis", "[1]", ""),
)
TAILS = (
    "",
    " Comment",
    " # c",
    " (c",
    " /* c",
    " /* c */ ( d",
    "#c",
    "/*c",
    "*/",
    "\u00a0",
)
ENDS = ("\n", "\r\n", "\r")


@st.composite
def list_texts(draw: st.DrawFn) -> str:
    """Texts of lines that follow the grammar more or less."""
    entry = st.builds(
        lambda lead, name, gap, value, tail: f"{lead}{name}{gap}{value}{tail}",
        st.sampled_from(["", " ", "\t"]),
        st.sampled_from(NAMES),
        st.sampled_from([" ", "    ", "\t", "", "\u00a0"]),
        st.sampled_from(VALUES),
        st.sampled_from(TAILS),
    )
    other = st.sampled_from(
        ["", "#", "# text µ", "#x", "...", ":", "End", "/* a", "b */"]
    )
    rough = st.text(max_size=20)
    lines = draw(st.lists(st.one_of(entry, other, rough), max_size=12))
    return "".join(line + draw(st.sampled_from(ENDS)) for line in lines)


def realistic(encoding: str = "latin-1") -> bytes:
    """A list as installations have them, with CRLF and comments in all styles."""
    rows = [
        "# Maschine Süd, Z-Achse",
        "#",
        "kopf.achs_nr        3      ( log. Achsnummer",
        'kopf.log_achs_name  "Z ACHSE"  (größte Achse)',
        "kw.ssfk.unit        1  /* 0.1 µm */",
        "kw.ssfk.res1        0",
        *(f"kw.ssfk.table[ {k}].pos  {7 * k - 9} # {k}" for k in range(2)),
        *(f"kw.ssfk.table[ {k}].neg  {5 * k}" for k in range(2)),
        "kw.crosscomp2.table[ 0][ 1].correction  -4",
        "Ende",
    ]
    return "".join(f"{row}\r\n" for row in rows).encode(encoding)


def read_everything(raw: bytes) -> ListFile:
    found = ListFile.parse(raw, "any.lis")
    assert found.dumps() == raw
    count = len(found.lines)
    assert len(found.entries) == sum(len(r.lines) for r in found.columns.values())
    for entry in found.entries:
        assert 1 <= entry.line <= count
        assert found.get(entry.name) is not None
        found.integer(entry.name)
        found.boolean(entry.name)
        found.text(entry.name)
    for remark in found.remarks:
        assert 1 <= remark.line <= count
        assert remark.column >= 1
    assert found.kind
    assert found.newline
    return found


@SEEDED
@given(st.binary(max_size=300))
@example(b"\xff\xfek\x00")
@example(b"a\x00 1\n\x1a")
def test_any_bytes_come_back_unchanged_and_are_read(raw: bytes) -> None:
    read_everything(raw)


@SEEDED
@given(list_texts(), st.sampled_from(["utf-8", "latin-1"]))
def test_any_text_comes_back_unchanged_and_is_read(text: str, encoding: str) -> None:
    read_everything(text.encode(encoding, errors="replace"))


@SEEDED
@given(list_texts())
def test_check_of_any_text_gives_findings_never_an_exception(text: str) -> None:
    found = ListFile.parse(text.encode(), "any.lis")
    assert all(f.line <= max(1, len(found.lines)) for f in check([found]))


def test_every_truncation_of_a_real_list_is_read() -> None:
    raw = realistic()
    for end in range(len(raw)):
        read_everything(raw[:end])
    raw = realistic("utf-8")
    for end in range(raw.index(b"kw.")):  # also in the middle of a character
        read_everything(raw[:end])


@SEEDED
@given(list_texts())
def test_every_line_is_entry_comment_or_remarked(text: str) -> None:
    found = ListFile.parse(text.encode())
    told = {r.line for r in found.remarks} | {entry.line for entry in found.entries}
    for number, line in enumerate(found.lines, 1):
        stripped = line.strip(" \t\r\n\v\f\u00a0\u2007\u202f\ufeff")
        assert number in told or not stripped or stripped.startswith("#")


@SEEDED
@given(list_texts())
def test_columns_agree_with_the_line_reader(text: str) -> None:
    found = ListFile.parse(text.encode())
    for key, rows in found.columns.items():
        for indices, value, number in zip(
            rows.indices, rows.texts, rows.lines, strict=True
        ):
            line = read_line(found.lines[number - 1])
            assert (line.key, line.indices, line.value) == (key, indices, value)


COLUMNS = (
    "frict_comp.table[{}].in",
    "frict_comp.table[ {}].out",
    "kw.ssfk.table[{}].pos",
    "KW.ssfk.table[{}].pos",
    "kw.crosscomp2.table[{}][ 3].correction",
    "kw.table[{}].in",
    "a.kw.table[{}].index",
    "achs_kw[{}]",
)


@SEEDED
@given(
    st.lists(st.sampled_from(COLUMNS), min_size=1, max_size=3),
    st.lists(st.sampled_from(["7\n", "-12 \r\n", "3 # c\n", "TRUE\n"]), max_size=30),
)
def test_columns_in_turn_say_what_each_of_their_lines_says(
    names: list[str], values: list[str]
) -> None:
    lines = [
        f"{names[k % len(names)].format(k // len(names))} {value}"
        for k, value in enumerate(values)
    ]
    found = ListFile.parse("".join(lines).encode())
    told = {
        number: (key, indices, value)
        for key, rows in found.columns.items()
        for indices, value, number in zip(
            rows.indices, rows.texts, rows.lines, strict=True
        )
    }
    read = map(read_line, lines)
    assert told == {
        number: (line.key, line.indices, line.value)
        for number, line in enumerate(read, 1)
    }
    assert all(rows.lines == sorted(rows.lines) for rows in found.columns.values())


@SEEDED
@given(list_texts(), st.data())
def test_changing_one_entry_changes_only_its_characters(
    text: str, data: st.DataObject
) -> None:
    raw = text.encode()
    found = ListFile.parse(raw)
    entries = [e for e in found.entries if found.get(e.name) == e]
    if not entries:
        return
    entry = data.draw(st.sampled_from(entries))
    value = data.draw(st.sampled_from([0, 1, 2, 5, -7, "Z2", "a b", True]))
    try:
        changed = found.replace({entry.name: value})
    except AxcompError:
        return
    before, after = found.lines[entry.line - 1], changed.lines[entry.line - 1]
    line = read_line(before)
    assert changed.lines[: entry.line - 1] == found.lines[: entry.line - 1]
    assert changed.lines[entry.line :] == found.lines[entry.line :]
    assert after[: line.value_start] == before[: line.value_start]
    assert after.endswith(before[line.value_end :])
    said = changed.get(entry.name)
    assert said is not None
    expected = str(int(value)) if isinstance(value, bool) else str(value)
    same = said.value == expected or after == before
    assert same, (before, after)


def test_realistic_list_keeps_all_but_the_changed_values() -> None:
    raw = realistic()
    found = ListFile.parse(raw)
    changed = found.replace({"kw.ssfk.table[1].pos": 123, "kw.ssfk.unit": 0})
    expected = raw.replace(b".pos  -2 #", b".pos  123 #")
    expected = expected.replace(b"kw.ssfk.unit        1 ", b"kw.ssfk.unit        0 ")
    assert changed.dumps() == expected


@pytest.mark.parametrize("length", [10_000])
def test_hostile_lines_take_no_longer_than_their_length(length: int) -> None:
    # Nothing here may backtrack: a quadratic reader would need minutes.
    for piece in (" ", "a", "a.", "[", "a[1]", "(", "/*", '"', "|", "\u00a0", "1"):
        for lead in ("", "a", "kw.ssfk.unit ", "kopf.log_achs_name ", "a["):
            read_everything(f"{lead}{piece * math.ceil(length / len(piece))}".encode())

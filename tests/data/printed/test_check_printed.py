"""Every list that the manuals print: it reads, and what `check` says of it is right.

Several break the manuals' own rules: which and why stands above each.
"""

import textwrap

import pytest

from axcomp.data.lists import Finding, ListFile
from axcomp.data.lists._check import check

from .texts import (
    BACKLASH_001,
    COMMENTS_002,
    CROSS_000,
    CROSS_001,
    CROSSTALK_MODE_1,
    CROSSTALK_MODE_2,
    CROSSTALK_MODE_3,
    FRICTION_001,
    LEADSCREW_000,
    LEADSCREW_001,
    MONITORING_001,
    PLANE_000,
    PLANE_001_FIGURE,
    PLANE_001_LARGE,
    PLANE_001_MAX_POINTS,
    START_UP_001,
    TEMPERATURE_001_P17,
    TEMPERATURE_001_P18,
)

ELISION = ("error", None, None)
"""A line of dots or colons: neither an entry nor a comment (S-01)."""


def parse(text: str) -> ListFile:
    return ListFile.parse(textwrap.dedent(text).lstrip("\n").encode(), "printed.lis")


def serious(text: str) -> list[tuple[str, str | None, int | None]]:
    """Return level, id and controller number of every error and warning, sorted."""
    found = [
        (f.level, f.id, f.number) for f in check([parse(text)]) if f.level != "info"
    ]
    return sorted(found, key=str)


def infos(text: str) -> list[Finding]:
    return [finding for finding in check([parse(text)]) if finding.level == "info"]


def pinned(
    *rows: tuple[str, str | None, int | None],
) -> list[tuple[str, str | None, int | None]]:
    return sorted(rows, key=str)


# Breaks: 97 of 100 points are left out in print, so their setpoints are 0 and do not
# ascend (70245); the lines of colons are no entries. Its comments speak of axis 3 as
# the master and axis 1 as the slave: they fit the older rule that the list belongs to
# the master (S-10), which is nothing that a checker can see.
@pytest.mark.parametrize(
    "text", [CROSS_000, CROSS_001], ids=["000/002 3.1.7", "001 p.35"]
)
def test_cross_example(text: str) -> None:
    assert serious(text) == pinned(
        ELISION,
        ELISION,
        ("error", "P-COMP-00006", 70245),
        ("warning", "P-COMP-00007", None),
    )
    assert parse(text).integer("kw.crosscomp.table[99].setpoint") == 10_000_000


# Breaks nothing in its figures: (100 + 1)² = 10201 entries are exactly the default
# size. The entries left out in print count as 0; `End` stands without # (S-09).
def test_plane_example_of_the_parameter_manuals() -> None:
    assert serious(PLANE_000) == pinned(ELISION, ("warning", "P-COMP-00016", None))
    end = next(f for f in check([parse(PLANE_000)]) if f.found == "End")
    assert (end.line, end.expected) == (37, "# Ende, or nothing")
    assert parse(PLANE_000).integer("kw.crosscomp2.table[0][7].correction") == 53


# A fragment beside a figure: it has no header, which every list needs (P-COMP-00001).
def test_plane_fragment_of_the_figure() -> None:
    assert serious(PLANE_001_FIGURE) == pinned(
        ELISION,
        ("error", "P-COMP-00001", None),
        ("warning", "P-COMP-00016", None),
    )


# Breaks: intervals and master axes are left out, although their default 0 is outside
# their own range (S-49), and the unit is then increments. Its size is right: 1001 · 21
# = 21021 entries in 50000; the text beside it speaks of the product of the last indices
# (S-15).
def test_plane_example_with_max_points() -> None:
    assert serious(PLANE_001_MAX_POINTS) == pinned(
        ELISION,
        ("error", "P-COMP-00009", 70430),
        ("error", "P-COMP-00014", 70182),
        ("error", "P-COMP-00015", 70182),
        ("warning", "P-COMP-00008", None),
        ("warning", "P-COMP-00016", None),
    )


# Breaks: last_index_master2 200 without max_points, where 100 is the limit
# (P-COMP-00061), and 101 · 201 = 20301 entries in a default of 10201: the kernel
# reports 70610.
def test_plane_example_with_two_hundred_rows() -> None:
    assert serious(PLANE_001_LARGE) == pinned(
        ELISION,
        ("error", "P-COMP-00011", 70610),
        ("error", "P-COMP-00061", 70610),
        ("warning", "P-COMP-00016", None),
    )
    size = next(f for f in check([parse(PLANE_001_LARGE)]) if f.id == "P-COMP-00061")
    assert "max_points = 10201 (default)" in size.found
    assert "last_index_master2 = 200" in size.found
    assert (
        parse(PLANE_001_LARGE).integer("kw.crosscomp2.table[200][71].correction") == 45
    )


# Breaks: the points left out in print do not ascend (110590). `kopf.log_achs_nr` is
# another name of kopf.achs_nr (S-48). The programmed position of the worked figures is
# +19866.7 µm where table[2].setpoint is -198667 (S-18): no rule of a list shows that.
def test_leadscrew_example_of_the_parameter_manuals() -> None:
    assert serious(LEADSCREW_000) == pinned(
        ELISION,
        ELISION,
        ELISION,
        ("error", "P-COMP-00025", 110590),
        ("warning", "P-COMP-00023", None),
        ("warning", "P-COMP-00024", None),
    )
    assert parse(LEADSCREW_000).integer("kopf.achs_nr") == 2
    told = {finding.id: finding.message for finding in infos(LEADSCREW_000)}
    assert told["P-COMP-00001"].endswith("kopf.log_achs_nr for kopf.achs_nr")
    assert "bilateral" in told["P-COMP-00057"]


# Breaks besides: the name `Y AXIS` has a blank and no quotes (S-03).
def test_leadscrew_example_of_the_functional_description() -> None:
    assert serious(LEADSCREW_001) == pinned(
        ELISION,
        ELISION,
        ELISION,
        ("error", "P-COMP-00025", 110590),
        ("warning", "P-COMP-00002", None),
        ("warning", "P-COMP-00023", None),
        ("warning", "P-COMP-00024", None),
    )
    assert parse(LEADSCREW_001).text("kopf.log_achs_name") == "Y AXIS"


# Breaks: position_delay 30 where at most 10 is allowed (S-29); a velocity of 0, which
# one of two statements allows (S-26). It is a fragment without header. A scaling of 10
# · 0.1 % is allowed and hardly acts.
def test_friction_example() -> None:
    assert serious(FRICTION_001) == pinned(
        ("error", "P-COMP-00001", None),
        ("error", "P-COMP-00043", None),
        ("warning", "P-COMP-00046", 110591),
    )
    delay = next(f for f in check([parse(FRICTION_001)]) if f.id == "P-COMP-00043")
    assert (delay.line, delay.column, delay.found) == (3, 27, "30")
    assert [finding.id for finding in infos(FRICTION_001)] == ["P-COMP-00045"]


# Breaks nothing. TRUE and Kw are read as 1 and kw (S-02, S-07).
def test_crosstalk_example_of_mode_1() -> None:
    assert serious(CROSSTALK_MODE_1) == []
    told = [finding.message for finding in infos(CROSSTALK_MODE_1)]
    assert sum("TRUE" in message for message in told) == 1
    assert sum("Kw.crosstalk" in message for message in told) == 2


# Breaks: neither max_points nor the adaptation axis is given, both needed in mode 2
# (S-40).
def test_crosstalk_example_of_mode_2() -> None:
    assert serious(CROSSTALK_MODE_2) == pinned(
        ("error", "P-COMP-00080", 70657),
        ("error", "P-COMP-00083", None),
    )


# Breaks nothing but its elisions: seven of nine tests are left out. It uses a third
# spelling of six names (S-41).
def test_crosstalk_example_of_mode_3() -> None:
    lacking = ("00085", "00086", "00087", "00088", "00089", "00090")
    assert serious(CROSSTALK_MODE_3) == pinned(
        *(("warning", f"P-COMP-{number}", None) for number in lacking)
    )
    file = parse(CROSSTALK_MODE_3)
    assert file.integer("kw.crosstalk.deceleration") == -1000
    name = "kw.crosstalk.position[8].correction_decelerate_dir_pos"
    assert file.integer(name) == 60


def test_start_up_example() -> None:
    assert serious(START_UP_001) == [ELISION, ELISION]
    assert parse(START_UP_001).kind == "startup"


# `lr_param. n_backlash_cyc` with a blank is probably a slip of the text extraction
# (S-46).
def test_backlash_example() -> None:
    assert serious(BACKLASH_001) == [("warning", "P-AXIS-00243", None)]
    assert parse(BACKLASH_001).integer("getriebe[0].lose") == 1000


def test_temperature_example() -> None:
    assert serious(TEMPERATURE_001_P17) == []


# Breaks: 20 cycles, where the parameter asks for fewer than 20 (S-44).
def test_temperature_example_with_twenty_cycles() -> None:
    assert serious(TEMPERATURE_001_P18) == [("warning", "P-AXIS-00275", 110362)]


def test_monitoring_example() -> None:
    assert serious(MONITORING_001) == []


@pytest.mark.parametrize(
    "text",
    [
        "lr_param.crosscomp 1\n",
        "lr_param.crosscomp2 1\n",
        "lr_param.ssfk 1\n",
        "lr_param.crosstalk 1\n",
        "kopf.achs_nr 1\n#\n# temperature compensation on/off\nlr_param.temp_comp 1\n",
        "lr_param.temp_comp_manual_activation 0\n",
    ],
)
def test_excerpts_of_axis_lists(text: str) -> None:
    assert serious(text) == []


# The page shows typographic quotes, one without a blank before it (S-04), and is no
# list of parameters at all.
def test_comment_examples() -> None:
    rows = serious(COMMENTS_002)
    assert rows.count(ELISION) == 2
    messages = [f.message for f in check([parse(COMMENTS_002)]) if f.level == "warning"]
    assert sum(message.startswith("typographic quote") for message in messages) == 2
    assert sum(message.startswith("quote without a blank") for message in messages) == 1
    file = parse(COMMENTS_002)
    assert [file.integer(f"dummy[{i}]") for i in (1, 2, 3, 4)] == [1, 1, 1, 1]
    assert file.text("beispiel[0].bezeichnung") == "STRING_1"
    assert file.text("beispiel[1].bezeichnung") == " STRING_(2)"


@pytest.mark.parametrize("closing", ["End", "Ende", "END"])
def test_closing_line_is_no_warning_and_ends_nothing(closing: str) -> None:
    # Real lists end so (S-09). What stands behind it the controller may not read.
    assert serious(f"kopf.achs_nr 3\nkw.ssfk.kw_nr_max 0\n{closing}\n") == []
    text = f"kopf.achs_nr 3\n{closing}\nkw.ssfk.kw_nr_max 0\n"
    assert serious(text) == [("warning", "P-COMP-00020", None)]
    assert parse(text).integer("kw.ssfk.kw_nr_max") == 0

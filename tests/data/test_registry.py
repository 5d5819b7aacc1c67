"""The registry of parameters, held to the manuals and to itself."""

import pathlib
import re

import pytest
from hypothesis import given, strategies as st

from axcomp.data.lists import registry
from axcomp.data.lists._document import document
from axcomp.data.lists._expression import Expression, expression
from axcomp.data.lists._parameter import parse_interval
from axcomp.data.lists._registry import BuildError, build_has, parse_build
from axcomp.data.lists._values import (
    INTEGER_LIMITS,
    parse_bits,
    parse_boolean,
    parse_integer,
    parse_real,
)

ROOT = pathlib.Path(__file__).parents[2]
SEEDS = ROOT.parent / "shared" / "seeds"
ID = re.compile(r"P-(?:COMP|AXIS|STUP)-[0-9]+")
PLACEHOLDER = "P-COMP-00"
"""A figure of [001] prints P-COMP-00<i> for all of them."""


@pytest.fixture(scope="module")
def named() -> set[str]:
    """Every id that the five manuals print; words broken over lines are joined."""
    texts = sorted(SEEDS.glob("00*.txt")) if SEEDS.is_dir() else []
    if not texts:
        pytest.skip("needs ../shared/seeds/00*.txt")
    found: set[str] = set()
    for path in texts:
        text = path.read_text(encoding="utf-8")
        text = re.sub(r"(P-)[\s]*((?:COMP|AXIS|STUP)-)\s*(?=[0-9])", r"\1\2", text)
        found.update(ID.findall(text))
    return found - {PLACEHOLDER}


def test_every_id_of_the_manuals_has_a_row(named: set[str]) -> None:
    assert named - set(registry().by_id) == set()


def test_no_row_is_invented(named: set[str]) -> None:
    assert {row.id for row in registry().rows if row.id} - named == set()


def test_entries_without_an_id_are_those_of_the_start_up_list() -> None:
    rows = [row for row in registry().rows if row.id is None]
    assert {row.kind for row in rows} == {"startup"}
    assert {row.key for row in rows} == {"zahl_kw", "achs_kw[]", "achs_kw_log_ax_nr[]"}


def test_parameters_named_in_passing_are_marked() -> None:
    assert {row.id for row in registry().rows if row.mentioned} == {
        "P-AXIS-00001",
        "P-AXIS-00008",
    }


def test_registry_has_the_rows_that_the_manuals_describe() -> None:
    ids = [row.id or "" for row in registry().rows]
    counted = {
        prefix: len({name for name in ids if name.startswith(prefix)})
        for prefix in ("P-COMP", "P-AXIS", "P-STUP")
    }
    assert counted == {"P-COMP": 63, "P-AXIS": 20, "P-STUP": 1}


def test_reused_ids_lead_to_the_present_meaning() -> None:
    known = registry()
    assert known.by_id["P-COMP-00063"].key == "kw.crosstalk.master_dyn_ax_nr"
    assert known.by_id["P-COMP-00066"].key == "kw.crosstalk.acceleration"
    assert known.by_key["kw.crosstalk.manual_activation"].id == "P-COMP-00065"
    old = {row.id: row.key for row in known.rows if row.generation == "old"}
    assert old == {
        "P-COMP-00063": "kw.crosstalk.master_ax_nr",
        "P-COMP-00065": "kw.crosstalk.last_index",
        "P-COMP-00066": "kw.crosstalk.table[].acceleration",
        "P-COMP-00067": "kw.crosstalk.table[].correction",
        "P-COMP-00073": "kw.crosstalk.manual_activation",
    }


@pytest.mark.parametrize(
    ("other", "key"),
    [
        ("kopf.log_achs_nr", "kopf.achs_nr"),
        ("kw.crosscomp.slave_ax_nr", "kw.crosscomp.master_ax_nr"),
        ("kw.crosstalk.acceleration_pos", "kw.crosstalk.acceleration"),
        ("kw.crosstalk.acceleration_neg", "kw.crosstalk.deceleration"),
        (
            "kw.crosstalk.position[].acc_pos_vel_neg_correction",
            "kw.crosstalk.position[].correction_accelerate_dir_neg",
        ),
        (
            "kw.crosstalk.position[].acc_neg_vel_pos_correction",
            "kw.crosstalk.position[].correction_decelerate_dir_pos",
        ),
        ("kw.ssfk.res1", "kw.ssfk.res1"),
    ],
)
def test_other_names_lead_to_the_canonical_key(other: str, key: str) -> None:
    assert registry().canonical(other) == key
    alias = registry().alias(other)
    assert (alias is None) == (other == key)


def test_misprinted_id_leads_to_its_row() -> None:
    assert registry().by_id["P-COMP-000031"].key == "kw.crosscomp2.grid"


def test_every_described_row_is_whole() -> None:
    types = {*INTEGER_LIMITS, "REAL64", "STRING", "BITS"}
    for row in registry().rows:
        assert row.text
        assert row.source
        if row.mentioned:
            continue
        assert row.type in types, row
        assert row.kind in ("compensation", "axis", "startup"), row
        assert all(re.fullmatch(r"S-[0-9]{2}", number) for number in row.semantics), row
        bounded = row.range or row.values or row.type in ("BOOLEAN", "STRING")
        assert bounded or row.kind == "startup", row


def test_defaults_outside_their_range_are_exactly_those_of_s_49() -> None:
    outside = {
        row.id
        for row in registry().rows
        if isinstance(row.default, int)
        and row.range is not None
        and not row.range.holds(row.default, row.default)
    }
    numbers = (1, 5, 9, 14, 15, 32, 33, 46, 63, 66, 67, 80, 81)
    axis = {"P-AXIS-00243", "P-AXIS-00275"}
    assert outside == {f"P-COMP-{number:05d}" for number in numbers} | axis


def test_expressions_name_entries_of_their_own_structure() -> None:
    known = registry().by_key
    count = 0
    for row in known.values():
        texts = [row.needed] if row.needed is not None else []
        for condition in row.conditions:
            texts += [
                *condition.readings,
                *([condition.when] if condition.when else []),
            ]
        for text in texts:
            count += 1
            for name in expression(text).names:
                assert f"{row.structure}.{name}" in known, (row.key, name)
    assert count > 20


def test_expression_says_nothing_where_a_value_is_unknown() -> None:
    assert Expression("a < b + 1").holds(lambda _: None, lambda _: True) is None


def test_expression_combines_and_compares() -> None:
    values = {"a": 3, "b": 4, "c": "TEXT"}
    cases = {
        "a < b and not given(a)": False,
        "(a + 1) * b - 1 >= 15": True,
        "c == 'TEXT' or a > b": True,
        "c != 'TEXT'": False,
        "true": True,
    }
    for text, result in cases.items():
        assert Expression(text).holds(values.get, lambda _: True) is result


@pytest.mark.parametrize(
    "text", ["__import__('os')", "a.b < 1", "[a]", "a < b < c", "a ** b"]
)
def test_expression_allows_nothing_else(text: str) -> None:
    with pytest.raises(ValueError, match="expression"):
        Expression(text).holds(lambda _: 1, lambda _: True)


def test_range_ends_are_those_of_the_type() -> None:
    interval = parse_interval("MIN <= x < MAX", "SGN16")
    assert interval.holds(-32768, 32766)
    assert not interval.holds(0, 32767)
    assert not interval.holds(-32769, 0)
    assert parse_interval("0 < x", "UNS32").maximum == 2**32 - 1


@pytest.mark.parametrize(
    ("build", "has"),
    [
        ("V3.1.3079.06", True),
        ("V3.1.3079.6", True),
        ("3.1.3108.4", True),
        ("V2.11.2022.05", False),
    ],
)
def test_build_decides_which_parameters_exist(build: str, has: bool) -> None:
    assert build_has(registry().by_id["P-COMP-00061"], build) is has


@pytest.mark.parametrize("build", ["", "newest", "V3", "V3.1.x"])
def test_build_that_cannot_be_read_is_refused(build: str) -> None:
    with pytest.raises(BuildError, match="expected a name such as V3"):
        parse_build(build)


@pytest.mark.parametrize(
    "text", ["+5", "0x10", "1e3", "1.0", "", "-", "٣", "--1", "1 "]
)
def test_only_decimal_integers_are_integers(text: str) -> None:
    assert parse_integer(text) is None


@given(st.integers())
def test_integers_are_read_as_they_stand(value: int) -> None:
    assert parse_integer(str(value)) == value


def test_enormous_integers_stay_outside_every_type() -> None:
    value = parse_integer("-" + "7" * 10_000)
    assert value is not None
    assert value < INTEGER_LIMITS["SGN64"][0]


def test_booleans_are_numbers_or_words() -> None:
    texts = ("0", "1", "TRUE", "False", "2", "yes")
    assert [parse_boolean(text) for text in texts] == [
        False,
        True,
        True,
        False,
        None,
        None,
    ]


def test_reals_are_finite() -> None:
    texts = ("4000", "-1.5e3", ".5", "1e999", "nan", "inf", "1,5")
    values = [parse_real(text) for text in texts]
    assert values == [4000.0, -1500.0, 0.5, None, None, None, None]


@pytest.mark.parametrize(
    ("text", "bits"),
    [
        ("LEAD | CROSS", 10),
        ("lead|plane", 18),
        ("0x1F", 31),
        ("12", 12),
        ("WARP", None),
    ],
)
def test_named_bits_are_read(text: str, bits: int | None) -> None:
    assert parse_bits(text) == bits


def test_documentation_is_current() -> None:
    # Renew with: python -m axcomp.data.lists._document > docs/parameters.md
    page = ROOT / "docs" / "parameters.md"
    if not page.is_file():
        pytest.skip("needs docs/parameters.md of the source tree")
    assert page.read_text(encoding="utf-8") == document()

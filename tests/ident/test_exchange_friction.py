"""Friction lists: the printed example by hand, and writing so that open points are moot."""

import equinox as eqx
import numpy as np
import pytest

from axcomp.data.lists import ListFile, check, new_list
from axcomp.ident.exchange import ExchangeError, ListTarget
from axcomp.ident.kinds.friction.entries import (
    ENTRIES,
    entries_of_friction,
    friction_from_list,
)
from axcomp.models import (
    Conventions,
    FrictionCompensation,
    FrictionTable,
    Setpoints,
    StribeckFriction,
)

RULES = Conventions()
ROUNDING = 1e-13  # two products of numbers below 1e4 and their sum

# [001] p.70, as printed.
PRINTED = """frict_comp.mode 3
frict_comp.table_entries 3
frict_comp.position_delay 30
frict_comp.reversal_lookahead 4
frict_comp.scaling_factor 10
frict_comp.delay_cycles 9
frict_comp.table[0].in 0
frict_comp.table[0].out 0
frict_comp.table[1].in 316
frict_comp.table[1].out 3722
frict_comp.table[2].in 333
frict_comp.table[2].out 3884
"""


def parse(text: str) -> ListFile:
    return ListFile.parse(text.encode(), "a.lis")


def table(speeds: list[float], currents: list[float]) -> FrictionTable:
    return FrictionTable(Setpoints(np.array(speeds)), np.array(currents))


def test_printed_example_has_the_values_worked_out_by_hand() -> None:
    found = friction_from_list(parse(PRINTED), RULES)
    # 316 µm/s is 0.316 mm/s; the factor 10 is 1 %. Halfway to it half of 37.22; above
    # the last entry 38.84; the sign of the motion.
    speeds = np.array([0.0, 0.158, 0.316, 0.333, 5.0, -0.158, -5.0])
    expected = [0.0, 18.61, 37.22, 38.84, 38.84, -18.61, -38.84]
    np.testing.assert_allclose(found.current(speeds), expected, rtol=0, atol=ROUNDING)
    assert float(found.position_delay) == 0.003  # 30 times 0.1 µm
    assert (found.reversal_lookahead, found.delay_cycles) == (4, 9)


def test_conventions_reach_the_model() -> None:
    rules = Conventions(
        friction_sign=-1,
        friction_below="line",
        friction_above="line",
        friction_rest="hold",
        friction_build_up="start",
        friction_decay="step",
        friction_overlap="lesser",
        friction_delay="reversal",
    )
    found = friction_from_list(parse(PRINTED), rules)
    assert isinstance(found.law, FrictionTable)
    assert (found.law.held_below, found.law.held_above) == (False, False)
    assert (found.sign, found.held_at_rest, found.restart_builds_up) == (-1, True, True)
    kept = found.decays_to_zero, found.weights_multiply, found.delays_all
    assert kept == (False, False, False)
    reversal = friction_from_list(
        parse(PRINTED), Conventions(friction_build_up="reversal")
    )
    assert not reversal.first_builds_up


def test_what_is_read_is_the_compensation_that_its_numbers_make() -> None:
    read = friction_from_list(parse(PRINTED), RULES)
    made = FrictionCompensation(
        FrictionTable(
            Setpoints(np.array([0.0, 0.316, 0.333])),
            np.array([0.0, 3722.0, 3884.0]),
            scaling=0.01,
        ),
        reversal_lookahead=4,
        position_delay=0.003,
        delay_cycles=9,
    )
    assert eqx.tree_equal(read, made)


def test_list_with_mode_0_holds_no_friction() -> None:
    assert ENTRIES.is_in(parse(PRINTED))
    assert not ENTRIES.is_in(parse(PRINTED.replace("mode 3", "mode 0")))


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("mode 3", "mode 2", r"mode: found 2, expected 3"),
        ("table_entries 3\n", "\n", r"table_entries: found no entry"),
        (
            "[1].in 316",
            "[1].in 333",
            r"in: found 333 after 333 .*, expected ascending .*91",
        ),
        ("[0].in 0", "[0].in -1", r"found -1, expected velocities from 0"),
        ("factor 10", "factor x", r"scaling_factor: found 'x', expected an integer"),
        ("delay_cycles 9", "delay_cycles -9", r"delay_cycles: found -9, expected 0 or"),
    ],
)
def test_list_that_is_no_friction_table_is_refused(
    old: str, new: str, match: str
) -> None:
    with pytest.raises(ExchangeError, match=match):
        friction_from_list(parse(PRINTED.replace(old, new)), RULES)


def test_written_table_begins_at_1_and_ends_flat() -> None:
    model = FrictionCompensation(
        table([0.5, 20.0, 300.0], [100.0, 60.0, 81.0]),
        reversal_lookahead=2,
        position_delay=np.array(0.0004),
        delay_cycles=3,
    )
    entries = entries_of_friction(model)
    columns = [
        [entries[f"frict_comp.table[{k}].{name}"] for k in range(5)]
        for name in ("in", "out")
    ]
    assert columns[0] == [1, 500, 20_000, 300_000, 300_001]
    assert columns[1] == [100, 100, 60, 81, 81]
    assert entries["frict_comp.table_entries"] == 5
    assert entries["frict_comp.position_delay"] == 4
    assert entries["frict_comp.scaling_factor"] == 1000
    assert "frict_comp.max_points" not in entries


def test_what_is_written_is_read_back_as_the_same_currents_and_without_findings() -> (
    None
):
    model = FrictionCompensation(table([0.001, 20.0, 300.0], [100.0, 60.0, 60.0]))
    listing = new_list({"kopf.achs_nr": 1} | entries_of_friction(model))
    assert list(check([listing])) == []
    back = friction_from_list(ListFile.parse(listing.dumps(), "a"), RULES)
    speeds = np.linspace(-400, 400, 801)
    np.testing.assert_allclose(
        back.current(speeds), model.current(speeds), rtol=0, atol=ROUNDING
    )
    # Already closed at both ends: nothing was added.
    assert entries_of_friction(back) == entries_of_friction(model)
    assert entries_of_friction(model)["frict_comp.table_entries"] == 3


def test_scaling_goes_into_the_entries_and_an_entry_at_rest_becomes_the_slowest() -> (
    None
):
    found = friction_from_list(parse(PRINTED.replace("delay 30", "delay 3")), RULES)
    entries = entries_of_friction(found)
    # 37.22 and 38.84 rounded; 1 µm/s on the line from 0 to 37.22 is 0.12.
    out = [entries[f"frict_comp.table[{k}].out"] for k in range(4)]
    assert out == [0, 37, 39, 39]
    assert [entries[f"frict_comp.table[{k}].in"] for k in range(4)] == [
        1,
        316,
        333,
        334,
    ]


def test_larger_table_reserves_memory_where_the_build_can() -> None:
    speeds = np.geomspace(0.001, 300, 22)
    model = FrictionCompensation(FrictionTable(Setpoints(speeds), np.ones(22)))
    assert entries_of_friction(model)["frict_comp.max_points"] == 23
    with pytest.raises(ExchangeError, match=r"max_points: found a table that needs 23"):
        entries_of_friction(model, target=ListTarget(build="V3.1.3074.0"))


@pytest.mark.parametrize(
    ("model", "match"),
    [
        (
            FrictionCompensation(
                StribeckFriction(*(np.array(x) for x in (1.0, 2.0, 3.0, 2.0, 0.0)))
            ),
            "found a StribeckFriction, expected a friction table",
        ),
        (
            FrictionCompensation(table([1.0, 1.0001], [1.0, 2.0])),
            r"in: found 1000 after 1000 .*, expected velocities 0.001 mm/s",
        ),
        (
            FrictionCompensation(table([1.0], [3e9])),
            "out: found 3e[+]09, expected a value from",
        ),
        (
            FrictionCompensation(table([1.0], [3.0]), position_delay=np.array(0.003)),
            "position_delay: found 0.003 mm or °, expected a value from 0 to 0.001",
        ),
        (
            FrictionCompensation(table([1.0], [3.0]), reversal_lookahead=5),
            "reversal_lookahead: found 5, expected 0 to 4",
        ),
        (
            FrictionCompensation(
                FrictionTable(Setpoints(np.ones(1)), np.ones(1), held_above=False)
            ),
            "found a table that is not held at its ends",
        ),
    ],
)
def test_what_no_list_can_hold_is_refused(
    model: FrictionCompensation, match: str
) -> None:
    with pytest.raises(ExchangeError, match=match):
        entries_of_friction(model)

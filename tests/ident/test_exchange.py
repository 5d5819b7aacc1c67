"""List ↔ model: tables come back as written, and what fits no list is refused."""

import pickle
from collections.abc import Mapping

import jax
import numpy as np
import pytest

from axcomp.data.lists import ListFile, Value, check, new_list
from axcomp.ident.exchange import (
    ExchangeError,
    ListNodes,
    ListTarget,
    Reading,
    axis_number,
    grid_nodes,
    offset_at,
    point_nodes,
    refuse_lost_nodes,
)
from axcomp.ident.kinds.cross.entries import (
    ENTRIES as CROSS,
    CrossTable,
    cross_from_list,
    entries_of_cross,
)
from axcomp.ident.kinds.leadscrew.entries import (
    LeadscrewTable,
    entries_of_leadscrew,
    leadscrew_from_list,
)
from axcomp.ident.kinds.plane.entries import (
    PlaneTable,
    entries_of_plane,
    plane_from_list,
)
from axcomp.models import Conventions, Cross, Leadscrew, Plane, Setpoints

RULES = Conventions()
RNG = np.random.default_rng(20)
VALUES = RNG.integers(-450, 450, (7, 8))  # neighbours closer than `check` doubts


def parse(text: str, name: str = "achskw3.lis") -> ListFile:
    return ListFile.parse(text.encode(), name)


def listed(entries: Mapping[str, Value], axis: int = 3) -> ListFile:
    head: dict[str, int | str] = {"kopf.achs_nr": axis, "kopf.log_achs_name": "Z"}
    return new_list({**head, **entries})


def faults(listing: ListFile) -> list[str]:
    return [str(item) for item in check([listing]) if item.level != "info"]


@pytest.mark.parametrize("second", [100_000, 50_000])
def test_plane_comes_back_as_written(second: int) -> None:
    table = PlaneTable(
        3, (1, 2), (ListNodes.grid(220_000, 100_000, 8), ListNodes.grid(-160_000, second, 7)),
        RULES,
    )  # fmt: skip
    listing = listed(table.entries(VALUES))
    again = plane_from_list(listing, RULES)
    # QUADRATIC is the default and stays unwritten; a second interval asks for the word.
    square = second == 100_000
    assert (listing.text("kw.crosscomp2.grid") is None) is square
    np.testing.assert_array_equal(np.asarray(again.values), VALUES / 10_000)
    np.testing.assert_array_equal(
        np.asarray(again.nodes2.positions), table.nodes[1].positions
    )
    assert entries_of_plane(again, (1, 2)) == table.entries(VALUES)
    assert faults(listing) == []


def test_cross_comes_back_as_written() -> None:
    points = ListNodes((-100_001, 0, 35_000, 4_100_000))
    table = CrossTable(3, (1,), (points,), RULES)
    listing = listed(table.entries(VALUES[0, :4]))
    again = cross_from_list(listing, RULES)
    np.testing.assert_array_equal(np.asarray(again.nodes.positions), points.positions)
    assert entries_of_cross(again, (1,)) == table.entries(VALUES[0, :4])
    assert faults(listing) == []


@pytest.mark.parametrize("bilateral", [False, True])
@pytest.mark.parametrize(
    "nodes",
    [
        ListNodes.grid(-200_000, 50_000, 8),
        ListNodes(tuple(range(-50_000, 750_000, 100_000))),
    ],
)
def test_leadscrew_comes_back_as_written(bilateral: bool, nodes: ListNodes) -> None:
    table = LeadscrewTable(3, (3,), (nodes,), RULES, bilateral=bilateral)
    values = VALUES[:2] if bilateral else VALUES[0]
    listing = listed(table.entries(values))
    again = leadscrew_from_list(listing, RULES)
    assert entries_of_leadscrew(again) == table.entries(values)
    assert (again.neg is None) is not bilateral
    assert listing.boolean("kw.ssfk.set_pos_without_comp") is (bilateral or None)
    assert faults(listing) == []


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("bilateral", [False, True])
@pytest.mark.parametrize(
    "nodes", [ListNodes.grid(-200_000, 50_000, 8), ListNodes(tuple(range(-5, 75, 10)))]
)
def test_a_leadscrew_table_reads_and_makes_what_the_list_describes(
    periodic: bool, bilateral: bool, nodes: ListNodes
) -> None:
    values = np.array(VALUES[:2] if bilateral else VALUES[0])
    values[..., -1] = values[..., 0]
    table = LeadscrewTable(3, (3,), (nodes,), RULES, periodic, bilateral)
    listing = listed(table.entries(values))
    described = leadscrew_from_list(listing, RULES)
    leaves, structure = jax.tree.flatten(described)
    assert all(isinstance(leaf, jax.Array) for leaf in leaves)
    for model in (table.read(listing), table.model(values)):
        own, kind = jax.tree.flatten(model)
        assert kind == structure
        for leaf, other in zip(own, leaves, strict=True):
            np.testing.assert_array_equal(leaf, other)


@pytest.mark.parametrize("rows", [7, 1500])
def test_tables_that_are_asked_together_add_what_each_adds_alone(rows: int) -> None:
    plane = PlaneTable(
        3, (1, 2), (ListNodes.grid(0, 50_000, 8), ListNodes.grid(0, 50_000, 7)), RULES
    )
    screw = LeadscrewTable(
        3, (3,), (ListNodes.grid(0, 50_000, 8),), RULES, periodic=False, bilateral=True
    )
    places = RNG.uniform(-1.0, 40.0, (rows, 2))
    branch = RNG.integers(0, 2, rows)
    for table, lists in (
        (plane, np.stack([VALUES, -VALUES, 3 * VALUES])),
        (screw, VALUES[:6].reshape(3, 2, 8)),
    ):
        together = table.offsets(lists, places, branch)
        for one, found in zip(lists, together, strict=True):
            alone = table.offsets(one[None], places, branch)[0]
            # The same sums in the same order.
            np.testing.assert_array_equal(found, alone)
            # XLA may round products and sums of the 4 nodes once instead of twice.
            np.testing.assert_allclose(
                found, table.offset(table.model(one), places, branch), atol=1e-15
            )


def test_modulo_leadscrew_comes_back_with_its_range() -> None:
    nodes = ListNodes.grid(0, 900_000, 5)
    table = LeadscrewTable(3, (3,), (nodes,), RULES, periodic=True)
    listing = listed(table.entries(np.array([5, 10, -7, 3, 5])))
    again = leadscrew_from_list(listing, RULES)
    assert again.modulo == (0.0, 360.0)
    places = np.array([[-90.0], [270.0], [630.0]])
    # Three names of one place; the wrapped angle is exact here.
    np.testing.assert_array_equal(offset_at(again, places), [-3e-4] * 3)


def test_modulo_table_with_open_ends_is_refused() -> None:
    nodes = ListNodes.grid(0, 900_000, 5)
    table = LeadscrewTable(3, (3,), (nodes,), RULES, periodic=True)
    with pytest.raises(ExchangeError, match="found 5 at the start and 6 at the end"):
        table.entries(np.array([5, 10, -7, 3, 6]))


def test_sign_of_each_compensation_is_that_of_the_rules() -> None:
    one = np.array([[10, 10], [10, 10]])
    plane = PlaneTable(
        3, (1, 2), (ListNodes.grid(0, 10, 2), ListNodes.grid(0, 10, 2)), RULES
    )
    cross = CrossTable(3, (1,), (ListNodes((0, 10)),), RULES)
    screw = LeadscrewTable(3, (3,), (ListNodes((0, 10)),), RULES)
    at = np.zeros((1, 2))
    # Entry = offset for plane and cross; a leadscrew entry is an error.
    assert offset_at(plane.model(one), at)[0] == pytest.approx(1e-3, rel=1e-12)
    assert offset_at(cross.model(one[0]), at)[0] == pytest.approx(1e-3, rel=1e-12)
    assert offset_at(screw.model(one[0]), at)[0] == pytest.approx(-1e-3, rel=1e-12)
    for table, entries in ((plane, one), (cross, one[0]), (screw, one[0])):
        offset = table.to_offsets(entries)
        np.testing.assert_array_equal(table.to_integers(offset), entries)


def test_index_order_of_the_plane_is_a_convention() -> None:
    other = Conventions(plane_index="ij")
    nodes = (ListNodes.grid(0, 10, 8), ListNodes.grid(0, 20, 7))
    table = PlaneTable(3, (1, 2), nodes, other)
    entries = table.entries(VALUES)
    assert entries["kw.crosscomp2.table[7][6].correction"] == VALUES[6, 7]
    again = plane_from_list(listed(entries), other)
    np.testing.assert_array_equal(np.asarray(again.values), VALUES / 10_000)


def test_old_name_of_the_master_is_read() -> None:
    listing = parse(
        "kopf.log_achs_nr 3\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 1\n"
        "kw.crosscomp.slave_ax_nr 2\n"
        "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 5\n"
        "kw.crosscomp.table[1].setpoint 100\nkw.crosscomp.table[1].correction 7\n"
    )
    assert CrossTable.kind.entries.named_masters(listing) == (2,)
    assert axis_number(listing) == 3
    np.testing.assert_array_equal(
        np.asarray(cross_from_list(listing, RULES).values), [5e-4, 7e-4]
    )


def test_number_of_a_list_without_header_stands_in_its_name() -> None:
    assert axis_number(parse("kw.ssfk.unit 1\n", "lists/achskw12.lis")) == 12
    assert axis_number(parse("lr_param.ssfk 1\n", r"x\achsmds4.add.lis")) == 4
    with pytest.raises(ExchangeError, match=r"table.lis: found neither kopf.achs_nr"):
        axis_number(parse("kw.ssfk.unit 1\n", "table.lis"))


INCREMENTS = (
    "kopf.achs_nr 3\nkw.crosscomp.unit 0\nkw.crosscomp.last_index 1\n"
    "kw.crosscomp.master_ax_nr 1\n"
    "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 5\n"
    "kw.crosscomp.table[1].setpoint 1000\nkw.crosscomp.table[1].correction 7\n"
)


def test_list_in_increments_needs_their_worth() -> None:
    with pytest.raises(
        ExchangeError, match=r"kw.crosscomp.unit: found 0 .*--increment"
    ):
        cross_from_list(parse(INCREMENTS), RULES)


def test_increments_of_master_and_slave_may_differ() -> None:
    same = CROSS.model(parse(INCREMENTS), 3, Reading(RULES, 0.002))
    np.testing.assert_allclose(np.asarray(same.nodes.positions), [0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(np.asarray(same.values), [0.01, 0.014], rtol=1e-15)
    own = CROSS.model(parse(INCREMENTS), 3, Reading(RULES, {1: 0.001, 3: 0.5}))
    np.testing.assert_allclose(np.asarray(own.nodes.positions), [0, 1.0], rtol=1e-15)
    np.testing.assert_allclose(np.asarray(own.values), [2.5, 3.5], rtol=1e-15)


def test_entries_that_a_plane_leaves_out_are_zero() -> None:
    listing = parse(
        "kopf.achs_nr 3\nkw.crosscomp2.unit 1\nkw.crosscomp2.interval 10\n"
        "kw.crosscomp2.last_index_master1 1\nkw.crosscomp2.last_index_master2 1\n"
        "kw.crosscomp2.master1_ax_nr 1\nkw.crosscomp2.master2_ax_nr 2\n"
        "kw.crosscomp2.table[1][0].correction 30\n"
        "kw.crosscomp2.table[5][0].correction 99\n"
    )
    values = np.asarray(plane_from_list(listing, RULES).values)
    np.testing.assert_array_equal(values, [[0, 0], [3e-3, 0]])


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("interval 10", "interval 0", "found interval 0, last index 1, expected an in"),
        ("interval 10", "interval ten", "interval: found 'ten', expected an integer"),
        ("kw.crosscomp2.master2_ax_nr 2\n", "", "master2_ax_nr: found no entry"),
        ("master1 1\n", "master1 -1\n", "last index -1, expected"),
    ],
)
def test_plane_that_is_no_table_is_refused(old: str, new: str, match: str) -> None:
    text = (
        "kopf.achs_nr 3\nkw.crosscomp2.unit 1\nkw.crosscomp2.interval 10\n"
        "kw.crosscomp2.last_index_master1 1\nkw.crosscomp2.last_index_master2 1\n"
        "kw.crosscomp2.master1_ax_nr 1\nkw.crosscomp2.master2_ax_nr 2\n"
        "kw.crosscomp2.table[1][0].correction 30\n"
    )
    with pytest.raises(ExchangeError, match=match):
        plane_from_list(parse(text.replace(old, new)), RULES)


def test_setpoints_that_do_not_ascend_are_refused() -> None:
    text = INCREMENTS.replace("setpoint 1000", "setpoint 0").replace("unit 0", "unit 1")
    with pytest.raises(
        ExchangeError, match=r"found 0 after 0 \(index 1\), expected asc"
    ):
        cross_from_list(parse(text), RULES)


@pytest.mark.parametrize(
    ("start", "interval", "count", "match"),
    [
        (0.00005, 1.0, 3, "start: found 5e-05, expected a multiple of 0.0001"),
        (0.0, 0.12345, 3, "interval: found 0.12345, expected a multiple"),
        (0.0, 0.0, 3, "interval: found 0, expected more than 0"),
        (0.0, 1.0, 1, "points: found 1, expected at least 2"),
        (214_000.0, 1000.0, 3, "last node: found 216000 mm or °, expected a value"),
    ],
)
def test_grid_that_no_list_holds_is_refused(
    start: float, interval: float, count: int, match: str
) -> None:
    with pytest.raises(ExchangeError, match=match):
        grid_nodes(start, interval, count, "fits[0]")


def test_setpoints_that_no_list_holds_are_refused() -> None:
    with pytest.raises(ExchangeError, match=r"found 1 after 2 .*, expected ascending"):
        point_nodes(np.array([0.0, 2.0, 1.0]), "fits[0]")
    with pytest.raises(ExchangeError, match=r"found 3e-05, expected a multiple"):
        point_nodes(np.array([0.0, 3e-5]), "fits[0]")


def test_positions_with_the_noise_of_floats_are_exact_list_units() -> None:
    # 0.1 + 0.2 is not 0.3, but it is 3000 list units.
    assert point_nodes(np.array([0.1 + 0.2, 0.7]), "x").integers == (3000, 7000)


def test_values_are_rounded_to_the_nearest_list_unit() -> None:
    table = CrossTable(3, (1,), (ListNodes((0, 10)),), RULES)
    offset = np.array([0.00014, -0.00016])
    np.testing.assert_array_equal(table.to_integers(offset), [1, -2])


@pytest.mark.parametrize("value", [3e5, np.nan, np.inf, -3e5])
def test_value_beyond_sgn32_is_refused(value: float) -> None:
    table = CrossTable(3, (1,), (ListNodes((0, 10)),), RULES)
    with pytest.raises(
        ExchangeError, match=r"kw.crosscomp.table\[\].correction: found"
    ):
        table.to_integers(np.array([0.0, value]))


def test_an_entry_of_more_than_32_bits_is_refused_with_its_line() -> None:
    text = "kw.ssfk.unit 1\nkw.ssfk.interval 10\nkw.ssfk.kw_nr_max 1\n"
    text += "kw.ssfk.table[0].pos 99999999999999999999\n"
    with pytest.raises(
        ExchangeError, match=r"lis:4: .*found '9+', expected an integer"
    ):
        leadscrew_from_list(ListFile.parse(text.encode(), "achskw1.lis"), RULES)


@pytest.mark.parametrize(
    ("count", "build", "expected"),
    [(101, None, None), (102, None, 102 * 2), (102, "V3.1.3079.6", 102 * 2)],
)
def test_max_points_of_a_plane(
    count: int, build: str | None, expected: int | None
) -> None:
    nodes = (ListNodes.grid(0, 1000, count), ListNodes.grid(0, 1000, 2))
    table = PlaneTable(3, (1, 2), nodes, RULES)
    entries = table.entries(
        np.zeros((2, count), dtype=np.int64), ListTarget(build=build)
    )
    assert entries.get("kw.crosscomp2.max_points") == expected
    assert faults(listed(entries)) == []


def test_table_beyond_the_default_is_refused_on_an_old_build() -> None:
    table = CrossTable(3, (1,), (ListNodes.grid(0, 10, 1001),), RULES)
    values = np.zeros(1001, dtype=np.int64)
    # One manual stops at index 999: under that reading 1001 need the parameter.
    assert table.entries(values)["kw.crosscomp.max_points"] == 1001
    with pytest.raises(ExchangeError, match=r"needs 1001 on build V3.1.3070.0"):
        table.entries(values, ListTarget(build="V3.1.3070.0"))


def test_larger_max_points_that_is_there_stays() -> None:
    table = CrossTable(3, (1,), (ListNodes.grid(0, 10, 1001),), RULES)
    values = np.zeros(1001, dtype=np.int64)
    there = parse("kopf.achs_nr 3\nkw.crosscomp.max_points 2000\n")
    small = parse("kopf.achs_nr 3\nkw.crosscomp.max_points 500\n")
    assert "kw.crosscomp.max_points" not in table.entries(values, ListTarget(there))
    assert table.entries(values, ListTarget(small))["kw.crosscomp.max_points"] == 1001


def test_rectangular_list_keeps_its_kind_of_grid() -> None:
    there = parse("kopf.achs_nr 3\nkw.crosscomp2.grid RECTANGULAR\n")
    table = PlaneTable(
        3, (1, 2), (ListNodes.grid(0, 10, 8), ListNodes.grid(0, 10, 7)), RULES
    )
    entries = table.entries(VALUES, ListTarget(there))
    assert entries["kw.crosscomp2.interval1"] == 10
    assert "kw.crosscomp2.interval" not in entries


def test_old_table_is_read_at_the_new_nodes() -> None:
    old = Cross(nodes=Setpoints([0.0, 10.0]), values=[0.0, 0.1])
    table = CrossTable(3, (1,), (ListNodes((-50_000, 0, 50_000, 100_000)),), RULES)
    # Held before the first node, halfway in between: exact in floats.
    np.testing.assert_array_equal(table.at_nodes(old), [0.0, 0.0, 0.05, 0.1])
    refuse_lost_nodes(table, old, "old.lis")


def test_active_bilateral_table_does_not_become_unilateral() -> None:
    nodes = ListNodes((0, 10))
    old = LeadscrewTable(3, (3,), (nodes,), RULES, bilateral=True).model(VALUES[:2, :2])
    new = LeadscrewTable(3, (3,), (nodes,), RULES)
    with pytest.raises(
        ExchangeError, match=r"bilateral: found 1 in the table that was"
    ):
        refuse_lost_nodes(new, old, "old.lis")


def test_plane_on_single_setpoints_fits_no_list() -> None:
    plane = Plane(
        nodes1=Setpoints([0.0, 1.0, 3.0]), nodes2=Setpoints([0.0, 1.0]),
        values=np.zeros((2, 3)),
    )  # fmt: skip
    with pytest.raises(
        ExchangeError, match="found single setpoints, expected equidist"
    ):
        entries_of_plane(plane, (1, 2))


def test_leadscrew_without_entries_is_refused() -> None:
    text = "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.kw_nr_max 0\n"
    with pytest.raises(ExchangeError, match="kw_nr_max: found 0, expected 1 or more"):
        leadscrew_from_list(parse(text), RULES)


def test_single_entry_is_a_constant() -> None:
    text = (
        "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.kw_nr_max 1\n"
        "kw.ssfk.table[0].setpoint 0\nkw.ssfk.table[0].pos 12\n"
    )
    screw = leadscrew_from_list(parse(text), RULES)
    assert isinstance(screw, Leadscrew)
    found = offset_at(screw, np.array([[-5.0], [0.0], [9.0]]))
    np.testing.assert_array_equal(found, [-1.2e-3] * 3)


def test_errors_survive_pickling() -> None:
    error = ExchangeError("x.lis: unit", "0", "1")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)

"""Crosstalk lists: printed examples by hand, both forms, strict writing."""

import numpy as np
import pytest

from axcomp.data.lists import ListFile, check, new_list
from axcomp.ident.exchange import ExchangeError
from axcomp.ident.kinds.crosstalk.entries import (
    ENTRIES,
    crosstalk_from_list,
    entries_of_crosstalk,
)
from axcomp.models import (
    BilinearGrid,
    Conventions,
    Crosstalk,
    DelaunaySurface,
    LegacyCrosstalk,
    Setpoints,
    ThinPlateSurface,
    grid_through,
)

RULES = Conventions()
ROUNDING = 1e-15  # products of numbers below 0.01 mm

# [001] p.91 and p.92, as printed but for the comments.
MODE_1 = """kopf.achs_nr 3
kw.crosstalk.mode 1
kw.crosstalk.master_dyn_ax_nr 1
kw.crosstalk.velocity_dependent TRUE
kw.crosstalk.acceleration 10000
kw.crosstalk.deceleration -10000
kw.crosstalk.position[0].correction_accelerate_dir_pos 25
Kw.crosstalk.position[0].correction_decelerate_dir_pos 25
Kw.crosstalk.position[0].correction_accelerate_dir_neg 50
kw.crosstalk.position[0].correction_decelerate_dir_neg 50
"""
MODE_2 = """kopf.achs_nr 3
kw.crosstalk.mode 2
kw.crosstalk.master_dyn_ax_nr 1
kw.crosstalk.velocity_dependent TRUE
kw.crosstalk.acceleration 1000
kw.crosstalk.deceleration -1000
""" + "".join(
    f"kw.crosstalk.position[{k}].ax_1 {1000 * k}\n"
    + "".join(
        f"kw.crosstalk.position[{k}].correction_{a}celerate_dir_{d} {value}\n"
        for d, value in (("pos", pos), ("neg", neg))
        for a in ("ac", "de")
    )
    for k, (pos, neg) in enumerate([(50, 60), (70, 80), (50, 60)])
)
MODE_3 = """kopf.achs_nr 3
kw.crosstalk.mode 3
kw.crosstalk.master_dyn_ax_nr 2
kw.crosstalk.master_pos1_ax_nr 1
kw.crosstalk.master_pos2_ax_nr 3
kw.crosstalk.max_points 4
kw.crosstalk.velocity_dependent TRUE
kw.crosstalk.acceleration_pos 1000
kw.crosstalk.acceleration_neg -1000
""" + "".join(
    f"kw.crosstalk.position[{k}].ax_1 {x}\nkw.crosstalk.position[{k}].ax_2 {y}\n"
    + "".join(
        f"kw.crosstalk.position[{k}].acc_{a}_vel_{v}_correction {value}\n"
        for a, value in (("pos", 60 + 10 * k), ("neg", 70 + 10 * k))
        for v in ("pos", "neg")
    )
    for k, (x, y) in enumerate([(0, 0), (0, 3000), (3000, 0), (3000, 3000)])
)
OLD = """kopf.achs_nr 3
kw.crosstalk.master_ax_nr 1
kw.crosstalk.n_cycles 4
kw.crosstalk.last_index 2
""" + "".join(
    f"kw.crosstalk.table[{k}].acceleration {a}\nkw.crosstalk.table[{k}].correction {c}\n"
    for k, (a, c) in enumerate([(-1000, -20), (0, 0), (2000, 30)])
)


def parse(text: str) -> ListFile:
    return ListFile.parse(text.encode(), "a.lis")


def offsets(
    text: str, *rows: tuple[float, ...], rules: Conventions = RULES
) -> np.ndarray:
    """Offsets in list units for rows of acceleration, velocity, adaptation positions."""
    table = np.array(rows, dtype=float)
    model = crosstalk_from_list(parse(text), rules)
    found = model.offset(table[:, 0], table[:, 1], table[:, 2:])
    return np.asarray(found) * 1e4


def test_mode_1_example_by_hand() -> None:
    found = offsets(
        MODE_1, (10_000, 1), (5_000, 1), (20_000, 1), (-5_000, 1), (5_000, -1),
        (-10_000, -1), (0, 1), (5_000, 0),
    )  # fmt: skip
    # Half the acceleration, half the value; held above; at rest as positive motion.
    expected = [25, 12.5, 25, 12.5, 25, 50, 0, 12.5]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    assert ENTRIES.named_masters(parse(MODE_1)) == (1,)


def test_mode_2_example_by_hand_with_the_tests_that_stand_there() -> None:
    found = offsets(
        MODE_2, (1000, 1, 0.0), (1000, 1, 0.05), (1000, -1, 0.15), (-500, 1, 0.1),
        (1000, 1, 9.0), (1000, 1, -9.0),
    )  # fmt: skip
    # 0.05 mm lies halfway from 50 to 70; 0.15 halfway from 80 to 60; ends are held.
    np.testing.assert_allclose(found, [50, 60, 70, 35, 50, 50], rtol=0, atol=1e-11)


def test_example_without_its_adaptation_axis_is_refused_where_it_is_needed() -> None:
    with pytest.raises(ExchangeError, match=r"master_pos1_ax_nr: found no entry"):
        ENTRIES.named_masters(parse(MODE_2))


def test_mode_3_in_its_own_spelling_is_bilinear_on_a_grid() -> None:
    found = offsets(
        MODE_3, (1000, 1, 0.0, 0.0), (1000, 1, 0.15, 0.15), (-1000, -1, 0.3, 0.0),
        (500, 1, 0.0, 0.3),
    )  # fmt: skip
    # The middle is the mean of 60, 70, 80, 90; 70 + 20; half of 70.
    np.testing.assert_allclose(found, [60, 75, 90, 35], rtol=0, atol=1e-11)
    assert ENTRIES.named_masters(parse(MODE_3)) == (2, 1, 3)


@pytest.mark.parametrize(
    ("choice", "kind"),
    [
        ("grid", BilinearGrid),
        ("triangles", DelaunaySurface),
        ("thin_plate", ThinPlateSurface),
    ],
)
def test_surface_is_a_convention(choice: str, kind: type) -> None:
    rules = Conventions.from_dict({"crosstalk_surface": choice})
    model = crosstalk_from_list(parse(MODE_3), rules)
    assert isinstance(model, Crosstalk)
    assert isinstance(model.surface, kind)


def test_without_velocity_dependent_the_conventions_say_what_decelerations_take() -> (
    None
):
    text = MODE_1.replace("TRUE", "0").replace(
        "decelerate_dir_pos 25", "decelerate_dir_pos 35"
    )
    rows = ((10_000, -1), (-10_000, -1))
    np.testing.assert_allclose(offsets(text, *rows), [25, 35], rtol=0, atol=1e-11)
    rules = Conventions(crosstalk_undirected="accelerate", crosstalk_sign=-1)
    found = offsets(text, *rows, rules=rules)
    np.testing.assert_allclose(found, [-25, -25], rtol=0, atol=1e-11)


def test_older_form_is_a_table_over_the_acceleration() -> None:
    found = offsets(OLD, (-2000, 1), (-500, 1), (1000, -1), (5000, 1))
    np.testing.assert_allclose(found, [-20, -10, 15, 30], rtol=0, atol=1e-11)
    model = crosstalk_from_list(parse(OLD), RULES)
    assert isinstance(model, LegacyCrosstalk)
    assert model.cycles == 4
    assert ENTRIES.named_masters(parse(OLD)) == (1,)
    assert ENTRIES.is_in(parse(OLD))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (MODE_1.replace("mode 1", "mode 4"), "mode: found 4, expected 1 to 3"),
        (
            MODE_1.replace("ion 10000", "ion 0"),
            r"acceleration: found 0 mm/s², exp.*70659",
        ),
        (
            MODE_1.replace("-10000", "10000"),
            r"deceleration: found 10000 .* less than 0",
        ),
        (MODE_1 + "kw.crosstalk.last_index 0\n", "found last_index beside position"),
        (
            MODE_3.replace("ax_1 3000", "ax_1 0"),
            r"position\[\]: found tests 0 and 2 stand",
        ),
        (
            OLD.replace("-1000", "0"),
            r"acceleration: found 0 after 0 .*, expected ascending",
        ),
        (
            MODE_1 + "kw.crosstalk.n_cycles -1\n",
            "n_cycles: found -1, expected 0 or more",
        ),
    ],
)
def test_list_that_is_no_crosstalk_table_is_refused(text: str, match: str) -> None:
    with pytest.raises(ExchangeError, match=match):
        crosstalk_from_list(parse(text), RULES)


@pytest.mark.parametrize(("text", "masters"), [(MODE_1, (1,)), (MODE_3, (2, 1, 3))])
def test_written_list_reads_back_the_same_and_has_no_findings(
    text: str, masters: tuple[int, ...]
) -> None:
    model = crosstalk_from_list(parse(text), RULES)
    entries = entries_of_crosstalk(model, masters)
    listing = new_list({"kopf.achs_nr": 3} | entries)
    assert list(check([listing])) == []
    again = ListFile.parse(listing.dumps(), "b")
    assert ENTRIES.named_masters(again) == masters
    rng = np.random.default_rng(2)
    rates, speeds = rng.uniform(-2e3, 2e3, 50), rng.normal(size=50)
    places = rng.uniform(-0.1, 0.4, (50, len(masters) - 1))
    found = crosstalk_from_list(again, RULES).offset(rates, speeds, places)
    np.testing.assert_array_equal(found, model.offset(rates, speeds, places))


def test_undirected_table_is_written_for_both_directions() -> None:
    model = crosstalk_from_list(parse(MODE_1.replace("TRUE", "0")), RULES)
    entries = entries_of_crosstalk(model, (1,))
    names = [f"{a}celerate_dir_{d}" for a in ("ac", "de") for d in ("pos", "neg")]
    stem = "kw.crosstalk.position[0].correction_"
    assert [entries[stem + name] for name in names] == [25, 25, 25, 25]
    assert entries["kw.crosstalk.velocity_dependent"] == 1


def test_tests_are_written_in_the_order_of_their_places() -> None:
    points = np.array([[1.0, 2.0], [0.0, 5.0], [1.0, 0.0], [0.0, 2.0]])
    surface = grid_through(points) or DelaunaySurface.through(points)
    values = np.tile(1e-4 * np.arange(4.0), (4, 1))
    model = Crosstalk(surface, values, np.array(1e3), np.array(-1e3))
    entries = entries_of_crosstalk(model, (1, 2, 4))
    columns = {
        name: [entries[f"kw.crosstalk.position[{k}].{name}"] for k in range(4)]
        for name in ("ax_1", "ax_2", "correction_accelerate_dir_pos")
    }
    assert columns["ax_1"] == [0, 0, 10_000, 10_000]
    assert columns["ax_2"] == [20_000, 50_000, 0, 20_000]
    assert columns["correction_accelerate_dir_pos"] == [3, 1, 2, 0]


@pytest.mark.parametrize(
    ("model", "masters", "match"),
    [
        (
            LegacyCrosstalk(Setpoints(np.array([-1.0, 1.0])), np.array([1.0, 1.0])),
            (1,),
            "found a table of the older form, expected tests of the present form",
        ),
        (
            Crosstalk(
                BilinearGrid((), (0,)), np.zeros((4, 1)), np.array(1.5), np.array(-1.0)
            ),
            (1,),
            "acceleration: found 1.5 mm/s², expected a whole number",
        ),
        (
            Crosstalk(
                BilinearGrid((), (0,)), np.zeros((4, 1)), np.array(1.0), np.array(-1.0)
            ),
            (1, 2),
            "masters: found 2, expected 1: the axis that accelerates and 0 adaptation",
        ),
        (
            Crosstalk(
                BilinearGrid((Setpoints(np.arange(15.0)),), tuple(range(15))),
                np.zeros((4, 15)), np.array(1.0), np.array(-1.0),
            ),
            (1, 2),
            "max_points: found 15 tests, expected at most 14",
        ),
    ],
)  # fmt: skip
def test_what_no_list_can_hold_is_refused(
    model: Crosstalk | LegacyCrosstalk, masters: tuple[int, ...], match: str
) -> None:
    with pytest.raises(ExchangeError, match=match):
        entries_of_crosstalk(model, masters)

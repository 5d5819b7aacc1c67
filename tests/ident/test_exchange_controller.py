"""A whole machine from its lists: which compensation acts where, and bad sets of lists."""

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.exchange import (
    ExchangeError,
    Motion,
    Reading,
    controller_from_lists,
    machine_lists,
    simulate,
)
from axcomp.models import Conventions, Motion as ControllerMotion, PositionController

RULES = Conventions()
ROUNDING = 1e-14  # sums of offsets below 1 mm


def parse(text: str, name: str) -> ListFile:
    return ListFile.parse(text.encode(), name)


def cross(axis: int, master: int, per_100: int, more: str = "") -> str:
    """A cross table that rises by this many list units over 100 mm of its master."""
    return (
        f"kopf.achs_nr {axis}\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 1\n"
        f"kw.crosscomp.master_ax_nr {master}\nkw.crosscomp.table[0].setpoint 0\n"
        f"kw.crosscomp.table[0].correction 0\nkw.crosscomp.table[1].setpoint 1000000\n"
        f"kw.crosscomp.table[1].correction {per_100}\n{more}"
    )


SCREW = (
    "kw.ssfk.unit 1\nkw.ssfk.interval 1000000\nkw.ssfk.kw_startpos 0\n"
    "kw.ssfk.kw_nr_max 2\nkw.ssfk.table[0].pos 0\nkw.ssfk.table[1].pos 1000\n"
)
FRICTION = (
    "frict_comp.mode 3\nfrict_comp.table_entries 2\nfrict_comp.table[0].in 1000\n"
    "frict_comp.table[0].out 50\nfrict_comp.table[1].in 11000\n"
    "frict_comp.table[1].out 150\n"
)
CROSSTALK = (
    "kw.crosstalk.mode 1\nkw.crosstalk.master_dyn_ax_nr 1\n"
    "kw.crosstalk.velocity_dependent 1\nkw.crosstalk.acceleration 1000\n"
    "kw.crosstalk.deceleration -1000\n"
    "kw.crosstalk.position[0].correction_accelerate_dir_pos 40\n"
    "kw.crosstalk.position[0].correction_decelerate_dir_pos 20\n"
    "kw.crosstalk.position[0].correction_accelerate_dir_neg 40\n"
    "kw.crosstalk.position[0].correction_decelerate_dir_neg 20\n"
)
MACHINE = (
    "kopf.achs_nr 2\nlr_param.crosscomp 1\nlr_param.ssfk 1\nlr_param.frict_comp 1\n"
    "lr_param.crosstalk 1\nlr_param.temp_comp 1\nlr_param.temp_comp_offset_0 30\n"
    "lr_param.anwahl_losekomp 1\ngetriebe[0].lose 60\n"
)
LISTS = [
    parse(cross(2, 1, 2000, SCREW + FRICTION + CROSSTALK), "kw2"),
    parse(MACHINE, "a2"),
]


def test_every_compensation_of_an_axis_by_hand() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.3])
    # X from rest to 50 mm/s in a step: 500 mm/s² once; Y moves down at 6 mm/s.
    below = np.array([50.0, 50.0, 49.4, 48.8])
    motion = Motion({1: np.array([0.0, 0.0, 5.0, 10.0]), 2: below}, {}, time)
    (found,) = simulate(LISTS, motion, Reading(RULES))
    assert found.axis == 2
    names = ("cross", "leadscrew", "temperature", "backlash", "crosstalk")
    assert tuple(found.parts) == names
    # 2000 list units per 100 mm of X; −1000 per 100 mm of Y with the offsets of the
    # others; 3 µm; 6 µm on the way down; 20 list units for half the acceleration.
    parts = {
        "cross": [0.0, 0.0, 0.01, 0.02],
        "temperature": [0.003] * 4,
        "backlash": [0.0, 0.0, -0.006, -0.006],
        "crosstalk": [0.0, 0.0, 0.002, 0.0],
    }
    others = np.sum(list(parts.values()), axis=0)
    place = below + others
    parts["leadscrew"] = list(-0.1 * place / 100)
    for name in names:
        np.testing.assert_allclose(
            found.parts[name], parts[name], rtol=0, atol=ROUNDING, err_msg=name
        )
    np.testing.assert_allclose(
        found.total, others + parts["leadscrew"], rtol=0, atol=ROUNDING
    )
    # 6 mm/s is halfway from 1 to 11: 100, against the motion up; at rest nothing.
    assert found.current is not None
    np.testing.assert_allclose(found.current, [0.0, 0.0, -100.0, -100.0], atol=1e-9)


def test_rows_without_time_stand_for_themselves() -> None:
    motion = Motion(
        {1: np.array([50.0, 0.0]), 2: np.array([0.0, 0.0])},
        {2: np.array([-1, 1])},
        None,
        velocities={2: np.array([-6.0, 6.0]), 1: np.array([1.0, 1.0])},
        accelerations={1: np.array([-500.0, 500.0])},
    )
    (found,) = simulate(LISTS, motion, Reading(RULES))
    assert found.left_out == ()
    np.testing.assert_allclose(found.parts["backlash"], [-0.006, 0.0], atol=ROUNDING)
    np.testing.assert_allclose(found.parts["crosstalk"], [0.001, 0.002], atol=ROUNDING)
    assert found.current is not None
    np.testing.assert_allclose(found.current, [-100.0, 100.0], rtol=0, atol=1e-9)


def test_what_the_motion_does_not_have_is_left_out_and_named() -> None:
    motion = Motion({1: np.array([50.0]), 2: np.array([0.0])}, {}, None)
    (found,) = simulate(LISTS, motion, Reading(RULES))
    assert set(found.left_out) == {"crosstalk", "friction"}
    assert "there is neither A1.acceleration nor time" in " ".join(found.remarks)
    assert "there is neither A2.velocity nor time" in " ".join(found.remarks)
    assert found.current is None


def test_cycles_of_the_lists_reach_the_controller() -> None:
    text = cross(2, 1, 2000, "kw.crosscomp.n_cycles 4\n" + SCREW + CROSSTALK)
    text += "kw.crosstalk.n_cycles 3\n"
    machine = MACHINE + "lr_param.n_backlash_cyc 7\nlr_param.temp_comp_n_cycles 5\n"
    found = controller_from_lists(
        [parse(text, "a"), parse(machine, "b")], Reading(RULES)
    )
    axis = found.axes[1]
    cycles = axis.switch_cycles
    assert axis.spread_cycles == 7
    assert {k: cycles[k] for k in ("cross", "temperature", "crosstalk")} == {
        "cross": 4, "temperature": 5, "crosstalk": 3,
    }  # fmt: skip


def test_what_waits_for_a_command_is_off_until_it_comes() -> None:
    text = cross(2, 1, 2000, "kw.crosscomp.manual_activation 1\n")
    waiting = controller_from_lists([parse(text, "a")], Reading(RULES))
    assert waiting.axes[1].manual == ("cross",)
    assert added(waiting) == 0.0
    commanded = controller_from_lists(
        [parse(text, "a")], Reading(RULES, commanded=True)
    )
    assert added(commanded) == pytest.approx(0.1, abs=ROUNDING)
    motion = Motion({1: np.array([50.0]), 2: np.array([0.0])}, {}, None)
    (found,) = simulate([parse(text, "a")], motion, Reading(RULES))
    assert found.total[0] == pytest.approx(0.1, abs=ROUNDING)
    assert "cross waits for COMP ON" in found.remarks[0]


def added(controller: PositionController) -> float:
    """What is added to the second axis with the first one at 50 mm."""
    place = np.array([[50.0, 0.0]])
    motion = ControllerMotion(*(np.asarray(x) for x in (place, 0 * place, 0 * place)))
    return float(controller.run(controller.start(), motion)[0].offset[0, 1])


def test_older_manuals_give_the_cross_table_to_the_master() -> None:
    rules = Conventions(cross_list="master")
    motion = Motion({1: np.array([0.0]), 3: np.array([50.0])}, {}, None)
    # The list of axis 3 names axis 1: that one is moved, over the position of 3.
    found = simulate([parse(cross(3, 1, 1000), "a")], motion, Reading(rules))
    parts = {one.axis: one.parts for one in found}
    assert list(parts[1]) == ["cross"]
    assert parts[1]["cross"][0] == pytest.approx(0.05, abs=ROUNDING)
    assert not parts[3]


def test_axis_list_alone_is_enough_for_what_it_sets_up() -> None:
    motion = Motion({2: np.array([1.0, 0.0])}, {}, np.array([0.0, 1e-3]))
    (found,) = simulate([parse(MACHINE, "a2")], motion, Reading(RULES))
    assert list(found.parts) == ["temperature", "backlash"]


def test_modulo_master_and_direction_over_the_transition() -> None:
    bilateral = (
        "kopf.achs_nr 4\nkw.ssfk.unit 1\nkw.ssfk.interval 1800000\nkw.ssfk.kw_startpos 0\n"
        "kw.ssfk.kw_nr_max 3\nkw.ssfk.modulo 1\nkw.ssfk.bilateral 1\n"
        "kw.ssfk.set_pos_without_comp 1\n"
        + "".join(
            f"kw.ssfk.table[{k}].pos 10\nkw.ssfk.table[{k}].neg 30\n" for k in range(3)
        )
    )
    place = np.array([350.0, 355.0, 0.0, 5.0])
    motion = Motion({4: place}, {}, 1e-3 * np.arange(4))
    (found,) = simulate(
        [parse(bilateral, "a")], motion, Reading(RULES, modulo={4: (0.0, 360.0)})
    )
    # Over the transition it goes on: never backwards.
    np.testing.assert_allclose(found.total, -1e-3, rtol=0, atol=ROUNDING)
    (plain,) = simulate([parse(bilateral, "a")], motion, Reading(RULES))
    np.testing.assert_allclose(plain.total[2], -3e-3, rtol=0, atol=ROUNDING)


# --------------------------------------------------------------------------- bad input


def test_master_that_the_machine_lacks_is_named() -> None:
    with pytest.raises(
        ExchangeError,
        match=r"kw2: cross: found master axis 1, which the machine lacks, expected one of"
        r" its axes, 2, 3",
    ):
        controller_from_lists(LISTS, Reading(RULES), axes=(2, 3))


def test_axis_that_the_machine_lacks_is_named() -> None:
    with pytest.raises(ExchangeError, match=r"found axis 2, which the machine lacks"):
        controller_from_lists(
            [parse(cross(2, 1, 5), "kw2")], Reading(RULES), axes=(1, 3)
        )


@pytest.mark.parametrize("kind", ["compensation", "axis"])
def test_two_lists_of_one_axis_are_refused(kind: str) -> None:
    text = MACHINE if kind == "axis" else cross(2, 1, 5)
    lists = [parse(text, "one.lis"), parse(text, "two.lis")]
    match = rf"two.lis: found a second {kind} list of axis 2 beside one.lis"
    with pytest.raises(ExchangeError, match=match):
        machine_lists(lists)


def test_two_cross_tables_that_act_on_one_axis_are_refused() -> None:
    lists = [parse(cross(3, 1, 5), "a.lis"), parse(cross(2, 1, 5), "b.lis")]
    with pytest.raises(
        ExchangeError, match=r"b.lis: found a second cross table for axis 1"
    ):
        controller_from_lists(lists, Reading(Conventions(cross_list="master")))


def test_temperature_of_a_rotary_axis_is_refused() -> None:
    with pytest.raises(ExchangeError, match="of the rotary axis 2, expected a linear"):
        controller_from_lists(
            [parse(MACHINE, "a")], Reading(RULES, modulo={2: (0.0, 360.0)})
        )


@pytest.mark.parametrize(
    ("motion", "match"),
    [
        (
            Motion({1: np.array([0.0, np.nan])}, {}, None),
            r"motion: A1.position: found nan in row 2, expected a finite number",
        ),
        (
            Motion({1: np.zeros(3)}, {}, np.array([0.0, 0.2, 0.1])),
            r"time: found 0.1 s after 0.2 s in row 3, expected ascending",
        ),
        (
            Motion({1: np.zeros(3), 2: np.zeros(2)}, {}, None),
            r"A2.position: found 2 rows, expected 3",
        ),
        (
            Motion({1: np.zeros(3)}, {}, 0.004 * np.arange(3)),
            r"time: found a time step of 4 ms, expected the cycle time of the controller, 2",
        ),
    ],
)
def test_motion_that_no_controller_commands_is_refused(
    motion: Motion, match: str
) -> None:
    with pytest.raises(ExchangeError, match=match):
        simulate(LISTS, motion, Reading(RULES), cycle_time=0.002)


def test_actual_positions_are_asked_for_where_a_convention_takes_them() -> None:
    rules = Conventions(direction_source="actual")
    time = np.array([0.0, 1e-3])
    motion = Motion({2: np.array([1.0, 0.0])}, {}, time)
    lists = [parse(MACHINE, "a2")]
    with pytest.raises(
        ExchangeError, match=r"no actual positions, expected .*A2.actual"
    ):
        simulate(lists, motion, Reading(rules))
    given = Motion({2: np.zeros(2)}, {}, time, actuals={2: np.array([1.0, 0.0])})
    (found,) = simulate(lists, given, Reading(rules))
    np.testing.assert_allclose(found.parts["backlash"], [0.0, -0.006], atol=ROUNDING)


def test_uneven_time_steps_are_remarked() -> None:
    motion = Motion({2: np.zeros(4)}, {}, np.array([0.0, 1e-3, 2e-3, 9e-3]))
    (found,) = simulate([parse(MACHINE, "a2")], motion, Reading(RULES))
    assert "time steps of motion differ" in found.remarks[-1]

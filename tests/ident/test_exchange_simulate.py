"""What lists add along a motion: activation, direction, spread of a reversal, sums."""

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.exchange import (
    ExchangeError,
    Motion,
    Reading,
    direction_of_motion,
    simulate,
)
from axcomp.models import Conventions

RULES = Conventions()


def parse(text: str, name: str) -> ListFile:
    return ListFile.parse(text.encode(), name)


SCREW = (
    "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 100000\nkw.ssfk.kw_startpos 0\n"
    "kw.ssfk.kw_nr_max 3\nkw.ssfk.bilateral 1\nkw.ssfk.set_pos_without_comp 1\n"
    "kw.ssfk.table[0].pos 0\nkw.ssfk.table[1].pos 100\nkw.ssfk.table[2].pos 100\n"
    "kw.ssfk.table[0].neg 40\nkw.ssfk.table[1].neg 140\nkw.ssfk.table[2].neg 140\n"
)
CROSS = (
    "kw.crosscomp.unit 1\nkw.crosscomp.last_index 1\nkw.crosscomp.master_ax_nr 2\n"
    "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 0\n"
    "kw.crosscomp.table[1].setpoint 1000000\nkw.crosscomp.table[1].correction 20000\n"
)


def test_direction_is_that_of_the_last_step() -> None:
    position = np.array([0.0, 0.0, 1.0, 1.0, 0.5, 0.5, 0.7])
    found = direction_of_motion(position)
    np.testing.assert_array_equal(found, [1, 1, 1, 1, -1, -1, 1])


def test_direction_before_the_first_motion_is_a_convention() -> None:
    position = np.array([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(direction_of_motion(position, -1), [-1, -1, 1])


def test_bilateral_table_takes_the_direction_of_the_motion() -> None:
    motion = Motion({1: np.array([0.0, 5.0, 10.0, 5.0])}, {}, np.arange(4) * 1e-3)
    found = simulate([parse(SCREW, "a")], motion, Reading(RULES))[0]
    # Offset = −entry, in 0.1 µm: 0, 50, 100 forward and 90 on the way back.
    np.testing.assert_allclose(found.total, [0, -5e-3, -10e-3, -9e-3], atol=1e-12)
    assert list(found.parts) == ["leadscrew"]


def test_independent_positions_go_forward_unless_a_direction_is_given() -> None:
    place = np.array([10.0, 5.0])
    alone = simulate([parse(SCREW, "a")], Motion({1: place}, {}, None), Reading(RULES))
    given = Motion({1: place}, {1: np.array([-1, 1])}, None)
    told = simulate([parse(SCREW, "a")], given, Reading(RULES))
    np.testing.assert_allclose(alone[0].total, [-10e-3, -5e-3], atol=1e-12)
    np.testing.assert_allclose(told[0].total, [-14e-3, -5e-3], atol=1e-12)


def test_reversal_is_spread_over_the_cycles_of_the_axis_list() -> None:
    place = np.concatenate([[20.0, 21.0, 22.0], 21.9 - 0.1 * np.arange(6)])
    motion = Motion({1: place}, {}, np.arange(9) * 1e-3)
    machine = parse("kopf.achs_nr 1\nlr_param.ssfk 1\nlr_param.n_backlash_cyc 4\n", "m")
    found = simulate([parse(SCREW, "a"), machine], motion, Reading(RULES))[0]
    # 4 µm of reversal; sin²(π/2 · k/4) of it is out in the k-th cycle of the way back.
    share = np.sin(0.5 * np.pi * np.array([1, 2, 3, 4, 4, 4]) / 4) ** 2
    np.testing.assert_allclose(found.total[3:], -10e-3 - 4e-3 * share, atol=1e-12)
    np.testing.assert_allclose(found.total[:3], -10e-3, atol=1e-12)


@pytest.mark.parametrize(("alone", "entry"), [(1, 50.0), (0, 60.0)])
def test_leadscrew_comes_last_with_or_without_the_other_offsets(
    alone: int, entry: float
) -> None:
    text = SCREW.replace("without_comp 1", f"without_comp {alone}") + CROSS
    motion = Motion({1: np.array([5.0]), 2: np.array([50.0])}, {}, None)
    found = simulate([parse(text, "a")], motion, Reading(RULES))[0]
    # Y = 50 adds 1 mm to X = 5; the table rises by 10 list units per mm.
    assert found.parts["cross"][0] == pytest.approx(1.0, abs=1e-12)
    assert found.parts["leadscrew"][0] == pytest.approx(-entry * 1e-4, abs=1e-12)
    assert found.total[0] == pytest.approx(1.0 - entry * 1e-4, abs=1e-12)


def test_axis_list_says_what_is_active() -> None:
    motion = Motion({1: np.array([5.0]), 2: np.array([50.0])}, {}, None)
    lists = [parse(SCREW + CROSS, "a")]
    assert list(simulate(lists, motion, Reading(RULES))[0].parts) == [
        "cross",
        "leadscrew",
    ]
    machine = parse("kopf.achs_nr 1\nlr_param.crosscomp 1\nlr_param.ssfk 0\n", "m")
    assert list(simulate([*lists, machine], motion, Reading(RULES))[0].parts) == [
        "cross"
    ]


def test_missing_master_is_named() -> None:
    motion = Motion({1: np.array([5.0])}, {}, None)
    with pytest.raises(
        ExchangeError, match=r"found A1.position, expected A2.position f"
    ):
        simulate([parse(SCREW + CROSS, "a")], motion, Reading(RULES))


def test_axis_list_alone_is_refused() -> None:
    motion = Motion({1: np.array([5.0])}, {}, None)
    with pytest.raises(ExchangeError, match="found no compensation list, expected"):
        simulate(
            [parse("kopf.achs_nr 1\nlr_param.ssfk 1\n", "m")], motion, Reading(RULES)
        )

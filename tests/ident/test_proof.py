"""The gate, the spread of a reversal, and the figures of an error."""

import numpy as np
import pytest

from axcomp.ident.proof import (
    GateLimits,
    GateTable,
    RunTable,
    choose_cycles,
    error_figures,
    groups_of_passes,
    judge,
    reversal_dynamics,
)


def line(
    *offset: list[float],
    nodes: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0),
    **more: object,
) -> GateTable:
    options: dict[str, object] = {
        "names": ("X",), "nodes": (np.array(nodes),), "change": None,
        "closed": (False,), "periodic": False, "unit": "mm", "cycles": 0,
        "cycle_time": 1e-3, "offset": tuple(np.array(own) for own in offset),
    }  # fmt: skip
    return GateTable(**(options | more))  # type: ignore[arg-type]


def values(table: GateTable, limits: GateLimits | None = None) -> dict[str, float]:
    return {check.name: check.value for check in judge(table, limits or GateLimits())}


def test_gate_measures_size_slope_and_step() -> None:
    table = line([0.0, 0.01, -0.03, -0.03])
    found = values(table)
    assert found["max_correction"] == pytest.approx(0.03)
    assert found["max_step"] == pytest.approx(0.04)
    # 40 µm on 10 mm, at 30 m/min = 500 mm/s.
    assert found["max_slope"] == pytest.approx(4.0)
    assert found["max_velocity"] == pytest.approx(2.0)
    # From +1 to −4 µm per mm.
    assert found["max_kink"] == pytest.approx(2.5)
    # 10 ms are 5 mm, less than a cell: the whole kink within 10 ms.
    assert found["max_acceleration"] == pytest.approx(250.0)


def test_gate_says_where_in_words() -> None:
    checks = {
        c.name: c.where for c in judge(line([0, 0.01, -0.03, -0.03]), GateLimits())
    }
    assert checks["max_correction"] == "at X = 20"
    assert checks["max_slope"] == "between X = 10 and 20"
    assert checks["max_kink"] == "at X = 10"


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("max_correction", GateLimits(max_correction=0.029)),
        ("max_slope", GateLimits(max_slope=3.9)),
        ("max_step", GateLimits(max_step=0.039)),
        ("max_velocity", GateLimits(max_velocity=1.9)),
        ("max_kink", GateLimits(max_kink=2.4)),
        ("max_acceleration", GateLimits(max_acceleration=249.0)),
    ],
)
def test_each_line_of_the_gate_fails_on_its_own(name: str, limits: GateLimits) -> None:
    table = line([0.0, 0.01, -0.03, -0.03])
    failed = [check.name for check in judge(table, limits) if not check.passed]
    assert failed == [name]


def test_value_on_the_limit_passes() -> None:
    limits = GateLimits(max_correction=0.03, max_slope=4.0, max_step=0.04)
    assert all(check.passed for check in judge(line([0, 0.01, -0.03, -0.03]), limits))


def test_feed_scales_what_the_table_adds() -> None:
    slow = values(line([0.0, 0.01, -0.03, -0.03]), GateLimits(feed=6_000.0))
    # 100 mm/s instead of 500.
    assert slow["max_velocity"] == pytest.approx(0.4)
    assert slow["max_acceleration"] == pytest.approx(50.0)


def test_held_edge_is_a_kink_unless_the_limits_end_there() -> None:
    ramp = [0.0, 0.01, 0.02, 0.03]
    assert values(line(ramp))["max_kink"] == pytest.approx(0.5)
    assert values(line(ramp, closed=(True,)))["max_kink"] == pytest.approx(
        0.0, abs=1e-12
    )


def test_kinks_closer_than_ten_milliseconds_add_up() -> None:
    # Slopes 0, 1, 2, 3 µm/mm on cells of 2 mm; 10 ms are 5 mm: two cells and a half.
    table = line([0.0, 0.0, 2e-3, 6e-3, 12e-3], nodes=(0.0, 2.0, 4.0, 6.0, 8.0),
                 closed=(True,))  # fmt: skip
    assert values(table)["max_kink"] == pytest.approx(0.5)
    assert values(table)["max_acceleration"] == pytest.approx(3e-3 * 500 / 0.01)


def test_modulo_table_has_a_kink_at_its_transition() -> None:
    table = line([0.0, 0.01, 0.02, 0.0], periodic=True)
    # Slopes 1, 1, −2 µm/mm: the transition goes from −2 to 1 as node 20 does back.
    assert values(table)["max_kink"] == pytest.approx(1.5)


def test_plane_is_judged_in_its_worst_direction() -> None:
    x, y = np.meshgrid(np.arange(0, 31, 10.0), np.arange(0, 21, 10.0))
    table = line([0.0], names=("X", "Y"), nodes=(0.0,))
    table = GateTable(
        names=("X", "Y"), nodes=(np.arange(0, 31, 10.0), np.arange(0, 21, 10.0)),
        offset=(3e-3 * x + 4e-3 * y,), change=None, closed=(True, True),
        periodic=False, unit="mm", cycles=0, cycle_time=1e-3,
    )  # fmt: skip
    found = {check.name: check for check in judge(table, GateLimits())}
    assert found["max_slope"].value == pytest.approx(4.0)
    # Along the gradient: 5 µm per mm at 500 mm/s.
    assert found["max_velocity"].value == pytest.approx(2.5)
    assert found["max_kink"].value == pytest.approx(0.0, abs=1e-9)
    assert found["max_correction"].where == "at X = 30, Y = 20"


def test_twist_of_a_plane_accelerates() -> None:
    x, y = np.meshgrid(np.array([0.0, 10.0]), np.array([0.0, 10.0]))
    table = GateTable(
        names=("X", "Y"), nodes=(np.array([0.0, 10.0]), np.array([0.0, 10.0])),
        offset=(1e-6 * x * y,), change=None, closed=(True, True), periodic=False,
        unit="mm", cycles=0, cycle_time=1e-3,
    )  # fmt: skip
    found = {check.name: check.value for check in judge(table, GateLimits())}
    # z = c·x·y along the diagonal at 500 mm/s: c · 500².
    assert found["max_acceleration"] == pytest.approx(0.25)


def test_change_is_judged_only_against_a_list_and_with_a_limit() -> None:
    change = (np.array([0.0, 0.2, 0.0, 0.0]),)
    table = line([0.0, 0.0, 0.0, 0.0], change=change)
    assert "max_change" not in values(table)
    limited = judge(table, GateLimits(max_change=0.1))
    assert [check.name for check in limited if not check.passed] == ["max_change"]
    alone = line([0.0, 0.0, 0.0, 0.0])
    assert "max_change" not in values(alone, GateLimits(max_change=0.1))


def test_reversal_jump_is_judged_with_its_spread() -> None:
    table = line([0.0] * 4, [0.0, 0.03, 0.0, 0.0], cycles=6)
    found = {check.name: check for check in judge(table, GateLimits(max_reversal=0.02))}
    assert not found["max_reversal"].passed
    assert found["max_reversal"].where == "at X = 10"
    velocity, acceleration = reversal_dynamics(0.03, 6, 1e-3)
    assert found["max_velocity at reversal"].value == velocity
    assert found["max_acceleration at reversal"].value == acceleration


def test_fewest_cycles_inside_the_limits_are_chosen() -> None:
    chosen = choose_cycles(0.0336, 1e-3, 20.0, 5000.0)
    assert 2 < chosen < 19
    velocity, acceleration = reversal_dynamics(0.0336, chosen, 1e-3)
    assert velocity <= 20.0
    assert acceleration <= 5000.0
    assert reversal_dynamics(0.0336, chosen - 1, 1e-3)[1] > 5000.0


def test_tiny_jump_takes_the_fewest_cycles_and_a_huge_one_the_most() -> None:
    assert choose_cycles(1e-5, 1e-3, 20.0, 5000.0) == 2
    assert choose_cycles(5.0, 1e-3, 20.0, 5000.0) == 19


def test_value_in_the_axis_list_stays_where_it_is_long_enough() -> None:
    assert choose_cycles(0.0336, 1e-3, 20.0, 5000.0, existing=12) == 12
    assert choose_cycles(0.0336, 1e-3, 20.0, 5000.0, existing=2) > 2
    assert choose_cycles(0.0336, 1e-3, 20.0, 5000.0, existing=25) < 19


def test_figures_name_iso_230_only_for_run_tables() -> None:
    target = np.tile([0.0, 1.0], 4)
    run = np.repeat([1, 1, 2, 2], 2)
    direction = np.tile(np.repeat([1, -1], 2), 2)
    error = np.where(direction > 0, 2e-3, -1e-3)
    plain = error_figures(error)
    full = error_figures(error, RunTable(target, run, direction))
    assert plain.iso230 is None
    assert plain.max == 2e-3
    assert full.iso230 is not None
    # All readings of a direction are equal: 3 µm of reversal, no scatter.
    assert full.iso230["B"] == pytest.approx(3e-3)
    assert full.iso230["A"] == pytest.approx(3e-3)


def test_passes_there_and_back_are_left_out_together_where_a_log_has_several() -> None:
    time = np.arange(6000.0)
    place = 200.0 - 200.0 * np.cos(np.pi * time / 1000.0)  # three times there and back
    found = groups_of_passes(place, time)
    assert found is not None
    # The row at which the axis turned belongs to the pass that it ends.
    assert np.sum(found != time // 2000) <= 4
    shuffled = np.random.default_rng(0).permutation(6000)
    again = groups_of_passes(place[shuffled], time[shuffled])
    assert again is not None
    assert np.array_equal(again, found[shuffled])


@pytest.mark.parametrize("reach", [0.0, 0.3])
def test_of_a_log_that_hardly_comes_back_blocks_are_left_out(reach: float) -> None:
    time = np.arange(6000.0)
    place = reach * 200.0 * np.sin(np.pi * time / 1000.0) + 200.0 * time / 6000.0
    assert groups_of_passes(place, time) is None

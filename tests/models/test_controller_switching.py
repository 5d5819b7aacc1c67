"""Activation: homing, COMP ON and OFF, and how switching is smoothed."""

import numpy as np
import pytest

from axcomp.models import (
    COMPENSATIONS,
    AxisCompensations,
    Backlash,
    CompCommand,
    Conventions,
    Coupled,
    Cross,
    FrictionCompensation,
    FrictionTable,
    Leadscrew,
    Motion,
    Plane,
    PositionController,
    ProgramEnd,
    Setpoints,
    TemperatureLine,
    commanded,
)

ENDS = Setpoints([0.0, 100.0])
HALF = np.sqrt(0.5)
# sin² over four cycles, from the first cycle on.
RAMP = np.array([(1 - HALF) / 2, 0.5, (1 + HALF) / 2, 1.0])


def machine(cycles: int = 0, **more: object) -> PositionController:
    """Axis 0 with everything that is switched, each 1 mm; masters are axes 1 and 2."""
    cross = Cross(ENDS, [1.0, 1.0])
    plane = Plane.quadratic((0.0, 0.0), 100.0, np.ones((2, 2)))
    axis = AxisCompensations(
        backlash=Backlash(1.0, -1),
        temperature=TemperatureLine(0.0, 1.0, 0.0, cycles=cycles),
        cross=Coupled(cross, (1,), cycles),
        plane=Coupled(plane, (1, 2), cycles),
        leadscrew=Leadscrew(ENDS, [-1.0, -1.0]),
        friction=FrictionCompensation(FrictionTable(Setpoints([1.0]), [1.0])),
        **more,  # type: ignore[arg-type]
    )
    return PositionController((axis, AxisCompensations(), AxisCompensations()))


def still(cycles: int, **more: object) -> Motion:
    zeros = np.zeros((cycles, 3))
    return Motion(zeros, zeros + 1.0, zeros, **more)  # type: ignore[arg-type]


def columns(controller: PositionController, motion: Motion) -> dict[str, np.ndarray]:
    found = controller.run(controller.start(), motion)[0]
    return {
        name: np.asarray(getattr(found, name)[:, 0]) for name in controller.installed
    }


def test_each_compensation_waits_for_the_axes_that_it_needs_homed() -> None:
    homed = np.zeros((5, 3), dtype=bool)
    homed[1:, 0] = homed[2:, 1] = homed[3:, 2] = True
    found = columns(machine(), still(5, homed=homed))
    assert {name: int(np.argmax(values != 0)) for name, values in found.items()} == {
        "backlash": 0,
        "temperature": 1,
        "leadscrew": 1,
        "cross": 2,
        "plane": 3,
        "friction": 0,
    }
    for values in found.values():
        assert set(values) <= {0.0, 1.0}


def test_homing_is_smoothed_over_the_cycles_of_the_list() -> None:
    homed = np.ones((7, 3), dtype=bool)
    homed[:2] = False
    found = columns(machine(4), still(7, homed=homed))
    expected = [0, 0, *RAMP, 1]
    for name in ("cross", "plane", "temperature"):
        # One rounding of the sines.
        np.testing.assert_allclose(found[name], expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(found["leadscrew"], [0, 0, 1, 1, 1, 1, 1])


def test_what_acts_from_the_first_row_acts_in_full() -> None:
    for motion in (still(3), still(3, homed=np.ones((3, 3), dtype=bool))):
        for values in columns(machine(4), motion).values():
            np.testing.assert_array_equal(values, np.ones(3))


def test_comp_off_and_on_that_overlap_are_superposed() -> None:
    controller = machine(4)
    active = commanded(
        controller,
        8,
        [CompCommand(1, 0, False, ("cross",)), CompCommand(3, 0, True, ("cross",))],
    )
    found = columns(controller, still(8, active=active))
    down = np.array([0, *RAMP, 1, 1, 1])
    up = np.array([0, 0, 0, *RAMP, 1])
    np.testing.assert_allclose(found["cross"], 1 - down + up, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(found["plane"], np.ones(8))


def test_off_all_switches_everything_off_at_the_cycle_where_nothing_smooths() -> None:
    controller = machine()
    active = commanded(controller, 4, [CompCommand(2, 0, False)])
    for values in columns(controller, still(4, active=active)).values():
        np.testing.assert_array_equal(values, [1, 1, 0, 0])


def test_manual_activation_waits_for_comp_on_and_ends_with_the_program() -> None:
    controller = machine(manual=("plane",))
    np.testing.assert_array_equal(columns(controller, still(2))["plane"], [0, 0])
    events = [
        CompCommand(1, 0, True, ("plane",)),
        CompCommand(2, 0, False, ("cross",)),
        ProgramEnd(3),
    ]
    found = columns(controller, still(5, active=commanded(controller, 5, events)))
    np.testing.assert_array_equal(found["plane"], [0, 1, 1, 0, 0])
    # COMP OFF outlives the program.
    np.testing.assert_array_equal(found["cross"], [1, 1, 0, 0, 0])
    later = commanded(controller, 3, events, first=2)
    np.testing.assert_array_equal(later, commanded(controller, 5, events)[2:])


def test_comp_on_waits_for_homing() -> None:
    controller = machine(manual=("leadscrew",))
    homed = np.zeros((4, 3), dtype=bool)
    homed[2:] = True
    active = commanded(controller, 4, [CompCommand(1, 0, True, ("leadscrew",))])
    found = columns(controller, still(4, homed=homed, active=active))
    np.testing.assert_array_equal(found["leadscrew"], [0, 0, 1, 1])


def test_switching_the_backlash_is_spread_as_a_reversal() -> None:
    axis = AxisCompensations(backlash=Backlash(1.0, -1, 4))
    controller = PositionController((axis, AxisCompensations(), AxisCompensations()))
    active = commanded(controller, 6, [CompCommand(1, 0, False, ("backlash",))])
    found = columns(controller, still(6, active=active))["backlash"]
    np.testing.assert_allclose(found, [1, *(1 - RAMP), 0], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("rules", "name"),
    [({"table_filter": "values"}, "cross"), ({"temperature_filter": "values"}, "line")],
)
def test_by_convention_the_filter_acts_on_the_offsets(
    rules: dict[str, str], name: str
) -> None:
    axis = AxisCompensations(
        cross=Coupled(Cross(ENDS, [0.0, 1.0]), (0,), 2) if name == "cross" else None,
        temperature=TemperatureLine(0.0, 0.0, 0.01, 2) if name == "line" else None,
    )
    controller = PositionController((axis,), Conventions.from_dict(rules))
    place = np.array([[0.0], [0.0], [100.0], [100.0]])
    found = controller.run(controller.start(), Motion(place, place, place))[0].offset
    np.testing.assert_allclose(found[:, 0], [0, 0, 0.5, 1], rtol=0, atol=1e-15)


def test_by_convention_the_first_share_comes_a_cycle_later() -> None:
    base = machine(2)
    late = PositionController(base.axes, Conventions(filter_delay=1))
    active = commanded(base, 5, [CompCommand(1, 0, False, ("plane",))])
    found = columns(late, still(5, active=active))["plane"]
    np.testing.assert_allclose(found, [1, 1, 0.5, 0, 0], rtol=0, atol=1e-15)


def test_commands_that_cannot_be_are_refused() -> None:
    controller = machine()
    with pytest.raises(ValueError, match=f"'lead' is none of {COMPENSATIONS[0]}"):
        CompCommand(0, 0, True, ("lead",))
    with pytest.raises(ValueError, match="Axis 3 does not exist, there are 3 axes"):
        commanded(controller, 2, [CompCommand(0, 3, True)])
    with pytest.raises(ValueError, match="in order, got cycle 1 after 2"):
        commanded(controller, 4, [ProgramEnd(2), ProgramEnd(1)])

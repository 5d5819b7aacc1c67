"""What the controller adds, against values worked out by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import (
    AxisCompensations,
    Backlash,
    BilinearGrid,
    Conventions,
    Coupled,
    Cross,
    Crosstalk,
    FrictionCompensation,
    FrictionTable,
    Leadscrew,
    Motion,
    Offsets,
    Plane,
    PositionController,
    Setpoints,
    TemperatureLine,
)

ENDS = [0.0, 100.0]
# At position x: 0.001 · x, 0.0002 · (x + y), and errors of 0.0005 · x there and twice
# that on the way back.
CROSS = Coupled(Cross(Setpoints(ENDS), [0.0, 0.1]), (1,))
PLANE = Coupled(
    Plane.rectangular((0.0, 0.0), (100.0, 100.0), np.array([[0, 0.02], [0.02, 0.04]])),
    (0, 1),
)
SCREW = Leadscrew(Setpoints(ENDS), [0.0, 0.05], [0.0, 0.1])
SHAKE = Crosstalk(
    BilinearGrid((), (0,)), [[0.01], [0.02], [-0.03], [-0.04]], 1000.0, -500.0
)
DRAG = FrictionCompensation(FrictionTable(Setpoints([0.0, 10.0]), [2.0, 4.0]))
LINE = TemperatureLine(0.0, 0.0, 1e-4)


def machine(*axes: AxisCompensations, **conventions: object) -> PositionController:
    return PositionController(axes, Conventions.from_dict(conventions))


def motion(*columns: list[float], **more: object) -> Motion:
    place = np.array(columns, dtype=float).T
    parts: dict[str, object] = {
        "position": place,
        "velocity": np.zeros_like(place),
        "acceleration": np.zeros_like(place),
    }
    return Motion(**(parts | more))  # type: ignore[arg-type]


def run(controller: PositionController, moving: Motion) -> Offsets:
    return controller.run(controller.start(), moving)[0]


def assert_close(found: object, expected: object) -> None:
    # Offsets below 1 mm, a few roundings each.
    np.testing.assert_allclose(np.asarray(found), np.array(expected), atol=1e-15)


STANDSTILL = [0.0, 0.0, 0.0]


def test_all_offsets_of_an_axis_are_summed_up_and_the_current_stays_apart() -> None:
    controller = machine(
        AxisCompensations(
            backlash=Backlash(0.3),
            temperature=LINE,
            cross=CROSS,
            plane=PLANE,
            crosstalk=Coupled(SHAKE, (1,)),
            leadscrew=SCREW,
            friction=DRAG,
            leadscrew_alone=True,
        ),
        AxisCompensations(),
    )
    found = run(
        controller,
        motion(
            [20.0, 40.0, 20.0],
            [10.0, 10.0, 50.0],
            velocity=[[0, 0], [5, 0], [-5, -1]],
            acceleration=[[0, 0], [0, 500], [0, -100]],
        ),
    )
    assert_close(found.backlash, [[0, 0], [0, 0], [-0.3, 0]])
    assert_close(found.temperature, [[0.002, 0], [0.004, 0], [0.002, 0]])
    assert_close(found.cross, [[0.01, 0], [0.01, 0], [0.05, 0]])
    assert_close(found.plane, [[0.006, 0], [0.01, 0], [0.014, 0]])
    # Half of 0.01 forwards; a fifth of −0.04 when slowing down backwards.
    assert_close(found.crosstalk, [[0, 0], [0.005, 0], [-0.008, 0]])
    assert_close(found.leadscrew, [[-0.01, 0], [-0.02, 0], [-0.02, 0]])
    assert_close(found.offset, [[0.008, 0], [0.009, 0], [-0.262, 0]])
    assert_close(found.friction, [[0, 0], [3, 0], [-3, 0]])


def test_what_no_axis_has_is_none() -> None:
    found = run(machine(AxisCompensations(cross=CROSS), AxisCompensations()), MOVE)
    assert found.plane is None
    assert found.friction is None
    assert_close(found.offset, np.asarray(found.cross))


MOVE = motion([20.0, 30.0, 20.0], [100.0, 100.0, 100.0])


@pytest.mark.parametrize(
    ("alone", "rule", "seen"),
    [(False, "all", 0.1), (True, "all", 0.0), (False, "none", 0.0)],
)
def test_the_leadscrew_looks_up_the_position_with_or_without_the_others(
    alone: bool, rule: str, seen: float
) -> None:
    controller = machine(
        AxisCompensations(cross=CROSS, leadscrew=SCREW, leadscrew_alone=alone),
        AxisCompensations(),
        leadscrew_input=rule,
    )
    found = run(controller, MOVE).leadscrew
    assert found is not None
    places = np.array([20.0, 30.0, 20.0]) + seen
    assert_close(found[:, 0], -places * [0.0005, 0.0005, 0.001])


def test_a_reversal_blends_the_tables_over_the_cycles() -> None:
    controller = machine(AxisCompensations(leadscrew=SCREW, reversal_cycles=2))
    found = run(controller, motion([0.0, 40.0, 20.0, 20.0, 10.0])).leadscrew
    assert found is not None
    # Half of both tables in the cycle of the reversal, then the one for backwards.
    assert_close(found[:, 0], [0.0, -0.02, -(0.01 + 0.02) / 2, -0.02, -0.01])


def test_the_leadscrew_spreads_as_the_backlash_does() -> None:
    controller = machine(AxisCompensations(backlash=Backlash(0.1, 1, 2)))
    assert controller.axes[0].spread_cycles == 2
    found = run(controller, motion([0.0, 40.0, 20.0, 20.0, 30.0, 30.0]))
    assert_close(found.offset[:, 0], [0, 0, -0.05, -0.1, -0.05, 0])


@pytest.mark.parametrize(("rule", "first"), [("direction", 0.1), ("reference", 0.0)])
def test_before_the_first_motion_the_backlash_follows_its_convention(
    rule: str, first: float
) -> None:
    controller = machine(
        AxisCompensations(backlash=Backlash(0.1, -1), leadscrew=SCREW),
        backlash_start=rule,
    )
    found = run(controller, motion([10.0, 10.0, 20.0, 10.0])).backlash
    assert found is not None
    assert_close(found[:, 0], [first, first, 0.1, 0.0])


def test_directions_that_are_given_count() -> None:
    controller = machine(AxisCompensations(leadscrew=SCREW, leadscrew_alone=True))
    given = motion([20.0, 30.0, 40.0], direction=np.array([[1.0], [-1.0], [1.0]]))
    found = run(controller, given).leadscrew
    assert found is not None
    assert_close(found[:, 0], [-0.01, -0.03, -0.02])


def test_rows_that_stand_for_themselves_have_neither_filters_nor_delays() -> None:
    controller = machine(
        AxisCompensations(
            backlash=Backlash(0.1, cycles=10),
            cross=Coupled(CROSS.law, (0,), 10),
            friction=FrictionCompensation(DRAG.law, 3, 5.0, 4),
        )
    )
    found = controller.settled(
        motion(
            [20.0, 30.0, 40.0],
            velocity=np.array([[5.0], [-5.0], [0.0]]),
            direction=np.array([[1.0], [-1.0], [0.0]]),
        )
    )
    assert_close(found.backlash, [[0], [-0.1], [0]])
    assert_close(found.cross, [[0.02], [0.03], [0.04]])
    assert_close(found.friction, [[3], [-3], [0]])


def test_crosstalk_values_always_pass_their_filter() -> None:
    law = Crosstalk(SHAKE.surface, SHAKE.values, 1000.0, -500.0, cycles=2)
    controller = machine(AxisCompensations(crosstalk=Coupled(law, (0,))))
    moving = motion(
        [0.0, 0.0, 0.0, 0.0],
        acceleration=np.array([[0.0], [1000.0], [1000.0], [0.0]]),
    )
    assert_close(run(controller, moving).offset[:, 0], [0, 0.005, 0.01, 0.005])


def test_actual_positions_count_where_the_conventions_say_so() -> None:
    controller = machine(
        AxisCompensations(plane=PLANE, leadscrew=SCREW, leadscrew_alone=True),
        AxisCompensations(),
        plane_input="actual",
        direction_source="actual",
    )
    back = np.array([[40.0, 0.0], [30.0, 0.0], [20.0, 0.0]])
    found = run(controller, motion([10.0, 20.0, 30.0], [0.0] * 3, actual=back))
    assert found.plane is not None
    assert found.leadscrew is not None
    assert_close(found.plane[:, 0], [0.008, 0.006, 0.004])
    assert_close(found.leadscrew[:, 0], [-0.005, -0.02, -0.03])
    with pytest.raises(ValueError, match=r"but Motion\.actual is None"):
        run(controller, MOVE)


def test_the_slave_may_tell_the_direction_for_crosstalk() -> None:
    moving = motion(
        [0.0] * 4,
        [0.0] * 4,
        velocity=np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]),
        acceleration=np.array([[1000.0, 0.0]] * 4),
    )
    shaken = (AxisCompensations(), AxisCompensations(crosstalk=Coupled(SHAKE, (0,))))
    # Entries 0.01 and 0.02 for either direction, of the master or of the slave.
    by_master = run(machine(*shaken), moving).offset[:, 1]
    assert_close(by_master, [0.01, 0.01, 0.02, 0.02])
    by_slave = run(machine(*shaken, crosstalk_velocity="slave"), moving).offset[:, 1]
    assert_close(by_slave, [0.01, 0.02, 0.01, 0.02])


def test_crosstalk_may_follow_the_actual_motion() -> None:
    controller = machine(
        AxisCompensations(crosstalk=Coupled(SHAKE, (0,))), crosstalk_input="actual"
    )
    actual = {
        "actual_velocity": np.array([[1.0], [-1.0], [1.0]]),
        "actual_acceleration": np.array([[1000.0], [500.0], [-500.0]]),
    }
    # Full acceleration, half of it backwards, full deceleration; the command stands.
    found = run(controller, motion([0.0] * 3, **actual)).offset[:, 0]
    assert_close(found, [0.01, 0.01, -0.03])
    with pytest.raises(ValueError, match=r"Motion\.actual_acceleration is None"):
        run(controller, motion([0.0]))


def test_friction_looks_ahead_into_the_motion_that_follows() -> None:
    controller = machine(AxisCompensations(friction=FrictionCompensation(DRAG.law, 2)))
    speeds = np.array([[5.0], [5.0], [5.0], [-5.0]])
    moving = motion([0.0, 5.0, 10.0, 5.0], velocity=speeds)
    ahead = motion([5.0], velocity=speeds[3:])
    first = motion([0.0, 5.0, 10.0], velocity=speeds[:3])
    assert controller.lookahead == 2
    whole = run(controller, moving).friction
    part = controller.run(controller.start(), first, ahead)[0].friction
    assert whole is not None
    # Weights 1/2 and 0 in the two cycles before the reversal.
    assert_close(whole[:, 0], [3, 1.5, 0, -3])
    np.testing.assert_array_equal(part, whole[:3])


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="Axis 0, cross: master 1 does not exist"):
        machine(AxisCompensations(cross=CROSS))
    with pytest.raises(ValueError, match="plane needs 2 masters, got \\(0,\\)"):
        AxisCompensations(plane=Coupled(PLANE.law, (0,)))
    with pytest.raises(ValueError, match="crosstalk needs 1 to 3 masters"):
        AxisCompensations(crosstalk=Coupled(SHAKE, ()))
    with pytest.raises(ValueError, match="cross: cycles cannot be negative, got -1"):
        AxisCompensations(cross=Coupled(CROSS.law, (1,), -1))
    with pytest.raises(ValueError, match="manual: 'plain' is none of backlash"):
        AxisCompensations(manual=("plain",))
    with pytest.raises(ValueError, match="one number of cycles, got 3 and 4"):
        AxisCompensations(backlash=Backlash(0.1, cycles=3), reversal_cycles=4)
    controller = machine(AxisCompensations(leadscrew=SCREW))
    with pytest.raises(ValueError, match="a column per axis, \\(3, 1\\), got shape"):
        run(controller, MOVE)
    empty = Motion(*(jnp.zeros((0, 1)) for _ in range(3)))
    with pytest.raises(ValueError, match="at least one cycle, got none"):
        run(controller, empty)

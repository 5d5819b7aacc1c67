"""Compensations that the library does not know, in the controller."""

from typing import final

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from axcomp.models import (
    AbstractOffset,
    AxisCompensations,
    Coupled,
    Leadscrew,
    Motion,
    PositionController,
    Rows,
    Setpoints,
)

SCREW = Leadscrew(Setpoints([0.0, 100.0]), [0.0, 0.1])


@final
class Push(AbstractOffset):
    """Follows the position of its master."""

    gain: Float[Array, ""]

    def offset(self, rows: Rows, axes: tuple[int, ...]) -> Float[Array, " t"]:
        return self.gain * rows.position[axes[1]]


def push(gain: float, cycles: int = 0) -> dict[str, Coupled[AbstractOffset]]:
    return {"push": Coupled(Push(jnp.asarray(gain)), (1,), cycles)}


def machine(**more: object) -> PositionController:
    own = AxisCompensations(**({"further": push(0.5)} | more))  # type: ignore[arg-type]
    return PositionController((own, AxisCompensations()))


def motion(homed: list[bool] | None = None) -> Motion:
    place = np.array([[10.0, 2.0], [20.0, 4.0], [30.0, 6.0]])
    known = None if homed is None else np.array([[True, one] for one in homed])
    return Motion(place, np.zeros_like(place), np.zeros_like(place), homed=known)


def test_it_is_one_of_the_sum_and_the_leadscrew_looks_up_with_it() -> None:
    controller = machine(leadscrew=SCREW)
    assert controller.installed == ("push", "leadscrew")
    offsets, _ = controller.run(controller.start(), motion())
    pushed = np.array([1.0, 2.0, 3.0])
    screw = -0.001 * (np.array([10.0, 20.0, 30.0]) + pushed)
    # One rounding of numbers around 30.
    np.testing.assert_allclose(offsets.further["push"][:, 0], pushed, atol=1e-14)
    np.testing.assert_allclose(offsets.offset[:, 0], pushed + screw, atol=1e-14)
    assert offsets.part("push") is offsets.further["push"]
    assert not np.any(offsets.further["push"][:, 1])
    assert offsets.part("cross") is None


def test_rows_that_stand_for_themselves_have_it_as_well() -> None:
    np.testing.assert_array_equal(machine().settled(motion()).offset[:, 0], [1, 2, 3])


def test_the_sum_is_differentiable_in_its_parameter() -> None:
    def total(gain: Array) -> Array:
        own = AxisCompensations(further={"push": Coupled(Push(gain), (1,))})
        controller = PositionController((own, AxisCompensations()))
        return controller.run(controller.start(), motion())[0].offset.sum()

    # The sum of the positions of the master.
    assert jax.grad(total)(jnp.asarray(0.5)) == pytest.approx(12.0, rel=1e-14)


def test_it_waits_for_its_master_and_comes_over_its_cycles() -> None:
    controller = machine(further=push(0.5, cycles=2))
    offsets, _ = controller.run(controller.start(), motion([False, True, True]))
    # sin² over two cycles: half of it in the first.
    np.testing.assert_allclose(offsets.offset[:, 0], [0.0, 1.0, 3.0], atol=1e-14)


def test_what_waits_for_a_command_adds_nothing() -> None:
    controller = machine(manual=("push",))
    assert not np.any(controller.run(controller.start(), motion())[0].offset)


def test_a_name_that_has_a_field_and_a_master_that_is_not_there_are_refused() -> None:
    law = Coupled(Push(jnp.asarray(1.0)), (5,))
    with pytest.raises(ValueError, match="'cross' has a field of its own"):
        AxisCompensations(further={"cross": law})
    with pytest.raises(ValueError, match="push: master 5 does not exist"):
        machine(further={"push": law})

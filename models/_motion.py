"""What enters the position controller per cycle, and what it adds to it."""

from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._nodes import Values, float_array

COMPENSATIONS: tuple[str, ...] = (
    "backlash",
    "temperature",
    "cross",
    "plane",
    "crosstalk",
    "leadscrew",
    "friction",
)
"""All compensations, in the order in which their offsets are summed up (S-56)."""


def _optional_floats(value: Any) -> Array | None:
    return None if value is None else float_array(value)


def _optional_flags(value: Any) -> Array | None:
    return None if value is None else jnp.asarray(value, dtype=bool)


@final
class Motion(eqx.Module):
    """Commanded motion of all axes of a machine, and what else the controller knows.

    One row per cycle. Linear axes in mm, rotary axes in °, per s and s².
    """

    position: Float[Values, "t a"] = eqx.field(converter=float_array)
    """Command positions."""
    velocity: Float[Values, "t a"] = eqx.field(converter=float_array)
    """Command velocities: friction, and the side of crosstalk tables."""
    acceleration: Float[Values, "t a"] = eqx.field(converter=float_array)
    """Command accelerations: crosstalk."""
    temperature: Float[Values, "t s"] | None = eqx.field(
        default=None, converter=_optional_floats
    )
    """Temperatures of all sensors in °C; None: there is no sensor."""
    homed: Bool[Values, "t a"] | None = eqx.field(
        default=None, converter=_optional_flags
    )
    """Which axes are homed; None: all, and have been for long."""
    active: Bool[Values, "t a c"] | None = eqx.field(
        default=None, converter=_optional_flags
    )
    """Which of `COMPENSATIONS` are selected, e.g. by COMP ON and OFF (`commanded`).

    None: those that need no command, and have been for long.
    """
    direction: Float[Values, "t a"] | None = eqx.field(
        default=None, converter=_optional_floats
    )
    """Directions of motion ±1; None: those of the steps of the positions."""
    actual: Float[Values, "t a"] | None = eqx.field(
        default=None, converter=_optional_floats
    )
    """Actual positions, for the conventions that take them instead of commands."""
    actual_velocity: Float[Values, "t a"] | None = eqx.field(
        default=None, converter=_optional_floats
    )
    """Actual velocities, likewise: crosstalk (S-61)."""
    actual_acceleration: Float[Values, "t a"] | None = eqx.field(
        default=None, converter=_optional_floats
    )
    """Actual accelerations, likewise."""

    @property
    def cycles(self) -> int:
        """Number of cycles."""
        return int(self.position.shape[0])


@final
class Offsets(eqx.Module):
    """What the controller adds, per cycle and axis.

    None: no axis has that compensation. An axis that lacks it has zeros.
    """

    offset: Float[Array, "t a"]
    """Sum of all position offsets in mm or °."""
    backlash: Float[Array, "t a"] | None
    """In mm or °."""
    temperature: Float[Array, "t a"] | None
    """In mm."""
    cross: Float[Array, "t a"] | None
    """In mm or °."""
    plane: Float[Array, "t a"] | None
    """In mm or °."""
    crosstalk: Float[Array, "t a"] | None
    """In mm or °."""
    leadscrew: Float[Array, "t a"] | None
    """In mm or °."""
    friction: Float[Array, "t a"] | None
    """Current in drive units; no part of the sum."""
    further: dict[str, Float[Array, "t a"]] = eqx.field(default_factory=dict)
    """In mm or °, of what is none of `COMPENSATIONS`, by name."""

    def part(self, name: str) -> Float[Array, "t a"] | None:
        """Return what a compensation adds, by its name; None: no axis has it."""
        field: Array | None = getattr(self, name) if name in COMPENSATIONS else None
        return self.further.get(name, field)


@final
class Rows(eqx.Module):
    """The motion of all axes, axis by axis; lives only while it is traced."""

    position: Float[Array, "a t"]
    """Command positions."""
    velocity: Float[Array, "a t"]
    """Command velocities."""
    acceleration: Float[Array, "a t"]
    """Command accelerations."""
    actual: Float[Array, "a t"] | None
    """Actual positions, if any."""
    actual_velocity: Float[Array, "a t"] | None
    """Actual velocities, if any."""
    actual_acceleration: Float[Array, "a t"] | None
    """Actual accelerations, if any."""
    temperature: Float[Array, "s t"]
    """Temperatures of all sensors."""


def rows_of(motion: Motion) -> Rows:
    """Return the motion axis by axis: turned round once, not in each use."""
    heat = motion.temperature
    if heat is None:
        heat = jnp.zeros((motion.cycles, 0))
    return Rows(
        position=motion.position.T,
        velocity=motion.velocity.T,
        acceleration=motion.acceleration.T,
        actual=_turned(motion.actual),
        actual_velocity=_turned(motion.actual_velocity),
        actual_acceleration=_turned(motion.actual_acceleration),
        temperature=heat.T,
    )


def _turned(rows: Float[Array, "t a"] | None) -> Float[Array, "a t"] | None:
    return None if rows is None else rows.T


def actual(motion: Motion | Rows) -> Float[Array, "_ _"]:
    """Return the actual positions of all axes, for conventions that take them.

    Raises:
        ValueError: If there are none.
    """
    if motion.actual is None:
        msg = "The conventions take actual positions, but Motion.actual is None."
        raise ValueError(msg)
    return motion.actual


def actual_rates(rows: Rows) -> tuple[Float[Array, "a t"], Float[Array, "a t"]]:
    """Return actual velocities and accelerations of all axes, likewise.

    Raises:
        ValueError: If there are none.
    """
    if rows.actual_velocity is None or rows.actual_acceleration is None:
        msg = (
            "The conventions take actual velocities and accelerations, but "
            "Motion.actual_velocity or Motion.actual_acceleration is None."
        )
        raise ValueError(msg)
    return rows.actual_velocity, rows.actual_acceleration


def picked(rows: Float[Array, "a t"], numbers: Int[np.ndarray, " k"]) -> Array:
    """Return some of the rows, in ascending order: all of them without a copy."""
    return rows if numbers.size == rows.shape[0] else rows[numbers]


def with_ahead(
    motion: Motion, ahead: Motion | None, cycles: int
) -> Float[Array, "n a"]:
    """Return all velocities, and those of so many cycles after the motion."""
    upcoming = motion.velocity[:0] if ahead is None else ahead.velocity[:cycles]
    upcoming = jnp.pad(upcoming, ((0, cycles - upcoming.shape[0]), (0, 0)))
    return jnp.concatenate([motion.velocity, upcoming])


def following(waiting: list[Motion], cycles: int) -> Motion:
    """Return so many cycles after the first piece: after the last one the axes stand.

    Always as many, so that pieces of equal length need one program only.
    """
    rows = [
        (piece.position, piece.velocity, piece.acceleration) for piece in waiting[1:]
    ]
    standing = jnp.zeros((cycles, waiting[0].position.shape[1]))
    return Motion(
        *(
            jnp.concatenate(part)[:cycles]
            for part in zip(*rows, (standing,) * 3, strict=True)
        )
    )


def chunk_size(count: int, most: int) -> int:
    """Return into chunks of which size a piece is cut: equal ones, if there are any."""
    if count <= most:
        return count
    equal = (size for size in range(most, most // 4, -1) if count % size == 0)
    return next(equal, most)

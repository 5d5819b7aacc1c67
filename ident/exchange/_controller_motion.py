"""Motion by axis number → motion as the controller takes it, a column per axis."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Array, Float

from ...models import Conventions, Motion as ControllerMotion
from ._errors import ExchangeError
from ._machine_lists import Reading
from ._motion import Motion, direction_of_motion, unwrapped
from ._nodes import as_array


def controller_motion(
    motion: Motion, numbers: Sequence[int], reading: Reading
) -> ControllerMotion:
    """Return the motion as the controller takes it, a column per axis.

    What no compensation needs and the motion does not have is 0.

    Raises:
        ExchangeError: If the conventions take actual positions and there are none.
    """
    none = np.zeros(motion.rows)

    def table(
        columns: Sequence[Float[np.ndarray, " t"] | None],
    ) -> Float[Array, "t a"]:
        return as_array(np.stack([none if c is None else c for c in columns], axis=1))

    conventions = reading.conventions
    pairs = [(n, reading.span(n)) for n in numbers]
    actual = _actuals(motion, numbers, conventions)
    velocities: Float[Array, "t a"] | None = None
    accelerations: Float[Array, "t a"] | None = None
    if conventions.crosstalk_input == "actual":
        rates = [motion.actual_rates(n, span) for n, span in pairs]
        velocities = table([one[0] for one in rates])
        accelerations = table([one[1] for one in rates])
    return ControllerMotion(
        position=table([motion.positions.get(n) for n in numbers]),
        velocity=table([motion.velocity(n, span) for n, span in pairs]),
        acceleration=table([motion.acceleration(n, span) for n, span in pairs]),
        temperature=(
            table(list(motion.temperatures.values())) if motion.temperatures else None
        ),
        direction=_directions(motion, numbers, reading),
        actual=actual,
        actual_velocity=velocities,
        actual_acceleration=accelerations,
    )


def _directions(
    motion: Motion, numbers: Sequence[int], reading: Reading
) -> Float[Array, "t a"] | None:
    """Return the directions where the controller cannot tell them by positions."""
    if not motion.directions and not reading.modulo:
        return None
    places = motion.positions
    if reading.conventions.direction_source == "actual":
        places = motion.actuals
    columns = []
    for axis in numbers:
        found = motion.directions.get(axis)
        if found is None and motion.time is not None and axis in places:
            found = direction_of_motion(unwrapped(places[axis], reading.span(axis)), 0)
        columns.append(np.zeros(motion.rows) if found is None else found.astype(float))
    return as_array(np.stack(columns, axis=1))


def _actuals(
    motion: Motion, numbers: Sequence[int], conventions: Conventions
) -> Float[Array, "t a"] | None:
    asking = {
        name
        for name in ("plane_input", "direction_source", "crosstalk_input")
        if getattr(conventions, name) == "actual"
    }
    if motion.actuals:
        # An axis without its own is where it is commanded.
        either = {**motion.positions, **motion.actuals}
        none = np.zeros(motion.rows)
        return as_array(np.stack([either.get(n, none) for n in numbers], axis=1))
    if asking:
        raise ExchangeError(
            where=motion.source,
            found="no actual positions",
            expected=f"columns such as A{numbers[0]}.actual, as the convention"
            f" {sorted(asking)[0]} takes them",
        )
    return None

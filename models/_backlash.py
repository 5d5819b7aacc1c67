"""Backlash compensation: an offset that changes where the axis reverses."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._direction import DirectionState, directions
from ._filter import Past, SineSquaredFilter
from ._nodes import Values, float_array


@final
class BacklashState(eqx.Module):
    """Which way the axis went, and what of the last reversals is still to come."""

    direction: DirectionState
    """Of the axis."""
    past: Past
    """Directions of the last cycles."""


@final
class Backlash(eqx.Module):
    """Backlash compensation of one axis (P-AXIS-00021, 00103, 00243).

    Moving in the reference direction the axis is where it is commanded; moving against
    it the offset is the width, against the reference direction (S-45). A negative width
    (play between slide and measuring system) turns the offset round. Units: mm or °.

    The offset has no derivative with respect to the position.
    """

    width: Float[Values, ""] = eqx.field(converter=float_array)
    """Size of the backlash in mm or °, positive or negative (P-AXIS-00103)."""
    reference: int = eqx.field(default=1, static=True)
    """Direction without an offset: 1 or −1 (P-AXIS-00021 = 1 or 2)."""
    cycles: int = eqx.field(default=0, static=True)
    """Cycles over which a reversal is spread; 0 and 1: at once (P-AXIS-00243)."""

    def __check_init__(self) -> None:
        if self.reference not in (1, -1):
            msg = f"reference must be 1 or -1, got {self.reference!r}."
            raise ValueError(msg)
        _ = self.filter  # refuses negative numbers of cycles

    @property
    def filter(self) -> SineSquaredFilter:
        """What spreads a reversal over cycles."""
        return SineSquaredFilter(self.cycles)

    def offset(self, direction: Float[Array | np.ndarray, " t"]) -> Float[Array, " t"]:
        """Return what the controller adds to the axis in mm or °.

        Args:
            direction: Of the motion, ±1; in between while a reversal is being spread.
        """
        against = 0.5 * (jnp.asarray(direction) - float(self.reference))
        return jnp.asarray(self.width * against)

    def start(self, direction: int = 1) -> BacklashState:
        """Return the state before the first cycle (`Conventions.start_direction`)."""
        return BacklashState(
            direction=DirectionState.start(direction),
            past=self.filter.start(float(direction)),
        )

    def run(
        self, state: BacklashState, position: Float[Array, " t"]
    ) -> tuple[Float[Array, " t"], BacklashState]:
        """Return the offset per cycle in mm or °, and the state after.

        Args:
            state: Before the first of these cycles.
            position: Command position of the axis per cycle in mm or °.
        """
        direction, _, after = directions(state.direction, position)
        spread, past = self.filter.run(state.past, direction)
        return self.offset(spread), BacklashState(after, past)

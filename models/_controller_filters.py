"""Filters of the controller, for several axes at once."""

from collections.abc import Sequence
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ._controller_axis import AxisCompensations
from ._conventions import Conventions
from ._filter import step_response
from ._kept import kept
from ._smoothing import smooth

Filtered = Float[Array, "k t"]


def filtered(
    value: Filtered,
    past: Float[Array, "k m"],
    begun: Bool[Array, ""],
    response: Float[np.ndarray, " r"],
) -> tuple[Filtered, Float[Array, "k m"]]:
    """Return the filtered rows and what the filter carries on.

    Before the first cycle of all, values have stood as they are in it. In rows that do
    not change the filter is left out: it would change nothing.
    """
    count = past.shape[1]
    if count == 0:
        return value, past
    history = jnp.concatenate([jnp.where(begun, past, value[:, :1]), value], axis=1)

    def filter_row(row: Array) -> Array:
        result: Array = lax.cond(
            jnp.all(row == row[0]),
            lambda row: row[count:],
            lambda row: smooth(row, response),
            row,
        )
        return result

    return lax.map(filter_row, history), history[:, value.shape[1] :]


@final
class Spread:
    """Axes whose reversals are spread over the same number of cycles.

    Attributes:
        members: Numbers of the axes.
        names: Compensations that follow these directions.
    """

    def __init__(
        self,
        members: Sequence[int],
        names: Sequence[str],
        starts: Sequence[int],
        response: Float[np.ndarray, " r"],
    ) -> None:
        self.members, self.names = tuple(members), tuple(names)
        self._starts = np.array(starts, dtype=np.float64)[:, None]
        self._response = response

    def start(self) -> Float[Array, "k m"]:
        """Return what is carried before the first cycle."""
        return jnp.zeros((len(self.members), self._response.size - 1))

    def run(
        self,
        direction: Float[Array, "a t"],
        past: Float[Array, "k m"],
        begun: Bool[Array, ""],
    ) -> tuple[Filtered, Float[Array, "k m"]]:
        """Return the spread directions, and what is carried after.

        Args:
            direction: Of all axes; 0 before the first motion.
            past: What is carried.
            begun: Whether there was a cycle before.
        """
        signs = direction[np.array(self.members)]
        signs = jnp.where(signs == 0.0, self._starts, signs)
        rows, after = filtered(signs, past, begun, self._response)
        return kept(rows), after


def spreads(
    axes: Sequence[AxisCompensations], rules: Conventions, settled: bool
) -> tuple[Spread, ...]:
    """Return the axes that follow directions, in groups of equal numbers of cycles."""
    groups: dict[tuple[int, tuple[str, ...]], list[tuple[int, int]]] = {}
    for number, axis in enumerate(axes):
        start: int = rules.start_direction
        flank = start
        if axis.backlash is not None and rules.backlash_start == "reference":
            flank = axis.backlash.reference
        names = [n for n in ("backlash", "leadscrew") if getattr(axis, n) is not None]
        # One filter serves both where both start from the same direction.
        parts = [(tuple(names), start)] if start == flank else []
        parts = parts or [((n,), flank if n == "backlash" else start) for n in names]
        for part, sign in parts:
            if part:
                groups.setdefault((axis.spread_cycles, part), []).append((number, sign))
    return tuple(
        Spread(
            [number for number, _ in members],
            names,
            [sign for _, sign in members],
            np.ones(1) if settled else step_response(cycles, rules.filter_delay),
        )
        for (cycles, names), members in groups.items()
    )


def followed(
    parts: Sequence[Spread],
    direction: Float[Array, "a t"],
    carried: Sequence[Float[Array, "_ _"]],
    begun: Bool[Array, ""],
) -> tuple[dict[str, list[Float[Array, " t"]]], tuple[Float[Array, "_ _"], ...]]:
    """Return the spread directions per compensation and axis, and what is carried."""
    directions = {name: list(direction) for name in ("backlash", "leadscrew")}
    after = []
    for part, past in zip(parts, carried, strict=True):
        rows, last = part.run(direction, past, begun)
        after.append(last)
        for name in part.names:
            for member, row in zip(part.members, rows, strict=True):
                directions[name][member] = row
    return directions, tuple(after)

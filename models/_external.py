r"""External compensation: any offsets of all axes, as the controller calls them.

The controller hands over the positions of all axes in each cycle and adds what comes
back ([004] 2). When it is switched on no axis may move: from the positions where the
axes stand follow the ones that, compensated, lead there (`start`).
"""

from collections.abc import Callable
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ._lookup import AbstractLookup

Offsets = Callable[[Float[Array, "t a"]], Float[Array, "t a"]]
"""From positions of all axes in mm or ° to their offsets; row by row, without memory."""

FAILED = 70582
"""What the controller reports where a call of the compensation signals an error."""

_TOLERANCE = 1e-10
"""Rest in mm or °: up to a slope of 0.9 the position is then right to 1e-9."""
_ROUNDINGS = 8.0 * float(np.finfo(np.float64).eps)
_MAX_STEPS = 200
_SHORTER = (1.0, 0.5, 0.125)


@final
class StartPoint(eqx.Module):
    """Where the axes are to be, for the compensation to lead to given positions."""

    positions: Float[Array, "t a"]
    """x with x + offset(x) = given, in mm or °."""
    offsets: Float[Array, "t a"]
    """offset(x) in mm or °: what the controller takes over (computeStartOffsets)."""
    result: Int[Array, " t"]
    """0, or 70582 in rows where no such position was found."""


@final
class ExternalCompensation(eqx.Module):
    """Offsets of all axes as a compensation of the external interface.

    The derivatives of `start` and `start_offsets` come from the solution itself (the
    implicit function theorem), in forward and in reverse mode. At a kink of the offsets
    they are those of the cell on the right-hand side of the position that was found.
    """

    law: Offsets
    """The offsets: an `OffsetStack`, another module, or any function of positions."""

    def offsets(
        self, positions: Float[Array | np.ndarray, "t a"]
    ) -> Float[Array, "t a"]:
        """Return the offsets in mm or ° at positions of all axes (computeOffsets)."""
        return self.law(jnp.asarray(positions, dtype=jnp.float64))

    def start_offsets(
        self, positions: Float[Array | np.ndarray, "t a"]
    ) -> Float[Array, "t a"]:
        """Return the offsets with which nothing moves when they are switched on.

        That is offset(x) in mm or °, with x + offset(x) = positions, right to 1e-9; NaN
        in rows without a solution (`start` tells them apart).
        """
        start = self.start(positions)
        solved = (start.result == 0)[:, None]
        return jnp.where(solved, start.offsets, jnp.nan)

    @eqx.filter_jit
    def start(self, positions: Float[Array | np.ndarray, "t a"]) -> StartPoint:
        """Return the positions x with x + offset(x) = positions, row by row.

        Offsets that change by less than they are moved (slope below 1 in any direction,
        kinks or not) have exactly one such x, and it is found.
        """
        target = jnp.asarray(positions, dtype=jnp.float64)

        def missed(place: Float[Array, "t a"]) -> Float[Array, "t a"]:
            return place + self.law(place) - target

        place = lax.custom_root(missed, target, _solve, _solve_tangent)
        offsets = self.law(place)
        solved = _within(place, place + offsets - target)
        return StartPoint(
            positions=place, offsets=offsets, result=jnp.where(solved, 0, FAILED)
        )


def _solve(
    missed: Callable[[Float[Array, "t a"]], Float[Array, "t a"]],
    target: Float[Array, "t a"],
) -> Float[Array, "t a"]:
    """Return the zeros of `missed`, row by row.

    Of a plain step, which contracts wherever the slope is below 1, and Newton steps of
    several lengths, which converge at once inside a cell but may go around in circles
    between cells, each row takes the one that leaves least.
    """

    def unfinished(state: tuple[Array, Array, Array]) -> Bool[Array, ""]:
        place, miss, step = state
        return (step < _MAX_STEPS) & ~jnp.all(_within(place, miss))

    def improve(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        place, miss, step = state
        newton = jnp.linalg.solve(_slopes(missed, place), miss[..., None])[..., 0]
        best, least = place - miss, missed(place - miss)
        for length in _SHORTER:
            trial = place - length * newton
            remaining = missed(trial)
            # False for NaN, of a singular slope: then the plain step stays.
            better = (_size(remaining) < _size(least))[:, None]
            best = jnp.where(better, trial, best)
            least = jnp.where(better, remaining, least)
        # Rows that are done stay, whatever their neighbours need.
        solved = _within(place, miss)[:, None]
        return (
            jnp.where(solved, place, best),
            jnp.where(solved, miss, least),
            step + 1,
        )

    start = (target, missed(target), jnp.zeros((), dtype=jnp.int32))
    zeros: Float[Array, "t a"] = lax.while_loop(unfinished, improve, start)[0]
    return zeros


def _solve_tangent(
    slope: Callable[[Float[Array, "t a"]], Float[Array, "t a"]],
    right: Float[Array, "t a"],
) -> Float[Array, "t a"]:
    columns = [
        slope(jnp.broadcast_to(unit, right.shape)) for unit in jnp.eye(right.shape[1])
    ]
    matrix = jnp.stack(columns, axis=-1)
    tangent: Float[Array, "t a"] = jnp.linalg.solve(matrix, right[..., None])[..., 0]
    return tangent


def _slopes(
    missed: Callable[[Float[Array, "t a"]], Float[Array, "t a"]],
    place: Float[Array, "t a"],
) -> Float[Array, "t a a"]:
    """Return d missed / d place of each row."""
    columns = [
        jax.jvp(missed, (place,), (jnp.broadcast_to(unit, place.shape),))[1]
        for unit in jnp.eye(place.shape[1])
    ]
    return jnp.stack(columns, axis=-1)


def _size(miss: Float[Array, "t a"]) -> Float[Array, " t"]:
    # Plain steps contract in the Euclidean norm where the slope is below 1 in it.
    return jnp.sum(jnp.square(miss), axis=-1)


def _within(place: Float[Array, "t a"], miss: Float[Array, "t a"]) -> Bool[Array, " t"]:
    allowed = jnp.maximum(_TOLERANCE, _ROUNDINGS * jnp.abs(place))
    return jnp.all(jnp.abs(miss) <= allowed, axis=-1)


@final
class OffsetPart(eqx.Module):
    """One table in a stack: what it adds to which axis, over which axes."""

    model: AbstractLookup
    """The table; a leadscrew for one or both directions alike, without memory."""
    axis: int = eqx.field(static=True)
    """Column of the axis that it adds to."""
    masters: tuple[int, ...] = eqx.field(static=True)
    """Columns of the axes whose positions enter, master 1 first."""
    compensated: bool = eqx.field(default=False, static=True)
    """Whether the parts before it are added to the position of its own axis first."""

    def __check_init__(self) -> None:
        needed = len(self.model.ways)
        if len(self.masters) != needed:
            msg = (
                f"A {type(self.model).__name__} needs {needed} master column(s), got "
                f"{self.masters!r}."
            )
            raise ValueError(msg)
        if len(self.model.tables) > 1:
            msg = (
                "An external compensation knows positions only, got a leadscrew table "
                "for each direction of motion."
            )
            raise ValueError(msg)

    def offset(self, positions: Float[Array, "t a"]) -> Float[Array, " t"]:
        """Return what it adds to its axis in mm or °."""
        table: Any = self.model
        forward = np.ones(len(positions), dtype=np.int64)
        arguments = table.looked_up(positions[:, np.array(self.masters)], forward)
        offset: Float[Array, " t"] = table.offset(*arguments)
        return offset


@final
class OffsetStack(eqx.Module):
    """The sum of several tables as offsets of all axes, in their order."""

    parts: tuple[OffsetPart, ...]
    axes: int = eqx.field(static=True)
    """Number of axes: columns of positions and of offsets."""

    def __check_init__(self) -> None:
        for part in self.parts:
            if not all(0 <= k < self.axes for k in (part.axis, *part.masters)):
                msg = (
                    f"Columns must be 0 to {self.axes - 1}, got axis {part.axis} and "
                    f"masters {part.masters!r}."
                )
                raise ValueError(msg)

    def __call__(self, positions: Float[Array, "t a"]) -> Float[Array, "t a"]:
        """Return the offsets of all axes in mm or °."""
        total = jnp.zeros_like(positions)
        for part in self.parts:
            place = positions
            if part.compensated:
                shifted = positions[:, part.axis] + total[:, part.axis]
                place = positions.at[:, part.axis].set(shifted)
            total = total.at[:, part.axis].add(part.offset(place))
        return total

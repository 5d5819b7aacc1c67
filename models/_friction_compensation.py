"""Friction compensation over cycles: weighted around reversals, and delayed."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ._direction import last_of
from ._filter import Delay, Past
from ._friction import AbstractFriction
from ._friction_hold import HoldState, ReversalHold
from ._kept import kept
from ._kernels import take
from ._nodes import Values, float_array, is_known
from ._running import last_flagged


@final
class FrictionState(eqx.Module):
    """What friction compensation carries from one piece of a log to the next."""

    direction: Float[Array, ""]
    """Of the last motion, ±1; 0 before the first one."""
    moving: Bool[Array, ""]
    """Whether the axis moved in the last cycle."""
    position: Float[Array, ""]
    """In the last cycle, in mm or °; without a meaning before the first cycle."""
    begun: Bool[Array, ""]
    """Whether there was a cycle."""
    origin: Float[Array, ""]
    """Where the last build-up began, in mm or °."""
    built: Bool[Array, ""]
    """Whether there was a build-up: without one the current is not weighted."""
    past: Past | HoldState
    """Currents of the last cycles, for the delay."""


@final
class Turns(eqx.Module):
    """Which way an axis goes, cycle by cycle."""

    direction: Float[Array, " t"]
    """Of the last motion, ±1; 0 before the first one."""
    reverses: Bool[Array, " t"]
    """Whether the cycle is the first one of a new direction."""


@final
class FrictionCompensation(eqx.Module):
    """What the controller adds to the current of one axis, cycle by cycle.

    The current of the law is weighted where the direction reverses: down to 0 over the
    cycles before the first one of the new direction, and up from 0, linear in the
    distance, after it. The distance counts from the position of the cycle before that
    first one. Standing between both directions changes nothing of it: the cycles of the
    dwell are among those before, and have no current anyway. An axis that stops and
    goes on in its direction is not weighted (S-28, S-30).

    The direction is that of the last velocity that was not 0. Which cycles are weighted
    has no derivative; weights have one with respect to position and `position_delay`,
    and it is 0 where the distance is that of the delay or more.
    """

    law: AbstractFriction
    """Current over velocity, in drive units."""
    reversal_lookahead: int = eqx.field(default=0, static=True)
    """Cycles N before a reversal with falling current (P-COMP-00044)."""
    position_delay: Float[Values, ""] = eqx.field(default=0.0, converter=float_array)
    """Distance in mm or ° over which the current rises (P-COMP-00043); 0: at once."""
    delay_cycles: int = eqx.field(default=0, static=True)
    """Cycles that all values come later (P-COMP-00058)."""
    sign: float = eqx.field(default=1.0, static=True)
    """Current per entry for positive motion: +1 or −1 (S-47)."""
    first_builds_up: bool = eqx.field(default=True, static=True)
    """The first motion of all builds up as after a reversal (S-28)."""
    restart_builds_up: bool = eqx.field(default=False, static=True)
    """Motion from standstill builds up in the same direction, too (S-28)."""
    decays_to_zero: bool = eqx.field(default=True, static=True)
    """The last cycle before a reversal has weight 0; else 1/(N+1) (S-30)."""
    weights_multiply: bool = eqx.field(default=True, static=True)
    """Weights before and after reversals multiply where both act; else the lesser."""
    delays_all: bool = eqx.field(default=True, static=True)
    """`delay_cycles` shift all values; else they hold them from reversals on (S-31)."""
    held_at_rest: bool = eqx.field(default=False, static=True)
    """At standstill acts the current of speed 0 in the last direction; else 0 (S-27)."""

    def __check_init__(self) -> None:
        for name in ("reversal_lookahead", "delay_cycles"):
            if getattr(self, name) < 0:
                msg = f"{name} cannot be negative, got {getattr(self, name)!r} cycles."
                raise ValueError(msg)
        delay = self.position_delay
        if is_known(delay) and not np.all(np.asarray(delay) >= 0):
            msg = f"position_delay cannot be negative, got {self.position_delay!s} mm."
            raise ValueError(msg)

    def current(self, velocity: Float[Array | np.ndarray, " t"]) -> Float[Array, " t"]:
        """Return what is added in steady motion, in drive units, at mm/s or °/s."""
        return self.sign * self.law(velocity)

    def start(self) -> FrictionState:
        """Return the state before the first cycle: the axis has not moved yet."""
        return FrictionState(
            direction=float_array(0.0),
            moving=jnp.zeros((), dtype=bool),
            position=float_array(0.0),
            begun=jnp.zeros((), dtype=bool),
            origin=float_array(0.0),
            built=jnp.zeros((), dtype=bool),
            past=(
                Delay(self.delay_cycles).start()
                if self.delays_all
                else ReversalHold(self.delay_cycles).start()
            ),
        )

    @eqx.filter_jit
    def run(
        self,
        state: FrictionState,
        position: Float[Array | np.ndarray, " t"],
        velocity: Float[Array | np.ndarray, " t"],
        ahead: Float[Array | np.ndarray, " h"] | None = None,
    ) -> tuple[Float[Array, " t"], FrictionState]:
        """Return the current per cycle in drive units, and the state after.

        Args:
            state: Of `start` or of the piece before.
            position: Commanded, in mm or °, at least one cycle.
            velocity: Commanded, in mm/s or °/s.
            ahead: Velocities of the cycles that follow; the first `reversal_lookahead`
                of them are used. Where there are less, the axis stands after them.
        """
        speed = jnp.asarray(velocity, dtype=jnp.float64)
        share, turns, after = self.shares(state, position, speed, ahead)
        level = self.law.level(jnp.abs(speed), turns.direction)
        return self.delayed(share, level, turns, after)

    def shares(
        self,
        state: FrictionState,
        position: Float[Array | np.ndarray, " t"],
        velocity: Float[Array | np.ndarray, " t"],
        ahead: Float[Array | np.ndarray, " h"] | None = None,
    ) -> "tuple[Float[Array, ' t'], Turns, FrictionState]":
        """Return how much of the law's level acts per cycle, −1 to 1, and the state after.

        The first part of `run`, with its arguments; the state still lacks the currents of
        these cycles. What the level is in between needs no cycle before.
        """
        place = jnp.asarray(position, dtype=jnp.float64)
        speed = jnp.asarray(velocity, dtype=jnp.float64)
        count = place.size
        speeds = jnp.concatenate([speed, self._following(ahead)])
        direction = _directions(state.direction, speeds)
        before = jnp.concatenate([state.direction[None], direction[:-1]])
        moving = speeds != 0.0
        reverses = moving & (direction * before < 0.0)
        first = moving & (before == 0.0)

        now, standing = moving[:count], ~moving[:count]
        begins = reverses[:count]
        if self.first_builds_up or self.restart_builds_up:
            begins = begins | first[:count]
        if self.restart_builds_up:
            begins = begins | (now & _shifted(~state.moving, standing))
        came_from = _shifted(jnp.where(state.begun, state.position, place[0]), place)
        rising, origin, built = self._rise(state, place, came_from, begins)
        falling = self._fall(reverses, count)
        weight = (
            rising * falling if self.weights_multiply else jnp.minimum(rising, falling)
        )

        sign = direction[:count]
        active = sign if self.held_at_rest else jnp.where(now, sign, 0.0)
        share = kept(weight * active)
        return (
            share,
            Turns(sign, reverses[:count]),
            FrictionState(
                direction=sign[-1],
                moving=now[-1],
                position=place[-1],
                begun=jnp.ones((), dtype=bool),
                origin=origin,
                built=built,
                past=state.past,
            ),
        )

    def delayed(
        self,
        share: Float[Array, " t"],
        level: Float[Array, " t"],
        turns: "Turns",
        after: FrictionState,
    ) -> tuple[Float[Array, " t"], FrictionState]:
        """Return the current per cycle in drive units, and the state after.

        The last part of `run`: what `shares` gave, and the law's level at these cycles.
        """
        current = self.sign * (share * level)
        delayed, past = self._delay(after.past, current, turns.reverses)
        return delayed, eqx.tree_at(lambda state: state.past, after, past)

    def _delay(
        self,
        past: Past | HoldState,
        current: Float[Array, " t"],
        reverses: Bool[Array, " t"],
    ) -> tuple[Float[Array, " t"], Past | HoldState]:
        if isinstance(past, HoldState):
            return ReversalHold(self.delay_cycles).run(past, current, reverses)
        return Delay(self.delay_cycles).run(past, current)

    def _following(
        self, ahead: Float[Array | np.ndarray, " h"] | None
    ) -> Float[Array, " n"]:
        """Return the velocities of the look-ahead, with standstill where unknown."""
        needed = self.reversal_lookahead
        if ahead is None:
            return jnp.zeros(needed)
        speeds = jnp.asarray(ahead, dtype=jnp.float64)[:needed]
        return jnp.pad(speeds, (0, needed - speeds.size))

    def _fall(self, reverses: Bool[Array, " n"], count: int) -> Float[Array, " t"]:
        """Return the weights before reversals."""
        cycles = self.reversal_lookahead
        weight = jnp.ones(count)
        if cycles == 0:
            return weight

        def fall(reverses: Array) -> Array:
            result = weight
            # From the farthest on: the next reversal has the last word.
            for cycle in range(cycles, 0, -1):
                share = cycle / (cycles + 1)
                if self.decays_to_zero:
                    share = (cycle - 1) / cycles
                result = jnp.where(reverses[cycle : cycle + count], share, result)
            return result

        falling: Array = lax.cond(jnp.any(reverses), fall, lambda _: weight, reverses)
        return falling

    def _rise(
        self,
        state: FrictionState,
        place: Float[Array, " t"],
        came_from: Float[Array, " t"],
        begins: Bool[Array, " t"],
    ) -> tuple[Float[Array, " t"], Float[Array, ""], Bool[Array, ""]]:
        """Return the weights after reversals, where the last began, whether one did."""

        def begin(begins: Array, came_from: Array) -> tuple[Array, Array]:
            last = last_flagged(begins)
            start = take(came_from, jnp.maximum(last - 1, 0))
            origin = jnp.where(last > 0, start, state.origin)
            return origin, (last > 0) | state.built

        def begin_none(begins: Array, came_from: Array) -> tuple[Array, Array]:
            origins = jnp.broadcast_to(state.origin, came_from.shape)
            return origins, jnp.broadcast_to(state.built, begins.shape)

        # In most pieces of a log no axis reverses.
        origin, built = lax.cond(jnp.any(begins), begin, begin_none, begins, came_from)
        delay = self.position_delay
        distance = jnp.abs(place - origin)
        # Not a division: XLA rounds that one differently for a single cycle.
        share = distance * (1.0 / jnp.where(delay > 0.0, delay, 1.0))
        weight = jnp.where(built & (distance < delay), share, 1.0)
        return weight, origin[-1], built[-1]


def _directions(
    start: Float[Array, ""], velocity: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Return the sign of the last velocity that was not 0, per cycle."""
    return last_of(jnp.sign(lax.stop_gradient(velocity)), start)


def _shifted(first: Array, values: Array) -> Array:
    """Return what was there one cycle before."""
    return jnp.concatenate([first[None], values[:-1]])

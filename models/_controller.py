"""The position controller: what all compensations of a machine add, cycle by cycle."""

from collections.abc import Iterable, Iterator
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ._controller_axis import AxisCompensations
from ._controller_filters import Spread, followed, spreads
from ._controller_groups import Group, assembled, group
from ._conventions import Conventions
from ._direction import DirectionState, directions
from ._friction_compensation import FrictionState
from ._kept import kept, run_again
from ._motion import (
    COMPENSATIONS,
    Motion,
    Offsets,
    actual,
    chunk_size,
    following,
    picked,
    rows_of,
    with_ahead,
)

_CHUNK = 1 << 13
"""Most cycles worked on at once: what an axis needs of them stays in the cache."""
_OFFSETS = COMPENSATIONS[:-1]
"""Those of the positions: all but friction."""


@final
class ControllerState(eqx.Module):
    """What the controller carries from one piece of a log to the next."""

    begun: Bool[Array, ""]
    """Whether there was a cycle."""
    direction: DirectionState
    """Of all axes, one behind the other; 0 before the first motion of an axis."""
    spread: tuple[Float[Array, "_ _"], ...]
    """Directions of the last cycles, per number of cycles that a reversal takes."""
    filtered: tuple[Float[Array, "_ _"], ...]
    """Per group of like compensations what its filter acts on: activation or offset."""
    friction: tuple[FrictionState, ...]
    """Per group of like friction compensations."""


@final
class PositionController(eqx.Module):
    """All compensations of one machine's axes.

    The offsets of an axis are summed up, leadscrew last, as it may look up the position
    with the other offsets (S-23, S-56). What needs the axis or its masters homed waits
    for it. Switching is smoothed by sin² over `n_cycles`, a reversal of backlash and of
    a leadscrew table with two sides over P-AXIS-00243 cycles; crosstalk values always
    pass their filter (S-06). Before the first cycle everything has stood as it is then:
    what acts from the first row on acts in full.

    Differentiable with respect to all tables, parameters and positions; what depends on
    a direction of motion or on activation has no derivative with respect to what
    decides it.
    """

    axes: tuple[AxisCompensations, ...]
    """Of each axis, in the order of the columns of `Motion`."""
    conventions: Conventions = eqx.field(default=Conventions(), static=True)
    """Rules that the manuals leave open; signs and edges are with the tables."""

    def __check_init__(self) -> None:
        for number, axis in enumerate(self.axes):
            for name in ("cross", "plane", "crosstalk", *axis.further):
                coupled = axis.part(name)
                for master in () if coupled is None else coupled.masters:
                    if not 0 <= master < len(self.axes):
                        msg = (
                            f"Axis {number}, {name}: master {master} does not exist, "
                            f"there are {len(self.axes)} axes, from 0."
                        )
                        raise ValueError(msg)

    @property
    def installed(self) -> tuple[str, ...]:
        """Names of the compensations that any axis has."""
        have = {name for axis in self.axes for name in axis.installed}
        return tuple(n for n in (*self._further, *COMPENSATIONS) if n in have)

    @property
    def lookahead(self) -> int:
        """Number of cycles that friction compensation looks ahead."""
        laws = (axis.friction for axis in self.axes)
        return max(
            (law.reversal_lookahead for law in laws if law is not None), default=0
        )

    def start(self) -> ControllerState:
        """Return the state before the first cycle."""
        return self._start(settled=False)

    @eqx.filter_jit
    def run(
        self, state: ControllerState, motion: Motion, ahead: Motion | None = None
    ) -> tuple[Offsets, ControllerState]:
        """Return what is added per cycle, and the state after.

        Args:
            state: Of `start`, or of the piece before.
            motion: At least one cycle of all axes.
            ahead: Motion that follows; its first `lookahead` cycles are used. None, or
                less: the axes stand after it.

        Raises:
            ValueError: If the motion does not have as many axes as the machine, or
                lacks actual positions that the conventions take.
        """
        self._check(motion)
        velocities = with_ahead(motion, ahead, self.lookahead)
        count = motion.cycles
        size = chunk_size(count, _CHUNK)
        number = count // size
        if number == 1 and size == count:
            return self._chunk(state, motion, velocities[count:])
        full = number * size
        pieces = jax.tree.map(
            lambda rows: rows[:full].reshape(number, size, *rows.shape[1:]), motion
        )
        upcoming = size * np.arange(1, number + 1)[:, None] + np.arange(self.lookahead)

        def body(
            state: ControllerState, piece: tuple[Motion, Array]
        ) -> tuple[ControllerState, Offsets]:
            offsets, state = self._chunk(state, *piece)
            return state, offsets

        # Backwards the chunk is run again: what it needs fits the cache, not memory.
        state, chunks = lax.scan(run_again(body), state, (pieces, velocities[upcoming]))
        offsets = jax.tree.map(lambda rows: rows.reshape(full, *rows.shape[2:]), chunks)
        if full == count:
            return offsets, state
        remainder = jax.tree.map(lambda rows: rows[full:], motion)
        last, state = self._chunk(state, remainder, velocities[count:])
        total = jax.tree.map(lambda *rows: jnp.concatenate(rows), offsets, last)
        return total, state

    def run_pieces(
        self, pieces: Iterable[Motion], state: ControllerState | None = None
    ) -> Iterator[Offsets]:
        """Return what is added, piece by piece, with the look-ahead into the next ones.

        Args:
            pieces: Of one log in its order, of any lengths; read as they are needed.
            state: Before the first piece; None: of `start`.
        """
        state = self.start() if state is None else state
        waiting: list[Motion] = []
        for piece in pieces:
            waiting.append(piece)
            while sum(p.cycles for p in waiting[1:]) >= max(self.lookahead, 1):
                offsets, state = self.run(
                    state, waiting[0], following(waiting, self.lookahead)
                )
                waiting.pop(0)
                yield offsets
        while waiting:
            offsets, state = self.run(
                state, waiting[0], following(waiting, self.lookahead)
            )
            waiting.pop(0)
            yield offsets

    @eqx.filter_jit
    def settled(self, motion: Motion) -> Offsets:
        """Return what is added where each row stands for itself, long after the last.

        Neither filters nor delays nor weights of reversals; directions are those of
        `Motion.direction`, and the one to start from where it is 0 or missing.
        """
        self._check(motion)
        recorded = motion.direction
        direction = jnp.zeros_like(motion.position) if recorded is None else recorded
        state = self._start(settled=True)
        return self._step(
            state, motion, direction.T, motion.velocity[:0], settled=True
        )[0]

    # ------------------------------------------------------------------------- details

    def _start(self, settled: bool) -> ControllerState:
        return ControllerState(
            begun=jnp.zeros((), dtype=bool),
            direction=jax.vmap(lambda _: DirectionState.start(0))(
                jnp.arange(len(self.axes))
            ),
            spread=tuple(spread.start() for spread in self._spreads(settled)),
            filtered=tuple(
                batch.start()
                for name in (*self._further, *_OFFSETS)
                for batch in self._groups(name, settled)
            ),
            friction=tuple(
                batch.start_friction() for batch in self._groups("friction", settled)
            ),
        )

    @property
    def _further(self) -> tuple[str, ...]:
        return tuple(sorted({name for axis in self.axes for name in axis.further}))

    def _groups(self, name: str, settled: bool) -> tuple[Group, ...]:
        return group(self.axes, name, self.conventions, settled)

    def _spreads(self, settled: bool) -> tuple[Spread, ...]:
        return spreads(self.axes, self.conventions, settled)

    def _check(self, motion: Motion) -> None:
        shape = (motion.cycles, len(self.axes))
        for name in ("position", "velocity", "acceleration"):
            got = getattr(motion, name).shape
            if got != shape:
                msg = f"{name} must have a column per axis, {shape}, got shape {got}."
                raise ValueError(msg)
        if motion.cycles == 0:
            msg = "Motion must have at least one cycle, got none."
            raise ValueError(msg)

    def _chunk(
        self,
        state: ControllerState,
        motion: Motion,
        ahead: Float[Array, "h a"],
    ) -> tuple[Offsets, ControllerState]:
        direction, last = self._directions(state.direction, motion)
        offsets, after = self._step(state, motion, direction, ahead, settled=False)
        return offsets, eqx.tree_at(lambda s: s.direction, after, last)

    def _step(
        self,
        state: ControllerState,
        motion: Motion,
        direction: Float[Array, "a t"],
        ahead: Float[Array, "h a"],
        settled: bool,
    ) -> tuple[Offsets, ControllerState]:
        """Return what is added and the state after, but for the directions in it."""
        count = len(self.axes)
        rows = rows_of(motion)
        directions, spread = followed(
            self._spreads(settled), direction, state.spread, state.begun
        )
        carried = iter(state.filtered)
        after = []
        tables: dict[str, Float[Array, "a t"]] = {}
        total = jnp.zeros((count, motion.cycles))
        for name in (*self._further, *_OFFSETS):
            groups = self._groups(name, settled)
            parts = []
            for batch in groups:
                members = np.array(batch.members)
                place = picked(rows.position, members)
                if batch.sees_offsets:
                    place = kept(place + picked(total, members))
                signs = jnp.stack([directions[batch.way][m] for m in batch.members])
                value, past = batch.switched(
                    batch.law(rows, signs, place), next(carried), state.begun, motion
                )
                parts.append(value)
                after.append(past)
            if groups:
                tables[name] = assembled(groups, parts, count)
                total = total + tables[name]

        groups, parts, frictions = self._groups("friction", settled), [], []
        for batch, before in zip(groups, state.friction, strict=True):
            value, past_friction = batch.friction(before, rows, ahead)
            parts.append(batch.acting(value, motion))
            frictions.append(past_friction)
        if groups:
            tables["friction"] = assembled(groups, parts, count)
        parted = {name: rows.T for name, rows in tables.items()}
        further = {name: parted.pop(name) for name in self._further}
        fields = dict.fromkeys(COMPENSATIONS) | parted
        offsets = Offsets(offset=total.T, **fields, further=further)
        return offsets, ControllerState(
            begun=jnp.ones((), dtype=bool),
            direction=state.direction,
            spread=spread,
            filtered=tuple(after),
            friction=tuple(frictions),
        )

    def _directions(
        self, state: DirectionState, motion: Motion
    ) -> tuple[Float[Array, "a t"], DirectionState]:
        if motion.direction is not None:
            return motion.direction.T, state
        by_actual = self.conventions.direction_source == "actual"
        source = actual(motion) if by_actual else motion.position
        direction, _, after = lax.map(lambda pair: directions(*pair), (state, source.T))
        return direction, after

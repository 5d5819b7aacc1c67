"""One compensation of several axes at once: what it adds, with switching and filters.

Axes whose tables have the same structure are worked on side by side: six axes then take
the time to compile of one.
"""

from collections.abc import Sequence
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ._controller_axis import AxisCompensations, Coupled
from ._controller_batch import columns, mapped, vectorised
from ._controller_filters import Filtered, filtered
from ._conventions import Conventions
from ._filter import step_response
from ._friction_compensation import FrictionCompensation, FrictionState
from ._motion import COMPENSATIONS, Motion, Rows, actual, actual_rates


@final
class Group:
    """Axes with the same kind of one compensation; lives only while it is traced.

    Attributes:
        name: Of the compensation.
        members: Numbers of the axes.
        axes: Their compensations.
        response: Step response of the filter.
    """

    def __init__(
        self,
        name: str,
        members: Sequence[int],
        axes: Sequence[AxisCompensations],
        rules: Conventions,
        settled: bool,
    ) -> None:
        self.name, self.members, self.axes = name, tuple(members), tuple(axes)
        cycles = self.axes[0].switch_cycles[name]
        self.response = (
            np.ones(1) if settled else step_response(cycles, rules.filter_delay)
        )
        self.rules, self.settled = rules, settled

    @property
    def memory(self) -> int:
        """How many cycles before the present one the filter needs."""
        return self.response.size - 1

    @property
    def _pairs(self) -> tuple[tuple[int, AxisCompensations], ...]:
        return tuple(zip(self.members, self.axes, strict=True))

    @property
    def way(self) -> str:
        """Compensation whose directions count: of the backlash, or of the leadscrew."""
        return "backlash" if self.name == "backlash" else "leadscrew"

    def start(self) -> Float[Array, "k m"]:
        """Return what the filter carries before the first cycle."""
        return jnp.zeros((len(self.members), self.memory))

    def start_friction(self) -> FrictionState:
        """Return what friction compensation carries before the first cycle."""
        states = [_friction(axis).start() for axis in self.axes]
        stacked: FrictionState = jax.tree.map(lambda *ls: jnp.stack(ls), *states)
        return stacked

    # -------------------------------------------------------------------- what is added

    @property
    def sees_offsets(self) -> bool:
        """Whether the law looks up the position with the offsets before it (S-23)."""
        alone = self.axes[0].leadscrew_alone or self.rules.leadscrew_input == "none"
        return self.name == "leadscrew" and not alone

    def law(
        self,
        rows: Rows,
        direction: Filtered,
        place: Filtered,
    ) -> Filtered:
        """Return the offsets of the law per cycle, unswitched and unfiltered.

        Args:
            rows: Motion of all axes.
            direction: Of these axes, with reversals spread.
            place: Positions of these axes that the law looks up.
        """
        if self.name not in COMPENSATIONS:
            pairs = [(m, axis.further[self.name]) for m, axis in self._pairs]
            return jnp.stack([c.law.offset(rows, (m, *c.masters)) for m, c in pairs])
        laws = [_law(getattr(axis, self.name)) for axis in self.axes]
        if self.name == "backlash":
            return _typed(mapped(lambda law, d: law.offset(d), laws, direction))
        if self.name == "temperature":
            sensors = rows.temperature.T
            return _typed(
                vectorised(lambda law, x: law.offset(x, sensors), laws, place)
            )
        if self.name == "leadscrew":
            share = 0.5 * (1.0 - direction)
            return _typed(
                mapped(lambda law, x, b: law.blended_offset(x, b), laws, place, share)
            )
        return self._coupled(rows, laws)

    def _coupled(self, rows: Rows, laws: Sequence[Any]) -> Filtered:
        """Return the offsets of a law that looks at other axes."""
        masters = np.array([getattr(axis, self.name).masters for axis in self.axes])
        place, speed, change = rows.position, rows.velocity, rows.acceleration
        if self.name == "cross":
            offset = vectorised(lambda law, m: law.offset(place[m[0]]), laws, masters)
        elif self.name == "plane":
            position = place
            if self.rules.plane_input == "actual":
                position = actual(rows)
            offset = vectorised(
                lambda law, m: law.offset(columns(position, m)), laws, masters
            )
        else:
            if self.rules.crosstalk_input == "actual":
                speed, change = actual_rates(rows)
            by_slave = self.rules.crosstalk_velocity == "slave"
            turning = np.array(self.members) if by_slave else masters[:, 0]
            offset = vectorised(
                lambda law, m, axis: law.offset(
                    change[m[0]], speed[axis], columns(place, m[1:])
                ),
                laws,
                masters,
                turning,
            )
        return _typed(offset)

    def friction(
        self, state: FrictionState, rows: Rows, ahead: Float[Array, "h a"]
    ) -> tuple[Filtered, FrictionState]:
        """Return the currents, and what friction compensation carries after."""
        members = np.array(self.members)
        laws = [_friction(axis) for axis in self.axes]
        if self.settled:
            current = mapped(
                lambda law, m: law.current(rows.velocity[m]), laws, members
            )
        else:
            share, turns, after = mapped(
                lambda law, m, s: law.shares(
                    s, rows.position[m], rows.velocity[m], ahead[:, m]
                ),
                laws,
                members,
                state,
            )
            # The look-up has no condition, other than what comes before it.
            level = vectorised(
                lambda law, m, t: law.law.level(jnp.abs(rows.velocity[m]), t.direction),
                laws,
                members,
                turns,
            )
            current, state = mapped(
                lambda law, *parts: law.delayed(*parts),
                laws,
                share,
                level,
                turns,
                after,
            )
        return _typed(current), state

    # --------------------------------------------------------- switching and filtering

    def acting(self, value: Filtered, motion: Motion) -> Filtered:
        """Return the values where it is active, else 0."""
        return _times(value, self._active(motion))

    def switched(
        self,
        value: Filtered,
        past: Float[Array, "k m"],
        begun: Bool[Array, ""],
        motion: Motion,
    ) -> tuple[Filtered, Float[Array, "k m"]]:
        """Return the offsets with their switching or filter, and what was filtered."""
        active = self._active(motion)
        if self._filters_values:
            return filtered(_times(value, active), past, begun, self.response)
        if isinstance(active, float | int):
            return _times(value, active), jnp.full_like(past, active)
        share, after = filtered(active, past, begun, self.response)
        return _times(value, share), after

    @property
    def _filters_values(self) -> bool:
        """Whether the filter acts on the offset instead of its switching."""
        if self.name in ("cross", "plane"):
            return self.rules.table_filter == "values"
        if self.name == "temperature":
            return self.rules.temperature_filter == "values"
        return self.name == "crosstalk"

    def _active(self, motion: Motion) -> Filtered | float:
        """Return where it acts: 1 or 0 per cycle, as one number if it never changes."""
        flags: list[Bool[Array, "k t"]] = []
        if motion.active is not None and self.name in COMPENSATIONS:
            number = COMPENSATIONS.index(self.name)
            flags.append(motion.active[:, np.array(self.members), number].T)
        elif self.name in self.axes[0].manual:
            return 0.0
        if motion.homed is not None:
            homed = motion.homed.T
            needed = [
                axis.needs_homed(self.name, member) for member, axis in self._pairs
            ]
            for masters in zip(*needed, strict=True):
                flags.append(homed[np.array(masters)])
        if not flags:
            return 1.0
        acts: Filtered = jnp.all(jnp.stack(flags), axis=0).astype(jnp.float64)
        return acts


def group(
    axes: Sequence[AxisCompensations],
    name: str,
    rules: Conventions,
    settled: bool = False,
) -> tuple[Group, ...]:
    """Return the axes that have a compensation, in groups of the same structure."""
    groups: dict[Any, list[int]] = {}
    for number, axis in enumerate(axes):
        compensation = axis.part(name)
        if compensation is None:
            continue
        law = _law(compensation)
        key = (
            jax.tree.structure(law),
            tuple(np.shape(leaf) for leaf in jax.tree.leaves(law)),
            len(compensation.masters) if isinstance(compensation, Coupled) else 0,
            axis.switch_cycles[name],
            name in axis.manual,
            name == "leadscrew" and axis.leadscrew_alone,
        )
        groups.setdefault(key, []).append(number)
    return tuple(
        Group(name, members, [axes[m] for m in members], rules, settled)
        for members in groups.values()
    )


def assembled(
    groups: tuple[Group, ...], parts: list[Filtered], count: int
) -> Float[Array, "a t"]:
    """Return the rows of all axes, zeros for those in no group."""
    if groups[0].members == tuple(range(count)):
        return parts[0]
    rows = [jnp.zeros_like(parts[0][0])] * count
    for batch, part in zip(groups, parts, strict=True):
        for member, row in zip(batch.members, part, strict=True):
            rows[member] = row
    return jnp.stack(rows)


def _law(compensation: Any) -> Any:
    """Return the law of a compensation, without the axes that it looks at."""
    return compensation.law if isinstance(compensation, Coupled) else compensation


def _typed(values: Any) -> Filtered:
    rows: Filtered = values
    return rows


def _times(value: Filtered, active: Filtered | float) -> Filtered:
    if isinstance(active, float):
        return value if active == 1.0 else jnp.zeros_like(value)
    # Mostly all of it acts. And what a condition gives is rounded: fused with the sum of
    # all offsets the product would not be, depending on the length of a piece.
    product: Filtered = lax.cond(
        jnp.all(active == 1.0), lambda value, _: value, jnp.multiply, value, active
    )
    return product


def _friction(axis: AxisCompensations) -> FrictionCompensation:
    assert axis.friction is not None
    return axis.friction

"""Friction compensation: ``frict_comp`` in a list ↔ `FrictionCompensation`."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Int

from ....data.lists import ListFile
from ....models import (
    AbstractFriction,
    FrictionCompensation,
    FrictionTable,
    Setpoints,
)
from ...exchange._capacity import ANY_LIST, ListTarget, refuse_huge
from ...exchange._identity import column, not_negative, optional, required
from ...exchange._machine_lists import InUse, Reading
from ...exchange._nodes import refuse_unordered
from ...exchange._units import (
    LIST_UNITS,
    SGN32,
    ExchangeError,
    ModelUnit,
    expect,
    round_to_list,
)
from ...exchange.controller._motion import Motion
from .._protocol import AbstractEntries, Axes
from . import KIND

PREFIX = KIND.prefix
VELOCITY_UNITS = 1000
"""µm/s per mm/s, or 0.001°/s per °/s."""
DEFAULT_COUNT = 19
"""Entries without ``max_points``: one manual asks for fewer than its 20 (S-33)."""
BY_SPEED = 3
"""The only mode that does anything: additive current by commanded velocity."""

_PER_MILLE = 1000
_FASTEST_ENTRY = 2**31 - 2
_MOST = {"position_delay": 10, "reversal_lookahead": 4, "delay_cycles": 248}


def _with_ends(
    table: AbstractFriction,
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Return velocities and currents of a table in list units, from 1 µm/s to a flat end."""
    if not isinstance(table, FrictionTable):
        raise ExchangeError(
            where=PREFIX,
            found=f"a {type(table).__name__}",
            expected="a friction table (sample_friction makes one of a law)",
        )
    expect(
        table.held_below and table.held_above,
        PREFIX,
        "a table that is not held at its ends",
        "one that is held: only the list can say what happens there",
    )
    knots = np.asarray(table.nodes.points)
    level = np.asarray(table.scaling) * np.asarray(table.values)
    name = f"{PREFIX}.table[].in"
    speeds = round_to_list(knots, name, (0, _FASTEST_ENTRY), VELOCITY_UNITS)
    refuse_unordered(speeds, name, "velocities 0.001 mm/s or more apart (110591)")
    bounds = SGN32[0] + 1, SGN32[1]
    currents = round_to_list(level, f"{PREFIX}.table[].out", bounds, 1)
    if speeds[0] != 1:
        # At rest there is no current: an entry for 0 stands for the slowest motion.
        slow = np.interp([1.0], knots * VELOCITY_UNITS, level)
        start = round_to_list(slow, f"{PREFIX}.table[].out", bounds, 1)
        keep = speeds > 1
        speeds = np.concatenate([[1], speeds[keep]])
        currents = np.concatenate([start, currents[keep]])
    end = int(speeds[-1]) + 1
    flat = len(speeds) > 1 and currents[-1] == currents[-2]
    if not flat:
        words = f"{end / VELOCITY_UNITS:.6g} mm/s"
        most = f"at most {_FASTEST_ENTRY / VELOCITY_UNITS:.10g}"
        expect(end <= _FASTEST_ENTRY, name, words, most)
        speeds = np.append(speeds, end)
        currents = np.append(currents, currents[-1])
    return speeds, currents


@final
class FrictionEntries(AbstractEntries):
    """``frict_comp`` ↔ `FrictionCompensation`."""

    kind = KIND
    models = (FrictionCompensation,)
    value = f"{PREFIX}.table[].out"
    units = ("list",)
    rules = (
        "first_builds_up",
        "restart_builds_up",
        "decays_to_zero",
        "weights_multiply",
        "delays_all",
        "held_at_rest",
    )
    coupled = False

    def is_in(self, listing: ListFile) -> bool:
        # Its mode may switch the table off.
        present = bool(listing.table(PREFIX, "out"))
        return present and optional(listing, f"{PREFIX}.mode") != 0

    def model(
        self, listing: ListFile, axis: int, reading: Reading
    ) -> FrictionCompensation:
        rules = reading.conventions
        mode = required(listing, f"{PREFIX}.mode")
        expect(mode == BY_SPEED, f"{listing.source}: {PREFIX}.mode", mode, "3")
        count = required(listing, f"{PREFIX}.table_entries")
        refuse_huge(count, f"{listing.source}: {PREFIX}.table_entries")
        knots = column(listing, PREFIX, "in", count)
        where = f"{listing.source}: {PREFIX}.table[].in"
        refuse_unordered(knots, where, "ascending velocities (110591)")
        expect(knots[0] >= 0, where, knots[0], "velocities from 0 on (110591)")
        scale = optional(listing, f"{PREFIX}.scaling_factor")
        delay, lookahead, cycles = (
            not_negative(listing, f"{PREFIX}.{name}") for name in _MOST
        )
        return FrictionCompensation(
            law=FrictionTable(
                nodes=Setpoints(knots / VELOCITY_UNITS),
                values=column(listing, PREFIX, "out", count).astype(float),
                scaling=scale / _PER_MILLE,
                held_below=rules.friction_below == "hold",
                held_above=rules.friction_above == "hold",
            ),
            reversal_lookahead=lookahead,
            position_delay=delay / LIST_UNITS,
            delay_cycles=cycles,
            sign=float(rules.friction_sign),
            first_builds_up=rules.friction_build_up != "reversal",
            restart_builds_up=rules.friction_build_up == "start",
            decays_to_zero=rules.friction_decay == "zero",
            weights_multiply=rules.friction_overlap == "product",
            delays_all=rules.friction_delay == "all",
            held_at_rest=rules.friction_rest == "hold",
        )

    def to_list(
        self,
        model: FrictionCompensation,
        masters: Axes = (),
        target: ListTarget = ANY_LIST,
    ) -> dict[str, int | str]:
        # Written so that open points cannot matter: the table begins at 1 µm/s and ends with
        # a flat segment, entries for which are added where they are missing; what they say
        # is what is held there anyway. ``scaling_factor`` is 1000, the knob of the
        # commissioning engineer; the scaling of the model goes into the entries.
        speeds, currents = _with_ends(model.law)
        count = len(speeds)
        entries = target.max_points_entry(PREFIX, count + 1, count <= DEFAULT_COUNT)
        delay = np.asarray(model.position_delay, float)
        delay = round_to_list(delay, f"{PREFIX}.position_delay", (0, 10))
        values = int(delay), model.reversal_lookahead, model.delay_cycles
        numbers = dict(zip(_MOST, values, strict=True))
        for name, number in numbers.items():
            limit = _MOST[name]
            expect(number <= limit, f"{PREFIX}.{name}", number, f"0 to {limit}")
        entries |= {
            f"{PREFIX}.mode": BY_SPEED,
            f"{PREFIX}.table_entries": count,
            **{f"{PREFIX}.{name}": number for name, number in numbers.items()},
            f"{PREFIX}.scaling_factor": _PER_MILLE,
        }
        pairs = zip(speeds.tolist(), currents.tolist(), strict=True)
        for k, (speed, current) in enumerate(pairs):
            entries[f"{PREFIX}.table[{k}].in"] = speed
            entries[f"{PREFIX}.table[{k}].out"] = current
        return entries

    def in_list_units(
        self, model: FrictionCompensation, unit: ModelUnit | None
    ) -> FrictionCompensation:
        # A current has no unit unless somebody says it.
        unit = unit or ModelUnit("no stated unit")
        if unit.name in self.units:
            return model
        if unit.size is not None and isinstance(model.law, FrictionTable):
            scaling = model.law.scaling / unit.size
            law = dataclasses.replace(model.law, scaling=scaling)
            return dataclasses.replace(model, law=law)
        expected = (
            "currents in units of the list (units={'friction': 'list'}), which are"
            " shares of the rated torque, or what one of them is:"
            f" ModelUnit({unit.name!r}, size=rated current · share)"
        )
        raise ExchangeError(self.value, f"values in {unit.name}", expected)

    def lacks(self, in_use: InUse, motion: Motion, reading: Reading) -> str | None:
        if motion.rates(in_use.axis)[0] is None:
            return motion.lacks(in_use.axis, "velocity")
        return None

    def looks_at(self, in_use: InUse, motion: Motion, reading: Reading) -> Axes:
        return () if motion.time is None else in_use.masters


ENTRIES = FrictionEntries()
friction_from_list, entries_of_friction = ENTRIES.from_list, ENTRIES.to_list

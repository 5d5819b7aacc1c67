"""All that acts on one axis, judged together: offsets, motion, and what switching does.

`judge_workspace` judges the sum over the whole travel by the lines of the gate, `judge_together`
what it leaves of the readings of a measurement. `check_switching` judges one compensation that is
switched on or off, `acts_against` compares the two sides of a gantry.
"""

import dataclasses
import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ...data.signals import wild_readings
from ...models import AbstractLookup
from ..exchange import LIST_UNITS, AxisLists, Motion, reversal_cycles
from ._dynamics import GateTable
from ._gate import (
    MOST_CYCLES as MOST_CYCLES,
    GateCheck,
    GateLimits,
    check_switching as check_switching,
    gate_check,
    judge,
    largest_step as largest_step,
    switching_cycles as switching_cycles,
)

Span = tuple[float, float]
Column = Float[np.ndarray, " t"]
"""A value per reading."""

_SURE = 3.0
"""Standard deviations of an rms figure of n readings, 1/√(2n) of it each, by which it may differ
from another that is the same."""
_TWISTED = 0.5
"""Share of what an axis is moved that its gantry partner may be moved otherwise without a word."""
_TURNED = 0.5
"""Norm of the sum of two tables, relative to that of their difference, below which they have
opposite signs."""
_SLACK = 1.1
"""Ratio of the errors with and without other tables up to which these add their noise only."""


@dataclasses.dataclass(frozen=True)
class Travel:
    """Where the axes of a machine go, and how warm they get.

    Attributes:
        names: Of the axes, by logical number.
        spans: By logical number in mm or °: software limits, else where it was measured.
        closed: Axes that motion never takes out of their span.
        warmth: States of all sensors in °C that the temperature laws reach; one empty
            state where nothing follows a sensor.
        unit: Of what is added, mm or °.
        cycle_time: In s.
    """

    names: Mapping[int, str]
    spans: Mapping[int, Span]
    closed: frozenset[int]
    warmth: tuple[Mapping[str, float], ...]
    unit: str
    cycle_time: float


def judge_workspace(
    loaded: AxisLists, travel: Travel, limits: GateLimits
) -> tuple[tuple[GateCheck, ...], dict[str, float]]:
    """Return the lines of the gate for the sum of all that acts on an axis.

    Beside them stands the largest offset of each compensation in mm or °.

    Compensations that look at different axes are judged apart and brought together: their
    largest offsets add up, their velocities as at right angles; of kinks and accelerations,
    which do not come at one moment, the largest counts. ``max_jump`` is the largest sum,
    which the axis moves by where everything comes or goes at once.

    Raises:
        ExchangeError: If a list makes no table.
    """
    parts = [_judged(loaded, travel, limits, part) for part in _parts(loaded)]
    low, high = (sum(part.bounds[k] for part in parts) for k in (0, 1))
    total = max(abs(low), abs(high))
    names = f"{' + '.join(loaded.used)} together"
    checks = []
    for name, top in _worst(c for part in parts for c in part.lines.values()).items():
        value, place = top.value, top.where
        if name == "max_correction":
            value, place = total, names
        elif name == "max_velocity":
            value = math.hypot(*(part.lines[name].value for part in parts))
        line = gate_check(f"axis {name}", value, top.limit, top.unit, place)
        checks.append(line)
    jump = limits.check("max_jump", total, travel.unit, f"{names}, at once")
    return (*checks, jump), {k: v for part in parts for k, v in part.jumps.items()}


@dataclasses.dataclass(frozen=True)
class _Part:
    """What compensations over the same axes add: bounds, each one's largest, and their gate."""

    bounds: tuple[float, float]
    jumps: Mapping[str, float]
    lines: Mapping[str, GateCheck]


def _worst(checks: Iterable[GateCheck]) -> dict[str, GateCheck]:
    """Return the line with the largest value of each name."""
    worst = dict[str, GateCheck]()
    for check in checks:
        if check.name not in worst or check.value > worst[check.name].value:
            worst[check.name] = check
    return worst


def _parts(loaded: AxisLists) -> list[tuple[tuple[int, ...], tuple[str, ...]]]:
    """Return which compensations look at the same axes, and at which."""
    parts: list[tuple[tuple[int, ...], tuple[str, ...]]] = []
    for name in loaded.used:
        if loaded.used[name].kind.unseen:
            continue  # 0 where no axis accelerates
        axes = loaded.inputs(name) or (loaded.axis,)
        names: tuple[str, ...] = (name,)
        for overlapping in [part for part in parts if set(part[0]) & set(axes)]:
            parts.remove(overlapping)
            axes = tuple(dict.fromkeys((*overlapping[0], *axes)))
            names = (*overlapping[1], *names)
        parts.append((axes, names))
    return parts


def _judged(
    loaded: AxisLists,
    travel: Travel,
    limits: GateLimits,
    part: tuple[tuple[int, ...], tuple[str, ...]],
) -> _Part:
    """Return the worst of each line over the states of the sensors."""
    axes, names = part
    nodes = [_nodes(loaded, travel, names, axis) for axis in axes]
    # `[j, i]`, as the gate takes a plane: master 1 runs fastest.
    grid = np.meshgrid(*reversed(nodes), indexing="ij")
    count = grid[0].size
    # Where the other axes stand does not matter here.
    every = {axis for name in loaded.used for axis in loaded.inputs(name)}
    places = {k: np.full(count, np.mean(travel.spans.get(k, 0.0))) for k in every}
    places |= {k: line.ravel() for k, line in zip(reversed(axes), grid, strict=True)}
    signs = (1, -1) if any(map(loaded.turns, names)) else (1,)
    # Every state of the sensors in both directions, in one run of the controller.
    states = list(itertools.product(travel.warmth, signs))
    motion = Motion(
        positions={axis: np.tile(line, len(states)) for axis, line in places.items()},
        directions={loaded.axis: np.repeat([sign for _, sign in states], count)},
        time=None,
        temperatures={
            sensor: np.repeat([warm[sensor] for warm, _ in states], count)
            for sensor in travel.warmth[0]
        },
    )
    added = loaded.parts(motion)
    total = np.sum([added[name] for name in names], axis=0)
    sizes = [len(coordinates) for coordinates in reversed(nodes)]
    tables = [
        GateTable(
            names=tuple(travel.names.get(axis, f"axis {axis}") for axis in axes),
            nodes=tuple(nodes),
            offset=list(branches),
            change=None,
            closed=tuple(axis in travel.closed for axis in axes),
            periodic=False,
            unit=travel.unit,
            cycles=reversal_cycles(loaded.machine),
            cycle_time=travel.cycle_time,
        )
        for branches in total.reshape(len(travel.warmth), len(signs), *sizes)
    ]
    return _Part(
        bounds=(min(0.0, float(total.min())), max(0.0, float(total.max()))),
        jumps={name: float(np.abs(added[name]).max()) for name in names},
        lines=_worst(check for table in tables for check in judge(table, limits)),
    )


def _nodes(
    loaded: AxisLists, travel: Travel, names: Sequence[str], axis: int
) -> Float[np.ndarray, " n"]:
    """Return the nodes of all tables over one axis, and the ends of its travel."""
    places = [np.asarray(travel.spans.get(axis, ()), dtype=float)]
    for name in names:
        model = loaded.models[name]
        if isinstance(model, AbstractLookup):
            places += [
                np.asarray(nodes.positions)
                for master, nodes in zip(loaded.inputs(name), model.ways, strict=True)
                if master == axis
            ]
    rows = np.unique(np.concatenate(places))
    if axis in travel.closed:
        low, high = travel.spans[axis]
        rows = rows[(rows >= low) & (rows <= high)]
    if len(rows) < 2:
        middle = float(rows[0]) if len(rows) else 0.0
        rows = np.array([middle, middle + 1.0])
    return rows


@dataclasses.dataclass(frozen=True)
class Together:
    """What is left of the error of one measurement, by what was fitted to it alone and by all.

    Attributes:
        measurement: Its name.
        fitted: Compensations that were fitted to it as one, or that of them which leaves less
            alone.
        before: rms of the error as measured, in mm or °.
        alone: rms with these alone.
        together: rms with all that will act on the axis.
        limit: Largest rms that passes.
    """

    measurement: str
    fitted: tuple[str, ...]
    before: float
    alone: float
    together: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether all together leave no more than the fit promises."""
        return self.together <= self.limit

    def check(self, unit: str) -> GateCheck:
        """Return the line of the gate."""
        place = f"rms of measurement {self.measurement}, all that acts together"
        return gate_check("axis error", self.together, self.limit, unit, place)


def added_beyond(
    after: AxisLists, before: AxisLists, active: Collection[str], motion: Motion
) -> dict[str, Column]:
    """Return what each compensation adds beyond what acted while measuring, mm or °.

    Args:
        after: What will act.
        before: The lists that the controller had while measuring.
        active: Compensations that were on then. What no list holds is taken to act on as
            it did.
        motion: Where the readings are.

    Raises:
        ExchangeError: If a list makes no table, or the motion lacks a position.
    """
    added = after.parts(motion)
    earlier = [name for name in active if name in before.used]
    if not earlier:
        return added
    for name, value in before.parts(motion).items():
        if name in earlier:
            added[name] = added[name] - value if name in added else -value
    return added


def judge_together(
    name: str,
    fitted: tuple[str, ...],
    error: Column,
    added: dict[str, Column],
    predicted: float,
    about_zero: bool,
) -> Together:
    """Return what is left of a measurement by what was fitted to it, and by all together.

    Args:
        name: Of the measurement.
        fitted: Compensations that were fitted to it as one: several of a group. All that acts
            is to leave no more than these, and than each of them.
        error: As measured, in mm or °.
        added: By compensation (`added_beyond`).
        predicted: rms on readings that the fit did not see; 0 where there are none.
        about_zero: The zero of the error is known; else it is judged about its middle.
    """

    def rms(values: Column) -> float:
        middle = 0.0 if about_zero else float(np.median(values[sound]))
        return float(np.sqrt(np.mean(np.square(values[sound] - middle))))

    def under(names: Iterable[str]) -> Column:
        own = [added[name] for name in names if name in added]
        return np.asarray(error + np.sum(own, axis=0))

    error_together = under(added)
    sound = ~wild_readings(under(fitted), least=1.0 / LIST_UNITS)
    promised = max(rms(under(fitted)), predicted)
    parts = {(name,): rms(under([name])) for name in fitted if len(fitted) > 1}
    promises = {fitted: promised} | parts
    least = min(promises, key=promises.__getitem__)
    tolerance = _SLACK + _SURE / np.sqrt(2.0 * max(sound.sum(), 1))
    return Together(
        measurement=name,
        fitted=least,
        before=rms(error),
        alone=rms(under(least)),
        together=rms(error_together),
        limit=float(promises[least] * tolerance) + 1.0 / LIST_UNITS,
    )


def acts_against(partner: AxisLists, axis: AxisLists, name: str) -> tuple[bool, float]:
    """Return whether a gantry partner has a compensation turned over, and what it twists by.

    At the nodes of the axis and in both directions: both together are then less than half
    of what lies between them. The twist is the largest difference in mm; 0 where it is less
    than half of what the axis is moved. What follows more than positions is not compared.

    Raises:
        ExchangeError: If a list makes no table.
    """
    model, axes = axis.models[name], axis.inputs(name) or (axis.axis,)
    nodes = [np.array([0.0, 1000.0])] * len(axes)
    if isinstance(model, AbstractLookup):
        nodes = [np.asarray(line.positions) for line in model.ways]
    grid = np.meshgrid(*nodes)
    direction = np.repeat([1, -1], grid[0].size)
    places = {k: np.tile(line.ravel(), 2) for k, line in zip(axes, grid, strict=True)}
    own = places.get(axis.axis, np.zeros(len(direction)))
    places |= dict.fromkeys((axis.axis, partner.axis), own)
    mine, theirs = (
        side.parts(Motion(places, {side.axis: direction}, time=None)).get(name)
        for side in (axis, partner)
    )
    if mine is None or theirs is None:
        return False, 0.0
    total, difference = mine + theirs, mine - theirs
    turned = np.linalg.norm(total) < _TURNED * np.linalg.norm(difference)
    twist = float(np.abs(difference).max())
    return bool(turned), twist if twist > _TWISTED * np.abs(mine).max() else 0.0

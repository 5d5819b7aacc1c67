"""Everything that a list may have done to an axis, and how likely each makes a change."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...exchange import InUse, Reading
from ..verify import (
    FAULT,
    AbstractChannel,
    Found,
    LogMotion,
    Rival,
    Target,
    said,
    search,
)
from ._measured import Difference

SUSPECTED = 2.0 * math.log(6.0)
"""Cost of a fault here: who measures again has a reason to."""

_MATTERS = 0.3
"""Share of the effect of a list that a shift must change to matter."""

_EXCLUDED = 2.0 * math.log(100.0)
"""Difference of criteria from which on a shift is excluded."""

_BAND = 0.1
"""Share by which the effect of a list may be off: machine and instrument drift."""

_MOST_SHIFTS = 160

_RIGHT = "right: the list adds what it says"

_WORDS = ("sign", "unit", "twice", "shift", "swapped")
"""Faults that measurements show; what a controller does beyond a table is none of them."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One explanation.

    Attributes:
        word: Of the interface.
        criterion: −2 log likelihood, with what it is less likely beforehand.
        sentence: What the list does then.
        value: Of the verdict: a factor, a shift in mm or °, or the number of an axis.
        sign: 1 where the list acts here with its sign, −1 with the opposite one, else 0.
    """

    word: str
    criterion: float
    sentence: str = ""
    value: float | None = None
    sign: int = 0

    @classmethod
    def of(cls, one: Rival, channel: AbstractChannel) -> "Case":
        """Return what a hypothesis is called: several faults at once are no explanation."""
        found, scale = one.hypothesis.faults(channel), one.hypothesis.scale
        words = [word for word in found if word in _WORDS]
        if not words:
            return cls("right", one.criterion, _RIGHT, 1.0, 1)
        if words[0] == "sign":  # whatever its size
            words = [word for word in words if word not in ("unit", "twice")]
        if one.hypothesis.is_free or len(words) > 1:
            return cls("cannot tell", one.criterion)
        text = said(one.hypothesis, channel, _WORDS)
        if words == ["swapped"]:
            return cls("wrong axis", one.criterion, text)
        value = found["shift"] if words == ["shift"] else scale
        return cls(words[0], one.criterion, text, value, 1 if scale > 0 else -1)


@dataclasses.dataclass(frozen=True)
class Scene:
    """What was measured, and how the lists are read.

    Attributes:
        changes: Between the measurements, by axis.
        switched: 1 where a compensation was switched on between them, −1 where off, by axis
            and name.
        reading: How lists are read.
        names: Of the axes.
    """

    changes: Mapping[int, Difference]
    switched: Mapping[tuple[int, str], int]
    reading: Reading
    names: Mapping[int, str]
    columns: dict[tuple[int, str], Float[np.ndarray, " g"]] = dataclasses.field(
        default_factory=dict
    )
    """What each compensation adds where it is right, by axis and name."""

    def name(self, axis: int) -> str:
        """Return the name of an axis."""
        return self.names.get(axis, f"A{axis}")

    def channel(self, use: InUse, axis: int) -> AbstractChannel:
        """Return a compensation at the places where an axis was measured."""
        change = self.changes[axis]
        motion = LogMotion(
            positions=change.positions,
            directions={} if change.direction is None else {use.axis: change.direction},
            time=None,
            source="the measurements",
            ranges=self.reading.modulo,
        )
        return use.kind.log_channel(use, motion, self.reading)

    def target(self, use: InUse, axis: int) -> Target:
        """Return the change of an axis as what a compensation may have added to it.

        The zero of the instrument and what other compensations of the axis did are free.
        """
        change, own = self.changes[axis], (use.axis, use.name)
        others = [v for k, v in self.columns.items() if k[0] == axis and k != own]
        free = np.column_stack([change.free, *others])
        values = self.switched[own] * change.change
        found = Target.of(values, free, weight=1.0 / change.variance)
        return dataclasses.replace(found, band=_BAND)


def cases_of(use: InUse, scene: Scene) -> tuple[Sequence[Case], float, float | None]:
    """Return every explanation of a change, and what else the fits say of it.

    That is the factor of the offset that fits best, and the largest shift in mm or ° that
    the readings cannot exclude and that would matter; None where there is none.
    """
    channel, target = scene.channel(use, use.axis), scene.target(use, use.axis)
    inner, power = target.products(channel.column(channel.plain)[None])
    if power[0] <= 1e-18 * len(target.values):
        return [Case("cannot tell", 0.0)], 1.0, None
    found = search(channel, target)
    cases = []
    for one in found.rivals:
        shift = one.hypothesis.change.shift
        # One that changes less than another factor may counts as none.
        if not any(shift) or _matters(channel, np.array([shift]), _BAND)[0]:
            cases.append(Case.of(one, channel))
    cases += _elsewhere(use, scene, found)
    return cases, float(inner[0] / power[0]), _blind(channel, target, found)


def _matters(
    channel: AbstractChannel, shifts: Float[np.ndarray, "s k"], share: float
) -> Bool[np.ndarray, " s"]:
    """Return which shifts change as much as a share of what a list adds, or more."""
    none, rows = np.zeros((1, shifts.shape[1])), np.arange(channel.motion.rows)
    moved = channel.columns_at(channel.plain, np.concatenate([none, shifts]), rows)
    effect = np.linalg.norm(moved[0] - moved[0].mean())
    apart = np.linalg.norm(moved[1:] - moved[0], axis=1)
    return np.asarray(apart >= share * effect)


def _blind(channel: AbstractChannel, target: Target, found: Found) -> float | None:
    """Return the largest shift that readings cannot exclude and that would matter."""
    none, shifts = np.zeros((1, len(channel.ways))), _shifts(channel)
    shifts = shifts[_matters(channel, shifts, _MATTERS)]
    tried = np.concatenate([none, shifts])
    part = target.at(found.rows)
    columns = channel.columns_at(channel.plain, tried, found.rows)
    left = np.array([part.left_by(column) for column in columns])
    misfit = part.criterion(left, found.samples)
    near = misfit[1:] < misfit[0] + _EXCLUDED
    return float(np.abs(shifts[near]).max()) if near.any() else None


def _shifts(channel: AbstractChannel) -> Float[np.ndarray, "s k"]:
    """Return every other place of the table that is worth telling from its own."""
    found = [np.zeros((0, len(channel.ways)))]
    for k, way in enumerate(channel.ways):
        length = way.high - way.low
        spacing = max(0.1 * way.step, length / _MOST_SHIFTS)
        count = int(0.5 * length / spacing)
        steps = np.array([*range(-count, 0), *range(1, count + 1)], dtype=float)
        shift = np.zeros((len(steps), len(channel.ways)))
        shift[:, k] = steps * spacing
        found.append(shift)
    return np.concatenate(found)


def _elsewhere(use: InUse, scene: Scene, found: Found) -> list[Case]:
    """Return the cases in which nothing is added here: on another axis, or nowhere."""
    cases: list[Case] = []
    own = scene.name(use.axis)
    for axis, change in scene.changes.items():
        if axis == use.axis or any(one not in change.positions for one in use.masters):
            continue
        channel = scene.channel(use, axis)
        if np.ptp(channel.column(channel.plain)) > 0.0:
            there = search(channel, scene.target(use, axis))
            gain = there.rivals[0].criterion + FAULT - there.nothing
            words = f"acts on {scene.name(axis)} instead of {own}"
            cases.append(Case("wrong axis", found.nothing + gain, words, float(axis)))
    if cases:
        # Not where it was measured: not active, or on an axis that nobody looked at.
        return [*cases, Case("cannot tell", found.nothing)]
    words = (
        f"does nothing to {own}: it acts on another axis, follows another master, or"
    )
    return [Case("wrong axis", found.nothing, f"{words} is not active")]

"""Everything that a list may have done to an axis, and how likely each makes a change."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ...exchange import InUse, Reading
from ..verify import (
    FAULT,
    AbstractChannel,
    Found,
    Hypothesis,
    LogMotion,
    Target,
    fault_words,
    reversal_words,
    search,
    worst_of,
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

_ALIKE = 0.7
"""Share of independent rows from which on what is left is noise."""

_CHANCE = 3.0
"""Deviations by which neighbours correlate before they are called alike."""

_WHOLLY = 0.5
"""Share of the effect of a list that may be left of one that is right as a whole."""

_MOST_SHIFTS = 160

_RIGHT = "right: the list adds what it says"

_UNLIKE = (
    "something else is added, which no single fault of this list explains; are its nodes in"
    " the right order, along each axis?"
)

_WORDS = ("sign", "unit", "twice", "shift", "swapped")
"""Faults that measurements show; what a controller does beyond a table is none of them."""


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """What is wrong with one compensation of one axis.

    Attributes:
        axis: Logical number.
        compensation: As in a job file.
        verdict: ``right``, ``sign``, ``unit``, ``shift``, ``wrong axis``, ``twice``,
            ``swapped`` (directions), ``other`` (than all of these) or ``cannot tell``.
        value: Factor of the offset; shift in mm or °; number of the other axis; None
            where there is none.
        probability: Of the verdict, given that one of them is true.
        sentence: For the person at the machine.
        sign: 1 where the list surely acts with the sign that it has, right or shifted,
            −1 where surely with the opposite one; 0 where neither is sure.
        near: The place where a list that is right as a whole is not, in words; empty: none.
    """

    axis: int
    compensation: str
    verdict: str
    value: float | None = None
    probability: float = 0.0
    sentence: str = ""
    sign: int = 0
    near: str = ""

    @property
    def is_right(self) -> bool:
        """Whether it is right at all places that were measured."""
        return self.verdict == "right" and not self.near

    def as_tree(self) -> dict[str, Any]:
        """Return it as result.json has it."""
        names = "verdict", "value", "probability", "sign", "sentence"
        return {name: getattr(self, name) for name in names}


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
            names=self.names,
        )
        return use.kind.log_channel(use, motion, self.reading)

    def with_free(
        self, axis: int, columns: Sequence[Float[np.ndarray, " g"]]
    ) -> "Scene":
        """Return what was measured, further columns free in the change of an axis."""
        change = self.changes[axis]
        free = np.column_stack([change.free, *columns])
        changes = {**self.changes, axis: dataclasses.replace(change, free=free)}
        return dataclasses.replace(self, changes=changes)

    def target(self, use: InUse, axis: int) -> Target:
        """Return the change of an axis as what a compensation may have added to it.

        The zero of the instrument and what other compensations of the axis did are free.
        """
        change, key = self.changes[axis], (use.axis, use.name)
        columns = [v for k, v in self.columns.items() if k[0] == axis and k != key]
        nuisance = np.column_stack([change.free, *columns])
        values = self.switched[key] * change.change
        target = Target.of(values, nuisance, weight=1.0 / change.variance)
        return dataclasses.replace(target, band=_BAND)


Case = tuple[float, Diagnosis]
"""−2 log likelihood of an explanation, with what it is less likely beforehand."""


def cases_of(
    use: InUse, scene: Scene, *, blurred: bool
) -> tuple[list[Case], float, float | None]:
    """Return every explanation of a change, and what else the fits say of it.

    That is the factor of the offset that fits best, NaN where these places show none, and
    the largest shift in mm or ° that the readings cannot exclude and that would matter; None
    where there is none. Blurred is what looks like a fault by what another list adds.
    """
    channel, target = scene.channel(use, use.axis), scene.target(use, use.axis)
    factor, _, power = target.fitted(channel.column(channel.plain)[None])
    if not power[0]:
        return [(0.0, Diagnosis(use.axis, use.name, "cannot tell"))], math.nan, None
    search_result = search(channel, target)
    best, cases = search_result.rivals[0], []
    unlike = "" if blurred else _unlike(search_result)
    for rival in search_result.rivals:
        change = rival.hypothesis.change
        shift = change.shift
        # One that changes less than another factor may counts as none.
        if any(shift) and not _matters(channel, np.array([shift]), _BAND)[0]:
            continue
        # What adds no more than may drift between measurements adds nothing.
        if rival.hypothesis.is_free and abs(rival.hypothesis.scale) <= _BAND:
            continue
        if change.turned and rival is not best and not _turn_matters(channel):
            continue
        named = _named(rival.hypothesis, channel)
        # What the best one leaves between the directions, others that turn them leave, too.
        alike = rival is best or named.verdict in {"right", "swapped"}
        if unlike and alike:
            named = Diagnosis(use.axis, use.name, "other", sentence=unlike)
        elif rival is best and named.verdict == "right":
            rows = scene.changes[use.axis].readings
            named = _as_a_whole(named, search_result, rows)
        cases.append((rival.criterion, named))
    cases += _elsewhere(use, scene, search_result)
    return cases, float(factor[0]), _blind(target, search_result)


def _unlike(search_result: Found) -> str:
    """Return what the best explanation leaves that is no noise, in words; empty: nothing."""
    channel = search_result.channel
    if not channel.ways:
        return ""
    rows = search_result.rows
    listed, added = channel.column(channel.plain)[rows], search_result.column[rows]
    # Of a table applied elsewhere little may act where it was measured.
    scale = abs(search_result.best.scale) or 1.0  # where nothing was added at all
    size = min(float(np.std(listed)), float(np.std(added)) / scale)
    named = _named(search_result.best, channel).verdict
    if named in {"right", "swapped"}:
        share = _BAND if channel.two_way else _MATTERS
        if reversal := reversal_words(search_result, share * size):
            return f"something else is added: {reversal}"
    # Neighbours are alike, and more than chance makes them.
    chance = 1.0 / (1.0 + 2.0 * _CHANCE / math.sqrt(len(rows)))
    alike = search_result.samples < min(_ALIKE, chance) * len(rows)
    much = (_WHOLLY if named == "right" else _MATTERS) * size
    return _UNLIKE if alike and float(np.std(search_result.residual)) > much else ""


def _as_a_whole(
    right: Diagnosis, search_result: Found, readings: Float[np.ndarray, " g"]
) -> Diagnosis:
    """Return a diagnosis that says where a list is right as a whole only.

    `readings` are how many each row is the mean of.
    """
    size = float(np.sqrt(np.mean(search_result.column[search_result.rows] ** 2)))
    judged = search_result.channel.motion.judged
    worst = worst_of(search_result, readings[judged])
    if not worst.beyond(_MATTERS * size):
        return right
    text = (
        f"right as a whole, but {1e3 * worst.left:.2g} µm are left near {worst.where}, as if"
        " an entry there were another"
    )
    return dataclasses.replace(right, sentence=text, near=worst.where)


def _named(hypothesis: Hypothesis, channel: AbstractChannel) -> Diagnosis:
    """Return what a hypothesis is called: several faults at once are no explanation."""
    faults, identity = hypothesis.faults(channel), (channel.axis, channel.compensation)
    words = [word for word in faults if word in _WORDS]
    sign = 1 if hypothesis.scale > 0 else -1
    if not words:
        return Diagnosis(*identity, "right", 1.0, sentence=_RIGHT, sign=1)
    if words[0] == "sign":  # whatever its size and directions
        lesser = ("unit", "twice", *(["swapped"] if hypothesis.change.turned else []))
        words = [word for word in words if word not in lesser]
    if hypothesis.is_free or len(words) > 1:
        return Diagnosis(*identity, "cannot tell")
    text = fault_words(hypothesis, channel, _WORDS)
    if words == ["swapped"]:
        if hypothesis.change.turned:
            return Diagnosis(*identity, "swapped", sentence=text, sign=sign)
        return Diagnosis(*identity, "wrong axis", sentence=text)
    value = faults["shift"] if words == ["shift"] else hypothesis.scale
    return Diagnosis(*identity, words[0], value, sentence=text, sign=sign)


def _matters(
    channel: AbstractChannel, shifts: Float[np.ndarray, "s k"], share: float
) -> Bool[np.ndarray, " s"]:
    """Return which shifts change as much as a share of what a list adds, or more."""
    places = np.concatenate([np.zeros((1, shifts.shape[1])), shifts])
    rows = np.arange(channel.motion.rows)
    columns = channel.columns_at(channel.plain, places, rows)
    effect = np.linalg.norm(columns[0] - columns[0].mean())
    distance = np.linalg.norm(columns[1:] - columns[0], axis=1)
    return np.asarray(distance >= share * effect)


def _turn_matters(channel: AbstractChannel) -> bool:
    """Return whether swapped directions change enough that readings should exclude it."""
    plain = channel.column(channel.plain)
    turned = channel.column(dataclasses.replace(channel.plain, turned=True))
    effect = np.linalg.norm(plain - plain.mean())
    return bool(np.linalg.norm(turned - plain) >= _MATTERS * effect)


def _blind(target: Target, search_result: Found) -> float | None:
    """Return the largest shift that readings cannot exclude and that would matter."""
    channel = search_result.channel
    shifts = _shifts(channel)
    shifts = shifts[_matters(channel, shifts, _MATTERS)]
    places = np.concatenate([np.zeros((1, len(channel.ways))), shifts])
    part = target.at(search_result.rows)
    columns = channel.columns_at(channel.plain, places, search_result.rows)
    misfit = part.criterion(part.residual_squares(columns), search_result.samples)
    undistinguished = shifts[misfit[1:] < misfit[0] + _EXCLUDED]
    return float(np.abs(undistinguished).max()) if len(undistinguished) else None


def _shifts(channel: AbstractChannel) -> Float[np.ndarray, "s k"]:
    """Return every other place of the table that is worth telling from its own."""
    shifts = [np.zeros((0, len(channel.ways)))]
    for k, master in enumerate(channel.ways):
        length = master.high - master.low
        spacing = max(0.1 * master.step, length / _MOST_SHIFTS)
        count = int(0.5 * length / spacing)
        steps = np.array([*range(-count, 0), *range(1, count + 1)], dtype=float)
        shift = np.zeros((len(steps), len(channel.ways)))
        shift[:, k] = steps * spacing
        shifts.append(shift)
    return np.concatenate(shifts)


def _elsewhere(use: InUse, scene: Scene, search_result: Found) -> list[Case]:
    """Return the cases in which nothing is added here: on another axis, or nowhere."""
    cases: list[Case] = []
    identity, axis_name = (use.axis, use.name), scene.name(use.axis)
    for axis, change in scene.changes.items():
        if axis == use.axis or not change.positions.keys() >= {*use.masters}:
            continue
        channel = scene.channel(use, axis)
        if np.ptp(channel.column(channel.plain)) > 0.0:
            fitted = search(channel, scene.target(use, axis))
            # There it adds what it says; a factor that fits finds something anywhere.
            plain = Hypothesis(channel.plain)
            listed = (one for one in fitted.rivals if one.hypothesis == plain)
            found = next(listed, None)
            if found is None:
                continue
            gain = found.criterion + FAULT - fitted.nothing
            words = f"acts on {scene.name(axis)} instead of {axis_name}"
            diagnosis = Diagnosis(*identity, "wrong axis", float(axis), sentence=words)
            cases.append((search_result.nothing + gain, diagnosis))
    if cases:
        # Not where it was measured: not active, or on an axis that nobody looked at.
        return [*cases, (search_result.nothing, Diagnosis(*identity, "cannot tell"))]
    words = (
        f"does nothing to {axis_name}: it acts on another axis, follows another master, or is"
        " not active"
    )
    return [(search_result.nothing, Diagnosis(*identity, "wrong axis", sentence=words))]

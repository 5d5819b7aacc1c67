"""Everything that a list may have done to an axis, and how likely each makes a change."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ...exchange import InUse, Reading
from ..verify import FLOOR, AbstractChannel, Hypothesis, LogMotion, Target
from ._measured import Difference

_SCALES = {
    1.0: ("right", 0.5),
    -1.0: ("sign", 0.08),
    10.0: ("unit", 0.04),
    0.1: ("unit", 0.04),
    1000.0: ("unit", 0.002),
    2.0: ("twice", 0.08),
    -10.0: ("sign", 0.002),
    -0.1: ("sign", 0.002),
    -2.0: ("sign", 0.002),
}
"""Factor of the offset: its word, and how likely it is beforehand."""

_SHIFTED, _ELSEWHERE, _UNKNOWN = 0.08, 0.08, 0.02

_MATTERS = 0.3
"""Share of the effect of a list that a shift must change to matter."""

_EXCLUDED = float(np.log(100.0))
"""Difference of log likelihoods from which on a shift is excluded."""

_LARGEST = 20.0
"""Factor of the offset up to which anything is thought possible."""

_MOST_SHIFTS = 160


_FREEDOM = 6.0
"""Degrees of freedom of the noise: Student's t, so that wild readings count little."""

_BAND = 0.1
"""Share by which the effect of a list may be off: machine and instrument drift."""

_STEPS = 25
_SETTLED = 1e-5
"""Change of the noise, as a share of it, at which the likelihood has settled."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One explanation.

    Attributes:
        word: Of the interface.
        likelihood: Its logarithm.
        prior: Probability beforehand.
        applied: How the list acts on its axis; None where it does not, or nobody can say.
        axis: Number of the axis on which it acts instead.
    """

    word: str
    likelihood: float
    prior: float
    applied: Hypothesis | None = None
    axis: int | None = None

    @property
    def follows_another(self) -> bool:
        """Whether another master is followed."""
        return self.applied is not None and self.applied.change.masters is not None

    @property
    def value(self) -> float | None:
        """Of the verdict: a factor, a shift in mm or °, or the number of an axis."""
        if self.applied is None or self.follows_another:
            return None if self.axis is None else float(self.axis)
        change = self.applied.change
        return max(change.shift, key=abs) if change.is_shifted else self.applied.scale

    @property
    def sign(self) -> int:
        """1 where the list acts here with its sign, −1 with the opposite one, else 0."""
        if self.applied is None or self.follows_another:
            return 0
        return 1 if self.applied.scale > 0 else -1


@dataclasses.dataclass(frozen=True)
class Scene:
    """What was measured, and how the lists are read.

    Attributes:
        changes: Between the measurements, by axis.
        switched: 1 where a compensation was switched on between them, −1 where off, by axis
            and name.
        reading: How lists are read.
    """

    changes: Mapping[int, Difference]
    switched: Mapping[tuple[int, str], int]
    reading: Reading
    columns: dict[tuple[int, str], Float[np.ndarray, " g"]] = dataclasses.field(
        default_factory=dict
    )
    """What each compensation adds where it is right, by axis and name."""

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

    def column(self, use: InUse, axis: int) -> Float[np.ndarray, " g"]:
        """Return what a compensation adds at these places."""
        channel = self.channel(use, axis)
        return channel.column(channel.plain)

    def weigh(
        self,
        use: InUse,
        axis: int,
        columns: Float[np.ndarray, "h g"],
        scales: Float[np.ndarray, " h"],
    ) -> "_Weighed":
        """Return how likely columns make the change of an axis, at the places measured.

        The zero of the instrument, what other compensations of the axis did, and within a
        tenth of it the factor are fitted: the same for every column, so that none gains by
        it. Noise is Student's t, its scale that of each column; what is free is fitted with
        the weights that it gives about the column that explains most.

        Args:
            use: The compensation.
            axis: Where it is looked for.
            columns: What the list adds under each hypothesis, in mm or °.
            scales: Factor of it; NaN: whatever fits.
        """
        change, own = self.changes[axis], (use.axis, use.name)
        others = [v for k, v in self.columns.items() if k[0] == axis and k != own]
        free = np.column_stack([change.free, *others])
        values = self.switched[own] * change.change
        low, high = scales - _BAND * np.abs(scales), scales + _BAND * np.abs(scales)
        weight = 1.0 / change.variance
        noise = likelihood = factor = power = np.zeros(len(scales))
        for step in range(_STEPS):
            target = Target.of(values, free, weight=weight)
            inner, power = target.products(columns)
            power = np.maximum(power, 1e-30)
            fitted = inner / power
            factor = np.where(np.isnan(scales), fitted, np.clip(fitted, low, high))
            rest = target.residual(factor[:, None] * columns)
            squares, before = np.square(rest) / change.variance, noise
            if step == 0:
                noise = np.maximum(np.sqrt(np.median(squares, axis=1)), FLOOR)
            # The scale of Student's t that makes these squares most likely.
            for _ in range(2):
                mean = np.mean(_shares(squares, noise) * squares, axis=1)
                noise = np.maximum(np.sqrt(mean), FLOOR)
            logs = np.log1p(squares / (_FREEDOM * noise[:, None] ** 2)).sum(axis=1)
            likelihood = -len(values) * np.log(noise) - 0.5 * (_FREEDOM + 1.0) * logs
            if np.max(np.abs(noise - before) / noise) < _SETTLED:
                break
            weight = _shares(squares, noise)[np.argmax(likelihood)] / change.variance
        return _Weighed(likelihood, factor, noise / np.sqrt(power))


def _shares(
    squares: Float[np.ndarray, "h g"], noise: Float[np.ndarray, " h"]
) -> Float[np.ndarray, "h g"]:
    return np.asarray((_FREEDOM + 1.0) / (_FREEDOM + squares / noise[:, None] ** 2))


@dataclasses.dataclass(frozen=True)
class _Weighed:
    """How well hypotheses explain a change.

    Attributes:
        likelihood: Logarithm, per hypothesis.
        factor: Of the column, as fitted.
        deviation: Standard deviation of that factor.
    """

    likelihood: Float[np.ndarray, " h"]
    factor: Float[np.ndarray, " h"]
    deviation: Float[np.ndarray, " h"]


def cases_of(use: InUse, scene: Scene) -> tuple[Sequence[Case], float, float | None]:
    """Return every explanation of a change, and what else the fits say of it.

    That is the factor of the offset that fits best, and the largest shift in mm or ° that
    the readings cannot exclude and that would matter; None where there is none.
    """
    channel = scene.channel(use, use.axis)
    change, shifts = channel.plain, _shifts(channel)
    rows = np.arange(len(scene.changes[use.axis].change))
    moved = channel.columns_at(change, shifts, rows)
    plain = moved[0]
    # A shift that changes less than the band of every factor counts as none.
    apart = np.linalg.norm(moved - plain, axis=1)
    effect = np.linalg.norm(plain - plain.mean())
    seen = 1 + np.flatnonzero(apart[1:] >= _BAND * effect)
    swaps = [dataclasses.replace(change, masters=one) for one in channel.swaps]
    scales = [*_SCALES, 0.0, np.nan]
    columns = [plain] * len(scales) + [*moved[seen], *map(channel.column, swaps)]
    factors = np.ones(len(columns))
    factors[: len(scales)] = scales
    weighed = scene.weigh(use, use.axis, np.stack(columns), factors)
    ends = np.cumsum([len(scales), len(seen)])
    likely, tried, swapped = np.split(weighed.likelihood, ends)
    cases = [
        Case(word, float(likely[k]), prior, Hypothesis(change, scale=scale))
        for k, (scale, (word, prior)) in enumerate(_SCALES.items())
    ]
    blind: float | None = None
    if len(seen):
        near = (apart[seen] >= _MATTERS * effect) & (tried > likely[0] - _EXCLUDED)
        if near.any():
            blind = float(np.abs(shifts[seen[near]]).max())
        best = tuple(shifts[seen[np.argmax(tried)]].tolist())
        further = Hypothesis(dataclasses.replace(change, shift=best))
        together = float(np.logaddexp.reduce(tried) - np.log(len(seen)))
        cases.append(Case("shift", together, _SHIFTED, further))
    prior = 0.5 * _ELSEWHERE / max(len(swaps), 1)
    cases += [
        Case("wrong axis", likelihood, prior, Hypothesis(other))
        for other, likelihood in zip(swaps, swapped.tolist(), strict=True)
    ]
    nothing, anything = likely[-2:].tolist()
    cases += _elsewhere(use, scene, nothing)
    # Any factor at all, up to `_LARGEST`: the share of that range that fits.
    at = len(scales) - 1
    factor, width = float(weighed.factor[at]), float(weighed.deviation[at])
    range_cost = min(0.0, float(np.log(2.5 * width / (2.0 * _LARGEST))))
    cases.append(Case("cannot tell", anything + range_cost, _UNKNOWN))
    return cases, factor, blind


def _shifts(channel: AbstractChannel) -> Float[np.ndarray, "s k"]:
    """Return the place of the table, and every other one that is worth telling from it."""
    found = [np.zeros((1, len(channel.ways)))]
    for k, way in enumerate(channel.ways):
        length = way.high - way.low
        spacing = max(0.1 * way.step, length / _MOST_SHIFTS)
        count = int(0.5 * length / spacing)
        steps = np.array([*range(-count, 0), *range(1, count + 1)], dtype=float)
        shift = np.zeros((len(steps), len(channel.ways)))
        shift[:, k] = steps * spacing
        found.append(shift)
    return np.concatenate(found)


def _elsewhere(use: InUse, scene: Scene, nothing: float) -> list[Case]:
    """Return the cases in which nothing is added here: on another axis, or nowhere."""
    found: dict[int, float] = {}
    for axis, change in scene.changes.items():
        if axis == use.axis or any(one not in change.positions for one in use.masters):
            continue
        column = scene.column(use, axis)
        if np.ptp(column) > 0.0:
            both = np.stack([column, column]), np.array([1.0, 0.0])
            there, absent = scene.weigh(use, axis, *both).likelihood
            found[axis] = nothing + float(there - absent)
    if not found:
        return [Case("wrong axis", nothing, _ELSEWHERE)]
    share = _ELSEWHERE / len(found)
    named = [Case("wrong axis", one, share, axis=axis) for axis, one in found.items()]
    # Not where it was measured: not active, or on an axis that nobody looked at.
    return [*named, Case("cannot tell", nothing, _ELSEWHERE)]

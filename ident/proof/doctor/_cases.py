"""Everything that a list may have done to an axis, and how likely each makes a change."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ...exchange import InUse, Reading
from ..verify import AbstractChannel, Hypothesis, LogMotion
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

_FLOOR = 1e-5
"""mm: noise that is taken for granted."""

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

    def fits(
        self,
        use: InUse,
        axis: int,
        columns: list[np.ndarray],
        scales: Sequence[float],
    ) -> "_Fitted":
        """Return how well columns explain the change of an axis.

        What other compensations of the axis did is not known either.
        """
        change, own = self.changes[axis], (use.axis, use.name)
        others = [v for k, v in self.columns.items() if k[0] == axis and k != own]
        return _fit_changes(
            self.switched[own] * change.change,
            np.stack(columns),
            np.array(scales),
            np.column_stack([change.free, *others]),
            change.variance,
        )


def cases_of(use: InUse, scene: Scene) -> tuple[Sequence[Case], float, float | None]:
    """Return every explanation of a change, and what else the fits say of it.

    That is the factor of the offset that fits best, and the largest shift in mm or ° that
    the readings cannot exclude and that would matter; None where there is none.
    """
    channel = scene.channel(use, use.axis)
    change, plain = channel.plain, channel.column(channel.plain)
    scales = [*_SCALES, 0.0, np.nan]
    scaled = scene.fits(use, use.axis, [plain] * len(scales), scales)
    likely = scaled.likelihood.tolist()
    cases = [
        Case(word, likely[k], prior, Hypothesis(change, scale=scale))
        for k, (scale, (word, prior)) in enumerate(_SCALES.items())
    ]
    blind: float | None = None
    shifts = _shifts(channel)
    moved = np.zeros((0, len(plain)))
    if len(shifts):
        moved = channel.columns_at(change, shifts, np.arange(len(plain)))
    # A shift that changes less than the band of every factor counts as none.
    apart = np.linalg.norm(moved - plain, axis=1)
    effect = np.linalg.norm(plain - plain.mean())
    seen = apart >= _BAND * effect
    if seen.any():
        many, shifts = int(seen.sum()), shifts[seen]
        tried = scene.fits(use, use.axis, list(moved[seen]), [1.0] * many).likelihood
        matters = apart[seen] >= _MATTERS * effect
        kept = matters & (tried > likely[0] - _EXCLUDED)
        if kept.any():
            blind = float(np.abs(shifts[kept]).max())
        best = tuple(shifts[int(np.argmax(tried))].tolist())
        further = Hypothesis(dataclasses.replace(change, shift=best))
        together = float(np.logaddexp.reduce(tried) - np.log(many))
        cases.append(Case("shift", together, _SHIFTED, further))
    for swap in channel.swaps:
        other = dataclasses.replace(change, masters=swap)
        left = scene.fits(use, use.axis, [channel.column(other)], [1.0]).likelihood
        prior = 0.5 * _ELSEWHERE / len(channel.swaps)
        cases.append(Case("wrong axis", float(left[0]), prior, Hypothesis(other)))
    cases += _elsewhere(use, scene, likely[-2])
    # Any factor at all, up to `_LARGEST`: the share of that range that fits.
    factor, width = float(scaled.factor[-1]), float(scaled.deviation[-1])
    range_cost = min(0.0, float(np.log(2.5 * width / (2.0 * _LARGEST))))
    cases.append(Case("cannot tell", likely[-1] + range_cost, _UNKNOWN))
    return cases, factor, blind


def _shifts(channel: AbstractChannel) -> Float[np.ndarray, "s k"]:
    """Return every other place of the table that is worth telling from its own."""
    found: list[Float[np.ndarray, "s k"]] = [np.zeros((0, len(channel.ways)))]
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
    found: list[Case] = []
    for axis, change in scene.changes.items():
        if axis == use.axis or any(one not in change.positions for one in use.masters):
            continue
        column = scene.column(use, axis)
        if np.ptp(column) == 0.0:
            continue
        there, absent = scene.fits(use, axis, [column] * 2, [1.0, 0.0]).likelihood
        likely = nothing + float(there - absent)
        found.append(Case("wrong axis", likely, 0.0, axis=axis))
    if not found:
        return [Case("wrong axis", nothing, _ELSEWHERE)]
    share = _ELSEWHERE / len(found)
    found = [dataclasses.replace(one, prior=share) for one in found]
    # Not where it was measured: not active, or on an axis that nobody looked at.
    return [*found, Case("cannot tell", nothing, _ELSEWHERE)]


@dataclasses.dataclass(frozen=True)
class _Fitted:
    """How well hypotheses explain a change.

    Attributes:
        likelihood: Logarithm, per hypothesis.
        factor: Of the column, as fitted.
        deviation: Standard deviation of that factor.
    """

    likelihood: Float[np.ndarray, " h"]
    factor: Float[np.ndarray, " h"]
    deviation: Float[np.ndarray, " h"]


def _fit_changes(
    change: Float[np.ndarray, " g"],
    columns: Float[np.ndarray, "h g"],
    scales: Float[np.ndarray, " h"],
    free: Float[np.ndarray, "g f"],
    variance: Float[np.ndarray, " g"],
) -> "_Fitted":
    """Return how likely a change is under each hypothesis.

    Zero, noise and, within a tenth of it, the factor are fitted: the same for every
    hypothesis, so that none gains by it.

    Args:
        change: Error after − before, in mm or °.
        columns: What the list adds under each hypothesis, in mm or °.
        scales: Factor of it; NaN: whatever fits.
        free: Columns that may be in the change in any case.
        variance: Of each change, relative to that of one reading.
    """
    # Free columns of a like size keep the equations solvable.
    free = free / np.sqrt(np.mean(np.square(free), axis=0))
    weight = np.broadcast_to(1.0 / variance, columns.shape)
    low, high = scales - _BAND * np.abs(scales), scales + _BAND * np.abs(scales)
    noise = np.zeros(len(columns))
    factor, power = np.zeros(len(columns)), np.zeros(len(columns))
    squares = np.zeros(columns.shape)
    for step in range(_STEPS):
        clear = columns - _explained(columns, free, weight)
        power = np.sum(weight * clear * clear, axis=1)
        best = np.sum(weight * clear * change, axis=1) / np.maximum(power, 1e-30)
        factor = np.where(np.isnan(scales), best, np.clip(best, low, high))
        rest = change - factor[:, None] * columns
        rest = rest - _explained(rest, free, weight)
        squares = np.square(rest) / variance
        if step == 0:
            noise = np.maximum(np.sqrt(np.median(squares, axis=1)), _FLOOR)
        before = noise
        # The scale of Student's t that makes these squares most likely.
        for _ in range(2):
            mean = np.mean(_shares(squares, noise) * squares, axis=1)
            noise = np.maximum(np.sqrt(mean), _FLOOR)
        weight = _shares(squares, noise) / variance
        if np.max(np.abs(noise / before - 1.0)) < _SETTLED:
            break
    logs = np.log1p(squares / (_FREEDOM * noise[:, None] ** 2)).sum(axis=1)
    likelihood = -len(change) * np.log(noise) - 0.5 * (_FREEDOM + 1.0) * logs
    return _Fitted(likelihood, factor, noise / np.sqrt(np.maximum(power, 1e-30)))


def _shares(
    squares: Float[np.ndarray, "h g"], noise: Float[np.ndarray, " h"]
) -> Float[np.ndarray, "h g"]:
    return np.asarray((_FREEDOM + 1.0) / (_FREEDOM + squares / noise[:, None] ** 2))


def _explained(
    values: Float[np.ndarray, "h g"],
    free: Float[np.ndarray, "g f"],
    weight: Float[np.ndarray, "h g"],
) -> Float[np.ndarray, "h g"]:
    """Return what of each row of values the free columns explain."""
    weighted = weight[:, :, None] * free
    normal = free.T @ weighted
    normal += (
        1e-12
        * np.trace(normal, axis1=1, axis2=2)[:, None, None]
        * np.eye(free.shape[1])
    )
    right = np.einsum("hgf,hg->hf", weighted, values)
    found = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    return np.asarray(found @ free.T)

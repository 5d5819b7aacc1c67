"""Everything that a list may have done to an axis, and how likely each makes a change."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ....models import Conventions
from ...exchange import Increments, InUse, Motion, Ranges
from ..verify import AbstractChannel, LogMotion, channel_of
from ._likelihood import BAND, Fitted, fit_changes, mean_likelihood
from ._measured import Difference

_SCALES = {
    1.0: ("right", 0.5),
    -1.0: ("sign", 0.08),
    10.0: ("unit", 0.04),
    0.1: ("unit", 0.04),
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


@dataclasses.dataclass(frozen=True)
class Case:
    """One explanation.

    Attributes:
        word: Of the interface.
        value: Of the verdict.
        likelihood: Its logarithm.
        prior: Probability beforehand.
        note: ``master`` where another master is followed, ``axis`` where it acts on
            another axis, ``nowhere`` where it acts on none that was measured.
        sign: 1 where the list acts here with its sign, −1 with the opposite one, 0 where
            it does neither.
    """

    word: str
    value: float | None
    likelihood: float
    prior: float
    note: str = ""
    sign: int = 0


@dataclasses.dataclass(frozen=True)
class Explained:
    """What may have made a change.

    Attributes:
        cases: Every explanation.
        factor: Factor of the offset that fits best.
        blind: Shift in mm or ° that the readings cannot exclude and that would matter;
            None where there is none.
    """

    cases: Sequence[Case]
    factor: float
    blind: float | None


@dataclasses.dataclass(frozen=True)
class Setting:
    """How lists are read."""

    conventions: Conventions
    increment: Increments
    ranges: Ranges

    def channel(self, use: InUse, change: Difference) -> AbstractChannel:
        path = Motion(
            positions=change.positions,
            directions={} if change.direction is None else {use.axis: change.direction},
            time=None,
            source="the measurements",
        )
        motion = LogMotion(path, ranges=self.ranges)
        return channel_of(use, motion, self.conventions, self.increment)

    def column(self, use: InUse, change: Difference) -> Float[np.ndarray, " g"]:
        channel = self.channel(use, change)
        return channel.column(channel.plain)


def cases_of(
    use: InUse,
    switched: int,
    changes: Mapping[int, Difference],
    columns: Mapping[tuple[int, str], Float[np.ndarray, " g"]],
    setting: Setting,
) -> Explained:
    """Return every explanation of a change, and what else the fits say of it.

    Args:
        use: The compensation.
        switched: 1 where it was switched on between the measurements, −1 where off.
        changes: By axis.
        columns: What each compensation adds where it is right, by axis and name.
        setting: How lists are read.
    """
    here = changes[use.axis]
    channel = setting.channel(use, here)
    # What other compensations of the axis did is not known either.
    others = [
        column
        for key, column in columns.items()
        if key[0] == use.axis and key[1] != use.name
    ]
    free = np.column_stack([here.free, *others])
    change = switched * here.change

    def fits(columns: Sequence[np.ndarray], scales: Sequence[float]) -> Fitted:
        return fit_changes(
            change, np.stack(columns), np.array(scales), free, here.variance
        )

    plain = channel.column(channel.plain)
    scales = [*_SCALES, 0.0, np.nan]
    scaled = fits([plain] * len(scales), scales)
    cases = [
        Case(
            word, scale, float(scaled.likelihood[k]), prior, sign=1 if scale > 0 else -1
        )
        for k, (scale, (word, prior)) in enumerate(_SCALES.items())
    ]
    blind: float | None = None
    shifts = _shifts(channel)
    if len(shifts):
        sizes = shifts[np.arange(len(shifts)), np.argmax(np.abs(shifts), axis=1)]
        moved = channel.columns_at(channel.plain, shifts, np.arange(len(change)))
        # A shift that changes less than the band of every factor counts as none.
        apart = np.linalg.norm(moved - plain, axis=1)
        seen = apart >= BAND * np.linalg.norm(plain - plain.mean())
        if seen.any():
            tried = fits(list(moved[seen]), [1.0] * int(seen.sum())).likelihood
            value = float(sizes[seen][int(np.argmax(tried))])
            matters = apart[seen] >= _MATTERS * np.linalg.norm(plain - plain.mean())
            kept = matters & (tried > float(scaled.likelihood[0]) - _EXCLUDED)
            if kept.any():
                blind = float(np.abs(sizes[seen][kept]).max())
            cases.append(Case("shift", value, mean_likelihood(tried), _SHIFTED, sign=1))
    for swap in channel.swaps:
        column = channel.column(dataclasses.replace(channel.plain, masters=swap))
        prior = 0.5 * _ELSEWHERE / len(channel.swaps)
        other = float(fits([column], [1.0]).likelihood[0])
        cases.append(Case("wrong axis", None, other, prior, "master"))
    nothing = float(scaled.likelihood[-2])
    cases += _elsewhere(use, switched, changes, columns, setting, nothing)
    # Any factor at all, up to `_LARGEST`: the share of that range that fits.
    factor, width = float(scaled.factor[-1]), float(scaled.deviation[-1])
    range_cost = min(0.0, float(np.log(2.5 * width / (2.0 * _LARGEST))))
    free_case = float(scaled.likelihood[-1]) + range_cost
    cases.append(Case("cannot tell", None, free_case, _UNKNOWN))
    return Explained(cases, factor, blind)


def _shifts(channel: AbstractChannel) -> Float[np.ndarray, "s k"]:
    """Return every other place of the table that is worth telling from its own."""
    found: list[Float[np.ndarray, "s k"]] = [np.zeros((0, len(channel.ways)))]
    for k, way in enumerate(channel.ways):
        length = way.high - way.low
        spacing = max(0.1 * way.step, 2.0 * 0.5 * length / _MOST_SHIFTS)
        count = int(0.5 * length / spacing)
        steps = np.array([*range(-count, 0), *range(1, count + 1)], dtype=float)
        shift = np.zeros((len(steps), len(channel.ways)))
        shift[:, k] = steps * spacing
        found.append(shift)
    return np.concatenate(found)


def _elsewhere(
    use: InUse,
    switched: int,
    changes: Mapping[int, Difference],
    columns: Mapping[tuple[int, str], Float[np.ndarray, " g"]],
    setting: Setting,
    nothing: float,
) -> list[Case]:
    """Return the cases in which nothing is added here: on another axis, or nowhere."""
    found: list[Case] = []
    for axis, change in changes.items():
        if axis == use.axis or any(one not in change.positions for one in use.masters):
            continue
        own = [column for key, column in columns.items() if key[0] == axis]
        free = np.column_stack([change.free, *own])
        column = setting.column(use, change)
        if np.ptp(column) == 0.0:
            continue
        there, absent = fit_changes(
            switched * change.change,
            np.stack([column, column]),
            np.array([1.0, 0.0]),
            free,
            change.variance,
        ).likelihood.tolist()
        found.append(
            Case("wrong axis", float(axis), nothing + there - absent, 0.0, "axis")
        )
    if not found:
        return [Case("wrong axis", None, nothing, _ELSEWHERE, "nowhere")]
    share = _ELSEWHERE / len(found)
    found = [dataclasses.replace(one, prior=share) for one in found]
    # Not where it was measured: not active, or on an axis that nobody looked at.
    return [*found, Case("cannot tell", None, nothing, _ELSEWHERE, "nowhere")]

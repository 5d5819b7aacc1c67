"""Sign of a current against the motion, and saturation of a current."""

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float, Int

from ._errors import check_lengths
from ._noise import long_run_deviations, resolution
from ._order import median, quantile

_SURE = 4.0
"""Standard deviations from which on the sign is told."""
_LEAST_POWER = 1e-9
"""Share of a column that the others do not have, below which it is not told from them."""
_SAME = 1e-13
"""Such a share that is nothing but rounding."""
_RARE = 0.02
"""Share of the readings at either end that are not common."""
_AROUND = 5
"""Readings whose median tells a spike from a step."""
_OUTWEIGHS = 5.0
"""Current of friction over that of inertia from which on its sign alone is believed."""


@dataclasses.dataclass(frozen=True)
class Polarity:
    """Whether a current supports the motion or opposes it.

    Attributes:
        sign: +1 supports (drives), −1 opposes, None cannot tell.
        confidence: Probability of the sign, 0.5 … 1, for normal noise.
        friction: Mean difference of current between the directions, halved, in the unit
            of the current.
        inertia: Current per mm/s² or °/s²; 0 where no acceleration was given.
        statement: In words.
    """

    sign: int | None
    confidence: float
    friction: float
    inertia: float
    statement: str


@dataclasses.dataclass(frozen=True)
class Saturation:
    """Samples at which a current is held by a limit.

    Attributes:
        rows: True at those.
        lower: Level of the lower limit, or None where it is not reached.
        upper: Level of the upper limit, or None.
        statement: In words.
    """

    rows: Bool[np.ndarray, " t"]
    lower: float | None
    upper: float | None
    statement: str

    @property
    def share(self) -> float:
        """Share of the samples that are held."""
        return float(np.mean(self.rows))


def find_polarity(
    current: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"],
    acceleration: Float[np.ndarray, " t"] | None = None,
    *,
    correlated: int = 200,
) -> Polarity:
    r"""Return the sign of a current against the motion.

    Friction takes up current in the direction of motion: of $i = c\,\mathrm{sign}(v) +
    J a + o$ both $c$ and $J$ have the sign that is looked for. The offset $o$ (gravity)
    is told from $c$ only where both directions are recorded.

    Args:
        current: In any unit.
        direction: ±1, or 0 where it is not certain: such samples are left out.
        acceleration: In mm/s² or °/s².
        correlated: Samples over which the remainder may be correlated.

    Raises:
        SignalError: If the lengths differ.
    """
    sizes = [current.size, direction.size]
    sizes += [] if acceleration is None else [acceleration.size]
    check_lengths("sign of the current", *sizes, least=1)
    use = direction != 0
    side = direction[use].astype(np.float64)
    if side.size < 20:
        return _unknown("the axis hardly moves")
    names, columns = ["offset"], [np.ones(side.size)]
    if side.min() < side.max():
        names.append("friction")
        columns.append(side)
    rate = None if acceleration is None else acceleration[use]
    if rate is not None and rate.min() < rate.max():
        names.append("inertia")
        columns.append(rate)
    if len(columns) == 1:
        return _unknown("only one direction is recorded, and no acceleration")
    values, scores = _regress(np.stack(columns), current[use], correlated)
    estimates = dict(zip(names, values.tolist(), strict=True))
    ratio = dict(zip(names, scores.tolist(), strict=True))
    friction, inertia = estimates.get("friction", 0.0), estimates.get("inertia", 0.0)
    certain = [n for n in names[1:] if abs(ratio[n]) >= _SURE]
    signs = {int(np.sign(estimates[name])) for name in certain}
    best = max(names[1:], key=lambda name: abs(ratio[name]))
    confidence = 0.5 * (1.0 + math.erf(abs(ratio[best]) / 2.0**0.5))
    if len(signs) == 2:
        # Friction that builds up behind reversals, or comes late, takes from the current
        # where the acceleration is largest: that looks like a small negative inertia.
        assert rate is not None
        pushed = abs(inertia) * float(np.sqrt(np.mean(rate**2)))
        if abs(friction) >= _OUTWEIGHS * pushed:
            certain = ["friction"]
            signs = {int(np.sign(friction))}
    if len(signs) == 2:
        reason = "friction and inertia contradict each other"
        return _unknown(reason, friction, inertia)
    if not signs:
        reason = f"its {best} is {abs(ratio[best]):.1f} standard deviations from 0"
        return _unknown(reason, friction, inertia, confidence)
    sign = signs.pop()
    word = "supports the motion" if sign > 0 else "opposes the motion"
    evidence = " and ".join(certain)
    statement = f"the current {word}, by its {evidence}"
    return Polarity(sign, confidence, friction, inertia, statement)


def _unknown(
    reason: str, friction: float = 0.0, inertia: float = 0.0, confidence: float = 0.5
) -> Polarity:
    words = f"the sign of the current cannot be told: {reason}"
    return Polarity(None, confidence, friction, inertia, words)


def _regress(
    columns: Float[np.ndarray, "k t"], target: Float[np.ndarray, " t"], lag: int
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return coefficients, and each over its deviation for a correlated remainder.

    Columns that cannot be told apart share what they explain, and their ratios are 0.
    """
    scale = np.sqrt(np.einsum("kt,kt->k", columns, columns))
    unit = columns / scale[:, None]
    spread, axes = np.linalg.eigh(unit @ unit.T)
    significant = spread > _SAME
    inverse = axes[:, significant] / spread[significant] @ axes[:, significant].T
    fit = inverse @ (unit @ target)
    # Once more for what rounding leaves, which the inverse of squares has doubled.
    fit += inverse @ (unit @ (target - fit @ unit))
    residual = target - fit @ unit
    # Of each column what the others do not have; its power is what tells of it.
    power = 1.0 / (axes**2 @ (1.0 / np.maximum(spread, _SAME)))
    unique = (inverse @ unit) * power[:, None]
    deviation = long_run_deviations(unique * residual, lag) / power
    # A remainder of nothing but rounding must not give an infinite ratio.
    floor = 1e-12 * float(np.linalg.norm(target)) + 1e-300
    determined = power >= _LEAST_POWER
    return fit / scale, np.where(determined, fit / np.maximum(deviation, floor), 0.0)


def find_saturation(
    current: Float[np.ndarray, " t"], *, limit: float | None = None, shortest: int = 5
) -> Saturation:
    """Return where a current is held by a limit.

    Without a known limit a level counts as one where the record stays at its own
    extreme for some samples at a stretch while it is restless elsewhere: noise ends at
    a limit.

    Args:
        current: In any unit.
        limit: Of its amount, where it is known.
        shortest: Samples at a stretch.
    """
    check_lengths("saturation", current.size, least=1)
    if limit is not None:
        rows = np.abs(current) >= limit * (1.0 - 1e-3)
        upper = limit if (current[rows] > 0).any() else None
        lower = -limit if (current[rows] < 0).any() else None
        return Saturation(rows, lower, upper, _say(rows, lower, upper))
    rows = np.zeros(current.size, dtype=bool)
    levels: list[float | None] = []
    for sign in (-1.0, 1.0):
        held = _held(sign * current, shortest)
        rows |= held
        levels.append(median(current[held]) if held.any() else None)
    return Saturation(rows, levels[0], levels[1], _say(rows, levels[0], levels[1]))


def without_spikes(
    current: Float[np.ndarray, " t"],
) -> tuple[Float[np.ndarray, " t"], int]:
    """Return a current whose spikes are drawn from their neighbours, and how many there were.

    A spike is a reading or two in a row far beyond all that is common in the recording and
    as far from the median of five: a filter would smear it over its neighbours.
    """
    if current.size < _AROUND:
        return current, 0
    low, high = (quantile(current, share) for share in (_RARE, 1.0 - _RARE))
    common = high - low
    beyond = (current > high + common) | (current < low - common)
    if common == 0.0 or not beyond.any():
        return current, 0
    rows = np.flatnonzero(beyond)
    around = np.clip(
        rows[:, None] + np.arange(_AROUND) - _AROUND // 2, 0, current.size - 1
    )
    rows = rows[np.abs(current[rows] - np.median(current[around], axis=1)) > common]
    sound = np.ones(current.size, dtype=bool)
    sound[rows] = False
    place = np.arange(current.size)
    return np.interp(place, place[sound], current[sound]), int(rows.size)


def _held(values: Float[np.ndarray, " t"], shortest: int) -> Bool[np.ndarray, " t"]:
    """Return the samples that stay at the largest value while others do not stay.

    A signal comes to a limit with a kink, by several steps of its display; the crest of
    a slow wave is left by one.
    """
    top = float(values.max())
    span = top - float(values.min())
    nothing = np.zeros(values.size, dtype=bool)
    if values.size < 4 * shortest or span == 0.0:
        return nothing
    at_top = values >= top - 1e-6 * span
    if np.count_nonzero(at_top) < shortest:
        return nothing
    edges = np.diff(np.concatenate([[0], at_top.astype(np.int8), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    long = stops - starts >= shortest
    held = nothing.copy()
    for start, stop in zip(starts[long], stops[long], strict=True):
        held[start:stop] = True
    if not held.any():
        return nothing
    before, after = starts[long] - 1, stops[long]
    ends = np.concatenate([before[before >= 0], after[after < values.size]])
    kink = median(top - values[ends]) if ends.size else 0.0
    if kink <= 2.5 * resolution(values):
        return nothing
    # Elsewhere the signal must move from sample to sample, by more than its display
    # does: a drive at constant speed without noise stays at a level without a limit.
    steps = np.abs(np.diff(values))
    outside = ~(held[1:] | held[:-1])
    restless = median(steps[outside]) if outside.any() else 0.0
    quiet = median(steps[held[1:] & held[:-1]])
    return held if restless > 3.0 * quiet and restless > 0.0 else nothing


def _say(rows: Bool[np.ndarray, " t"], lower: float | None, upper: float | None) -> str:
    if not rows.any():
        return "the current does not reach a limit"
    levels = " and ".join(
        f"{level:.4g}" for level in (lower, upper) if level is not None
    )
    share = 100.0 * float(np.mean(rows))
    return f"the current is held at {levels} in {share:.2g} % of the samples"

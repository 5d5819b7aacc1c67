"""What a recording of position and current can tell about friction, and what not."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from ._clock import Clock
from ._current import Polarity, Saturation, find_polarity, find_saturation
from ._errors import check_lengths
from ._motion import Motion
from ._order import quantile

Kind = Literal[
    "no motion",
    "one direction",
    "no slow samples",
    "current keeps its sign",
    "current opposes the motion",
    "sign of the current unknown",
    "saturated",
    "held at a limit",
    "clock jumps",
]
"""What can be wrong with a recording."""

_SLOW = 0.02
"""Share of the fastest speed below which a sample is slow, where no speed is given."""
_RAMPS = 0.003
"""Share of the samples that are slow in any recording, on the ramps between speeds."""
_FEW = 20
"""Fewer samples than that count as none."""
_HELD = 0.2
"""Share of the motion with the current at its limit from which on no law can be told: what
is left are the samples with the least friction, not a fair choice of them."""
_SURE = 5.0
"""Standard deviations of the velocity from which on its sign is certain."""
_RINGING = 0.2
"""Share of acceleration over circular bandwidth that a filter overshoots by, at most.

Of the Butterworth filter at a sudden stop; 0.08 at the end of a ramp, splines 0.08."""
_DROP = ("breakaway", "stribeck_velocity", "stribeck_shape")
_LAW = ("coulomb", "viscous", *_DROP)


@dataclasses.dataclass(frozen=True)
class Finding:
    """One shortcoming of a recording.

    Attributes:
        kind: Which.
        sentence: For the report, with figures.
        undetermined: Parameters that cannot be told because of it.
    """

    kind: Kind
    sentence: str
    undetermined: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Examination:
    """A recording, looked over before a friction fit.

    Attributes:
        clock: Of the times.
        polarity: Sign of the current against the motion.
        saturation: Of the current.
        usable: Rows that tell of kinetic friction: settled, with a certain direction, the
            current not held by a limit.
        findings: Shortcomings, worst first.
    """

    clock: Clock
    polarity: Polarity
    saturation: Saturation
    usable: Bool[np.ndarray, " t"]
    findings: tuple[Finding, ...]

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that the recording cannot tell, each once."""
        names = (name for finding in self.findings for name in finding.undetermined)
        return tuple(dict.fromkeys(names))


def examine(
    motion: Motion,
    current: Float[np.ndarray, " t"],
    *,
    limit: float | None = None,
    slow: float | None = None,
    unit: str = "mm",
) -> Examination:
    """Return what a recording can and cannot tell about the friction of an axis.

    Args:
        motion: Derived from its positions.
        current: In any unit.
        limit: Amount at which the drive limits it, where it is known.
        slow: Speed in mm/s or °/s below which the drop of the Stribeck law shows; 2 % of
            the fastest where left out.
        unit: Of the positions, for the sentences.

    Raises:
        SignalError: If the lengths differ.
    """
    check_lengths("recording", motion.time.size, current.size, least=8)
    clock, direction = motion.clock, _direction(motion)
    saturation = find_saturation(current, limit=limit)
    certain = np.where(motion.settled & ~saturation.rows, direction, 0)
    usable: Bool[np.ndarray, " t"] = certain != 0
    polarity = find_polarity(current, certain, motion.acceleration)
    moving = motion.settled & (direction != 0)
    held = _held_at_limit(saturation, moving)
    findings = [
        # With the current held all the time no sample is certain, though the axis moves.
        *(held or _directions(certain)),
        *_slow_samples(motion, usable, slow, unit),
        *_sign(current[usable], certain, polarity),
        *([] if held else _limits(saturation, motion, usable)),
    ]
    if clock.jumps:
        findings.append(Finding("clock jumps", f"The clock has {clock.statement}."))
    return Examination(clock, polarity, saturation, usable, tuple(findings))


def _direction(motion: Motion) -> Int[np.ndarray, " t"]:
    """Return +1 or −1 where the sign of the velocity is certain, else 0.

    Certain is what exceeds the noise of the velocity and what the filter may show behind a
    change of acceleration, where nothing moves.
    """
    from scipy.ndimage import maximum_filter1d

    window = 1 + 2 * max(1, round(2.0 / motion.bandwidth / motion.step))
    strongest = maximum_filter1d(np.abs(motion.acceleration), window, mode="nearest")
    ringing = _RINGING * strongest / (2.0 * np.pi * motion.bandwidth)
    slowest = _SURE * motion.velocity_noise + ringing
    certain = motion.settled & (np.abs(motion.velocity) > slowest)
    return np.where(certain, np.sign(motion.velocity), 0.0).astype(np.int64)


def _directions(certain: Int[np.ndarray, " t"]) -> list[Finding]:
    counts = {sign: np.count_nonzero(certain == sign) for sign in (1, -1)}
    if max(counts.values()) < _FEW:
        sentence = (
            "The axis does not move, or not faster than the noise of its positions."
        )
        return [Finding("no motion", sentence, ("inertia", "offset", *_LAW))]
    words = {1: "positive", -1: "negative"}
    for sign, word in words.items():
        if counts[-sign] < _FEW:
            sentence = (
                f"Only motion in {word} direction is recorded: the offset cannot be told"
                f" from the Coulomb friction, and nothing of the {words[-sign]} direction."
            )
            missing = tuple(f"{name}_{words[-sign]}" for name in _LAW)
            return [Finding("one direction", sentence, ("offset", *missing))]
    return []


def _slow_samples(
    motion: Motion, usable: Bool[np.ndarray, " t"], slow: float | None, unit: str
) -> list[Finding]:
    moving = np.abs(motion.velocity[usable])
    if moving.size < _FEW:
        return []
    fastest = quantile(moving, 0.99)
    bound = _SLOW * fastest if slow is None else slow
    if quantile(moving, _RAMPS) <= bound:
        return []
    slowest = quantile(moving, 0.01)
    sentence = (
        f"Hardly a sample lies below {bound:.3g} {unit}/s (the slowest hundredth begins at"
        f" {slowest:.3g} {unit}/s): how friction rises towards rest is not measured."
    )
    return [Finding("no slow samples", sentence, _DROP)]


def _sign(
    driven: Float[np.ndarray, " u"], certain: Int[np.ndarray, " t"], polarity: Polarity
) -> list[Finding]:
    """Return what is wrong with the sign of the current of the usable samples."""
    findings = []
    if not driven.size:
        return []
    low, high = quantile(driven, 0.001), quantile(driven, 0.999)
    both = bool((certain > 0).any() and (certain < 0).any())
    if both and low * high > 0.0:
        has_sign = polarity.sign is not None and polarity.friction != 0.0
        reason = (
            "a constant load is larger than the friction"
            if has_sign
            else "its amount was recorded, or a constant load hides the friction"
        )
        sentence = (
            f"The current keeps its sign ({low:.3g} to {high:.3g}) in both directions:"
            f" {reason}."
        )
        unknown = () if has_sign else ("offset", *_LAW)
        findings.append(Finding("current keeps its sign", sentence, unknown))
    if polarity.sign is None:
        sentence = f"{polarity.statement[0].upper()}{polarity.statement[1:]}."
        findings.append(Finding("sign of the current unknown", sentence))
    elif polarity.sign < 0:
        sentence = (
            "The current opposes the motion: it is recorded with the sign of a feedback"
            " and has to be turned round."
        )
        findings.append(Finding("current opposes the motion", sentence))
    return findings


def _held_at_limit(
    saturation: Saturation, moving: Bool[np.ndarray, " t"]
) -> list[Finding]:
    held, driven = (saturation.rows & moving).sum(), moving.sum()
    share = float(held / driven) if driven else 0.0
    if share <= _HELD:
        return []
    sentence = (
        f"The current is held at its limit in {share:.0%} of the motion"
        f" ({saturation.statement}): what the rest shows is not what friction takes."
        " Record at a lower acceleration or with a higher limit."
    )
    return [Finding("held at a limit", sentence, ("inertia", "offset", *_LAW))]


def _limits(
    saturation: Saturation, motion: Motion, usable: Bool[np.ndarray, " t"]
) -> list[Finding]:
    if not saturation.rows.any():
        return []
    unknown: tuple[str, ...] = ()
    size = np.abs(motion.acceleration)
    if size.max() > 0.0:
        strong = (
            size > 0.5 * quantile(size[motion.settled], 0.99)
            if (motion.settled.any())
            else size > 0.0
        )
        if np.count_nonzero(strong & usable) < _FEW:
            unknown = ("inertia",)
    sentence = f"{saturation.statement[0].upper()}{saturation.statement[1:]}"
    sentence += ": these are left out."
    return [Finding("saturated", sentence, unknown)]

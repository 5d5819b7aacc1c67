"""Averages over stretches of constant speed: the manual's way of measuring friction, with σ."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._errors import FitError
from ._covariance import score_covariance
from ._samples import DriveSamples, check_samples, saturated

_STEADY = 0.02
"""Scatter of the velocity within a plateau, as a share of its speed."""
_SHORTEST = 10
"""Samples that a plateau needs."""
_FAR = 5.0
"""Residuals further off than this many robust scales do not enter an average."""


@dataclasses.dataclass(frozen=True)
class Plateaus:
    """Stretches of constant speed: what the drive needed there.

    Attributes:
        velocity: Mean in mm/s, signed.
        current: Mean in drive units.
        standard_deviation: Of that mean, neighbouring samples resembling each other (HAC).
        count: Samples in each.
    """

    velocity: Float[np.ndarray, " p"]
    current: Float[np.ndarray, " p"]
    standard_deviation: Float[np.ndarray, " p"]
    count: Int[np.ndarray, " p"]


def average_plateaus(samples: DriveSamples, plateau: Int[np.ndarray, " t"]) -> Plateaus:
    """Return the average of each plateau.

    Args:
        samples: The recording.
        plateau: Index ≥ 0 of the plateau that a sample belongs to, −1 for none.

    Raises:
        FitError: If there is no plateau.
    """
    check_samples(samples)
    if len(plateau) != len(samples.time):
        msg = f"plateaus: found {len(plateau)} samples, expected {len(samples.time)}."
        raise FitError(msg)
    usable = samples.in_motion & ~saturated(samples.current) & (plateau >= 0)
    rows = []
    for number in np.unique(plateau[usable]):
        at = usable & (plateau == number)
        if at.sum() < _SHORTEST:
            continue
        rows.append(_average(samples, at))
    if not rows:
        msg = (
            f"found no stretch of constant speed with {_SHORTEST} samples, expected some "
            "in each direction."
        )
        raise FitError(msg)
    velocity, current, spread, count = zip(*rows, strict=True)
    return Plateaus(
        np.asarray(velocity), np.asarray(current), np.asarray(spread), np.asarray(count)
    )


def _average(
    samples: DriveSamples, at: Bool[np.ndarray, " t"]
) -> tuple[float, float, float, int]:
    current = samples.current[at]
    off = np.abs(current - np.median(current))
    keep = off <= _FAR * max(1.4826 * float(np.median(off)), 1e-12 * np.ptp(current))
    if not keep.any():
        keep = np.ones(len(current), bool)
    mean = float(current[keep].mean())
    left = np.where(keep, current - mean, 0.0)[:, None]
    total, lag = score_covariance(left, samples.piece[at])
    count = int(keep.sum())
    plain = float((left**2).sum())
    # A lag of L samples leaves about n / L independent ones to judge the scatter by.
    free = max(count / (lag + 1) - 1, 1.0) * (lag + 1)
    variance = max(float(total[0, 0]), plain) / count / free
    return float(samples.velocity[at].mean()), mean, float(np.sqrt(variance)), count


def find_plateaus(samples: DriveSamples) -> Int[np.ndarray, " t"]:
    """Return the plateau of each sample, −1 where the speed changes.

    A plateau is a stretch whose velocity stays within 2 % of its own median; for recordings
    that name their plateaus, this is not needed.
    """
    result = np.full(len(samples.time), -1)
    moving = samples.in_motion
    piece = samples.piece
    number, start = 0, 0
    count = len(result)
    while start < count:
        if not moving[start]:
            start += 1
            continue
        first = samples.velocity[start]
        near = np.abs(samples.velocity[start:] - first) <= _STEADY * np.abs(first)
        near &= piece[start:] == piece[start]
        length = int(np.argmin(near)) if not near.all() else len(near)
        if length >= _SHORTEST:
            result[start : start + length] = number
            number += 1
        start += max(length, 1)
    return result

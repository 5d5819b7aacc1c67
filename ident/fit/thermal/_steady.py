"""Which readings to believe before any fit: missed sensors, steady stretches."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

from ...core._errors import FitError

_ABSOLUTE_ZERO = -273.15
_WINDOW = 7
"""Readings over which a temperature is compared with its neighbours."""
_GLITCH = 8.0
"""Distance from the neighbours, in typical distances, that no structure can follow."""
_LEAST = 1.0
"""Distance in K that is no glitch in any case."""


def missed_temperatures(
    temperature: Float[np.ndarray, " t"],
) -> Bool[np.ndarray, " t"]:
    """Return which readings of a sensor are none: not finite, impossible, or lone jumps.

    Args:
        temperature: In °C, in order of time.
    """
    missed = ~np.isfinite(temperature) | (temperature < _ABSOLUTE_ZERO)
    values = temperature[~missed]
    if len(values) >= _WINDOW:
        away = np.abs(values - median_filter(values, _WINDOW, mode="nearest"))
        typical = 1.4826 * float(np.median(away))
        missed[~missed] = away > max(_GLITCH * typical, _LEAST)
    return np.asarray(missed)


def steady(
    time: Float[np.ndarray, " t"],
    value: Float[np.ndarray, " t"],
    within: float,
    level: float | None = None,
) -> Bool[np.ndarray, " t"]:
    """Return the readings of the longest plateau of a signal: heating done, load constant.

    Args:
        time: In s, ascending.
        value: Of the signal that is to be steady (a heater, a spindle), NaN = missed.
        within: Largest distance from the level.
        level: Of the plateau; None = the most frequent one.

    Raises:
        FitError: If there is none.
    """
    known = np.isfinite(value)
    if level is None and known.any():
        ordered = np.sort(value[known])
        # The densest half: a plateau is where the signal spends its time.
        half = max(len(ordered) // 2, 1)
        width = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
        first = int(np.argmin(width))
        level = float(np.median(ordered[first : first + half]))
    inside = known & (np.abs(value - (0.0 if level is None else level)) <= within)
    # A lone reading outside does not end a plateau.
    bridged = inside.copy()
    bridged[1:-1] |= ~inside[1:-1] & inside[:-2] & inside[2:]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bridged, [False]])))
    starts, ends = edges[::2], edges[1::2]
    if not len(starts):
        msg = f"no reading lies within ±{within:g} of a plateau, expected a steady stretch."
        raise FitError(msg)
    longest = int(np.argmax(time[ends - 1] - time[starts]))
    result = np.zeros(len(value), bool)
    result[starts[longest] : ends[longest]] = True
    return np.asarray(result & inside)

"""What a temperature fit has to say, and which effects it cannot tell apart."""

import numpy as np
from jaxtyping import Float

from ._line import Data
from ._types import Confusion, Lag

_ALIKE = 0.98
"""Partial correlation of two effects from which the readings do not tell them apart."""

_LEVEL = "level of the error"
_WORDS: tuple[str, ...] = (
    "temperature at the offset",
    "slope over the position",
    "change of that slope",
)


def confusions(data: Data, lags: tuple[float, float]) -> tuple[Confusion, ...]:
    """Return the pairs of effects that these positions and temperatures confuse.

    Looks at the columns only, never at the errors: offset over temperature, slope over the
    position, and the slope's own change with the temperature.
    """
    if data.sensors[1] is None:
        return ()
    offset, slope = data.structure(lags)
    away = data.position - data.position.mean()
    warm = slope - slope.mean()
    parts: list[Float[np.ndarray, " t"]] = [away, warm * away]
    words = list(_WORDS[1:])
    if data.sensors[0] is not None:
        parts.insert(0, offset - offset.mean())
        words.insert(0, _WORDS[0])
    scale = [float(np.std(part)) for part in parts]
    columns = np.column_stack(
        [
            part / size if size > 0 else part
            for part, size in zip(parts, scale, strict=True)
        ]
    )
    columns = columns - columns.mean(axis=0)
    result = []
    product = warm * away
    level = float(
        np.sqrt(product.mean() ** 2 / max(float(np.mean(product**2)), 1e-300))
    )
    if level > _ALIKE:
        # As warm as it is far out: the change of the slope is the same number everywhere.
        result.append(Confusion(_LEVEL, _WORDS[2], level))
    for i in range(len(words)):
        for j in range(i + 1, len(words)):
            correlation = _alike(columns[:, i], columns[:, j])
            if abs(correlation) > _ALIKE:
                result.append(Confusion(words[i], words[j], correlation))
    return tuple(result)


def _alike(first: Float[np.ndarray, " t"], second: Float[np.ndarray, " t"]) -> float:
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / size if size > 0 else 0.0


def lag_sentence(lag: Lag) -> str:
    """Return what a lag means for the machine."""
    name = f"sensor {lag.sensor + 1}"
    if lag.sensor_late:
        return (
            f"The structure is ahead of {name}: the sensor sits where it warms late. No "
            "filter undoes that; a sensor closer to the source would."
        )
    if not lag.applied:
        return f"No lag between {name} and the structure shows."
    low, high = lag.interval
    return (
        f"The structure follows {name} with a time constant of {lag.time_constant:.3g} s "
        f"(95 %: {low:.3g} to {high:.3g} s)."
    )

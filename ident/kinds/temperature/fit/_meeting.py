r"""Where the lines of all temperatures meet: about that position only the slope changes.

At a distance $a$ from the reference the error is $o(T) + c(T)\,a$, which there is the same at all
temperatures. Offset and coefficient are estimates with a covariance: each temperature counts by
the variance of that sum, and what is left must be within it.
"""

import dataclasses

import numpy as np

from ....core import node_shares
from ._estimate import Meeting, TemperatureFit

_SURE = 3.0
"""Deviations by which the coefficient must change, and up to which lines meet in a point."""
_ROUNDS = 3
"""In which the weights of the temperatures follow the position."""
_FAR = 1e3
"""Distance of the position, in measured ranges, from which on there is none."""


def about_meeting(fit: TemperatureFit, span: float) -> TemperatureFit:
    """Return a line about the position where those of all temperatures meet.

    Where they do not, it stays as it is, with the reason.

    Args:
        fit: With offset and coefficient.
        span: Measured range of positions in mm.
    """

    def stays(meeting: Meeting, unsure: float | None = None) -> TemperatureFit:
        return dataclasses.replace(fit, meeting=meeting, meeting_deviation=unsure)

    line, size, every = fit.line, fit.line.size, len(fit.covariance)
    nodes, own = line.nodes, line.split(np.arange(size))
    if len(nodes["coefficient"]) < 2:
        return stays("parallel")
    if len(line.sensor_names) > 1:
        return stays("two sensors")
    warm = np.union1d(nodes["offset"], nodes["coefficient"])
    # Rows that make offset and slope at each temperature of all that was fitted.
    offset, slope = np.zeros((2, len(warm), every))
    offset[:, own["offset"]] = node_shares(warm, nodes["offset"])
    slope[:, own["coefficient"]] = node_shares(warm, nodes["coefficient"])
    rise, tilt = offset - offset.mean(axis=0), slope - slope.mean(axis=0)
    value = np.append(fit.values, np.zeros(every - size))
    shift, change = rise @ value, tilt @ value
    variance = ((tilt @ fit.covariance) * tilt).sum(axis=1)
    if not (change**2 > _SURE**2 * variance).any():
        return stays("unsure slope")
    away, weight = 0.0, np.ones(len(warm))
    for _ in range(_ROUNDS):
        pull = weight * change
        away = -float(pull @ shift) / float(pull @ change)
        rows = rise + away * tilt
        variance = ((rows @ fit.covariance) * rows).sum(axis=1)
        weight = 1.0 / np.maximum(variance, 1e-18)
    moves = -(pull @ rows) / float(pull @ change)
    sure = float(np.sqrt(max(moves @ fit.covariance @ moves, 0.0)))
    if abs(away) > _FAR * span:
        return stays("too far")
    if ((rows @ value) ** 2 > _SURE**2 * np.maximum(variance, 1e-18)).any():
        return stays("not one point")
    if not sure < max(10.0 * span, abs(fit.reference + away)):
        return stays("uncertain", sure)
    level = (offset + away * slope).mean(axis=0)
    given = np.eye(every)
    # Offset, coefficient, position, then what comes behind the values.
    turn = np.vstack(
        [
            level + float((slope @ value).mean()) * moves,
            given[own["coefficient"]],
            moves,
            given[size:],
        ]
    )
    law = {"offset": warm.mean(keepdims=True), "coefficient": nodes["coefficient"]}
    first = len(own["offset"])
    return dataclasses.replace(
        fit,
        line=dataclasses.replace(line, law=law, reference=fit.reference + away),
        values=np.append(level @ value, fit.values[first:]),
        covariance=turn @ fit.covariance @ turn.T,
        names=(
            "offset",
            *fit.names[first:size],
            "reference position",
            *fit.names[size:],
        ),
        support=(int((fit.used & ~fit.wild).sum()), *fit.support[first:]),
        meeting="met",
        meeting_deviation=sure,
    )

r"""Where the lines of all temperatures meet: about that position only the slope changes.

At a distance $a$ from the reference the error is $o(T) + c(T)\,a$, which there is the same at all
temperatures. Offset and coefficient are estimates with a covariance: $a$ is that of generalised
least squares over what both change with the temperature, what is left must be within its
deviation, and the law is then the one given that nothing is left.
"""

import dataclasses

import numpy as np

from ...core import node_shares
from ._line import Meeting, TemperatureFit

_SURE = 3.0
"""Deviations by which the coefficient must change, and up to which lines meet in a point."""
_ROUNDS = 4
"""In which the weights of the temperatures follow the position."""
_FAR = 1e3
"""Distance of the position, in measured ranges, from which on there is none."""


def about_meeting(fit: TemperatureFit) -> TemperatureFit:
    """Return a line about the position where those of all temperatures meet.

    Where they do not, it stays as it is, with the reason.
    """

    def stays(meeting: Meeting) -> TemperatureFit:
        return dataclasses.replace(fit, meeting=meeting)

    line, size, every = fit.line, fit.line.size, len(fit.covariance)
    nodes, own = line.nodes, line.split(np.arange(size))
    assert fit.position is not None  # there is a coefficient
    span = float(np.ptp(fit.position))
    if len(fit.sensors) > 1:
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
        return stays("parallel")
    weight, rounds = np.eye(len(warm)), 0
    while True:
        rounds += 1
        pull = weight @ change
        away = -float(pull @ shift) / float(pull @ change)
        rows = rise + away * tilt
        spread = rows @ fit.covariance @ rows.T
        if rounds == _ROUNDS or not spread.any():
            break
        # What moves together counts once: the rows sum to zero.
        weight = np.linalg.pinv(spread, rcond=1e-6, hermitian=True)
    moves = -(pull @ rows) / float(pull @ change)
    sure = float(np.sqrt(max(moves @ fit.covariance @ moves, 0.0)))
    if abs(away) > _FAR * span:
        return stays("parallel")
    if ((rows @ value) ** 2 > _SURE**2 * np.maximum(np.diag(spread), 1e-18)).any():
        return stays("not one point")
    if not sure < max(10.0 * span, abs(fit.reference + away)):
        return stays("uncertain")
    # The laws given that the lines meet, and what they are beside the position.
    gain = fit.covariance @ rows.T @ weight
    value = value - gain @ (rows @ value)
    given = np.eye(every) - gain @ (rows + np.outer(change, moves))
    level = (offset + away * slope).mean(axis=0)
    # Offset, coefficient, position, then what comes behind the values.
    moved = level @ given + float((slope @ value).mean()) * moves
    turn = np.vstack([moved, given[own["coefficient"]], moves, given[size:]])
    warm = nodes["coefficient"]
    law = {"offset": warm.mean(keepdims=True), "coefficient": warm}
    return dataclasses.replace(
        fit,
        line=dataclasses.replace(line, law=law, reference=fit.reference + away),
        values=np.append(level @ value, value[own["coefficient"]]),
        covariance=turn @ fit.covariance @ turn.T,
        support=(int((~fit.wild).sum()), *fit.support[len(own["offset"]) :]),
        meeting="met",
        reference_deviation=sure,
    )

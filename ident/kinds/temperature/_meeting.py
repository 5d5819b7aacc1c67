r"""Where the lines of all temperatures meet: about that position only the slope changes.

At a distance $a$ from the reference the error is $o(T) + c(T)\,a$, which there is the same at all
temperatures. Offset and coefficient are estimates with a covariance: $a$ is that of generalised
least squares over what both change with the temperature, what is left must be within its
deviation, and the law is then the one given that nothing is left.
"""

import dataclasses

import numpy as np

from ...core import node_shares
from ...fit.joint import LAWS, Temperature
from ._line import Meeting, TemperatureFit

_SURE = 3.0
"""Deviations by which the coefficient must change, and up to which lines meet in a point."""
_ROUNDS = 4
"""In which the weights of the temperatures follow the position."""
_FAR = 1e3
"""Distance of the position, in measured ranges, from which on there is none."""


def bent_to_meet(line: Temperature) -> Temperature:
    """Return a line whose offset bends as its coefficient does, as it does where lines meet.

    The line itself where it bends so already, or has no coefficient that could meet.
    """
    sensor, law = line.sensors.get("coefficient"), line.law
    if sensor is None or line.sensors.get("offset", sensor) != sensor:
        return line
    if int(law.get("offset", 1)) >= int(law["coefficient"]):
        return line
    law = dict.fromkeys(LAWS, law["coefficient"])
    return dataclasses.replace(line, sensors=dict.fromkeys(LAWS, sensor), law=law)


def about_meeting(fit: TemperatureFit) -> TemperatureFit:
    """Return a line about the position where those of all temperatures meet.

    Where they do not, it stays as it is, with the reason; and where its offset cannot bend
    as the coefficient does.
    """

    def stays(meeting: Meeting) -> TemperatureFit:
        return dataclasses.replace(fit, meeting=meeting)

    line, size = fit.line, fit.line.size
    nodes, own = line.nodes, line.split(np.arange(size))
    assert fit.position is not None  # there is a coefficient
    span = float(np.ptp(fit.position))
    if len(fit.sensors) > 1:
        return stays("two sensors")
    if len(nodes["offset"]) < len(nodes["coefficient"]):
        return fit
    warm = np.union1d(nodes["offset"], nodes["coefficient"])
    # Rows that make offset and slope at each temperature of all that was fitted.
    offset, slope = np.zeros((2, len(warm), size))
    offset[:, own["offset"]] = node_shares(warm, nodes["offset"])
    slope[:, own["coefficient"]] = node_shares(warm, nodes["coefficient"])
    rise, tilt = offset - offset.mean(axis=0), slope - slope.mean(axis=0)
    shift, change = rise @ fit.values, tilt @ fit.values
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
    if ((rows @ fit.values) ** 2 > _SURE**2 * np.maximum(np.diag(spread), 1e-18)).any():
        return stays("not one point")
    if not sure < max(10.0 * span, abs(fit.reference + away)):
        return stays("uncertain")
    # The laws given that the lines meet.
    gain = fit.covariance @ rows.T @ weight
    value = fit.values - gain @ (rows @ fit.values)
    given = np.eye(size) - gain @ (rows + np.outer(change, moves))
    # Where they meet nothing is corrected at the reference temperature, so nowhere.
    turn = np.vstack([np.zeros(size), given[own["coefficient"]]])
    warm = nodes["coefficient"]
    law = {"offset": warm.mean(keepdims=True), "coefficient": warm}
    return dataclasses.replace(
        fit,
        line=dataclasses.replace(line, law=law, reference=fit.reference + away),
        values=np.append(0.0, value[own["coefficient"]]),
        covariance=turn @ fit.covariance @ turn.T,
        support=(int((~fit.wild).sum()), *fit.support[len(own["offset"]) :]),
        meeting="met",
        reference_deviation=sure,
    )

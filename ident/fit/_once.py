"""A surface probed once: what its own readings cannot tell about their noise.

Where every node has one reading, the scatter about a smooth table may be noise, or structure
of the surface that comes back with the next probing. Where lines of readings differ by far more
than readings scatter, the surface has structure as fine as the nodes:

* an offset of each scan line (the probe touches off anew) hides in it. It is taken to be as
  large as the scatter of a reading; on three probings of a printer bed it was 1.1 to 1.4 times
  that. Where the surface is smooth across its lines, fourth differences of their means show it.
* the scatter within a line may be structure. The table goes half way to the reading, which has
  the least loss in the worse of the two cases.

Where a surface bends from node to node the prior may explain every reading and leave next to no
noise. Fourth differences along both axes tell it to about 20 %; the table is then that of the
same prior for as large a noise.
"""

import dataclasses
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from ._types import Samples, TableFit

_NEAR = 1e-3
"""Distance in node spacings at which a reading is one of the node."""
_MOST = 0.9
"""Share of the nodes that must have their reading."""
_FEWEST = 5
"""Lines from which on their scatter can be judged."""
_SQUARE, _OVERLAP = 70.0, 2.6
"""Mean square of fourth differences along one axis for noise of 1; how many of them, as they
overlap, say as much as an independent one."""
_ORDER, _NORM, _ALIKE = 4, 70.0, 6.9
"""Order of the differences that tell the noise of a smooth surface; their scatter along both
axes for noise of 1; how many of them, as neighbours overlap, say as much as an independent one."""

Place = tuple[Int[np.ndarray, " t"], Int[np.ndarray, " t"]]
"""Rows and columns of a table's array: the node of every reading."""


def judge_once(fit: TableFit, samples: Samples) -> TableFit:
    """Return the fit, with what a single probing cannot tell added to its uncertainty.

    With repeated readings, runs, or many nodes without a reading it comes back as it is.
    """
    plain = len(fit.layout.nodes) == 2 and samples.run is None and fit.noise > 0.0
    place = _nodes_read(fit, samples) if plain else None
    if place is None:
        return fit
    readings = fit.values.copy()
    readings[place] += np.where(fit.wild, 0.0, fit.residual)
    floor = _least_noise(readings)
    if floor > fit.noise:
        fit = _noisier(fit, place, floor)
    rough = [_roughness(readings, axis) for axis in (0, 1)]
    across = int(np.argmax(rough))
    # Below the scatter of a reading no structure can hide; from twice that on, all of it can.
    share = float(np.clip(rough[across] / fit.noise - 1.0, 0.0, 1.0))
    offsets = [_offset_of_lines(readings, axis, fit.noise) for axis in (0, 1)]
    if not share:
        across = int(np.argmax(offsets))
    offset = max(share * fit.noise, offsets[across])
    return _half_way(fit, place, across, share, offset) if offset else fit


def _nodes_read(fit: TableFit, samples: Samples) -> Place | None:
    """Return the node of every reading in the table's array; None unless each has its own."""
    if len(samples.error) > fit.values.size:
        return None
    place = []
    for position, nodes in zip(samples.positions.T, fit.layout.nodes, strict=True):
        nearest = np.searchsorted(0.5 * (nodes[1:] + nodes[:-1]), position)
        distance = np.abs(position - nodes[nearest])
        if np.any(distance > _NEAR * np.diff(nodes).min()):
            return None
        place.append(nearest)
    first, second = place
    visits = np.zeros(fit.values.shape, int)
    np.add.at(visits, (second, first), 1)
    once = visits.max() == 1 and visits.mean() >= _MOST
    return (second, first) if once else None


def _least_noise(readings: Float[np.ndarray, "n m"]) -> float:
    """Return the least noise of a reading that fourth differences along both axes allow.

    Less one standard deviation of it; 0 for a mesh too small to tell.
    """
    bends = np.diff(np.diff(readings, _ORDER, axis=0), _ORDER, axis=1)
    if not bends.size:
        return 0.0
    noise = 1.4826 * float(np.median(np.abs(bends))) / _NORM
    return noise / (1.0 + float(np.sqrt(0.5 * _ALIKE / bends.size)))


def _noisier(fit: TableFit, place: Place, noise: float) -> TableFit:
    """Return the table of the same prior for readings of a larger noise."""
    assert fit.estimate is not None  # a fit of readings in memory has one
    weights = fit.estimate.posterior.weights * (noise / fit.noise) ** 2
    post = fit.estimate.posterior.problem.at(weights)
    if post is None:
        return fit
    table = fit.layout
    values = table.to_table(post.values[: table.size])
    deviation = noise * np.sqrt(post.inverse_diagonal[: table.size])
    return dataclasses.replace(
        fit,
        values=values,
        standard_deviation=table.to_table(deviation),
        noise=noise,
        smoothness=dict(zip(table.prior.names, weights.tolist(), strict=True)),
        residual=fit.residual + (fit.values - values)[place],
        covariance=noise**2 * post.covariance(table.offsets),
        estimate=dataclasses.replace(fit.estimate, posterior=post),
    )


def _roughness(readings: Float[np.ndarray, "n m"], axis: int) -> float:
    """Return the deviation of the mean of a line from those beside it along an array axis.

    By second differences, as if it were independent from line to line.
    """
    if readings.shape[axis] < _FEWEST:
        return 0.0
    bend = np.diff(readings.mean(axis=1 - axis), 2)
    return float(np.sqrt(np.mean(np.square(bend)) / 6.0))


def _offset_of_lines(
    readings: Float[np.ndarray, "n m"], axis: int, noise: float
) -> float:
    """Return the deviation of lines of a surface that is smooth across them, at most the noise.

    By fourth differences of their means; 0 where the noise of their readings may give these.
    """
    count, length = readings.shape[axis], readings.shape[1 - axis]
    if count <= _ORDER:
        return 0.0
    bends = np.diff(readings.mean(axis=1 - axis), _ORDER)
    square, chance = float(np.mean(np.square(bends))) / _SQUARE, noise**2 / length
    most = 1.0 + 2.0 * np.sqrt(2.0 * _OVERLAP / len(bends))
    if square < most * chance:
        return 0.0
    return min(noise, float(np.sqrt(square - chance)))


def _half_way(
    fit: TableFit, place: Place, across: int, share: float, offset: float
) -> TableFit:
    """Return the table half way to its readings, with an offset of every line in its noise.

    Args:
        fit: Of the smooth surface.
        place: Node of every reading.
        across: Array axis along which lines follow each other.
        share: Part of the scatter that may be structure, 0 to 1.
        offset: Standard deviation of an offset of every line, in mm or °.
    """
    fraction = 0.5 * share
    fractions = np.where(fit.wild, 0.0, fraction)
    change, weight = np.zeros(fit.values.shape), np.zeros(fit.values.shape)
    change[place] = fractions * fit.residual
    # If all scatter is noise the table takes over a part of it; if all is structure, it misses
    # no more than that.
    weight[place] = fractions
    before = np.square(fit.standard_deviation)
    gain = np.square(weight * fit.noise) - np.square(weight) * before
    table = fit.layout
    # Nodes of one line share its offset.
    unknown = table.to_table(np.arange(table.size))
    along = int(np.abs(np.diff(unknown, axis=1 - across).flat[0]))
    same = np.full(table.size, offset**2)
    more = [same[along:], same + table.to_values(gain), same[along:]]
    places: Any = [-along, 0, along]
    shared = sp.diags_array(more, offsets=places)
    size = offset / fit.noise
    way = f", and the table goes {fraction:.0%} of the way from the smooth surface to each reading"
    message = (
        f"{fit.message} Every node was read once, and the lines of readings differ by more "
        "than readings scatter: an offset of every line and structure as fine as the nodes "
        "cannot be told from noise. The standard deviations allow for such an offset, as "
        f"large as {'the scatter' if size >= 1.0 else f'{size:.0%} of the scatter'} of a "
        f"reading{way if share else ''}. A second probing would tell."
    )
    return dataclasses.replace(
        fit,
        values=fit.values + change,
        standard_deviation=np.sqrt(np.maximum(before + gain, 0.0) + offset**2),
        noise=float(np.hypot(fit.noise, offset)),
        line_offset=offset,
        residual=fit.residual * (1.0 - fractions),
        covariance=sp.csr_array(fit.covariance + shared),
        message=message,
    )

"""Logs of an axis in motion: what the readings of a pass share, and what both ways differ by."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.signals import NORMAL, independent, travel_direction
from ...fit import Samples, TableFit, as_alike, fit_table
from ...readings import Readings
from ..result._result import Remark
from ._plan import Plan
from ._remarks import LOG
from ._run_remarks import SEEN, TINY

_PASS, _PASSES, _ALIKE = 0.25, 10, 2.0
"""Share of the longest pass of a node that one has at least; passes beyond the first of each
node that tell how they differ; and the variance, in that of white noise, from which on they do."""
_FAST, _ONE_WAY, _LATE = 0.5, 0.98, 0.01
"""s between readings of a log in motion; mean sign of its speed that is one way; s by which an
instrument is late, for what it would do."""
_LINES = 8
"""Nodes along each axis of a surface from which on few readings tell waves from its shape."""
_IN_COMMON = 7
"""Places that two measurements share, from which on their zeros can be compared."""
_NOTHING = 1e-18
"""mm²: variance of what readings without any noise tell."""
_LOOSE, _FAINT = 1e-6, 1e-3
"""Smoothness of a table that only fills what was not read; mean square of what is left of ±½
by both ways from which on it tells how much they differ."""


@final
@dataclasses.dataclass(frozen=True)
class NodePasses:
    """What a table leaves of its readings, by pass of a node: one after the other in time.

    A pass has two readings or more; mean and mean square are those of what is left in mm or °.
    """

    node: Int[np.ndarray, " p"]
    size: Int[np.ndarray, " p"]
    mean: Float[np.ndarray, " p"]
    square: Float[np.ndarray, " p"]

    @classmethod
    def of(
        cls,
        plan: Plan,
        samples: Samples,
        left: Float[np.ndarray, " t"],
        wild: Bool[np.ndarray, " t"],
    ) -> "NodePasses":
        """Return the passes of readings that stand in the order in which they were taken."""
        keep = np.isfinite(left) & ~wild
        node, left = nearest_node(plan, samples)[keep], left[keep]
        number = np.cumsum(np.diff(node, prepend=-1) != 0) - 1
        size = np.bincount(number)
        first = np.cumsum(size) - size
        mean, square = (np.bincount(number, each) / size for each in (left, left**2))
        # One reading tells nothing of the scatter within its pass.
        more = size > 1
        return cls(node[first][more], size[more], mean[more], square[more])

    @classmethod
    def joined(cls, parts: "Sequence[NodePasses]") -> "NodePasses":
        """Return those of pieces that follow each other."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*map(np.concatenate, columns))

    def whole(self) -> "NodePasses":
        """Return those that have most of the readings of a pass; others touch a node's edge."""
        longest = np.zeros(self.node.max(initial=0) + 1)
        np.maximum.at(longest, self.node, self.size)
        most = self.size >= _PASS * longest[self.node]
        return NodePasses(*(column[most] for column in vars(self).values()))


def as_passes_differ(
    plan: Plan, passes: NodePasses, samples: Samples, fit: TableFit
) -> tuple[TableFit, list[Remark]]:
    """Return the fit of a log whose readings share some of their error, and the words for it.

    Neighbours in time share what air, vibration and heat do. Then the passes of a node differ
    by more than the scatter within them would make them differ. The table must not follow
    that, and its deviations hold it: it is the mean of so many passes, and not of so many
    readings. The fit holds the residuals of the samples, the passes are those of all readings.
    """
    passes = passes.whole()
    node, size, mean = passes.node, passes.size, passes.mean
    free = len(node) - len(np.unique(node))
    if free < _PASSES:
        return fit, []
    middle = np.bincount(node, size * mean) / np.maximum(np.bincount(node, size), 1)
    within = float(np.sum(size * (passes.square - mean**2)) / np.sum(size - 1))
    between = float(np.sum(size * (mean - middle[node]) ** 2)) / free
    if between <= _ALIKE * within:
        return fit, []
    apart = (between - within) / float(np.mean(size))
    words = (
        "Readings of the log that follow each other err alike: the passes of a node differ by"
        f" {plan.small(np.sqrt(apart))} more than the scatter within them explains. The"
        " table is smoothed for it and the standard deviations hold that; more passes make"
        " them smaller, more readings per second do not."
    )
    alike = between / float(np.average(passes.square, weights=size))
    fit = as_alike(fit, samples, max(alike, 1.0))
    # Passes that follow each other err alike as well.
    passed = independent(np.sqrt(size) * (mean - middle[node]))
    deviation = np.sqrt(len(size) / passed) * np.asarray(fit.standard_deviation)
    return dataclasses.replace(fit, standard_deviation=deviation), [Remark.info(words)]


def one_way(plan: Plan, readings: Readings, fit: TableFit) -> list[Remark]:
    """Return what a late instrument would do to a table whose passes all go the same way.

    Where they go both ways, `of_both_ways` sees it.
    """
    time, table = readings.time, plan.table
    if time is None or len(time) < LOG:
        return []
    if readings.late is not None or table.branches > 1:
        return []
    order = np.argsort(time, kind="stable")
    steps = np.diff(time[order])
    most = int(np.argmax(np.ptp(readings.positions, axis=0)))
    moved = np.diff(readings.positions[order, most])
    if not 0.0 < np.median(steps) < _FAST:
        return []
    speed = np.divide(moved, steps, out=np.zeros(len(steps)), where=steps > 0.0)
    fast = np.abs(speed) > 0.1 * np.percentile(np.abs(speed), 90)
    nodes = table.nodes[most].positions
    if not fast.any():
        return []
    usual = float(np.median(np.abs(speed[fast])))
    # Not the jump from the end of a pass to the beginning of the next.
    passed = speed[(np.abs(speed) > 0.5 * usual) & (np.abs(speed) < 2.0 * usual)]
    if abs(np.sign(passed).mean()) < _ONE_WAY:
        return []
    axis = fit.values.ndim - 1 - most
    slope = float(np.abs(np.gradient(fit.values, nodes, axis=axis)).max())
    shift = _LATE * usual
    name = plan.fit.over[most]
    unit = plan.job.spec.axes[name].unit
    return [
        Remark.info(
            f"All passes over {name} go the same way, at about {usual:.3g} {unit}/s. An instrument"
            f" that is {1e3 * _LATE:g} ms late shifts the table by {shift:.3g} {unit} along {name},"
            f" up to {plan.small(shift * slope)}, which such passes do not show: scan back as well."
        )
    ]


def nearest_node(plan: Plan, samples: Samples) -> Int[np.ndarray, " t"]:
    """Return the number of the node that is nearest to each reading, by direction."""
    at: list[np.ndarray] = [] if samples.branch is None else [samples.branch]
    for nodes, places in zip(
        reversed(plan.table.nodes), reversed(samples.positions.T), strict=True
    ):
        middles = 0.5 * (nodes.positions[1:] + nodes.positions[:-1])
        at.append(np.searchsorted(middles, places))
    return np.ravel_multi_index(tuple(at), plan.table.layout.shape)


def zeros_apart(plan: Plan, readings: Readings) -> list[Remark]:
    """Return a doubt where a measurement lies beyond another at the places of both."""
    branch = plan.branch(readings.direction)
    samples = Samples(readings.positions, readings.error, branch)
    place, size = nearest_node(plan, samples), 2 * plan.table.layout.size
    # What an axis loses where it turns is no zero.
    place = 2 * place + (readings.direction == -1)
    means, found = {}, list[tuple[float, str, str]]()
    for name, rows in readings.slices.items():
        count = np.bincount(place[rows], minlength=size)
        total = np.bincount(place[rows], readings.error[rows], size)
        means[name] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    for low, high in itertools.permutations(means, 2):
        gaps = means[high] - means[low]
        gaps = gaps[np.isfinite(gaps)]
        if len(gaps) >= _IN_COMMON:
            apart = float(np.median(gaps))
            scatter = NORMAL * float(np.median(np.abs(gaps - apart)))
            if apart > max(SEEN * scatter, TINY):
                found.append((apart, low, high))
    return [
        Remark.warning(
            f"Measurement {high!r} lies {plan.small(apart)} above {low!r} where both were read."
            ' Where the zero of one is the instrument\'s, state remove = "offset" of it: what is'
            " written holds a mean of both."
        )
        for apart, low, high in sorted(found)[-1:]
    ]


def of_both_ways(
    plan: Plan, order: Float[np.ndarray, " t"], samples: Samples, fit: TableFit
) -> tuple[Samples, list[Remark]]:
    """Return the readings of a log as the mean of both ways of the axis that moves most.

    A table of one direction cannot hold what differs between them. Where each line of a
    surface was passed one way only, it would take that for waves from line to line; of few
    readings, as of a probe, that is said and not taken off.

    The order is when each reading was taken.
    """
    order = np.argsort(order, kind="stable")
    few, surface = len(order) < LOG, samples.positions.shape[1] > 1
    if few and not (surface and min(plan.table.layout.shape) >= _LINES):
        return samples, []
    places = samples.positions[order]
    most = int(np.argmax(np.abs(np.diff(places, axis=0)).sum(axis=0)))
    # Stops with several readings count once: their steps are no noise of a position.
    starts = np.flatnonzero(np.diff(places[:, most], prepend=np.nan) != 0.0)
    ways = travel_direction(places[starts, most])
    if len(np.unique(ways)) < 2 or (ways == 0).any():
        return samples, []
    count = np.diff(starts, append=len(order))
    stop = np.repeat(np.arange(len(starts)), count)
    # Where an axis stands as it turns, half of the readings are of the way back.
    later = 2 * (np.arange(len(order)) - starts[stop]) >= count[stop]
    way = np.empty(len(order), np.int64)
    way[order] = ways[np.minimum(stop + later, len(ways) - 1)]
    apart, deviation = _difference(plan, samples, fit, 0.5 * way, most)
    if abs(apart) < max(SEEN * deviation, fit.noise, TINY):
        return samples, []
    mover = plan.fit.over[most]
    words = (
        f"Readings taken while {mover} moves in positive direction lie {plan.small(apart, '+.2g')}"
        " from those on the way back: lost motion, or an instrument that is late. This table"
        " knows no direction"
    )
    if few:  # Nothing but the waves themselves tells them from a surface that has such.
        words += (
            ": where a line was passed one way only it holds half of that, as waves from line"
            " to line. Pass every line both ways, or all of them the same way."
        )
        return samples, [Remark.warning(words)]
    words += " and is the mean of both ways, each of which keeps half of that."
    error = samples.error - 0.5 * apart * way
    return dataclasses.replace(samples, error=error), [Remark.warning(words)]


def _difference(
    plan: Plan, samples: Samples, fit: TableFit, way: Float[np.ndarray, " t"], most: int
) -> tuple[float, float]:
    """Return by how much both ways of an axis differ, and its standard deviation.

    By what a table leaves of the readings of a place that was passed both ways, and else by
    the second differences from line to line, which are large for waves and small for a shape.
    """
    keep = ~np.asarray(fit.wild)
    kept = dataclasses.replace(samples.take(keep), run=None, order=None)
    shape, waves = (
        fit_table(
            plan.table.layout,
            dataclasses.replace(kept, error=error[keep]),
            smoothness=_LOOSE,
            loss="gauss",
            allow_gaps=True,
        )
        for error in (np.asarray(samples.error), way)
    )
    pairs = [(np.asarray(waves.residual), np.asarray(shape.residual))]
    for axis in range(shape.values.ndim):
        if axis != shape.values.ndim - 1 - most and shape.values.shape[axis] > 2:
            bends = [np.diff(each.values, 2, axis=axis) for each in (waves, shape)]
            pairs.append((bends[0].ravel(), bends[1].ravel()))
    total = weight = 0.0
    for pattern, seen in pairs:
        square = float(pattern @ pattern)
        if square < _FAINT * pattern.size:
            continue
        size = float(pattern @ seen) / square
        variance = max(float(np.mean((seen - size * pattern) ** 2)) / square, _NOTHING)
        total, weight = total + size / variance, weight + 1.0 / variance
    return (total / weight, weight**-0.5) if weight else (0.0, np.inf)

"""What is left out together of a log: runs that repeat each other, else spatial blocks."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Int

from ...exchange import AbstractTable
from ...fit import AbstractPass, Grouping, Place, Samples, Stream, added
from ...proof import blocks_of, run_groups
from ...readings import places_of, visits_overlap
from ._readings import LogReadings


def grouping_of(readings: LogReadings, stream: Stream) -> Grouping:
    """Return the groups to leave out, for which runs are looked at where there are any."""
    if readings.has_runs:
        visits = stream.ask(_Visit(readings.table))
        runs = np.unique(visits.pairs[:, 0])
        visitor = np.searchsorted(runs, visits.pairs[:, 0])
        readings_of = np.array([visits.readings[int(run)] for run in runs])
        if visits_overlap(visits.pairs[:, 1], visitor, readings_of):
            return Runs(runs, run_groups(np.arange(len(runs))))
    return Blocks(readings.table)


@final
@dataclasses.dataclass(frozen=True)
class Blocks:
    """Spatial blocks as groups to leave out; a `Grouping`."""

    table: AbstractTable

    def __call__(self, samples: Samples) -> Int[np.ndarray, " t"]:
        """Return the group of each reading."""
        return blocks_of(self.table.layout, samples)


@final
@dataclasses.dataclass(frozen=True)
class Runs:
    """Runs as groups to leave out; a `Grouping`.

    Attributes:
        runs: All that there are, ascending.
        groups: The group of each.
    """

    runs: Int[np.ndarray, " r"]
    groups: Int[np.ndarray, " r"]

    def __call__(self, samples: Samples) -> Int[np.ndarray, " t"]:
        """Return the group of each reading."""
        assert samples.run is not None  # of a log with runs
        return np.asarray(self.groups[np.searchsorted(self.runs, samples.run)])


@dataclasses.dataclass(frozen=True)
class _Visits:
    """Which runs visit which places.

    Attributes:
        pairs: Different pairs of a run and a place, shape ``(v, 2)``.
        readings: Number of readings by run.
    """

    pairs: Int[np.ndarray, "v 2"]
    readings: dict[int, int]

    def __add__(self, other: "_Visits") -> "_Visits":
        both = np.concatenate([self.pairs, other.pairs])
        counts = dict(self.readings)
        for run, count in other.readings.items():
            counts[run] = counts.get(run, 0) + count
        return _Visits(np.unique(both, axis=0), counts)


@final
@dataclasses.dataclass(frozen=True)
class _Visit(AbstractPass):
    """Asks which runs visit which places."""

    table: AbstractTable

    def onto(self, done: _Visits | None, samples: Samples, place: Place) -> _Visits:
        """See `AbstractPass`."""
        nodes = tuple(each.positions for each in self.table.nodes)
        direction = None
        if samples.branch is not None and self.table.branches == 2:
            direction = 1 - 2 * samples.branch
        assert samples.run is not None  # of a log with runs
        cells = places_of(samples.positions, nodes, direction)
        pairs = np.unique(np.stack([samples.run, cells], axis=1), axis=0)
        runs, counts = np.unique(samples.run, return_counts=True)
        found = _Visits(pairs, dict(zip(runs.tolist(), counts.tolist(), strict=True)))
        return added(done, found)

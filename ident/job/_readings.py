"""From measurements to readings of one fit: errors, positions, directions, runs."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ..exchange import AbstractTable
from ..kinds._keys import TableSpec
from ..proof import RunTable
from ..readings import Tables, place_in_run, read_joined, runs_overlap, wanted_by
from ._draft import Leftovers
from ._load import Job
from ._result import Remark


@dataclasses.dataclass(frozen=True)
class Readings:
    """What was measured, ready for a fit; one row per reading, mm or °.

    Attributes:
        positions: Of the masters, shape ``(t, d)``.
        error: Actual − commanded, reduced as the job asks.
        direction: ±1, or None where it is neither needed nor known.
        run: Cycle of each reading, or None where nothing was repeated.
        order: Time in s, or row number.
        place: Place within the run, 0 to 1, or None.
        datum: Where the error is zero, per master, or None.
        slices: Rows of each measurement.
        repeated: The runs go over the same places, so that each can be judged by the
            others.
        remarks: What was taken for granted.
        timed: Whether `order` is a time.
        late: What one standard deviation of the instruments' delays makes of the error, or
            None at standstill.
    """

    positions: Float[np.ndarray, "t d"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    run: Int[np.ndarray, " t"] | None
    order: Float[np.ndarray, " t"]
    place: Float[np.ndarray, " t"] | None
    datum: tuple[float, ...] | None
    slices: Mapping[str, slice]
    repeated: bool
    remarks: tuple[Remark, ...]
    timed: bool = False
    late: Float[np.ndarray, " t"] | None = None

    def zero_at_datum(self, table: AbstractTable) -> float:
        """Return the error where it is to be zero: median of the readings nearest to it.

        Both directions count alike; 0 without a datum.
        """
        if self.datum is None:
            return 0.0
        reach = [0.5 * np.diff(each.positions).min() for each in table.nodes]
        away = np.max(np.abs(self.positions - self.datum) / reach, axis=1)
        near = away <= max(1.0, float(away.min()))
        if self.direction is None or table.branches == 1:
            return float(np.median(self.error[near]))
        ways = [near & (self.direction == way) for way in (1, -1)]
        return float(np.mean([np.median(self.error[w]) for w in ways if w.any()]))

    def with_remark(self, remark: Remark) -> "Readings":
        """Return the same readings with one more remark."""
        return dataclasses.replace(self, remarks=(*self.remarks, remark))

    def run_table(self, axis_is_master: bool) -> RunTable | None:
        """Return how the readings lie in a run table of ISO 230-2, or None.

        Only errors along the axis itself, at targets that come back, make one.
        """
        if not axis_is_master or self.run is None:
            return None
        target = self.positions[:, 0]
        if 2 * len(np.unique(target)) > len(target):
            return None
        direction = self.direction
        if direction is None:
            direction = np.ones(len(target), dtype=np.int64)
        return RunTable(target, self.run, direction)


def read_fit(
    tables: Tables,
    index: int,
    fit: TableSpec,
    table: AbstractTable,
    left: Leftovers,
    words: tuple[Remark, ...] = (),
) -> Readings:
    """Return the readings of a fit, all its measurements joined.

    Args:
        tables: Files of the job.
        index: Of the fit in the job.
        fit: Its specification.
        table: What will be written.
        left: What earlier fits of this axis add, and what will act on it as well and was
            off while measuring: the fit takes what they leave.
        words: What there is to say of them already.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        JobError: If the measurement does not suit the fit.
    """
    found = read_joined(tables, fit, wanted_by(fit, table))
    error, run, time = found.error.copy(), found.run, found.time
    remarks = [*words, *map(Remark.info, found.remarks)]
    for name, rows in found.rows.items():
        own = found.slices[name]
        if (fit.axis, name) in left.earlier:
            error[own] += left.earlier[fit.axis, name]
            remarks.append(
                Remark.info(
                    f"Measurement {name!r} serves an earlier fit of {fit.axis} as well:"
                    " this one corrects what that list leaves."
                )
            )
        for one in left.beside.get((index, name), ()):
            error[own] += one.at(rows)
            remarks.append(
                Remark.info(
                    f"Beside this table acts {one.words}, which was off while {name!r} was"
                    " measured: this table corrects what it leaves."
                )
            )
    order = np.arange(len(error), dtype=float) if time is None else time
    repeated = run is not None and runs_overlap(
        found.positions,
        run,
        tuple(nodes.positions for nodes in table.nodes),
        found.direction if table.branches == 2 else None,
    )
    if run is not None and not repeated and len(np.unique(run)) > 1:
        remarks.append(
            Remark.info(
                "The runs do not go over the same places, so that none can be judged by"
                " the others: offsets of single runs are not estimated."
            )
        )
    return Readings(
        positions=found.positions,
        error=error,
        direction=found.direction,
        run=run,
        order=order,
        place=None if run is None else place_in_run(run, order),
        datum=datum_of(tables.job, index, fit),
        slices=found.slices,
        repeated=repeated,
        remarks=tuple(remarks),
        timed=time is not None,
        late=found.late,
    )


def datum_of(job: Job, index: int, fit: TableSpec) -> tuple[float, ...] | None:
    """Return where the error of a fit is zero, per master, or None.

    Raises:
        JobError: If its measurements differ, or it has not one position per master.
    """
    found = {
        name: spec.datum.at
        for name in fit.sources
        if (spec := job.spec.measurements[name]).datum is not None
        and spec.datum is not None
    }
    if not found:
        return None
    places = {
        name: tuple(map(float, at if isinstance(at, list) else [at]))
        for name, at in found.items()
    }
    name, place = next(iter(places.items()))
    if len(set(places.values())) > 1 or len(places) < len(fit.sources):
        raise job.error(
            ("fits", index),
            "found measurements with different datums, expected the same one for all"
            " that are joined",
        )
    count = len(fit.over)
    if len(place) != count:
        raise job.error(
            ("measurements", name, "datum", "at"),
            f"found {len(place)} position{'s' * (len(place) > 1)}, expected {count} for"
            " the"
            f" {fit.compensation} fit of {fit.axis}",
        )
    return place

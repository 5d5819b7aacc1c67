"""One measurement as a fit takes it, and several measurements one after the other."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float, Int

from ...data.measurements import Measurement
from ..kinds._keys import FitSpec, TableSpec
from ._rows import Rows, reference_words
from ._runs import cycles_of, ranked
from ._tables import Tables
from ._zero import without_zero

if TYPE_CHECKING:
    from ..exchange import AbstractTable
    from ..job._load import Job


@dataclasses.dataclass(frozen=True)
class Wanted:
    """What a fit takes from its measurements.

    Attributes:
        masters: Axes whose positions it needs, master 1 first.
        direction: ``needed``, ``welcome`` or ``no``.
        lengths: The error is one of length along the axis itself, so that it grows with
            the temperature of the scale.
    """

    masters: tuple[str, ...]
    direction: Literal["needed", "welcome", "no"]
    lengths: bool


def wanted_by(fit: TableSpec, table: "AbstractTable") -> Wanted:
    """Return what a table fit takes from its measurements."""
    way: Literal["needed", "welcome", "no"] = "welcome" if fit.lengths else "no"
    return Wanted(fit.over, "needed" if table.branches == 2 else way, fit.lengths)


@dataclasses.dataclass(frozen=True)
class Readings:
    """What was measured for one fit, one measurement after the other; in mm or °.

    Attributes:
        positions: Of the masters.
        error: Actual − commanded.
        direction: ±1, or None where it is neither needed nor known.
        run: Cycle of each reading, or None where nothing was repeated.
        order: Time in s, or row number.
        timed: Whether it is a time.
        slices: Rows of each measurement.
        remarks: What was taken for granted.
        rows: All columns of each measurement.
        late: What one standard deviation of the instruments' delays makes of the error, or
            None at standstill.
    """

    positions: Float[np.ndarray, "t d"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    run: Int[np.ndarray, " t"] | None
    order: Float[np.ndarray, " t"]
    timed: bool
    slices: Mapping[str, slice]
    remarks: tuple[str, ...] = ()
    rows: Mapping[str, Rows] = dataclasses.field(default_factory=dict)
    late: Float[np.ndarray, " t"] | None = None

    @property
    def time(self) -> Float[np.ndarray, " t"] | None:
        """In s, or None."""
        return self.order if self.timed else None


def read_rows(
    job: "Job", name: str, measured: Measurement, fit: FitSpec, wanted: Wanted
) -> Readings:
    """Return readings of one measurement, each as its own row tells: nothing is removed yet.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
    """
    rows = Rows(job, name, measured, [fit.axis])
    why = f"for the {fit.compensation} fit of {fit.axis}"
    positions = np.stack([rows.position(axis, why) for axis in wanted.masters], axis=1)
    error = rows.raw_error(fit.axis)
    if wanted.lengths:
        error = rows.at_reference(fit.axis, error, positions[:, 0])
    direction, time = None, rows.time
    if wanted.direction != "no":
        direction = rows.direction(fit.axis, needed=wanted.direction == "needed")
    return Readings(
        positions=positions,
        error=error,
        direction=direction,
        run=rows.run,
        order=np.arange(len(error), dtype=float) if time is None else time,
        timed=time is not None,
        slices={name: slice(0, len(error))},
        remarks=tuple(rows.remarks),
        rows={name: rows},
        late=rows.measured.late.get(fit.axis),
    )


def read_joined(tables: Tables, fit: FitSpec, wanted: Wanted) -> Readings:
    """Return the readings of a fit, all its measurements joined, reduced as the job asks.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
    """
    parts, errors, remarks = list[Readings](), list[np.ndarray](), list[str]()
    for name in fit.sources:
        measured = tables.measured(name, fit.axis, wanted.masters)
        part = read_rows(tables.job, name, measured, fit, wanted)
        spec, change = part.rows[name].spec, part.rows[name].change
        parts.append(part)
        errors.append(without_zero(part.error, [*part.positions.T], spec.remove))
        remarks += part.remarks
        remarks += reference_words(
            name, spec, fit.axis, wanted.lengths, change.get(fit.axis)
        )
    counts = [len(error) for error in errors]
    direction, time = (
        joined([part.direction for part in parts]),
        joined([part.time for part in parts]),
    )
    run = joined_runs([part.run for part in parts], counts)
    if run is not None and direction is not None:
        run = cycles_of(run, direction)
    return Readings(
        positions=np.concatenate([part.positions for part in parts]),
        error=np.concatenate(errors),
        direction=direction,
        run=run,
        order=np.arange(sum(counts), dtype=float) if time is None else time,
        timed=time is not None,
        slices=rows_of(fit.sources, counts),
        remarks=tuple(remarks),
        rows={name: rows for part in parts for name, rows in part.rows.items()},
        late=joined([part.late for part in parts]),
    )


def rows_of(sources: Sequence[str], counts: Sequence[int]) -> dict[str, slice]:
    """Return the rows of each measurement, one after the other, by its name."""
    ends = itertools.pairwise([0, *itertools.accumulate(counts)])
    return {name: slice(*own) for name, own in zip(sources, ends, strict=True)}


def joined(parts: list[np.ndarray | None]) -> np.ndarray | None:
    """Return the columns of all measurements one after the other, if all have it."""
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def joined_runs(
    runs: Sequence[Int[np.ndarray, " _t"] | None], counts: Sequence[int]
) -> Int[np.ndarray, " t"] | None:
    """Number the runs of all measurements one after the other.

    A measurement without runs is a run of its own beside others.

    Args:
        runs: Of each measurement, or None.
        counts: Readings of each measurement.
    """
    if len(runs) == 1 and runs[0] is None:
        return None
    numbered: list[np.ndarray] = []
    first = 1
    for run, count in zip(runs, counts, strict=True):
        own = np.zeros(count, dtype=np.int64) if run is None else ranked(run)[1]
        numbered.append(own.astype(np.int64) + first)
        first += int(own.max(initial=0)) + 1
    return np.concatenate(numbered)

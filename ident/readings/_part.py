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
class Part:
    """The readings of one measurement.

    Attributes:
        positions: Of the masters, in mm or °.
        error: Actual − commanded in mm or °.
        direction: ±1, or None where it is neither needed nor known.
        rows: All columns of the same rows.
        remarks: What was taken for granted.
    """

    positions: Float[np.ndarray, "t d"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    rows: Rows
    remarks: tuple[str, ...]


def read_rows(
    job: "Job", name: str, measured: Measurement, fit: FitSpec, wanted: Wanted
) -> Part:
    """Return readings for a fit, each as its own row tells: nothing is removed yet.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
    """
    rows = Rows(job, name, measured, [fit.axis])
    why = f"for the {fit.compensation} fit of {fit.axis}"
    positions = np.stack([rows.position(axis, why) for axis in wanted.masters], axis=1)
    error = rows.raw_error(fit.axis)
    if wanted.lengths:
        error = rows.at_reference(fit.axis, error, positions[:, 0])
    direction = None
    if wanted.direction != "no":
        direction = rows.direction(fit.axis, needed=wanted.direction == "needed")
    return Part(positions, error, direction, rows, tuple(rows.remarks))


@dataclasses.dataclass(frozen=True)
class Joined:
    """The readings of all measurements of a fit, one after the other.

    Attributes:
        positions: Of the masters, in mm or °.
        error: Actual − commanded in mm or °, reduced as the job asks.
        direction: ±1, or None where it is neither needed nor known.
        run: Cycle of each reading, or None where nothing was repeated.
        time: In s, or None.
        late: What one standard deviation of the instruments' delays makes of the error, or
            None at standstill.
        slices: Rows of each measurement.
        rows: All columns of each measurement.
        remarks: What was taken for granted.
    """

    positions: Float[np.ndarray, "t d"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    run: Int[np.ndarray, " t"] | None
    time: Float[np.ndarray, " t"] | None
    late: Float[np.ndarray, " t"] | None
    slices: Mapping[str, slice]
    rows: Mapping[str, Rows]
    remarks: tuple[str, ...]


def read_joined(tables: Tables, fit: FitSpec, wanted: Wanted) -> Joined:
    """Return the readings of a fit, all its measurements joined.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
    """
    parts, errors, remarks = list[Part](), list[np.ndarray](), list[str]()
    for name in fit.sources:
        measured = tables.measured(name, fit.axis, wanted.masters)
        part = read_rows(tables.job, name, measured, fit, wanted)
        rows, places = part.rows, [*part.positions.T]
        parts.append(part)
        errors.append(without_zero(part.error, places, rows.spec.remove))
        remarks += part.remarks
        remarks += reference_words(
            name, rows.spec, fit.axis, wanted.lengths, rows.change.get(fit.axis)
        )
    counts = [len(error) for error in errors]
    direction = joined([part.direction for part in parts])
    run = joined_runs([part.rows.run for part in parts], counts)
    if run is not None and direction is not None:
        run = cycles_of(run, direction)
    return Joined(
        positions=np.concatenate([part.positions for part in parts]),
        error=np.concatenate(errors),
        direction=direction,
        run=run,
        time=joined([part.rows.time for part in parts]),
        late=joined([part.rows.measured.late.get(fit.axis) for part in parts]),
        slices=rows_of(fit.sources, counts),
        rows={part.rows.name: part.rows for part in parts},
        remarks=tuple(remarks),
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

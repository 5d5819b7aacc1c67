"""Readings of a table: what other lists add taken into account; their zero, their runs."""

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from ...core import FitError
from ...exchange import AbstractTable
from ...fit import Samples, fit_table
from ...kinds._keys import FitSpec
from ...proof import RunTable
from ...readings import Readings, Tables, joined, without_zero
from .._draft import Leftovers
from ..file._load import Job
from ..joint._recording import GroupRecording, read_group
from ..result._result import Remark
from ._remarks import wander_remarks

if TYPE_CHECKING:
    from ._plan import Plan

_FLANKS, _SURE = 5, 4.0
"""Places read from both sides, and deviations of what lies between, that tell a lost motion."""
_STOOD = 1e-3
"""Share of a table within which a measurement stood at one place."""


def read_fit(
    tables: Tables, plan: "Plan", left: Leftovers
) -> tuple[Readings, list[Remark]]:
    """Return the readings of a table, all its measurements joined, and what to say of them.

    The fit takes what is left of them by earlier fits of this axis, and by what will act on
    it as well and was off while measuring.
    """
    recording, axis = read_group(tables, [plan], alone=True), plan.axis
    error, remarks = recording.data.error[axis].copy(), [*recording.remarks]
    for name, rows in recording.rows.items():
        part = recording.slices[name]
        for beside in left.get((plan.index, name), ()):
            added = beside.at(rows)
            if not beside.shared:
                # Of it, too, the readings tell no constant or slope of their own.
                places = [recording.data.position[k][part] for k in plan.fit.over]
                added = without_zero(added, places, rows.spec.remove)
            if plan.table.branches == 1 and not beside.shared:
                remarks += _unseen_flanks(plan, recording, part, added, beside.words)
            error[part] += added
            words = f"Beside this table acts {beside.words}, which was off while {name!r} was"
            words += " measured: this table corrects what it leaves."
            remarks.append(Remark.info(words))
    late = joined([rows.measured.late.get(axis) for rows in recording.rows.values()])
    readings = recording.readings(plan.fit.over, axis, error, np.ones(len(error), bool))
    _refuse_standing(plan, readings)
    measured = [rows.measured for rows in recording.rows.values()]
    remarks += wander_remarks(plan, measured, readings)
    return dataclasses.replace(readings, late=late), remarks


def _refuse_standing(plan: "Plan", readings: Readings) -> None:
    """Refuse measurements each of which stood at one place and has a zero of its own."""
    specs, fit = plan.job.spec.measurements, plan.fit
    reach = [float(np.ptp(nodes.positions)) for nodes in plan.table.nodes]
    for name, rows in readings.slices.items():
        moved = np.ptp(readings.positions[rows], axis=0) > _STOOD * np.array(reach)
        if specs[name].remove == "none" or moved.any():
            return
    if len(readings.slices) > 1:
        over = " and ".join(fit.over)
        reason = (
            f"each of {', '.join(readings.slices)} stood at one place of {over} and has a zero of"
            " its own (remove): they say nothing of the table. Expected one set-up that"
            f' moves along {over}, or remove = "none" where all have the same zero.'
        )
        raise plan.job.error(("fits", plan.index), reason)


def _unseen_flanks(
    plan: "Plan",
    recording: GroupRecording,
    part: slice,
    added: Float[np.ndarray, " r"],
    words: str,
) -> Iterator[Remark]:
    """Yield that what acts beside a table for both directions parts them, and no reading does.

    The table cannot take that over: what is loaded would make a lost motion that was not there.
    """
    direction = recording.data.direction.get(plan.axis)
    if direction is None:
        return
    way, error = direction[part], recording.data.error[plan.axis][part]
    columns = [recording.data.position[name][part].round(2) for name in plan.fit.over]
    place = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)[1]
    cell, size = 2 * place.reshape(-1) + (way < 0), 2 * len(way)
    count = np.bincount(cell, minlength=size).reshape(-1, 2)
    both = (count > 0).all(axis=1)
    if both.sum() < _FLANKS:
        return
    sums = [np.bincount(cell, values, size).reshape(-1, 2) for values in (error, added)]
    means = [each[both] / count[both] for each in sums]
    shown, gap = (mean[:, 0] - mean[:, 1] for mean in means)
    made, seen = float(np.median(gap)), float(np.median(shown))
    doubt = _SURE * float(np.std(shown)) / np.sqrt(both.sum())
    if abs(made) > doubt and abs(made + seen) > abs(seen) + 0.5 * abs(made):
        yield Remark.error(
            f"Beside this table acts {words}, which parts the directions by"
            f" {plan.small(abs(made))}, and readings that were taken with it off show"
            f" {plan.small(abs(seen), '.1g')} between them: switch it off there, state it in active"
            " if it was on, or fit it anew beside the table."
        )


def with_one_zero(
    plan: "Plan", readings: Readings
) -> tuple[Readings, Int[np.ndarray, " t"] | None]:
    """Return readings of several measurements as if all had one zero, and whose each had.

    The table that goes through all of them determines a zero that is the instrument's (`remove`,
    `datum`). It becomes the machine's where one has that, else the mean of all. None: the zero
    of each is the machine's.
    """
    specs = plan.job.spec.measurements
    free = [name for name in readings.slices if specs[name].zeroed]
    if not free or len(readings.slices) < 2:
        return readings, None
    owner = np.zeros(len(readings.error), dtype=np.int64)
    for number, name in enumerate(free, start=1):
        owner[readings.slices[name]] = number
    branch = plan.branch(readings.direction)
    try:
        fit = fit_table(
            plan.table.layout,
            Samples(readings.positions, readings.error, branch, run=owner),
            smoothness=plan.fit.smoothness,
            loss=plan.fit.loss,
            run_effects="offset",
            allow_gaps=True,
        )
    except FitError:  # so few readings that none tells the zero of another
        return readings, None
    offset = {run.run: run.offset for run in fit.runs}
    zero = np.array([offset[number] for number in owner.tolist()])
    zero -= zero.mean() if len(free) == len(readings.slices) else offset[0]
    return dataclasses.replace(readings, error=readings.error - zero), owner


def zero_at(
    readings: Readings, datum: tuple[float, ...] | None, table: AbstractTable
) -> float:
    """Return the error where it is to be zero: median of the readings nearest to it.

    Both directions count alike; 0 without a datum.
    """
    if datum is None:
        return 0.0
    reach = [0.5 * np.diff(nodes.positions).min() for nodes in table.nodes]
    distance = np.max(np.abs(readings.positions - datum) / reach, axis=1)
    nearest = distance <= max(1.0, float(distance.min()))
    if readings.direction is None or table.branches == 1:
        return float(np.median(readings.error[nearest]))
    masks = [nearest & (readings.direction == sign) for sign in (1, -1)]
    return float(np.mean([np.median(readings.error[at]) for at in masks if at.any()]))


def run_table(readings: Readings, table: AbstractTable) -> RunTable | None:
    """Return how the readings lie in a run table of ISO 230-2, or None.

    Only errors along the axis itself, at targets that come back, make one.
    """
    if table.masters != (table.axis,) or readings.run is None:
        return None
    target = readings.positions[:, 0]
    if 2 * len(np.unique(target)) > len(target):
        return None
    direction = readings.direction
    if direction is None:
        direction = np.ones(len(target), dtype=np.int64)
    return RunTable(target, readings.run, direction)


def datum_of(job: Job, index: int, fit: FitSpec) -> tuple[float, ...] | None:
    """Return where the error of a fit is zero, per master, or None.

    Raises:
        JobError: If its measurements differ, or it has not one position per master.
    """
    datums = {name: job.spec.measurements[name].datum for name in fit.sources}
    places = {
        name: tuple(map(float, datum.at if isinstance(datum.at, list) else [datum.at]))
        for name, datum in datums.items()
        if datum is not None
    }
    if not places:
        return None
    name, place = next(iter(places.items()))
    # A zero that is the instrument's is told by the table that goes through all of them.
    machine = any(
        job.spec.measurements[name].remove == "none"
        for name in datums
        if name not in places
    )
    if len(set(places.values())) > 1 or machine:
        words = (
            "found measurements with different datums, expected the same one for all"
        )
        raise job.error(("fits", index), f"{words} that are joined")
    count = len(fit.over)
    if len(place) != count:
        raise job.error(
            ("measurements", name, "datum", "at"),
            f"found {len(place)} position{'s' * (len(place) > 1)}, expected {count} for the"
            f" {fit.compensation} fit of {fit.axis}",
        )
    axes = job.spec.axes
    return tuple(
        float(axes[name].in_turn(np.asarray(each)))
        for name, each in zip(fit.over, place, strict=True)
    )

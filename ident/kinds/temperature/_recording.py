"""What was measured for a thermal line: its readings, and which of them are any."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...fit import FitError
from ...fit.joint import Temperature
from ...job.joint._recording import GroupRecording, folds, read_group
from ...job.result._result import Remark
from ...readings import sensor_name

if TYPE_CHECKING:
    from .plan import TemperaturePlan

FEWEST = 4
"""Readings of a fit, and between two nodes below which no node is set."""
_RANGE = 0.5
"""Range of a sensor in K below which no law is determined."""


def read_thermal(
    plan: "TemperaturePlan",
) -> tuple[GroupRecording, Int[np.ndarray, " n"]]:
    """Return the readings of a temperature fit, all its measurements joined.

    Returns:
        The recording; and the rows that count, which are all but where a plateau is asked for.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        FitError: If there is no plateau where one is asked for.
        JobError: If the measurements do not suit each other.
    """
    group = read_group(plan.tables, [plan])
    data, rows, remarks = group.data, np.arange(len(group.data)), [*group.remarks]
    time = None
    if data.time is not None and data.clock_number is None:
        time = data.time - np.nanmin(data.time)
    else:
        words = (
            "The rows have no time in common: they are taken in their order, and a lag behind the"
            " sensor cannot be seen."
        )
        remarks.append(Remark.info(words))
    data = dataclasses.replace(data, time=time)
    if (plateau := plan.fit.steady) is not None:
        name = sensor_name(plateau.sensor)
        warm = data.temperature[name]
        try:
            keep = steady(data.order, warm, plateau.within, plateau.level)
        except FitError as error:
            msg = f"steady: {plateau.sensor}: {error}"
            raise FitError(msg) from None
        sentence = (
            f"Only the {int(keep.sum())} of {len(keep)} readings count that were taken"
            f" while {name} stayed at {float(np.median(warm[keep])):.4g} °C within"
            f" ±{plateau.within:g} K (steady)."
        )
        remarks.append(Remark.info(sentence))
        rows = np.flatnonzero(keep)
    return dataclasses.replace(group, data=data, remarks=tuple(remarks)), rows


def only_these(
    recording: GroupRecording, rows: Int[np.ndarray, " n"]
) -> GroupRecording:
    """Return a recording with errors in some rows only: lags remember the others."""
    (axis, error), *_ = recording.data.error.items()
    errors = np.full(len(error), np.nan)
    errors[rows] = error[rows]
    fold = recording.fold.copy()
    if not recording.by_run:
        fold[rows], _ = folds(None, recording.data.order[rows])
    data = dataclasses.replace(recording.data, error={axis: errors})
    return dataclasses.replace(recording, data=data, fold=fold)


def steady(
    time: Float[np.ndarray, " t"],
    value: Float[np.ndarray, " t"],
    within: float,
    level: float | None = None,
) -> Bool[np.ndarray, " t"]:
    """Return the readings of the longest plateau of a signal: heating done, load constant.

    Args:
        time: In s, ascending.
        value: Of the signal that is to be steady (a heater, a spindle), NaN = missed.
        within: Largest distance from the level.
        level: Of the plateau; None = the most frequent one.

    Raises:
        FitError: If there is none.
    """
    finite = np.isfinite(value)
    if level is None and finite.any():
        ordered = np.sort(value[finite])
        # The densest half: a plateau is where the signal spends its time.
        half = max(len(ordered) // 2, 1)
        width = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
        first = int(np.argmin(width))
        level = float(np.median(ordered[first : first + half]))
    inside = finite & (np.abs(value - (0.0 if level is None else level)) <= within)
    # A lone reading outside does not end a plateau.
    bridged = inside.copy()
    bridged[1:-1] |= inside[:-2] & inside[2:]
    masked = np.ma.array(value, mask=bridged)
    stretches: list[slice] = np.ma.clump_masked(masked)  # type: ignore[no-untyped-call]
    if not stretches:
        msg = f"no reading lies within ±{within:g} of a plateau, expected a steady stretch."
        raise FitError(msg)
    longest = max(stretches, key=lambda rows: float(np.ptp(time[rows])))
    result = np.zeros(len(value), bool)
    result[longest] = inside[longest]
    return result


def about_runs(
    values: Float[np.ndarray, "t *p"], run: Int[np.ndarray, " t"]
) -> Float[np.ndarray, "t *p"]:
    """Return values less the mean of their run."""
    _, index, count = np.unique(run, return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, index, values)
    means = sums / count.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(values - means[index])


def complete_rows(
    line: Temperature, data: JointData, rows: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " t"]:
    """Return which of some rows have all that a line needs, in order of time.

    Raises:
        FitError: If they cannot tell what is asked for.
    """
    columns = [data.column(*key, line.name) for key in line.inputs]
    error = data.column("error", line.axis, line.name)
    complete = np.asarray(np.isfinite([error, data.order, *columns]).all(axis=0))
    usable = rows[complete[rows]]
    if len(usable) < FEWEST:
        msg = (
            f"{len(usable)} of {len(rows)} readings are complete, expected at least"
            f" {FEWEST}."
        )
        raise FitError(msg)
    for sensor in line.sensor_names:
        # What a noisy sensor shows of a temperature that stays is no range.
        low, high = np.percentile(data.temperature[sensor][usable], [1.0, 99.0])
        if high - low < _RANGE:
            msg = (
                f"{sensor} stays at {0.5 * (low + high):.4g} °C within {high - low:.2g} K,"
                f" expected a range of {_RANGE:g} K or more."
            )
            raise FitError(msg)
    for axis in line.masters:
        place = data.position[axis][usable]
        if np.ptp(place) == 0.0:
            first = line.sensor_names[0]
            msg = (
                f"found all readings at {place[0]:g} mm, expected two positions or more"
                f" for the coefficient, or sensors = {{ offset = {first!r} }}: at one position"
                " only the offset can be fitted"
            )
            raise FitError(msg)
    return np.asarray(usable[np.argsort(data.order[usable], kind="stable")])

"""What was measured for a thermal line, and what is asked of it."""

import dataclasses
import itertools
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...fit import FitError
from ...fit.joint import Temperature
from ...job.result._result import Remark
from ...job.table._readings import datum_of
from ...readings import sensor_name

if TYPE_CHECKING:
    from ...job.joint._recording import GroupRecording
    from .plan import TemperaturePlan


@dataclasses.dataclass(frozen=True)
class ThermalRecording:
    """Readings of one axis while temperatures changed.

    Attributes:
        data: Error, sensors, positions (or none) and instants (or None).
        rows: Which row of all measurements, one after the other, each reading was.
        line: What is fitted to them.
        datum: Where the instrument was set to zero at all temperatures, or None.
        remarks: What was taken for granted.
    """

    data: JointData
    rows: Int[np.ndarray, " t"]
    line: Temperature
    datum: float | None
    remarks: tuple[Remark, ...]


def read_thermal(plan: "TemperaturePlan") -> ThermalRecording:
    """Return the readings of a temperature fit, all its measurements joined.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        FitError: If there is no plateau where one is asked for.
        JobError: If the measurements do not suit each other.
    """
    from ...job.joint._recording import read_group  # takes long to load

    group = read_group(plan.tables, [plan])
    time, words = _one_clock(group)
    remarks = [*group.remarks, *map(Remark.info, words)]
    data = dataclasses.replace(group.data, time=time)
    rows, datum = np.arange(len(data)), datum_of(plan.job, plan.index, plan.fit)
    if (asked := plan.fit.steady) is not None:
        name = sensor_name(asked.sensor)
        clock = rows.astype(float) if time is None else time
        warm = data.temperature[name]
        try:
            keep = steady(clock, warm, asked.within, asked.level)
        except FitError as error:
            msg = f"steady: {asked.sensor}: {error}"
            raise FitError(msg) from None
        told = (
            f"Only the {int(keep.sum())} of {len(keep)} readings count that were taken"
            f" while {name} stayed at {float(np.median(warm[keep])):.4g} °C within"
            f" ±{asked.within:g} K (steady)."
        )
        remarks.append(Remark.info(told))
        data, rows = data.take(keep), rows[keep]
    line = plan.line(data)
    if datum is not None and "coefficient" in line.sensors:
        # The instrument was set to zero there: what the offset does, nobody saw.
        only = {"coefficient": line.sensors["coefficient"]}
        line = dataclasses.replace(line, sensors=only, reference=datum[0])
    zero = None if datum is None else datum[0]
    return ThermalRecording(data, rows, line, zero, tuple(remarks))


def _one_clock(
    group: "GroupRecording",
) -> tuple[Float[np.ndarray, " t"] | None, tuple[str, ...]]:
    """Return the instants of all measurements, where they follow each other; else why not."""
    time, order = group.data.time, "The rows have no time"
    if time is not None:
        parts = [time[rows] for rows in group.slices.values()]
        if all(np.nanmax(a) < np.nanmin(b) for a, b in itertools.pairwise(parts)):
            return time - np.nanmin(time), ()
        order = "The clocks of the measurements do not follow each other"
    rest = "rows are taken in their order, and a lag behind the sensor cannot be seen."
    return None, (f"{order}: {rest}",)


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
    known = np.isfinite(value)
    if level is None and known.any():
        ordered = np.sort(value[known])
        # The densest half: a plateau is where the signal spends its time.
        half = max(len(ordered) // 2, 1)
        width = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
        first = int(np.argmin(width))
        level = float(np.median(ordered[first : first + half]))
    inside = known & (np.abs(value - (0.0 if level is None else level)) <= within)
    # A lone reading outside does not end a plateau.
    bridged = inside.copy()
    bridged[1:-1] |= inside[:-2] & inside[2:]
    masked = np.ma.array(value, mask=bridged)
    stretches: list[slice] = np.ma.clump_masked(masked)  # type: ignore[no-untyped-call]
    if not stretches:
        msg = f"no reading lies within ±{within:g} of a plateau, expected a steady stretch."
        raise FitError(msg)
    longest = max(stretches, key=lambda own: float(np.ptp(time[own])))
    result = np.zeros(len(value), bool)
    result[longest] = inside[longest]
    return result

"""Complete readings in order of time, out of what was handed in."""

import numpy as np
from jaxtyping import Bool, Int

from ...core._errors import FitError
from ._line import Data
from ._steady import missed_temperatures
from ._types import SensorLog, ThermalReadings

LEAST_RANGE = 0.5
"""Range of a sensor in K below which no law can be told."""


def complete_rows(
    readings: ThermalReadings,
    offset_sensor: int | None,
    coefficient_sensor: int | None,
    own_log: bool,
) -> Bool[np.ndarray, " t"]:
    """Return the rows of which nothing is missing, after the arguments are checked."""
    sensors = readings.temperature.shape[1]
    used = [s for s in (offset_sensor, coefficient_sensor) if s is not None]
    if not used:
        msg = "no sensor is given, expected one for the offset or for the coefficient."
        raise FitError(msg)
    for sensor in used:
        if not 0 <= sensor < sensors:
            msg = (
                f"found sensor {sensor + 1} of {sensors}, expected one that was logged."
            )
            raise FitError(msg)
    if coefficient_sensor is not None and readings.position is None:
        msg = (
            "a coefficient needs the position of every reading; without positions only "
            "the offset can be fitted."
        )
        raise FitError(msg)
    keep = np.isfinite(readings.error)
    for values in (readings.position, readings.time):
        if values is not None:
            keep &= np.isfinite(values)
    for sensor in used if own_log else ():
        keep &= ~missed_temperatures(readings.temperature[:, sensor])
    return np.asarray(keep)


def ordered_data(
    readings: ThermalReadings,
    keep: Bool[np.ndarray, " t"],
    offset_sensor: int | None,
    coefficient_sensor: int | None,
    log: SensorLog | None,
) -> tuple[Data, Int[np.ndarray, " r"]]:
    """Return the complete readings in order of time, and the rows where they stood."""
    rows = np.flatnonzero(keep)
    clock = (
        np.arange(len(keep), dtype=float) if readings.time is None else readings.time
    )
    rows = rows[np.argsort(clock[rows], kind="stable")]
    position = readings.position
    if log is None:
        log = SensorLog(clock[rows], readings.temperature[rows])
    else:
        log = _clean(log)
    data = Data(
        readings.error[rows],
        np.zeros(len(rows)) if position is None else position[rows],
        clock[rows],
        log,
        (offset_sensor, coefficient_sensor),
    )
    inside = np.asarray(np.isfinite(data.structure((0.0, 0.0))).all(axis=0))
    keep[rows[~inside]] = False
    return data.take(inside), rows[inside]


def _clean(log: SensorLog) -> SensorLog:
    temperature = log.temperature.copy()
    for column in temperature.T:
        column[missed_temperatures(column)] = np.nan
    order = np.argsort(log.time, kind="stable")
    return SensorLog(log.time[order], temperature[order])


def check_data(data: Data, readings: ThermalReadings) -> None:
    count = len(data.error)
    if count < 4:
        msg = f"{count} of {len(readings.error)} readings are complete, expected at least 4."
        raise FitError(msg)
    theta = data.structure((0.0, 0.0))
    for effect, sensor, values in zip(
        ("offset", "coefficient"), data.sensors, theta, strict=True
    ):
        if sensor is not None and np.ptp(values) < LEAST_RANGE:
            msg = (
                f"sensor {sensor + 1} of the {effect} stays at {values[0]:.4g} °C within "
                f"{np.ptp(values):.2g} K, expected a range of {LEAST_RANGE} K or more."
            )
            raise FitError(msg)
    if data.sensors[1] is not None and np.ptp(data.position) == 0:
        msg = (
            f"all readings stand at {data.position[0]:g} mm: a coefficient needs two "
            "positions or more; at one position only the offset can be fitted."
        )
        raise FitError(msg)

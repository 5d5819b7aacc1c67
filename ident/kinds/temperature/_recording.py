"""What was measured for a temperature fit: errors, places, temperatures, instants."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.measurements import (
    Measurement,
    MeasurementError,
    MissingRole,
    derive_error,
    without_motion,
)
from ...fit import FitError
from ...job._remove import without_zero
from ...job._result import Remark
from ...job._source import ABSURD, Tables, measured_for
from .effect import ThermalReadings, steady
from .keys import Effect, Spec

_SENSOR = "temperature."


@dataclasses.dataclass(frozen=True)
class ThermalRecording:
    """Readings of one axis while temperatures changed.

    Attributes:
        readings: Error, sensors, positions (or None) and instants (or None).
        rows: Which row of all measurements, one after the other, each reading was.
        sensors: Names of the sensors, as columns of the temperatures.
        effects: Number of the sensor of each effect that is fitted.
        datum: Where the instrument was set to zero at all temperatures, or None.
        reference_temperature: In °C, at which nothing is to be corrected.
        remarks: What was taken for granted.
        carriers: Tables of the same group, which hold what no temperature moves; None
            where the line is fitted alone.
    """

    readings: ThermalReadings
    rows: Int[np.ndarray, " t"]
    sensors: tuple[str, ...]
    effects: dict[Effect, int]
    datum: float | None
    reference_temperature: float
    remarks: tuple[Remark, ...]
    carriers: tuple[str, ...] | None = None


def sensor_name(text: str) -> str:
    """Return the name of a sensor, given with or without ``temperature.``."""
    return text.removeprefix(_SENSOR)


def read_thermal(tables: Tables, fit: Spec) -> ThermalRecording:
    """Return the readings of a temperature fit, all its measurements joined.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        FitError: If there is no plateau where one is asked for.
        JobError: If the measurements do not suit each other.
    """
    effects = fit.effects
    remarks: list[Remark] = []
    parts = []
    for name in fit.sources:
        measured = measured_for(tables, name, fit, (fit.axis,))
        measured = without_motion(measured, [fit.axis]).with_gaps()
        remarks += [Remark.info(words) for words in measured.remarks]
        if effects is None:
            only = only_sensor(measured, fit.axis)
            effects = _both(only)
        parts.append(_part(tables, name, measured, fit, effects))
    assert effects is not None  # there is at least one measurement
    names = tuple(dict.fromkeys(sensor_name(each) for each in effects.values()))
    time, words = _one_clock([part.time for part in parts])
    remarks += words
    places = [part.position for part in parts if part.position is not None]
    readings = ThermalReadings(
        np.concatenate([part.error for part in parts]),
        np.concatenate([part.temperature for part in parts]),
        np.concatenate(places) if places else None,
        time,
    )
    rows = np.arange(len(readings.error))
    if fit.steady is not None:
        plateau = np.concatenate([part.plateau for part in parts])
        keep = _plateau(fit, plateau, time)
        remarks.append(_plateau_words(fit, plateau, keep))
        readings, rows = readings.take(keep), rows[keep]
    datum, reference = _common(tables, fit)
    numbers: dict[Effect, int] = {}
    for effect, sensor in effects.items():
        numbers[effect] = names.index(sensor_name(sensor))
    return ThermalRecording(
        readings=readings,
        rows=rows,
        sensors=names,
        effects=numbers,
        datum=datum,
        reference_temperature=reference,
        remarks=tuple(remarks),
    )


@dataclasses.dataclass(frozen=True)
class _Part:
    """Readings of one measurement."""

    error: Float[np.ndarray, " t"]
    temperature: Float[np.ndarray, "t s"]
    position: Float[np.ndarray, " t"] | None
    time: Float[np.ndarray, " t"] | None
    plateau: Float[np.ndarray, " t"]


def _part(
    tables: Tables,
    name: str,
    measured: Measurement,
    fit: Spec,
    effects: dict[Effect, str],
) -> _Part:
    why = f"for the temperature fit of {fit.axis}"
    names = dict.fromkeys(sensor_name(each) for each in effects.values())
    temperature = np.stack(
        [measured.require(_SENSOR + each, why) for each in names], axis=1
    ).astype(float)
    error = np.array(derive_error(measured, fit.axis), dtype=float)
    error[np.abs(error) > ABSURD] = np.nan
    position = None
    if "coefficient" in effects:
        position = measured.get(f"{fit.axis}.position")
        if position is None:
            raise MissingRole(
                str(measured.source),
                f"{fit.axis}.position",
                f"{why}, or sensors = {{ offset = … }} where the error was measured at"
                " one position",
                measured.values.keys(),
            )
        position = np.asarray(position, dtype=float)
    known = np.isfinite(error)
    places = np.zeros(len(error)) if position is None else position
    known &= np.isfinite(places)
    remove = tables.job.spec.measurements[name].remove
    if known.any():
        error[known] = without_zero(error[known], places[known, None], remove)
    plateau = np.zeros(len(error))
    if fit.steady is not None:
        role = _SENSOR + sensor_name(fit.steady.sensor)
        plateau = np.asarray(measured.require(role, "for steady"), dtype=float)
    return _Part(error, temperature, position, measured.get("time"), plateau)


def _both(sensor: str) -> dict[Effect, str]:
    return {"offset": sensor, "coefficient": sensor}


def only_sensor(measured: Measurement, axis: str) -> str:
    """Return the role of the only sensor.

    Raises:
        MeasurementError: If there is none, or several.
    """
    found = [role for role in measured.values if role.startswith(_SENSOR)]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(found) or "no temperature"
    reason = (
        f"found {listed}, expected sensor = the one that the error of {axis} follows"
    )
    raise MeasurementError(str(measured.source), reason)


def _one_clock(
    times: list[np.ndarray | None],
) -> tuple[np.ndarray | None, list[Remark]]:
    """Return the instants of all measurements, where they follow each other."""
    known = [np.asarray(time, dtype=float) for time in times if time is not None]
    if len(known) < len(times):
        return None, [
            Remark.info(
                "The rows have no time: they are taken in the order of the file, and a"
                " lag behind the sensor cannot be seen."
            )
        ]
    for before, after in itertools.pairwise(known):
        if not np.nanmax(before) < np.nanmin(after):
            return None, [
                Remark.info(
                    "The clocks of the measurements do not follow each other: rows are"
                    " taken in the order of the job, and a lag behind the sensor cannot"
                    " be seen."
                )
            ]
    time = np.concatenate(known)
    return time - np.nanmin(time), []


def _plateau(
    fit: Spec,
    values: Float[np.ndarray, " t"],
    time: Float[np.ndarray, " t"] | None,
) -> Bool[np.ndarray, " t"]:
    asked = fit.steady
    assert asked is not None  # the caller has seen to it
    clock = np.arange(len(values), dtype=float) if time is None else time
    try:
        return np.asarray(steady(clock, values, asked.within, asked.level))
    except FitError as error:
        msg = f"steady: {asked.sensor}: {error}"
        raise FitError(msg) from None


def _plateau_words(
    fit: Spec,
    values: Float[np.ndarray, " t"],
    keep: Bool[np.ndarray, " t"],
) -> Remark:
    assert fit.steady is not None
    level = float(np.median(values[keep]))
    return Remark.info(
        f"Only the {int(keep.sum())} of {len(keep)} readings count that were taken while"
        f" {sensor_name(fit.steady.sensor)} stayed at {level:.4g} °C within"
        f" ±{fit.steady.within:g} K (steady)."
    )


def _common(tables: Tables, fit: Spec) -> tuple[float | None, float]:
    """Return datum and reference temperature, which all measurements share."""
    specs = [tables.job.spec.measurements[name] for name in fit.sources]
    datums = {None if spec.datum is None else _first(spec.datum.at) for spec in specs}
    warmth = {spec.reference_temperature for spec in specs}
    if len(datums) > 1 or len(warmth) > 1:
        what = "datums" if len(datums) > 1 else "reference temperatures"
        raise MeasurementError(
            ", ".join(fit.sources),
            f"found measurements with different {what}, expected the same one for all"
            " that are joined",
        )
    return datums.pop(), warmth.pop()


def _first(at: float | list[float]) -> float:
    return float(at[0] if isinstance(at, list) else at)

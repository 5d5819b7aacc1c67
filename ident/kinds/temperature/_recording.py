"""What was measured for a temperature fit: errors, places, temperatures, instants."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.measurements import Measurement, MeasurementError
from ...fit import FitError
from ...job._result import Remark
from ...readings import Rows, Tables, joined, sensor_name
from .effect import ThermalReadings, steady
from .keys import Effect, Spec


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


def read_thermal(tables: Tables, fit: Spec) -> ThermalRecording:
    """Return the readings of a temperature fit, all its measurements joined.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        FitError: If there is no plateau where one is asked for.
        JobError: If the measurements do not suit each other.
    """
    effects: dict[Effect, str] | None = fit.effects
    remarks: list[Remark] = []
    parts: list[tuple[Rows, ThermalReadings]] = []
    for name in fit.sources:
        measured = tables.measured(name, fit.axis, (fit.axis,))
        rows = Rows(tables.job, name, measured, [fit.axis], gaps=True)
        if effects is None:
            only = only_sensor(rows.measured, fit.axis)
            effects = {"offset": only, "coefficient": only}
        parts.append((rows, _part(rows, fit, effects)))
        remarks += map(Remark.info, rows.remarks)
    assert effects is not None  # there is at least one measurement
    names = tuple(dict.fromkeys(sensor_name(each) for each in effects.values()))
    time, words = _one_clock([rows.time for rows, _ in parts])
    remarks += words
    readings = ThermalReadings(
        np.concatenate([part.error for _, part in parts]),
        np.concatenate([part.temperature for _, part in parts]),
        joined([part.position for _, part in parts]),
        time,
    )
    kept = np.arange(len(readings.error))
    if fit.steady is not None:
        sensor = fit.steady.sensor
        plateau = [rows.temperature(sensor, "for steady") for rows, _ in parts]
        keep, said = _plateau(fit, np.concatenate(plateau), time)
        remarks.append(said)
        readings, kept = readings.take(keep), kept[keep]
    datum, reference = _common(tables, fit)
    numbers: dict[Effect, int] = {}
    for effect, sensor in effects.items():
        numbers[effect] = names.index(sensor_name(sensor))
    return ThermalRecording(
        readings=readings,
        rows=kept,
        sensors=names,
        effects=numbers,
        datum=datum,
        reference_temperature=reference,
        remarks=tuple(remarks),
    )


def _part(rows: Rows, fit: Spec, effects: dict[Effect, str]) -> ThermalReadings:
    """Return the readings of one measurement."""
    why = f"for the temperature fit of {fit.axis}"
    names = dict.fromkeys(sensor_name(each) for each in effects.values())
    temperature = np.stack([rows.temperature(each, why) for each in names], axis=1)
    position = None
    if "coefficient" in effects:
        why += (
            ", or sensors = { offset = … } where the error was measured at one position"
        )
        position = rows.position(fit.axis, why)
    places = {} if position is None else {fit.axis: position}
    error = rows.error(fit.axis, places, lengths=False)
    return ThermalReadings(error, temperature, position, None)


def only_sensor(measured: Measurement, axis: str) -> str:
    """Return the role of the only sensor.

    Raises:
        MeasurementError: If there is none, or several.
    """
    found = [role for role in measured.values if sensor_name(role) != role]
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
    known = [time for time in times if time is not None]
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
    fit: Spec, values: Float[np.ndarray, " t"], time: Float[np.ndarray, " t"] | None
) -> tuple[Bool[np.ndarray, " t"], Remark]:
    """Return which readings were taken while a temperature stayed, and say so."""
    asked = fit.steady
    assert asked is not None  # the caller has seen to it
    clock = np.arange(len(values), dtype=float) if time is None else time
    try:
        keep = np.asarray(steady(clock, values, asked.within, asked.level))
    except FitError as error:
        msg = f"steady: {asked.sensor}: {error}"
        raise FitError(msg) from None
    level = float(np.median(values[keep]))
    words = (
        f"Only the {int(keep.sum())} of {len(keep)} readings count that were taken while"
        f" {sensor_name(asked.sensor)} stayed at {level:.4g} °C within"
        f" ±{asked.within:g} K (steady)."
    )
    return keep, Remark.info(words)


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

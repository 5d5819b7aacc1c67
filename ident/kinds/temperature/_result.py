"""What a job found of the thermal line of an axis."""

import dataclasses
from typing import Any, final

import numpy as np
from jaxtyping import Float

from ...job.result._result import AbstractResult, Expectation
from ._law import RATE, ThermalLaw
from ._line import Law, TemperatureFit


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class TemperatureResult(AbstractResult):
    """The thermal line of an axis.

    Errors are one per complete reading, against the state at the temperature where nothing is
    corrected: what the axis shows there belongs to its tables.

    Attributes:
        reference: Position where the line turns, in mm (P-AXIS-00272).
        zero: Temperature in °C at which nothing is corrected.
        law: As written; None where nothing is.
        fit: The estimate as it stands, with its readings.
        cycles: Of the sin² filter (P-AXIS-00275).
        before: Error in mm.
        predicted: Error left under the line fitted to the other blocks of time.
        from_file: Error left under the files as written, by the controller's rules.
    """

    reference: float
    zero: float
    law: ThermalLaw | None
    fit: TemperatureFit
    cycles: int
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    from_file: Float[np.ndarray, " t"]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors, as columns of the temperatures."""
        return self.fit.sensors

    @property
    def expectation(self) -> Expectation | None:
        """The largest correction of the written line at a place that was measured."""
        added, places = self.from_file - self.before, self.fit.position
        row = int(np.argmax(np.abs(added)))
        warm = self.fit.structure[row].tolist()
        return Expectation(
            {} if places is None else {self.axis: float(places[row])},
            None,
            float(added[row]),
            self.unit,
            temperatures=dict(zip(self.sensors, warm, strict=True)),
        )

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        found, law = self.fit, self.law
        table = spread = None
        if law is not None:
            table, spread = law.columns, law.deviations
        slope, slope_deviation = found.offset.slope
        return {
            "parameters": {
                "position_0": self.reference,
                "temperature_0": self.zero,
                "table": table,
                "intersects": found.intersects,
                "meeting": found.meeting,
                "n_cycles": self.cycles,
                "rate": RATE,
                "offset": _law(found.offset, 1.0),
                "coefficient": _law(found.coefficient, 1e6),
                "offset_per_kelvin": slope,
                "lags": [
                    {**vars(lag), "interval": lag.interval, "applied": lag.applied}
                    for lag in found.lags
                ],
            },
            "standard_deviations": {
                "table": spread,
                "position_0": found.reference_deviation,
                "offset_per_kelvin": slope_deviation,
            },
            "support": dict(zip(found.line.labels, found.support, strict=True)),
            "noise": found.noise.white,
            "drift": found.noise.drift,
            "drift_time": found.noise.time_constant,
            "independent": found.independent,
            "converged": found.converged,
            "wild": int(found.wild.sum()),
            "missed": found.missed,
        }


def _law(law: Law | None, factor: float) -> Any:
    """Return a law of the error: its sensor, nodes in °C, values in mm or µm/m."""
    if law is None:
        return None
    return {
        "sensor": law.sensor,
        "kind": law.kind,
        "temperature": law.temperature,
        "error": factor * law.value,
        "standard_deviation": factor * law.deviation_at(law.temperature),
    }

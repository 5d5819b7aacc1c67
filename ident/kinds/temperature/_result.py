"""What a job found of the thermal line of an axis."""

import dataclasses
import functools
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...job.result._result import AbstractResult, Expectation
from ._law import RATE, ThermalLaw
from .fit import Law, TemperatureFit


@dataclasses.dataclass(frozen=True)
class ThermalView:
    """The complete readings with what became of them; one row per reading.

    Errors are against the state at the temperature where nothing is corrected: what the
    axis shows there belongs to its tables.

    Attributes:
        row: Of all measurements, one after the other, from 0.
        time: In s, or None.
        position: In mm, or None.
        temperature: Of each sensor in °C.
        structure: The same behind its lag.
        before: Error in mm.
        predicted: Error left under the line fitted to the other blocks of time.
        from_file: Error left under the files as written, by the controller's rules.
        wild: Readings that the loss rejected.
    """

    row: Int[np.ndarray, " t"]
    time: Float[np.ndarray, " t"] | None
    position: Float[np.ndarray, " t"] | None
    temperature: Float[np.ndarray, "t s"]
    structure: Float[np.ndarray, "t s"]
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    from_file: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class TemperatureResult(AbstractResult):
    """The thermal line of an axis.

    Attributes:
        reference: Position where the line turns, in mm (P-AXIS-00272).
        zero: Temperature in °C at which nothing is corrected.
        law: As written; None where nothing is.
        fit: The estimate as it stands.
        cycles: Of the sin² filter (P-AXIS-00275).
        view: The readings before and after.
    """

    reference: float
    zero: float
    law: ThermalLaw | None
    fit: TemperatureFit
    cycles: int
    view: ThermalView

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors, as columns of the temperatures."""
        return self.fit.sensors

    @functools.cached_property
    def relative(self) -> TemperatureFit:
        """The estimate, zero at that temperature; sign of the error."""
        return self.fit.relative_to(self.zero)

    @property
    def expectation(self) -> Expectation | None:
        """The largest correction of the written line at a place that was measured."""
        view = self.view
        added = view.from_file - view.before
        row = int(np.argmax(np.abs(added)))
        place = 0.0 if view.position is None else float(view.position[row])
        return Expectation(
            {} if view.position is None else {self.axis: place},
            None,
            float(added[row]),
            self.unit,
            temperatures=dict(
                zip(self.sensors, view.structure[row].tolist(), strict=True)
            ),
        )

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        found, law = self.fit, self.law
        table = None if law is None else law.columns
        spread = None
        if law is not None:
            spread = {
                "offset_0": law.offset_deviation,
                "coefficient": law.coefficient_deviation,
            }
        slope, slope_deviation = found.slope
        return {
            "parameters": {
                "position_0": self.reference,
                "temperature_0": self.zero,
                "table": table,
                "intersects": found.intersects,
                "meeting": found.meeting,
                "n_cycles": self.cycles,
                "rate": RATE,
                "offset": _law(found.offset, self.sensors, 1.0),
                "coefficient": _law(found.coefficient, self.sensors, 1e6),
                "offset_per_kelvin": slope,
                "lags": [
                    vars(lag) | {"sensor": self.sensors[lag.sensor]}
                    for lag in found.lags
                ],
            },
            "standard_deviations": {
                "table": spread,
                "position_0": found.reference_deviation,
                "offset_per_kelvin": slope_deviation,
            },
            "support": dict(zip(found.names, found.support, strict=False)),
            "noise": found.noise.white,
            "drift": found.noise.drift,
            "drift_time": found.noise.time_constant,
            "independent": found.independent,
            "laws": [vars(score) for score in found.scores],
            "confounded": [vars(pair) for pair in found.confounded],
            "converged": found.converged,
            "wild": int(found.wild.sum()),
            "missed": int((~found.used).sum()),
        }


def _law(law: Law | None, sensors: tuple[str, ...], factor: float) -> Any:
    """Return a law of the error: its sensor, nodes in °C, values in mm or µm/m."""
    if law is None:
        return None
    return {
        "sensor": sensors[law.sensor],
        "kind": law.kind,
        "temperature": law.temperature,
        "error": factor * law.value,
        "standard_deviation": factor * law.standard_deviation,
    }

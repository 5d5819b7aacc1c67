"""Temperature: errors over position and temperature in, the thermal line out."""

from ._clock import (
    ClockOffset as ClockOffset,
    clock_offset as clock_offset,
    join_logs as join_logs,
)
from ._fit import fit_temperature as fit_temperature
from ._lag import lagged as lagged
from ._prepare import LEAST_RANGE as LEAST_RANGE
from ._steady import missed_temperatures as missed_temperatures, steady as steady
from ._types import (
    Confusion as Confusion,
    Lag as Lag,
    Law as Law,
    LawScore as LawScore,
    SensorLog as SensorLog,
    TemperatureFit as TemperatureFit,
    ThermalReadings as ThermalReadings,
)

"""Temperature as a job handles every compensation: a law for the PLC beside the axis list."""

from .._plc_names import temperature_names as temperature_names
from ._draft import plan_temperature as plan_temperature
from ._result import (
    TemperatureResult as TemperatureResult,
    ThermalView as ThermalView,
)
from ._table import ThermalLaw as ThermalLaw

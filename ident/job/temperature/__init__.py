"""Temperature as a job handles every compensation: a law for the PLC beside the axis list."""

from .._plc_names import temperature_names as temperature_names
from ._draft import (
    TemperatureDraft as TemperatureDraft,
    plan_temperature as plan_temperature,
    refuse_unstated_law as refuse_unstated_law,
    zero_of as zero_of,
)
from ._identify import Identified as Identified, drift_instead as drift_instead
from ._recording import (
    ThermalRecording as ThermalRecording,
    only_sensor as only_sensor,
    sensor_name as sensor_name,
)
from ._result import (
    TemperatureResult as TemperatureResult,
    ThermalView as ThermalView,
)
from ._table import ThermalLaw as ThermalLaw

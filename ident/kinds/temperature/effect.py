"""Temperature: errors over position and temperature in, the thermal line out.

Read in this order: `_types` (what goes in and comes out),
`_structure` (the temperature behind a sensor: the one first-order lag), `_line` (readings in
order, and the line fitted to them), `_choice` (law, lag and intersection by readings left
out), `_fit` (`fit_temperature`: all of it in order, and what the readings confuse).
"""

from ...fit.joint._temperature import LAWS as LAWS
from ._fit import LawKey as LawKey, fit_temperature as fit_temperature
from ._line import LEAST_RANGE as LEAST_RANGE
from ._structure import (
    Clocked as Clocked,
    clocked as clocked,
    lagged as lagged,
    steady as steady,
)
from ._types import (
    Confusion as Confusion,
    Effect as Effect,
    Lag as Lag,
    Law as Law,
    LawScore as LawScore,
    Meeting as Meeting,
    TemperatureFit as TemperatureFit,
    ThermalReadings as ThermalReadings,
    laws_of as laws_of,
)

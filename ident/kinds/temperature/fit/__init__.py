"""The thermal line fitted alone: readings and what is asked for in, the line out.

To be read in this order: `_estimate` (what comes out), `_line` (readings in order of time, and
the line fitted to them by regression), `_choice` (law and lag by readings left out), `_meeting`
(where the lines of all temperatures meet, in a group as well), `_fit` (all of it).
"""

from ._estimate import (
    Confusion as Confusion,
    Effect as Effect,
    Lag as Lag,
    Law as Law,
    LawScore as LawScore,
    Meeting as Meeting,
    TemperatureFit as TemperatureFit,
)
from ._fit import fit_temperature as fit_temperature
from ._line import LEAST_RANGE as LEAST_RANGE
from ._meeting import about_meeting as about_meeting

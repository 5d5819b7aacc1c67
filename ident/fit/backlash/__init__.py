"""Backlash: bidirectional readings or reversals in, width with uncertainty out."""

from ._bidirectional import fit_backlash as fit_backlash
from ._spread import carried_by as carried_by, spread_cycles as spread_cycles
from ._trace import fit_backlash_trace as fit_backlash_trace
from ._turns import Turn as Turn, find_turns as find_turns
from ._types import (
    BacklashFit as BacklashFit,
    Dependence as Dependence,
    Reversal as Reversal,
)

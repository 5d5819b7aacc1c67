"""Backlash: readings from both directions or reversals of a trace in, the width out.

Read in this order: `_types` (what comes out), `_standstill` (readings approached from both
directions), `_trace` (reversals of a motion).
"""

from ._standstill import fit_backlash as fit_backlash
from ._trace import fit_backlash_trace as fit_backlash_trace
from ._types import (
    BacklashFit as BacklashFit,
    Dependence as Dependence,
    Reversal as Reversal,
)

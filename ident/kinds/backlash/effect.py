"""Backlash: readings from both directions or reversals of a trace in, the width out.

Read in this order: `_fit` (what comes out; readings approached from both directions),
`_trace` (reversals of a motion).
"""

from ._fit import (
    BacklashFit as BacklashFit,
    Dependence as Dependence,
    Reversal as Reversal,
    fit_backlash as fit_backlash,
)
from ._trace import fit_backlash_trace as fit_backlash_trace

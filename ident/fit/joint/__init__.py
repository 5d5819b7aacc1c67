"""Joint identification: any stack of effects fitted together, and what data can tell.

Readings are those of `ident._recording`. Read `_effect` (what an effect is; `_tables`,
`_temperature` and `_motion` have some), `_design` (their columns side by side, datum
and runs), `_gauge` (what may be moved between effects, and the rules for it), `_identified`
(what the rows cannot tell) with `_words`, `_axis` (one axis fitted on `ident.core`) with `_lag`
and `_memory` (noise that remembers), and `_fit` (what goes in and comes out).
"""

from ..._recording import JointData as JointData
from ._effect import (
    AbstractEffect as AbstractEffect,
    Number as Number,
    is_number as is_number,
    numbers_of as numbers_of,
)
from ._fit import (
    JointFit as JointFit,
    Part as Part,
    examine_design as examine_design,
    fit_joint as fit_joint,
    held_out_errors as held_out_errors,
)
from ._motion import Backlash as Backlash, Crosstalk as Crosstalk, Delay as Delay
from ._tables import (
    AbstractTable as AbstractTable,
    Cross as Cross,
    Leadscrew as Leadscrew,
    Plane as Plane,
)
from ._temperature import LAWS as LAWS, Temperature as Temperature
from ._words import Confusion as Confusion, Gauge as Gauge

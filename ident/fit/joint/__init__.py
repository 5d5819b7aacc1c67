"""Joint identification: any stack of effects fitted together, and what data can tell.

Read `_data` and `_effect` (what goes in; `_tables`, `_crosstalk` and `_temperature` are more
effects), `_design` (their columns side by side, datum and runs), `_axis` (one axis fitted on
`ident.core`) with `_lag`, `_gauge` (what may be moved between effects, and the rules for it),
`_identified` (what the rows cannot tell) with `_words`, and `_fit`, `_report`, `_result` (what
comes out).
"""

from ._crosstalk import CrosstalkEffect as CrosstalkEffect
from ._data import JointData as JointData
from ._effect import (
    AbstractEffect as AbstractEffect,
    BacklashEffect as BacklashEffect,
    Block as Block,
    DelayEffect as DelayEffect,
)
from ._fit import (
    examine_design as examine_design,
    fit_joint as fit_joint,
    refit_joint as refit_joint,
)
from ._result import (
    Determination as Determination,
    Identifiability as Identifiability,
    JointFit as JointFit,
    Part as Part,
    RunCurve as RunCurve,
)
from ._tables import (
    CrossEffect as CrossEffect,
    LeadscrewEffect as LeadscrewEffect,
    PlaneEffect as PlaneEffect,
)
from ._temperature import TemperatureEffect as TemperatureEffect
from ._words import Confusion as Confusion, Gauge as Gauge

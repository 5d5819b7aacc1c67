"""Joint identification: any stack of effects fitted together, and what data can tell."""

from ._backlash import BacklashEffect as BacklashEffect
from ._crosstalk import CrosstalkEffect as CrosstalkEffect
from ._data import JointData as JointData
from ._delay import DelayEffect as DelayEffect
from ._effect import AbstractEffect as AbstractEffect, Block as Block
from ._examine import examine_design as examine_design
from ._fit import fit_joint as fit_joint, refit_joint as refit_joint
from ._result import (
    Confusion as Confusion,
    Determination as Determination,
    Gauge as Gauge,
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

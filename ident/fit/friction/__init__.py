"""Friction: estimators from recordings of a drive; arrays in, law and uncertainty out."""

from ._batch import (
    StribeckBatch as StribeckBatch,
    fit_stribeck_batch as fit_stribeck_batch,
)
from ._choice import (
    Choice as Choice,
    choose_law as choose_law,
    default_structures as default_structures,
    force_error as force_error,
)
from ._compete import Candidate as Candidate
from ._inverse import fit_inverse as fit_inverse
from ._placement import Knots as Knots, place_knots as place_knots
from ._plateaus import (
    Plateaus as Plateaus,
    average_plateaus as average_plateaus,
    find_plateaus as find_plateaus,
)
from ._problem import Known as Known
from ._result import FrictionFit as FrictionFit
from ._samples import DriveSamples as DriveSamples
from ._static import fit_static as fit_static
from ._structure import AbstractStructure as AbstractStructure
from ._structures import CoulombViscous as CoulombViscous, Stribeck as Stribeck
from ._tables import (
    DirectionalTable as DirectionalTable,
    KnotTable as KnotTable,
    default_knots as default_knots,
)

"""Friction of a drive: from a recording of any motion to a law, and to the knots of a list.

Read in this order:

- `_samples`: what a drive recorded; `_structures`: kinds of law and their columns.
- `_equation`: a recording as rows of a linear equation; `_weights`: how much each counts.
- `_result`: `FrictionFit`, parameters, their deviations, and what the data do not tell.
- `_inverse`: the fit of a law by variable projection, and what the data carry of it.
- `_choice`: `choose_law`, which kind of law predicts windows held out.
- `_simulate`: a drive under a measured force; `_output_error`: `fit_output_error`.
- `_reversal`: `fit_reversal`, how friction changes over where an axis reverses.
- `_knots`: `place_knots`, the entries of a friction list.
"""

from ._choice import Candidate as Candidate, Choice as Choice, choose_law as choose_law
from ._knots import Knots as Knots, place_knots as place_knots
from ._output_error import (
    OutputErrorFit as OutputErrorFit,
    fit_output_error as fit_output_error,
    laws_held_out as laws_held_out,
)
from ._result import FrictionFit as FrictionFit, friction_of as friction_of
from ._reversal import ReversalFit as ReversalFit, fit_reversal as fit_reversal
from ._samples import DriveSamples as DriveSamples
from ._structures import (
    CoulombViscous as CoulombViscous,
    KnotTable as KnotTable,
    Stribeck as Stribeck,
    default_knots as default_knots,
)

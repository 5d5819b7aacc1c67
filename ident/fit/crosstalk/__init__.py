"""Crosstalk: master motion and slave error in, tests of modes 1 to 3 out."""

from ._events import cut_events as cut_events
from ._fit import fit_crosstalk as fit_crosstalk
from ._types import (
    BRANCHES as BRANCHES,
    CrosstalkFit as CrosstalkFit,
    CrosstalkReadings as CrosstalkReadings,
    Event as Event,
    ModeScore as ModeScore,
)

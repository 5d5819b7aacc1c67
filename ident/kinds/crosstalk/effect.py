"""Crosstalk: master motion and slave error in, tests of modes 1 to 3 out.

Read in this order: `_events` (accelerations cut out of a log, one value each), `_tests` (where
the tests stand, by events held out), `_fit` (`fit_crosstalk`: all of it in order, and the values
of the tests).
"""

from ._events import (
    BRANCHES as BRANCHES,
    CrosstalkReadings as CrosstalkReadings,
    Event as Event,
    cut_events as cut_events,
)
from ._fit import (
    MOST_TESTS as MOST_TESTS,
    SAFE_TESTS as SAFE_TESTS,
    CrosstalkFit as CrosstalkFit,
    fit_crosstalk as fit_crosstalk,
    fit_events as fit_events,
)
from ._tests import ModeScore as ModeScore

"""Which compensations a machine asks for, from what was measured of it.

`discover` fits terms of every compensation, and of what the controller has none for, to
the error of each axis, and names those that come back in resamples; `Observed` is what
it takes. Beside `proof`: it rests on `fit`, and knows no files.
"""

from ._discover import discover as discover
from ._errors import DiscoverError as DiscoverError
from ._observed import Observed as Observed, stack as stack
from ._result import (
    AxisSummary as AxisSummary,
    Discovery as Discovery,
    Drift as Drift,
    Found as Found,
    Rejected as Rejected,
    Unexplained as Unexplained,
)

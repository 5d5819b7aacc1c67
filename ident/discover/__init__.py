"""Which compensations a machine asks for, from what was measured of it.

`discover` fits terms of every compensation, and of what the controller has none for, to the
error of each axis, and names those that come back in resamples. To be read in this order:
`_data` (readings in, findings out), `_terms` (what an error may depend on, and which
compensations hold it), `_view` (readings of one axis, and what they could show), `_columns`
(features of terms, by libraries of pysindy), `_evidence` (how large each term is), `_select`
(which terms are there, by optimisers of pysindy; sensor and lag), `_unexplained` (what the data
cannot tell apart, and what stays), `_discover` (the whole, for an axis and a drive).
"""

from ._data import (
    DiscoverError as DiscoverError,
    Discovery as Discovery,
    Found as Found,
    Observed as Observed,
    stack as stack,
)
from ._discover import discover as discover
from ._unexplained import against_drift as against_drift, heat_or_drift as heat_or_drift

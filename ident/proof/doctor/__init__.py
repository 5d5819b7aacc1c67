"""Measurements without and with the lists: what is wrong with what they do.

The change between both is what the lists did. What explains it is searched as for a log of
the controller (`verify`); each fault gets its probability, and below `SURE` nothing is said.
"""

from ._cases import Diagnosis as Diagnosis
from ._diagnose import (
    diagnose as diagnose,
    driving_axes as driving_axes,
    not_judged as not_judged,
    unlisted as unlisted,
)
from ._measured import Measured as Measured

"""Measurements without and with the lists: what is wrong with what they do.

The change between both is what the lists did. Each fault predicts another change; with
how likely it is beforehand, and with noise and zero of the instrument fitted, each gets
its probability. Below `SURE` nothing is said.
"""

from ._diagnose import (
    Diagnosis as Diagnosis,
    diagnose as diagnose,
    not_judged as not_judged,
)
from ._measured import Measured as Measured

"""Backlash as a job handles every compensation: an entry of the axis list, no table."""

from ._draft import plan_backlash as plan_backlash
from ._result import BacklashResult as BacklashResult

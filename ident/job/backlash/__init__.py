"""Backlash as a job handles every compensation: an entry of the axis list, no table."""

from ._draft import BacklashDraft as BacklashDraft, plan_backlash as plan_backlash
from ._known import KnownBacklash as KnownBacklash, known_backlash as known_backlash
from ._recording import Recording as Recording
from ._result import BacklashResult as BacklashResult

"""Crosstalk as a job handles every compensation: tests of a list from a log of motion."""

from ._draft import plan_crosstalk as plan_crosstalk
from ._result import (
    CrosstalkResult as CrosstalkResult,
    CrosstalkView as CrosstalkView,
    EventCourse as EventCourse,
)

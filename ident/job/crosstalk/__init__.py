"""Crosstalk as a job handles every compensation: tests of a list from a log of motion."""

from ._draft import CrosstalkDraft as CrosstalkDraft, plan_crosstalk as plan_crosstalk
from ._existing import (
    Existing as Existing,
    active_in as active_in,
    read_existing as read_existing,
)
from ._identify import (
    Choice as Choice,
    Identified as Identified,
    choice_of as choice_of,
)
from ._quadrants import events_under as events_under
from ._recording import (
    CrosstalkRecording as CrosstalkRecording,
    adaptation_of as adaptation_of,
    joined_logs as joined_logs,
)
from ._result import (
    CrosstalkResult as CrosstalkResult,
    CrosstalkView as CrosstalkView,
    EventCourse as EventCourse,
)

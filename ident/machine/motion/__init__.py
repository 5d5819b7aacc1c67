"""A machine in motion: loops that lag, warmth, and instruments with their own clocks.

`record` runs a programme on a `WorkingMachine` and gives a `MotionLog`, in which the
truth stands beside what a user would see.
"""

from ._everything import (
    SPACE as SPACE,
    Fault as Fault,
    machine_with_everything as machine_with_everything,
    work_programme as work_programme,
)
from ._instruments import HeatedPart as HeatedPart, Tracker as Tracker
from ._programme import CYCLE as CYCLE, Path as Path, Programme as Programme
from ._record import (
    AxisLoop as AxisLoop,
    MotionLog as MotionLog,
    WorkingMachine as WorkingMachine,
    record as record,
    write_motion_log as write_motion_log,
)

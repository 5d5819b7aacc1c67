"""A virtual machine with known errors: it takes lists, is measured, and can be asked.

Measured with no list, it gives the data of a job; measured again with the written lists active,
it gives a true second measurement, since its errors come from physical causes and its offsets
from the controller's rules, not from the fit.

Read `_sources` (causes, and the state of a machine), `_instruments` (what reads them),
`_machine` (at standstill), `_example` (the machine of the demo, and its drive); then the machine
in motion, whose loops lag, which warms up, and whose instruments have clocks of their own:
`_programme` (what it does), `_record` (runs that, and gives a log in which the truth stands
beside what a user would see), `_everything` (a machine with every fault, and its work).
"""

from ._everything import (
    SPACE as SPACE,
    machine_with_everything as machine_with_everything,
    work_programme as work_programme,
)
from ._example import (
    LASER as LASER,
    PROBE as PROBE,
    STRAIGHTEDGE as STRAIGHTEDGE,
    TRAVEL as TRAVEL,
    example_drive as example_drive,
    example_machine as example_machine,
    record_drive as record_drive,
)
from ._instruments import HeatedPart as HeatedPart, Instrument as Instrument
from ._machine import (
    Reading as Reading,
    VirtualMachine as VirtualMachine,
    measure as measure,
    write_reading as write_reading,
)
from ._programme import CYCLE as CYCLE, Path as Path
from ._record import (
    AxisLoop as AxisLoop,
    MotionLog as MotionLog,
    WorkingMachine as WorkingMachine,
    record as record,
    write_motion_log as write_motion_log,
)
from ._sources import (
    State as State,
    beam_bow as beam_bow,
    reversal as reversal,
    screw_pitch as screw_pitch,
    table_flatness as table_flatness,
)

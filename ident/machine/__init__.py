"""A virtual machine with known errors: it takes lists, is measured, and can be asked.

Measured with no list, it gives the data of a job; measured again with the written lists active,
it gives a true second measurement, since its errors come from physical causes and its offsets
from the controller's rules, not from the fit.

Read `_sources` (causes, and the state of a machine), `_machine`, `_measure` (files as
instruments leave them), `_drive`, `_example` (the machine of the demo); `motion` is the same
machine at work.
"""

from ._drive import (
    example_drive as example_drive,
    record_drive as record_drive,
)
from ._example import (
    LASER as LASER,
    PROBE as PROBE,
    STRAIGHTEDGE as STRAIGHTEDGE,
    TRAVEL as TRAVEL,
    example_machine as example_machine,
)
from ._machine import MachineError as MachineError, VirtualMachine as VirtualMachine
from ._measure import (
    Instrument as Instrument,
    Reading as Reading,
    measure as measure,
    write_reading as write_reading,
)
from ._sources import (
    AbstractErrorSource as AbstractErrorSource,
    BeamBow as BeamBow,
    Nodding as Nodding,
    PartGrowth as PartGrowth,
    Positions as Positions,
    Reversal as Reversal,
    ScrewPitch as ScrewPitch,
    State as State,
    TableFlatness as TableFlatness,
)

"""A virtual machine with known errors: it takes lists, is measured, and can be asked.

Measured with no list, it gives the data of a job; measured again with the written lists active,
it gives a true second measurement, since its errors come from physical causes and its offsets
from the controller's rules, not from the fit.

Read `_sources` (causes, and the state of a machine), `_machine` (and what instruments leave of
it), `_example` (the machine of the demo, and its drive); `motion` is the same machine at work.
"""

from ._example import (
    LASER as LASER,
    PROBE as PROBE,
    STRAIGHTEDGE as STRAIGHTEDGE,
    TRAVEL as TRAVEL,
    example_drive as example_drive,
    example_machine as example_machine,
    record_drive as record_drive,
)
from ._machine import (
    Instrument as Instrument,
    MachineError as MachineError,
    Reading as Reading,
    VirtualMachine as VirtualMachine,
    measure as measure,
    write_reading as write_reading,
)
from ._sources import (
    AbstractErrorSource as AbstractErrorSource,
    BeamBow as BeamBow,
    Nodding as Nodding,
    PartGrowth as PartGrowth,
    Reversal as Reversal,
    ScrewPitch as ScrewPitch,
    State as State,
    TableFlatness as TableFlatness,
)

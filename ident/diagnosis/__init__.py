"""What to look at on a controller: the CNC objects of its compensations, and a Scope recording.

`_objects` makes the table of a machine from its lists, `_scope_file` a TwinCAT Scope
configuration that records it; the export of that recording is what `axcomp.ident.proof` verifies.
The folder `probe` asks a machine for plateaus: lists, what to read, and an NC program.
"""

from ._objects import (
    Observable as Observable,
    objects_csv as objects_csv,
    observables as observables,
)
from ._scope_file import scope_configuration as scope_configuration
from .probe._nc import (
    AXIS_WORD as AXIS_WORD,
    CompState as CompState,
    declared as declared,
    numbered as numbered,
)
from .probe._probe import (
    Masters as Masters,
    Outcome as Outcome,
    Outcomes as Outcomes,
    Probe as Probe,
    ProbeAxis as ProbeAxis,
    Probed as Probed,
    make_probe as make_probe,
    probed_in as probed_in,
    travel_in as travel_in,
)
from .probe._probe_text import (
    probe_programs as probe_programs,
    probe_steps as probe_steps,
    probe_text as probe_text,
)

OBJECTS = "cnc_objects.csv"
"""Name of the table beside the lists of a job."""
SCOPE = "compensations.tcscopex"
"""Name of the Scope configuration beside it."""

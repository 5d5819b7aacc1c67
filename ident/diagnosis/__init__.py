"""What to look at on a controller: the CNC objects of its compensations, and a Scope recording.

`_objects` makes the table of a machine from its lists, `_scope_file` a TwinCAT Scope
configuration that records it; the export of that recording is what `axcomp.ident.proof` verifies.
"""

from ._objects import (
    Observable as Observable,
    objects_csv as objects_csv,
    observables as observables,
)
from ._scope_file import scope_configuration as scope_configuration

OBJECTS = "cnc_objects.csv"
"""Name of the table beside the lists of a job."""
SCOPE = "compensations.tcscopex"
"""Name of the Scope configuration beside it."""

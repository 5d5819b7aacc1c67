"""What to look at on the controller, written beside the lists of a job."""

from collections.abc import Sequence

from ..diagnosis import (
    OBJECTS,
    SCOPE,
    objects_csv,
    observables,
    scope_configuration,
)
from ._lists import AxisFiles
from ._load import Job
from ._output import OutFolder

DIAGNOSIS = (OBJECTS, SCOPE)
"""Names of the files."""


def write_diagnosis(job: Job, folder: OutFolder, files: Sequence[AxisFiles]) -> None:
    """Write the objects of the compensations that are let out, and how to record them."""
    lists = [listing for one in files if not one.failed for _, listing in one.lists]
    rows = observables(lists, job.conventions) if lists else ()
    if not rows:
        for name in DIAGNOSIS:
            folder.retire(name)
        return
    controller = job.spec.controller
    stated = "cycle_time" in controller.model_fields_set
    cycle_time = controller.cycle_time if stated else None
    folder.accept(OBJECTS, objects_csv(rows).encode())
    folder.accept(SCOPE, scope_configuration(rows, cycle_time=cycle_time))

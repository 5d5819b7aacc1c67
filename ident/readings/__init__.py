"""From the files of a job to readings: one reader for fits, groups, `discover` and `doctor`.

To be read in this order: `_tables` (each file once, its columns in mm, °, s and °C), `_joined`
with `_clocks` (several files on one clock), `_rows` (one measurement, a column at a time: motion,
modulo, absurd values, reference temperature, with `_zero` of the instrument), `_readings`
(several measurements one after the other; repeated runs). On top of them stand `_observe` (all
there is, for `discover`; errors of all axes, for `doctor` and the whole axis) and
`job.joint._recording` (what the fits of a job need, for a group or one alone).
"""

from typing import TYPE_CHECKING

from .._lazy import importer
from ._clocks import ClockState as ClockState
from ._readings import (
    Readings as Readings,
    cycles_of as cycles_of,
    joined as joined,
    joined_runs as joined_runs,
    longer_than as longer_than,
    place_in_run as place_in_run,
    rows_of as rows_of,
    runs_overlap as runs_overlap,
)
from ._rows import (
    IN_SHOP as IN_SHOP,
    POSITION_ORDER as POSITION_ORDER,
    SENSOR as SENSOR,
    SHOP as SHOP,
    Rows as Rows,
    away_from as away_from,
    reference_words as reference_words,
    sensor_name as sensor_name,
)
from ._tables import Tables as Tables
from ._zero import (
    Zero as Zero,
    step_of as step_of,
    without_zero as without_zero,
    zero_of as zero_of,
)

if TYPE_CHECKING:
    from ._observe import (
        Observation as Observation,
        errors_in as errors_in,
        observe as observe,
        read_error as read_error,
        read_outside as read_outside,
    )

__getattr__ = importer(__name__)

"""What was measured: readers, units, roles, directions, figures of ISO 230-2.

`read_table` gives the columns of a file in the file's own units; `measurement` gives
them a meaning and the library's units (mm, °, s, °C); `derive_error`, `derive_motion`,
`derive_direction` and `reduce_length` make of them what a fit needs; `iso230` evaluates
a positioning test, and `read_iso230` that in a file.
"""

from ._cnc_objects import (
    CNC_OBJECTS as CNC_OBJECTS,
    GEO_PORT as GEO_PORT,
    INDEX_GROUP as INDEX_GROUP,
    CncObject as CncObject,
)
from ._dates import may_be_ms as may_be_ms
from ._derive import (
    derive_error as derive_error,
    derive_motion as derive_motion,
    on_even_clock as on_even_clock,
    recorded_motion as recorded_motion,
    reduce_length as reduce_length,
    wrap_degrees as wrap_degrees,
)
from ._dialect import SEPARATORS as SEPARATORS
from ._direction import (
    Directions as Directions,
    derive_direction as derive_direction,
    explain_direction as explain_direction,
    restart_of as restart_of,
)
from ._dropped import filled_in as filled_in
from ._errors import (
    CellError as CellError,
    ColumnError as ColumnError,
    DirectionUnknown as DirectionUnknown,
    LineError as LineError,
    MeasurementError as MeasurementError,
    MissingRole as MissingRole,
    RoleError as RoleError,
    UnitError as UnitError,
)
from ._iso230 import (
    EDITION as EDITION,
    iso230 as iso230,
    iso230_figures as iso230_figures,
)
from ._iso230_file import (
    Iso230Test as Iso230Test,
    Iso230Verdict as Iso230Verdict,
    read_iso230 as read_iso230,
)
from ._iso230_types import (
    Iso230 as Iso230,
    Iso230Position as Iso230Position,
    Iso230Run as Iso230Run,
)
from ._iso230_words import (
    amount as amount,
    describe_drift as describe_drift,
    describe_iso230 as describe_iso230,
    widest_reversal as widest_reversal,
    with_arrows as with_arrows,
)
from ._large import (
    LargeFile as LargeFile,
    TablePart as TablePart,
    open_large as open_large,
)
from ._log import (
    ControllerLog as ControllerLog,
    LoggedOffset as LoggedOffset,
    read_log as read_log,
)
from ._log_names import EXTERNAL_LOG as EXTERNAL_LOG, log_name as log_name
from ._measurement import (
    Measurement as Measurement,
    RoleValues as RoleValues,
    advice as advice,
    measurement as measurement,
    own_roles as own_roles,
    turning_axes as turning_axes,
)
from ._mesh import PROBED_HEIGHTS as PROBED_HEIGHTS
from ._moving import (
    is_log as is_log,
    standstill_words as standstill_words,
    with_error as with_error,
    without_motion as without_motion,
)
from ._problems import problems_of as problems_of
from ._read import read_table as read_table
from ._roles import (
    AXIS_NAME as AXIS_NAME,
    KINDS as KINDS,
    ColumnSpec as ColumnSpec,
    Role as Role,
    find_role as find_role,
    role as role,
)
from ._table import (
    LASER_FORMAT as LASER_FORMAT,
    MESH_FORMATS as MESH_FORMATS,
    SCOPE_FORMAT as SCOPE_FORMAT,
    BadCell as BadCell,
    Column as Column,
    Lines as Lines,
    Skipped as Skipped,
    Table as Table,
    TextForm as TextForm,
)
from ._turns import passed_end as passed_end
from ._units import (
    UNITS as UNITS,
    Unit as Unit,
    find_unit as find_unit,
    nearest as nearest,
    unit as unit,
)
from ._words import (
    WORDS as WORDS,
    all_position as all_position,
    direction_of as direction_of,
    is_own_reading as is_own_reading,
    kinds_in as kinds_in,
    pieces as pieces,
    says_correction as says_correction,
    words_in as words_in,
)

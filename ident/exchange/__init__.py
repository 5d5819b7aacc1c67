"""List ↔ model, rounded to integers: the one place that converts list units.

Read `_units`, `_identity` and `_nodes` (integers of a list), then `_machine_lists` (which
compensations the lists of a machine switch on) and the folder `controller` (the controller that
has them, run along a motion); what each compensation says of itself is in
``kinds/<name>/entries.py``.
`_files`: the files of an axis. `_table`: what a table fit writes, with its nodes and its sign.
`load_model` (`_axis_models`) makes models of the lists of one axis, `write_lists` writes them
back. `_convert`: tables of other controllers. `_conventions_file`: the rules of one machine.
"""

from ._axis_models import (
    AxisModels as AxisModels,
    load_model as load_model,
    write_lists as write_lists,
)
from ._capacity import ListTarget as ListTarget
from ._conventions_file import (
    StoredConventions as StoredConventions,
    read_conventions as read_conventions,
)
from ._convert import (
    FORMATS as FORMATS,
    HEIGHTS as HEIGHTS,
    ExchangedTable as ExchangedTable,
    format_of as format_of,
    list_with as list_with,
    table_in as table_in,
    table_of_file as table_of_file,
    text_of as text_of,
)
from ._files import (
    axis_file as axis_file,
    compensation_file as compensation_file,
    is_to_add as is_to_add,
    to_add as to_add,
    with_tables as with_tables,
)
from ._identity import (
    MOST_REVERSAL_CYCLES as MOST_REVERSAL_CYCLES,
    Increments as Increments,
    axis_number as axis_number,
)
from ._machine_lists import (
    REVERSAL_CYCLES as REVERSAL_CYCLES,
    InUse as InUse,
    MachineLists as MachineLists,
    Reading as Reading,
    axes_in_use as axes_in_use,
    entries_of_activation as entries_of_activation,
    machine_lists as machine_lists,
    reversal_cycles as reversal_cycles,
)
from ._nodes import (
    ListNodes as ListNodes,
    Ranges as Ranges,
    grid_nodes as grid_nodes,
    point_nodes as point_nodes,
)
from ._table import (
    AbstractTable as AbstractTable,
    Model as Model,
    by_branch as by_branch,
    nodes_in as nodes_in,
    offset_at as offset_at,
    refuse_lost_nodes as refuse_lost_nodes,
)
from ._units import (
    LIST_UNITS as LIST_UNITS,
    ExchangeError as ExchangeError,
    ModelUnit as ModelUnit,
    expect as expect,
)
from .controller._events import (
    ControllerEvent as ControllerEvent,
    parse_action as parse_action,
)
from .controller._motion import (
    Motion as Motion,
    direction_of_motion as direction_of_motion,
)
from .controller._simulate import (
    AxisLists as AxisLists,
    AxisOffsets as AxisOffsets,
    columns_of as columns_of,
    controller_from_lists as controller_from_lists,
    simulate as simulate,
)

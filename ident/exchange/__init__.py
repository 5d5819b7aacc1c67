"""List ↔ model, rounded to integers: the one place that converts list units.

Read `_units` and `_nodes` (integers of a list), then a room per compensation: `_plane`,
`_cross`, `_leadscrew`, `_friction`, `_crosstalk` with `plane_from_list`/`entries_of_plane` and
so on; `_axis_list` (what an axis list sets up by itself) and `_startup`. `_table` with
`_tables`: what a table fit writes, with its nodes and its sign. `_machine_lists` and
`_controller` make a whole machine of its lists, `_simulate` runs it, `_probe` asks it for
plateaus; `load_model` (`_axis_models`) makes models of the lists of one axis, `write_lists`
writes them back. `_conventions_file`: how one machine reads them.
"""

from ._axis_list import (
    ACTIVATION as ACTIVATION,
    backlash_from_list as backlash_from_list,
    entries_of_activation as entries_of_activation,
    entries_of_backlash as entries_of_backlash,
    entries_of_temperature as entries_of_temperature,
    is_activated as is_activated,
    reversal_cycles as reversal_cycles,
    temperature_from_list as temperature_from_list,
)
from ._axis_models import (
    AxisModels as AxisModels,
    ModelUnit as ModelUnit,
    load_model as load_model,
    models_from_lists as models_from_lists,
    write_lists as write_lists,
)
from ._capacity import build_number as build_number
from ._controller import (
    Reading as Reading,
    controller_from_lists as controller_from_lists,
    model_of as model_of,
)
from ._conventions_file import (
    StoredConventions as StoredConventions,
    read_conventions as read_conventions,
)
from ._convert import (
    CONVERTIBLE as CONVERTIBLE,
    ExchangedTable as ExchangedTable,
    list_with as list_with,
    table_in as table_in,
)
from ._convert_text import (
    FORMATS as FORMATS,
    format_of as format_of,
    table_of_file as table_of_file,
    text_of as text_of,
)
from ._cross import (
    cross_axes as cross_axes,
    cross_from_list as cross_from_list,
    cross_master as cross_master,
    entries_of_cross as entries_of_cross,
    has_cross as has_cross,
)
from ._crosstalk import (
    crosstalk_from_list as crosstalk_from_list,
    crosstalk_masters as crosstalk_masters,
    entries_of_crosstalk as entries_of_crosstalk,
    has_crosstalk as has_crosstalk,
)
from ._errors import ExchangeError as ExchangeError
from ._evaluate import offset_at as offset_at
from ._external import (
    ExternalAxis as ExternalAxis,
    entries_of_external_axis as entries_of_external_axis,
    external_axis_from_list as external_axis_from_list,
    external_from_lists as external_from_lists,
    external_limits as external_limits,
    from_interface as from_interface,
    to_interface as to_interface,
)
from ._friction import (
    FrictionNumbers as FrictionNumbers,
    entries_of_friction as entries_of_friction,
    friction_from_list as friction_from_list,
    has_friction as has_friction,
    read_friction as read_friction,
)
from ._identity import (
    Increments as Increments,
    axis_number as axis_number,
)
from ._leadscrew import (
    entries_of_leadscrew as entries_of_leadscrew,
    has_leadscrew as has_leadscrew,
    leadscrew_from_list as leadscrew_from_list,
)
from ._machine_lists import (
    PREFIXES as PREFIXES,
    InUse as InUse,
    MachineLists as MachineLists,
    axes_in_use as axes_in_use,
    machine_lists as machine_lists,
)
from ._modulo import Ranges as Ranges
from ._motion import Motion as Motion, direction_of_motion as direction_of_motion
from ._nodes import (
    GridNodes as GridNodes,
    ListNodes as ListNodes,
    PointNodes as PointNodes,
    grid_nodes as grid_nodes,
    point_nodes as point_nodes,
)
from ._plane import (
    entries_of_plane as entries_of_plane,
    has_plane as has_plane,
    plane_from_list as plane_from_list,
    plane_masters as plane_masters,
)
from ._probe import (
    Probe as Probe,
    ProbeAxis as ProbeAxis,
    Probed as Probed,
    make_probe as make_probe,
)
from ._probe_inputs import (
    names_in as names_in,
    probed_in as probed_in,
    travel_in as travel_in,
)
from ._probe_steps import (
    Outcome as Outcome,
    ProbeStep as ProbeStep,
    probe_steps as probe_steps,
)
from ._probe_text import probe_program as probe_program, probe_text as probe_text
from ._simulate import AxisOffsets as AxisOffsets, simulate as simulate
from ._startup import (
    Startup as Startup,
    entries_of_startup as entries_of_startup,
    startup_from_list as startup_from_list,
)
from ._table import (
    AbstractTable as AbstractTable,
    Model as Model,
    by_branch as by_branch,
    nodes_in as nodes_in,
)
from ._tables import (
    CrossTable as CrossTable,
    LeadscrewTable as LeadscrewTable,
    PlaneTable as PlaneTable,
    refuse_lost_nodes as refuse_lost_nodes,
)
from ._temperature_table import (
    read_temperature_table as read_temperature_table,
    temperature_line as temperature_line,
)
from ._toml import TomlError as TomlError, read_toml as read_toml
from ._units import LIST_UNITS as LIST_UNITS

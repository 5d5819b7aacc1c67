"""List ↔ model, rounded to integers: the one place that converts list units.

Three rooms, one per table: `plane_from_list`/`entries_of_plane` and so on. A fit works
with an `AbstractTable`, which knows its nodes, its sign and how it is written.
"""

from ._capacity import build_number as build_number
from ._cross import (
    cross_from_list as cross_from_list,
    cross_master as cross_master,
    entries_of_cross as entries_of_cross,
    has_cross as has_cross,
)
from ._errors import ExchangeError as ExchangeError
from ._evaluate import offset_at as offset_at
from ._identity import (
    Increments as Increments,
    axis_number as axis_number,
)
from ._leadscrew import (
    entries_of_leadscrew as entries_of_leadscrew,
    has_leadscrew as has_leadscrew,
    leadscrew_from_list as leadscrew_from_list,
)
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
from ._simulate import (
    AxisOffsets as AxisOffsets,
    Motion as Motion,
    direction_of_motion as direction_of_motion,
    simulate as simulate,
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
from ._units import LIST_UNITS as LIST_UNITS

"""A model as an external compensation of the controller: C and C++, list entries, NC lines.

`export_external` (`_export`) is the whole. `_trace` with `_arithmetic` carries a model over from
JAX to CasADi, `_code` makes C of it with the files of ``templates``, `_extremes` searches the
largest figures in the workspace, `_entries` makes list entries of them; `_sources` takes the
tables of a job or of lists, of which `_law` makes one.
`_verify` holds what a controller logged against them.
"""

from typing import TYPE_CHECKING

from .._lazy import importer

if TYPE_CHECKING:
    from ._entries import (
        EXTERNAL as EXTERNAL,
        ExternalAxis as ExternalAxis,
        entries_of_external_axis as entries_of_external_axis,
    )
    from ._export import (
        ExternalFiles as ExternalFiles,
        Placed as Placed,
        export_external as export_external,
    )
    from ._extremes import Extremes as Extremes, extremes as extremes
    from ._law import (
        external_from_lists as external_from_lists,
        from_interface as from_interface,
    )
    from ._sources import ListSource as ListSource, list_source as list_source
    from ._trace import OffsetLaw as OffsetLaw, UntraceableError as UntraceableError
    from ._verify import (
        Snapshot as Snapshot,
        read_snapshot as read_snapshot,
        verify_external as verify_external,
        verify_snapshot as verify_snapshot,
    )

__getattr__ = importer(__name__)

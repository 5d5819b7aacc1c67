"""The report of a job: one HTML page that needs no network, and its plots as SVG.

Read in this order: `_write` (the page), `_verdict` (the headline of a fit), `_section` (one
fit: words, tables, plots), `_body` (what differs by compensation: the part ``page`` of its
folder in `axcomp.ident.kinds`, the folder `table` for tables), `_style` and `_scale` (how a
picture looks and in which units). The pictures: `_overview`, `_iso_chart`, `_group`, and
those of the folders.

The public names are imported when they are first asked for: the report of a job needs JAX, the
ISO 230-2 chart of this package does not, and `axcomp iso230` draws just that.
"""

from typing import TYPE_CHECKING

from .._lazy import importer

if TYPE_CHECKING:
    from ._overview import write_picture as write_picture
    from ._scale import scale_of as scale_of
    from ._verdict import headline_of as headline_of, short_verdict as short_verdict
    from ._write import write_report as write_report

__getattr__ = importer(__name__)

"""What was measured, and what a list says; two wings that do not know each other.

* `axcomp.data.measurements`: readers, units, roles, directions, ISO 230-2 (NumPy); its
  room `axcomp.data.signals`: motion from positions, delays (NumPy and SciPy).
* `axcomp.data.lists`: compensation, axis and start-up lists (plain Python).

Beside them `axcomp.data.files`: files that are whole, also after a crash or a power cut,
`axcomp.data.toml`: TOML files, read with the line of what is wrong in them, and
`axcomp.data.units`: units as people read them.
"""

from .errors import AxcompError as AxcompError

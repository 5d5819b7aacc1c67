"""The start-up list: which compensation list belongs to which axis."""

import dataclasses
from collections.abc import Mapping

from ...data.lists import ListFile
from ._errors import ExchangeError
from ._identity import flag, optional, required

EXTERNAL = "configuration.position_controller.enable_external_compensation_ifc"


@dataclasses.dataclass(frozen=True)
class Startup:
    """What a start-up list says of compensations.

    Attributes:
        files: File of the compensation list by logical axis number, as it is written.
        external: Whether the interface for external compensation is open (P-STUP-00110).
    """

    files: Mapping[int, str]
    external: bool = False


def startup_from_list(listing: ListFile) -> Startup:
    """Return what a start-up list says of compensations.

    Raises:
        ExchangeError: If a file has no axis number, or an axis two files.
    """
    count = optional(listing, "zahl_kw")
    files: dict[int, str] = {}
    for k in range(count):
        name = listing.text(f"achs_kw[{k}]")
        if name is None:
            continue
        axis = required(listing, f"achs_kw_log_ax_nr[{k}]")
        if axis in files:
            raise ExchangeError(
                where=f"{listing.source}: achs_kw_log_ax_nr[{k}]",
                found=f"axis {axis} again, beside {files[axis]}",
                expected="one list per axis (110229)",
            )
        files[axis] = name
    return Startup(files, flag(listing, EXTERNAL))


def entries_of_startup(startup: Startup) -> dict[str, int | str]:
    """Return the start-up entries, lists in the order of their axes."""
    entries: dict[str, int | str] = {"zahl_kw": len(startup.files)}
    for k, axis in enumerate(sorted(startup.files)):
        entries[f"achs_kw_log_ax_nr[{k}]"] = axis
        entries[f"achs_kw[{k}]"] = startup.files[axis]
    if startup.external:
        entries[EXTERNAL] = 1
    return entries

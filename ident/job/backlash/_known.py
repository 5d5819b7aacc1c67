"""The backlash that an axis list holds already."""

import dataclasses

from ....models import Backlash
from ...exchange import ExchangeError, backlash_from_list
from .._active import was_active
from .._draft import AxisLists
from .._fit_schema import BacklashSpec
from .._load import Job


@dataclasses.dataclass(frozen=True)
class KnownBacklash:
    """What an axis list says of the backlash.

    Attributes:
        old: Its entries, or None.
        active: Whether they acted while measuring.
    """

    old: Backlash | None
    active: bool

    @property
    def reference(self) -> int:
        """Direction in which the axis is right without it."""
        return 1 if self.old is None else self.old.reference

    @property
    def acting(self) -> float:
        """Width that acted while measuring, in mm or °."""
        return float(self.old.width) if self.active and self.old is not None else 0.0


def known_backlash(
    job: Job, index: int, fit: BacklashSpec, lists: AxisLists
) -> KnownBacklash:
    """Return what the axis list holds.

    Raises:
        JobError: If it cannot be read, or does not hold what was active.
    """
    where = ("fits", index)
    old: Backlash | None = None
    if lists.machine is not None:
        try:
            old = backlash_from_list(lists.machine, job.conventions)
        except ExchangeError as error:
            raise job.error(where, str(error)) from None
    holder = None
    if lists.machine is not None and old is not None and float(old.width) != 0.0:
        holder = lists.machine.source
    active = was_active(job, index, fit, holder)
    if active and old is None:
        raise job.error(
            ("axes", fit.axis, "machine_data"),
            "backlash was active while measuring, but no axis list that switches it on"
            " is given, expected machine_data = the file that was loaded",
        )
    return KnownBacklash(old, active)

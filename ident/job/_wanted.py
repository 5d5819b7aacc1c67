"""What a table fit takes from its measurements."""

import dataclasses
from typing import Literal

from ..exchange import AbstractTable
from ._fit_schema import CrossSpec, LeadscrewSpec, PlaneSpec, TableSpec


@dataclasses.dataclass(frozen=True)
class Wanted:
    """What a fit takes from its measurements.

    Attributes:
        masters: Axes whose positions it needs, master 1 first.
        direction: ``needed``, ``welcome`` or ``no``.
        lengths: The error is one of length along the axis itself, so that it grows with
            the temperature of the scale.
    """

    masters: tuple[str, ...]
    direction: Literal["needed", "welcome", "no"]
    lengths: bool


def wanted_by(fit: TableSpec, table: AbstractTable) -> Wanted:
    """Return what a table fit takes from its measurements."""
    own = isinstance(fit, LeadscrewSpec)
    way: Literal["needed", "welcome", "no"] = "welcome" if own else "no"
    return Wanted(masters_of(fit), "needed" if table.branches == 2 else way, own)


def masters_of(fit: TableSpec) -> tuple[str, ...]:
    """Return the axes whose positions enter a table, master 1 first."""
    if isinstance(fit, PlaneSpec):
        return (fit.masters[0], fit.masters[1])
    return (fit.master,) if isinstance(fit, CrossSpec) else (fit.axis,)

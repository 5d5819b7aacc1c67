"""Friction as a user states it, with the keys of the job file; fitted by itself."""

import dataclasses
from typing import ClassVar, Literal, final

from .fit.joint import Number


@final
@dataclasses.dataclass(frozen=True)
class Friction:
    """Friction law of an axis, from the current of its drive; fitted by itself.

    Attributes:
        axis: Name of the compensated axis.
        inertia: ``"fit"``, or known, in drive units per mm/s².
    """

    axis: str
    inertia: Number | Literal["fit"] = "fit"

    compensation: ClassVar[str] = "friction"
    no_keys: ClassVar[tuple[str, ...]] = ()

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the readings that it needs."""
        kinds = ("velocity", "acceleration", "current")
        return ("time", *(f"{self.axis}.{kind}" for kind in kinds))

"""The compensations of one axis, and the axes that they look at."""

import abc
from collections.abc import Mapping
from typing import Any, Generic, TypeVar, final

import equinox as eqx
from jaxtyping import Array, Float

from ._backlash import Backlash
from ._cross import Cross
from ._crosstalk import AbstractCrosstalk
from ._friction_compensation import FrictionCompensation
from ._leadscrew import Leadscrew
from ._motion import COMPENSATIONS, Rows
from ._plane import Plane
from ._temperature import TemperatureLine

Law_co = TypeVar("Law_co", bound=eqx.Module, covariant=True)


@final
class Coupled(eqx.Module, Generic[Law_co]):
    """A compensation together with the axes that it looks at."""

    law: Law_co
    """What is added, over what the masters do."""
    masters: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the master axes in the machine, from 0.

    Crosstalk: the axis that accelerates, then the adaptation axes.
    """
    cycles: int = eqx.field(default=0, static=True)
    """Cycles of the sin² filter of cross and plane (`n_cycles`; P-COMP-00026, 00027).

    A crosstalk law has its own.
    """


class AbstractOffset(eqx.Module):
    """The law of a compensation that is none of `COMPENSATIONS`.

    Each cycle stands for itself: such a law has no memory.
    """

    @abc.abstractmethod
    def offset(self, rows: Rows, axes: tuple[int, ...]) -> Float[Array, " t"]:
        """Return what is added to the position of an axis per cycle, in mm or °.

        Args:
            rows: Motion of all axes.
            axes: Number of that axis in the machine, then those of its masters.
        """


@final
class AxisCompensations(eqx.Module):
    """All compensations of one axis; None: it lacks it, or it is not activated."""

    backlash: Backlash | None = None
    """Activated by P-AXIS-00021."""
    temperature: TemperatureLine | None = None
    """Activated by P-AXIS-00271."""
    cross: Coupled[Cross] | None = None
    """Activated by P-AXIS-00047."""
    plane: Coupled[Plane] | None = None
    """Activated by P-AXIS-00174."""
    crosstalk: Coupled[AbstractCrosstalk] | None = None
    """Activated by P-AXIS-00789."""
    leadscrew: Leadscrew | None = None
    """Activated by P-AXIS-00175."""
    friction: FrictionCompensation | None = None
    """Activated by P-AXIS-00522."""
    further: Mapping[str, Coupled[AbstractOffset]] = eqx.field(default_factory=dict)
    """Compensations of positions that are none of these, by name; summed up first.

    They wait for their masters to be homed, and take no COMP command.
    """
    leadscrew_alone: bool = eqx.field(default=False, static=True)
    """The leadscrew looks up the position without the other offsets.

    `set_pos_without_comp`; S-23 and `Conventions.leadscrew_input` else.
    """
    reversal_cycles: int | None = eqx.field(default=None, static=True)
    """Cycles over which a reversal is spread (P-AXIS-00243); None: as the backlash."""
    manual: tuple[str, ...] = eqx.field(default=(), static=True)
    """Compensations that wait for COMP ON (`manual_activation`), by name."""

    def __check_init__(self) -> None:
        for name in self.manual:
            if name not in (*COMPENSATIONS, *self.further):
                msg = f"manual: {name!r} is none of {', '.join(COMPENSATIONS)}."
                raise ValueError(msg)
        for name in self.further:
            if name in COMPENSATIONS:
                msg = f"further: {name!r} has a field of its own."
                raise ValueError(msg)
        cycles = None if self.backlash is None else self.backlash.cycles
        if cycles is not None and self.reversal_cycles not in (None, cycles):
            msg = (
                f"Backlash and leadscrew share P-AXIS-00243: expected one number of "
                f"cycles, got {cycles} and {self.reversal_cycles}."
            )
            raise ValueError(msg)
        for name, least, most in (("cross", 1, 1), ("plane", 2, 2)):
            self._check_masters(name, least, most)
        self._check_masters("crosstalk", 1, 3)

    def _check_masters(self, name: str, least: int, most: int) -> None:
        coupled: Coupled[eqx.Module] | None = getattr(self, name)
        if coupled is None:
            return
        if not least <= len(coupled.masters) <= most:
            expected = f"{least}" if least == most else f"{least} to {most}"
            msg = f"{name} needs {expected} masters, got {coupled.masters!r}."
            raise ValueError(msg)
        if coupled.cycles < 0:
            msg = f"{name}: cycles cannot be negative, got {coupled.cycles!r}."
            raise ValueError(msg)

    @property
    def installed(self) -> tuple[str, ...]:
        """Names of the compensations that the axis has, in the order of their sum."""
        present = (name for name in COMPENSATIONS if getattr(self, name) is not None)
        return (*sorted(self.further), *present)

    def part(self, name: str) -> Any:
        """Return a compensation by its name; None: the axis lacks it."""
        return getattr(self, name) if name in COMPENSATIONS else self.further.get(name)

    @property
    def spread_cycles(self) -> int:
        """Cycles over which a reversal is spread; 0 and 1: at once."""
        if self.reversal_cycles is not None:
            return self.reversal_cycles
        return 0 if self.backlash is None else self.backlash.cycles

    @property
    def switch_cycles(self) -> dict[str, int]:
        """Cycles of the sin² filter of each compensation that has one.

        Switching the backlash is spread as a reversal is; leadscrew and friction have
        no such parameter: they come and go at once.
        """
        cycles: dict[str, int] = dict.fromkeys(COMPENSATIONS, 0)
        cycles["backlash"] = self.spread_cycles
        for name in ("cross", "plane"):
            coupled: Coupled[eqx.Module] | None = getattr(self, name)
            cycles[name] = 0 if coupled is None else coupled.cycles
        if self.temperature is not None:
            cycles["temperature"] = self.temperature.cycles
        if self.crosstalk is not None:
            cycles["crosstalk"] = self.crosstalk.law.cycles
        return cycles | {name: coupled.cycles for name, coupled in self.further.items()}

    def needs_homed(self, name: str, axis: int) -> tuple[int, ...]:
        """Return the axes that must be homed before this compensation acts.

        Leadscrew and temperature need the axis itself, cross, plane and what is `further`
        their masters; the others act from the start ([001] p.10, 64, 82, 97).

        Args:
            name: Of the compensation.
            axis: Number of this axis in the machine.
        """
        if name in ("leadscrew", "temperature"):
            return (axis,)
        if name in ("cross", "plane", *self.further):
            coupled: Coupled[eqx.Module] | None = self.part(name)
            return () if coupled is None else coupled.masters
        return ()

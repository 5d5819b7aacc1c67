"""The lists of a machine by axis, and which compensations they switch on."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

from ...data.lists import ListFile
from ...models import Conventions
from ._axis_list import is_activated
from ._cross import PREFIX as CROSS, cross_axes, has_cross
from ._crosstalk import PREFIX as CROSSTALK, crosstalk_masters, has_crosstalk
from ._errors import ExchangeError
from ._friction import PREFIX as FRICTION, has_friction
from ._identity import axis_number, flag
from ._leadscrew import PREFIX as SCREW, has_leadscrew
from ._plane import PREFIX as PLANE, has_plane, plane_masters

PREFIXES = {
    "cross": CROSS,
    "plane": PLANE,
    "crosstalk": CROSSTALK,
    "leadscrew": SCREW,
    "friction": FRICTION,
}
"""Structure of the compensation list by compensation."""

_HOLDS = {
    "cross": has_cross,
    "plane": has_plane,
    "crosstalk": has_crosstalk,
    "leadscrew": has_leadscrew,
    "friction": has_friction,
}


@dataclasses.dataclass(frozen=True, eq=False)
class InUse:
    """A compensation that lists hold and switch on.

    Attributes:
        axis: Logical number of the axis that it acts on.
        name: Of the compensation.
        masters: Logical numbers of the axes that it looks at; the axis itself for
            leadscrew, friction, temperature and backlash.
        listing: Where it stands.
        manual: It waits for COMP ON in the NC program.
    """

    axis: int
    name: str
    masters: tuple[int, ...]
    listing: ListFile
    manual: bool = False


@dataclasses.dataclass(frozen=True)
class MachineLists:
    """The lists of one machine by logical axis number.

    Attributes:
        compensation: Compensation lists.
        machine: Axis lists.
    """

    compensation: Mapping[int, ListFile]
    machine: Mapping[int, ListFile]

    def in_use(
        self, conventions: Conventions, heated: Iterable[int] = ()
    ) -> tuple[InUse, ...]:
        """Return what is switched on, by axis.

        Without an axis list everything in a compensation list is.

        Args:
            conventions: Whose list holds cross data.
            heated: Axes with a temperature line of their own, beside the lists.

        Raises:
            ExchangeError: If an entry that decides it is unreadable, or the cross
                tables of two lists act on one axis.
        """
        found: dict[tuple[int, str], InUse] = {}
        for number, listing in self.compensation.items():
            for name, holds in _HOLDS.items():
                if not holds(listing):
                    continue
                one = _in_list(number, name, listing, conventions)
                if not self._on(one.axis, name):
                    continue
                if (one.axis, name) in found:
                    other = found[one.axis, name].listing.source
                    raise ExchangeError(
                        where=listing.source,
                        found=f"a second {name} table for axis {one.axis} beside"
                        f" {other}",
                        expected="one per axis",
                    )
                found[one.axis, name] = one
        for number in set(heated) - set(self.machine):
            nowhere = ListFile.parse(b"", f"temperature line of axis {number}")
            found[number, "temperature"] = InUse(
                number, "temperature", (number,), nowhere
            )
        for number, machine in self.machine.items():
            for name in ("temperature", "backlash"):
                if is_activated(machine, name):
                    manual = name == "temperature" and flag(
                        machine, "lr_param.temp_comp_manual_activation"
                    )
                    one = InUse(number, name, (number,), machine, manual)
                    found[number, name] = one
        return tuple(found[key] for key in sorted(found))

    def _on(self, axis: int, name: str) -> bool:
        machine = self.machine.get(axis)
        return machine is None or is_activated(machine, name)


def machine_lists(lists: Sequence[ListFile]) -> MachineLists:
    """Sort the lists of one machine by kind and axis; start-up lists are left out.

    Raises:
        ExchangeError: If a file is no such list, or an axis has two of a kind.
    """
    found: dict[str, dict[int, ListFile]] = {"compensation": {}, "axis": {}}
    for listing in lists:
        if listing.kind == "unknown":
            raise ExchangeError(
                where=listing.source,
                found="none of the entries of a compensation or axis list",
                expected="kopf.*, kw.*, frict_comp.* or lr_param.*",
            )
        if listing.kind == "startup":
            continue
        number, kind = axis_number(listing), listing.kind
        if number in found[kind]:
            raise ExchangeError(
                where=listing.source,
                found=f"a second {kind} list of axis {number} beside"
                f" {found[kind][number].source}",
                expected="one per axis",
            )
        found[kind][number] = listing
    return MachineLists(found["compensation"], found["axis"])


def axes_in_use(used: Sequence[InUse], lists: MachineLists) -> tuple[int, ...]:
    """Return the logical numbers of all axes that lists and compensations name."""
    named = {axis for one in used for axis in (one.axis, *one.masters)}
    return tuple(sorted(named | set(lists.compensation) | set(lists.machine)))


def _in_list(
    number: int, name: str, listing: ListFile, conventions: Conventions
) -> InUse:
    axis = number
    masters: tuple[int, ...] = (number,)
    if name == "cross":
        axis, master = cross_axes(listing, conventions)
        masters = (master,)
    elif name == "plane":
        masters = plane_masters(listing)
    elif name == "crosstalk":
        masters = crosstalk_masters(listing)
    # Friction has no such entry.
    manual = name != "friction" and flag(listing, f"{PREFIXES[name]}.manual_activation")
    return InUse(axis, name, masters, listing, manual)

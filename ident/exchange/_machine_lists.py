"""The lists of a machine by axis, and which compensations they switch on."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from ...data.lists import ListFile
from ...models import Conventions, TemperatureLine
from ..kinds import Kind, kind, kinds
from ._identity import Increments, axis_number, flag, not_negative
from ._nodes import Ranges
from ._units import ExchangeError, expect

REVERSAL_CYCLES = "lr_param.n_backlash_cyc"
"""Entry of the axis list: cycles of a reversal, of the backlash and of a leadscrew table."""


@dataclasses.dataclass(frozen=True)
class Reading:
    """How lists are read.

    Attributes:
        conventions: Rules of the controller.
        increment: Worth of an encoder increment for lists with ``unit 0``.
        modulo: Range in ° by axis, for the axes that turn.
        lines: Temperature lines as a PLC makes them, by axis, instead of those that
            stand in the axis list.
        commanded: What waits for COMP ON is taken as switched on.
    """

    conventions: Conventions
    increment: Increments = None
    modulo: Ranges = dataclasses.field(default_factory=dict)
    lines: Mapping[int, TemperatureLine] = dataclasses.field(default_factory=dict)
    commanded: bool = False


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

    @property
    def kind(self) -> Kind:
        """What is known of the compensation."""
        return kind(self.name)

    def model(self, reading: Reading) -> Any:
        """Return the model that its entries make; its masters left out.

        Raises:
            ExchangeError: If they make none.
        """
        return self.kind.entries.model(self.listing, self.axis, reading)


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
        uses: dict[tuple[int, str], InUse] = {}
        for number, record, listing in self._contents(heated):
            axis, masters = record.entries.axes(listing, number, conventions)
            key = axis, record.name
            manual = record.manual is not None and flag(listing, record.manual)
            if record.holder == "compensation" and axis in self.machine:
                if not record.entries.is_activated(self.machine[axis]):
                    continue
            if key in uses:
                beside = f"beside {uses[key].listing.source}"
                words = f"a second {record.name} table for axis {axis} {beside}"
                raise ExchangeError(listing.source, words, "one per axis")
            uses[key] = InUse(axis, record.name, masters, listing, manual)
        return tuple(uses[key] for key in sorted(uses))

    def _contents(self, heated: Iterable[int]) -> Iterator[tuple[int, Kind, ListFile]]:
        """Yield what the lists hold, switched on or not, and what a PLC does beside them."""
        for record in kinds():
            in_table = record.holder == "compensation"
            lists = self.compensation if in_table else self.machine
            for number, listing in lists.items():
                if record.entries.is_in(listing):
                    yield number, record, listing
            if record.by_plc:
                for number in set(heated) - set(self.machine):
                    words = f"{record.name} line of axis {number}"
                    yield number, record, ListFile.parse(b"", words)


def machine_lists(lists: Sequence[ListFile]) -> MachineLists:
    """Sort the lists of one machine by kind and axis; start-up lists are left out.

    Raises:
        ExchangeError: If a file is no such list, or an axis has two of a kind.
    """
    by_holder: dict[str, dict[int, ListFile]] = {"compensation": {}, "axis": {}}
    for listing in lists:
        words = "none of the entries of a compensation or axis list"
        expected = "kopf.*, kw.*, frict_comp.* or lr_param.*"
        expect(listing.kind != "unknown", listing.source, words, expected)
        if listing.kind == "startup":
            continue
        number, holder = axis_number(listing), listing.kind
        if number in by_holder[holder]:
            beside = f"beside {by_holder[holder][number].source}"
            words = f"a second {holder} list of axis {number} {beside}"
            raise ExchangeError(listing.source, words, "one per axis")
        by_holder[holder][number] = listing
    return MachineLists(by_holder["compensation"], by_holder["axis"])


def axes_in_use(used: Sequence[InUse], lists: MachineLists) -> tuple[int, ...]:
    """Return the logical numbers of all axes that lists and compensations name."""
    numbers = {axis for use in used for axis in (use.axis, *use.masters)}
    return tuple(sorted(numbers | set(lists.compensation) | set(lists.machine)))


def entries_of_activation(compensations: Iterable[str]) -> dict[str, int | str]:
    """Return the entries of an axis list that switch tables and lines on: no backlash."""
    entries: dict[str, int | str] = {}
    for name in compensations:
        entries |= kind(name).entries.activation()
    return entries


def reversal_cycles(machine: ListFile | None) -> int:
    """Return over how many cycles an axis list spreads a reversal (P-AXIS-00243)."""
    return 0 if machine is None else not_negative(machine, REVERSAL_CYCLES)

"""What a compensation says of itself to lists, controller, proofs, verify and probe.

A colleague who adds a compensation writes its model in `axcomp.models` (or, as an
`AbstractOffset`, beside the parts) and in its folder:

* ``entries.py`` with ``ENTRIES``, an `AbstractEntries`;
* ``seen.py`` with ``CHANNEL``, a class that is a `proof.verify.AbstractChannel` (what a log
  shows of it), and ``PROBE``, an `AbstractProbe`;
* ``keys.py`` with ``Spec``, a `_keys.FitSpec`: light, it loads nothing that computes;
* ``plan.py``, a `PlanPart`: a fit from its plan to a draft, alone or in a group;
* ``page.py``, a `PagePart`: what the report shows of its result.

A draft (`AbstractDraft`) is what a job writes, judges and proves; it makes the result
(`AbstractResult`) that stands in ``result.json`` and in the report. Tables (`Kind.table`) share
theirs: they need no ``plan.py`` and no ``page.py``.
"""

import abc
import functools
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from ...data.lists import ListFile, Value
from ...models import Conventions, Coupled
from ..diagnosis.probe._probe import (
    HEIGHT,
    Masters,
    Outcomes,
    Places,
    ProbeAxis,
    Probed,
    both_signs,
    plateau,
)
from ..exchange._capacity import ANY_LIST, ListTarget
from ..exchange._identity import flag, not_negative
from ..exchange._machine_lists import InUse, Reading
from ..exchange._units import LIST_UNITS, ExchangeError, ModelUnit, expect
from ..exchange.controller._motion import Motion
from . import kind
from ._kind import Kind

if TYPE_CHECKING:
    from ..exchange._table import AbstractTable
    from ..job._draft import AbstractPlan
    from ..readings import Tables
    from ..report._body import Body
    from ..report._scale import Scale

Axes = tuple[int, ...]
"""Logical numbers of axes, or their columns."""


class AbstractEntries(abc.ABC):
    """One compensation between its list, in logical axis numbers, and its model.

    Attributes:
        kind: Its facts.
        models: Classes of its model, the usual one first.
        value: Entry that holds its values, for messages.
        units: Units that values of its model may have as they stand, the usual one first.
        stale: Entries of its structure that go before new ones are written, by their
            beginnings.
        comes_last: It may look up the position with what the others add.
        columns: Columns of its table in a list; none: it is no table.
        table: What a fit of a table writes; None: it is no table.
        coupled: The controller takes it as `Coupled`: with other axes, or with cycles.
        rules: Fields of its model that no list holds: the controller has them as it has.
    """

    kind: Kind
    models: tuple[type, ...]
    value: str
    units: tuple[str, ...] = ("mm", "deg")
    stale: tuple[str, ...] = ("table[",)
    rules: tuple[str, ...] = ()
    comes_last: bool = False
    columns: tuple[str, ...] = ()
    table: "type[AbstractTable] | None" = None
    coupled: bool = True

    # ------------------------------------------------------------------ where it stands

    def is_in(self, listing: ListFile) -> bool:
        """Whether a compensation list holds its table, or an axis list has it on."""
        if self.columns:
            return bool(listing.table(self.kind.prefix, self.columns[0]))
        return self.is_activated(listing)

    def is_activated(self, machine: ListFile) -> bool:
        """Whether an axis list switches it on.

        Raises:
            ExchangeError: If its entry is unreadable.
        """
        return flag(machine, self.kind.activation)

    def adds_nothing(self, listing: ListFile) -> bool:
        """Whether a list holds nothing but zeros of it."""
        tables = [listing.table(self.kind.prefix, name) for name in self.columns]
        return bool(tables) and not any(any(table.values()) for table in tables)

    def activation(self) -> dict[str, int | str]:
        """Return the entry of an axis list that switches it on."""
        return {self.kind.activation: 1}

    def named_masters(self, listing: ListFile) -> Axes:
        """Return the axes that a list names as its masters; none: it looks at its own."""
        return ()

    def axes(
        self, listing: ListFile, number: int, conventions: Conventions
    ) -> tuple[int, Axes]:
        """Return the axis that it acts on, and the axes that it looks at.

        `number` is that of the axis that the list belongs to.
        """
        return number, self.named_masters(listing) or (number,)

    # ---------------------------------------------------------------------- list ↔ model

    @abc.abstractmethod
    def model(self, listing: ListFile, axis: int, reading: Reading) -> Any:
        """Return the model that a list makes, in mm or °; None: it is off.

        Entries that the list leaves out are 0, as they are in the controller.

        Raises:
            ExchangeError: If its entries make none.
        """

    def from_list(self, listing: ListFile, conventions: Conventions) -> Any:
        """Return the `model` that a list in list units makes by itself, of axes that do not turn.

        Raises:
            ExchangeError: If its entries make none.
        """
        return self.model(listing, 0, Reading(conventions))

    @abc.abstractmethod
    def to_list(
        self, model: Any, masters: Axes = (), target: ListTarget = ANY_LIST
    ) -> Mapping[str, Value]:
        """Return the entries of the list that holds it, rounded to list units.

        Args:
            model: One of `models`, in mm or °; what a list holds as whole units (nodes,
                accelerations) must be a multiple of one.
            masters: Logical numbers, in the order of the list.
            target: The list that they are written for; a sign is that of the model.

        Raises:
            ExchangeError: If something does not fit.
        """

    def beside(self, model: Any, others: Collection[str]) -> dict[str, int | str]:
        """Return what else the axis list needs, beside these other compensations."""
        return {}

    def exactly(self, masters: Axes, count: int) -> Axes:
        """Return the masters, so many of them.

        Raises:
            ExchangeError: If there are more or fewer.
        """
        name, words = self.kind.name, f"{len(masters)} axis numbers"
        expected = f"{count}: masters={{'{name}': (…)}}"
        expect(len(masters) == count, f"masters of {name}", words, expected)
        return masters

    def in_list_units(self, model: Any, unit: ModelUnit | None) -> Any:
        """Return the model with its values in a unit of the list; None: the usual one.

        Raises:
            ExchangeError: If they have another unit.
        """
        if unit is None or unit.name in self.units:
            return model
        expected = f"values in {' or '.join(self.units)}"
        raise ExchangeError(self.value, f"values in {unit.name}", expected)

    # ---------------------------------------------------------------- in the controller

    def installed(self, model: Any, masters: Axes, listing: ListFile) -> dict[str, Any]:
        """Return it as `AxisCompensations` takes it, by the names of fields.

        What is none of these fields becomes one of its `further` compensations. The masters are
        the columns of the axes that it looks at.
        """
        if not self.coupled:
            return {self.kind.name: model}
        cycles = self.kind.cycles
        spread = 0 if cycles is None else not_negative(listing, cycles[0])
        return {self.kind.name: Coupled(model, masters, spread)}

    def sees_offsets(self, listing: ListFile, conventions: Conventions) -> bool:
        """Whether it looks up the position with what the others add (S-23)."""
        return False

    def lacks(self, in_use: InUse, motion: Motion, reading: Reading) -> str | None:
        """Return what a motion lacks to compute it at all, in words; None: nothing.

        Positions are not looked for here (`looks_at`): a motion without one is refused.
        """
        return None

    def looks_at(self, in_use: InUse, motion: Motion, reading: Reading) -> Axes:
        """Return the axes whose positions it takes from a motion."""
        return in_use.masters

    # --------------------------------------------------------------------- for the proofs

    def inputs(self, masters: Axes) -> Axes:
        """Return the axes over whose positions it acts at standstill."""
        return masters

    def turns(self, model: Any) -> bool:
        """Whether the direction of motion changes what it adds."""
        return False


class AbstractProbe:
    """The step of a probe for one compensation: a plateau that cannot be overlooked.

    What follows an acceleration is probed in fast motion, what follows a velocity at a slow
    and steady one.

    Attributes:
        checks: What to look at before, in words.
        plateaus: Tenths of the travel of each master where its plateau begins and ends;
            none: it is no table. The memory that a list reserves for a table stays.
    """

    checks: tuple[str, ...] = ()
    plateaus: tuple[tuple[int, int], ...] = ()

    def probed(self, in_use: InUse) -> Probed:
        """Return what of it is probed."""
        return Probed(in_use.axis, in_use.name, in_use.masters)

    def entries(
        self, probed: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> Mapping[str, Value]:
        """Return the entries of the compensation list, 10 µm whatever sign they get."""
        table_of = kind(probed.name).entries.table
        if table_of is None:
            return {}
        masters = [axes[number] for number in probed.masters]
        nodes = tuple(master.grid for master in masters)
        turns = any(master.modulo for master in masters)
        table = table_of(probed.axis, probed.masters, nodes, conventions, turns)
        shares = [plateau(bounds) / HEIGHT for bounds in reversed(self.plateaus)]
        heights = HEIGHT * functools.reduce(np.multiply.outer, shares)
        return table.entries(np.rint(heights * LIST_UNITS).astype(np.int64))

    def additions(self, axis: ProbeAxis) -> dict[str, int | str]:
        """Return what only stands in the axis list; else it is switched on there."""
        return {}

    def places(self, axis: ProbeAxis, masters: Masters) -> tuple[Places, Places]:
        """Return where nothing is added and where the plateau is, by axis name."""
        middles = [0.5 * sum(bounds) for bounds in self.plateaus]
        pairs = zip(masters, middles or [10.0] * len(masters), strict=True)
        start = {master.name: master.at(0.0) for master in masters}
        return start, {master.name: master.at(middle) for master, middle in pairs}

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        """Return what may be seen, and what follows from it; of a table either sign."""
        return both_signs(axis, f"{probed.name}_sign")


@runtime_checkable
class PlanPart(Protocol):
    """The module ``plan`` of a compensation; ``fit`` is of its own class of keys."""

    def plan(self, tables: "Tables", index: int, fit: Any) -> "AbstractPlan":
        """Plan the fit of this index in the job, with these keys.

        Raises:
            JobError: If keys or existing lists do not suit.
        """
        ...


@runtime_checkable
class PagePart(Protocol):
    """The module ``page`` of a compensation."""

    def body(self, fit: Any, scale: "Scale") -> "Body":
        """Return plots, sentences and wild readings of the result that its draft made."""
        ...

"""Probe lists: one plateau of 10 µm per compensation, where it can be told apart.

A list that somebody fitted says little about the controller's own rules: its values are
small and all over the place. A plateau is either there or not, up or down, and stands
at one place.
"""

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile, Value
from ....models import Conventions
from ...exchange._files import to_add, with_tables
from ...exchange._identity import Increments
from ...exchange._machine_lists import Reading, machine_lists
from ...exchange._nodes import ListNodes
from ...exchange._units import LIST_UNITS, expect
from ...kinds import kind
from ._nc import AXIS_WORD, WORD_SHAPE

HEIGHT = 0.01
"""Height of a plateau: 10 µm, or 0.01° of a rotary axis."""
FIRST, SECOND = (2, 4), (6, 8)
"""Tenths of the travel where a plateau begins and ends: two places, told apart."""
DEFAULT_ACCELERATION = 1000
"""mm/s² at which a crosstalk table reaches its values, where no list says it."""

_TENTHS = 10
_SHORTEST = 10.0
"""mm or °: the ramps of a shorter travel would be steep."""


@dataclasses.dataclass(frozen=True)
class ProbeAxis:
    """An axis of the machine to be probed.

    Attributes:
        number: Logical number.
        name: For people and for the header of the list.
        travel: Positions in mm or ° between which it may move.
        rotary: Positions are in °.
        modulo: The travel is one turn.
        channel: Whose NC programs know its name.
        partner: Word of the other axis of its gantry, or None.
    """

    number: int
    name: str
    travel: tuple[float, float]
    rotary: bool = False
    modulo: bool = False
    channel: int = 1
    partner: str | None = None

    @property
    def grid(self) -> ListNodes:
        """Eleven nodes over the travel, a tenth of it apart, on whole mm or 0.1 mm."""
        low, high = self.travel
        expect(
            high - low >= _SHORTEST,
            f"travel of axis {self.number}",
            f"{low:g} to {high:g}",
            f"{_SHORTEST:g} mm or ° or more, for gentle slopes",
        )
        # Whole units of 1 mm where the travel is long enough to lose none of it.
        unit = LIST_UNITS if high - low >= 100 else LIST_UNITS // 100
        if self.modulo:
            unit = 1
        start = int(np.ceil(round(low * LIST_UNITS / unit, 6))) * unit
        step = int((high * LIST_UNITS - start) / _TENTHS / unit + 1e-9) * unit
        return ListNodes.grid(start, step, _TENTHS + 1)

    @property
    def height_text(self) -> str:
        """The height of a plateau, for people."""
        return "0.01°" if self.rotary else "10 µm"

    def at(self, tenths: float) -> float:
        """Return a position in mm or °, counted in tenths of the travel."""
        grid = self.grid
        return (grid.integers[0] + tenths * grid.interval) / LIST_UNITS


@dataclasses.dataclass(frozen=True)
class Probed:
    """One compensation that is probed.

    Attributes:
        axis: Logical number of the axis that it acts on.
        name: Of the compensation.
        masters: Logical numbers of the axes that it looks at.
        acceleration: Of a crosstalk table in mm/s², where the values are reached.
        kept: Entries of the list that is loaded now, where they are probed at a low level.
    """

    axis: int
    name: str
    masters: tuple[int, ...]
    acceleration: int = DEFAULT_ACCELERATION
    kept: Mapping[str, Value] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One thing that may be seen, and what follows from it.

    Attributes:
        seen: In words, with units.
        means: In words.
        conventions: What it settles, by name of the convention.
    """

    seen: str
    means: str
    conventions: Mapping[str, int | str] = dataclasses.field(default_factory=dict)


Masters = Sequence[ProbeAxis]
"""Axes that a compensation looks at, in the order of its list."""
Outcomes = tuple[Outcome, ...]
"""What may be seen, the expected one first."""
Places = dict[str, float]
"""Positions in mm or ° by axis name."""


@dataclasses.dataclass(frozen=True)
class Probe:
    """What is to be loaded for a probe.

    Attributes:
        axes: By logical number.
        tables: What is probed.
        lists: Compensation list by axis.
        additions: By axis what its axis list needs, as a list of just these entries.
        remarks: What is not probed, and what to do about it.
    """

    axes: Mapping[int, ProbeAxis]
    tables: tuple[Probed, ...]
    lists: Mapping[int, ListFile]
    additions: Mapping[int, ListFile]
    remarks: tuple[str, ...] = ()


def probed_in(lists: Sequence[ListFile], conventions: Conventions) -> list[Probed]:
    """Return what lists hold and can be probed; tables whether active or not.

    Friction is probed where a list holds it, at a low level of it: a current that nobody
    measured must not be put on a drive.

    Raises:
        ExchangeError: If an axis has two lists, or a table does not name its master.
    """
    machine = machine_lists(lists)
    tables = dataclasses.replace(machine, machine={}).in_use(conventions)
    lines = dataclasses.replace(machine, compensation={}).in_use(conventions)
    return [use.kind.probe.probed(use) for use in (*tables, *lines)]


def travel_in(
    lists: Sequence[ListFile], conventions: Conventions, increment: Increments = None
) -> dict[int, tuple[float, float]]:
    """Return over which positions in mm or ° the tables of the lists go, by axis.

    Raises:
        ExchangeError: If a list makes no table.
    """
    machine = dataclasses.replace(machine_lists(lists), machine={})
    ends: dict[int, list[float]] = {}
    for use in machine.in_use(conventions):
        if not use.kind.table:
            continue
        ways = use.model(Reading(conventions, increment)).ways
        for axis, nodes in zip(use.masters, ways, strict=True):
            places = np.asarray(nodes.positions, dtype=float)
            ends.setdefault(axis, []).extend((places[0], places[-1]))
    return {axis: (float(min(p)), float(max(p))) for axis, p in ends.items()}


def make_probe(
    axes: Mapping[int, ProbeAxis],
    tables: Sequence[Probed],
    conventions: Conventions,
    existing: Mapping[int, ListFile] | None = None,
    remarks: Sequence[str] = (),
) -> Probe:
    """Return the probe lists of a machine.

    Args:
        axes: All axes that are probed or looked at, by logical number.
        tables: What is to be probed.
        conventions: Order of the indices of a plane.
        existing: Lists that are loaded now: the memory that they reserve stays, so that
            no restart is needed.
        remarks: What is not probed, and what to do about it.

    Raises:
        ExchangeError: If there is nothing to probe, an axis is not known, its travel is too
            short, or two axes that are told apart have one name, or no NC program
            understands it.
    """
    nothing = "; ".join(("nothing to probe", *remarks)).rstrip(".")
    expected = "a list that holds a compensation, or a job with [[fits]]"
    expect(tables, "probe", nothing, expected)
    known = ", ".join(map(str, sorted(axes)))
    for table in tables:
        for axis in (table.axis, *table.masters):
            expect(
                axis in axes,
                f"{table.name} of axis {table.axis}",
                f"axis {axis}, whose travel is not known",
                (f"one of {known}, or " if known else "")
                + f"its limits in the job, or --travel A{axis}=0:500",
            )
    # A word belongs to its channel; the axes of one step are told apart by it.
    channels = {axis.channel for axis in axes.values()}
    sets = [[a for a in axes.values() if a.channel == c] for c in channels]
    sets += [[axes[k] for k in {table.axis, *table.masters}] for table in tables]
    for each in sets:
        names = [axis.name.upper() for axis in each]
        twice = sorted({name for name in names if names.count(name) > 1})
        expected = "a word of its own for each (nc_name in the job)"
        expect(not twice, "names of axes", f"{', '.join(twice)} twice", expected)
    used = {axes[k].name for table in tables for k in (table.axis, *table.masters)}
    for word in sorted(used):
        expected = f"a word of NC programs, {WORD_SHAPE} (nc_name in the job)"
        expect(re.fullmatch(AXIS_WORD, word), "names of axes", repr(word), expected)
    lists, additions = {}, {}
    for number in sorted({table.axis for table in tables}):
        mine = [table for table in tables if table.axis == number]
        old = (existing or {}).get(number)
        entries: dict[str, Value] = {}
        for table in mine:
            facts = kind(table.name)
            entries |= facts.probe.entries(table, axes, conventions)
            size = f"{facts.prefix}.max_points"
            if old is not None and facts.probe.plateaus and old.integer(size):
                entries[size] = old.integer(size) or 0
        name = axes[number].name
        title = f"Probe list of {name}: 10 um plateaus, not for machining."
        if entries:
            made = with_tables(None, number, entries, title, name=name)
            lists[number] = made.listing
        added: dict[str, Value] = {"kopf.achs_nr": number}
        for table in mine:
            found = kind(table.name)
            own = found.probe.additions(axes[number])
            added |= own or found.entries.activation()
        additions[number] = to_add(number, added)
    return Probe(dict(axes), tuple(tables), lists, additions, tuple(remarks))


def plateau(between: tuple[int, int]) -> Float[np.ndarray, " n"]:
    """Return a plateau at the nodes of an axis, in mm or °.

    Args:
        between: Tenths of the travel where it begins and ends.
    """
    tenths = np.arange(_TENTHS + 1)
    return np.where((tenths >= between[0]) & (tenths <= between[1]), HEIGHT, 0.0)


def both_signs(axis: ProbeAxis, convention: str) -> Outcomes:
    """Return what either sign of a table looks like, the expected one first.

    The axis is the one that moves, the convention the name of the rule.
    """
    kept = f"entries are offsets: {axis.name} moves by what stands in the list"
    turned = f"entries are errors: the controller subtracts them from {axis.name}"
    plus = Outcome(f"+{axis.height_text}", kept, {convention: 1})
    minus = Outcome(f"−{axis.height_text}", turned, {convention: -1})
    return (plus, minus) if getattr(Conventions, convention) > 0 else (minus, plus)


def number_text(value: float) -> str:
    """Return a position without needless digits."""
    return f"{value:.10g}"


def places_text(places: Mapping[str, float]) -> str:
    """Return positions by axis as they are read aloud."""
    return ", ".join(f"{name} {number_text(value)}" for name, value in places.items())

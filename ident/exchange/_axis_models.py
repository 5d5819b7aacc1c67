"""The models of one axis ↔ its lists: `axcomp.load_model` and `axcomp.write_lists`."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any, final

from ...data.files import write_atomically, write_keeping
from ...data.lists import ListFile, Value
from ...models import Conventions
from ..kinds import kind, kinds
from ._capacity import ListTarget
from ._files import axis_file, to_add, with_tables
from ._identity import Increments
from ._machine_lists import Reading, entries_of_activation, machine_lists
from ._nodes import Ranges
from ._units import ModelUnit, expect


@final
@dataclasses.dataclass(frozen=True, eq=False)
class AxisModels(Mapping[str, Any]):
    """The compensations of one axis as models, by name: ``models["leadscrew"]``.

    Attributes:
        axis: Logical number of the axis.
        models: Model by compensation: backlash, temperature, cross, plane, leadscrew,
            friction (a `FrictionCompensation`), crosstalk.
        masters: Logical numbers of the axes that a cross table, a plane or a crosstalk
            looks at, in the order of the list.
        units: Unit of the values where it is not mm or °. Currents of a friction have
            none that a list holds unless it is stated: ``"list"`` as they come from one,
            or `ModelUnit`.
    """

    axis: int
    models: Mapping[str, Any]
    masters: Mapping[str, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    units: Mapping[str, ModelUnit | str] = dataclasses.field(default_factory=dict)

    def __getitem__(self, name: str) -> Any:
        return self.models[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.models)

    def __len__(self) -> int:
        return len(self.models)

    def to_entries(
        self,
        *,
        conventions: Conventions | None = None,
        existing: ListFile | None = None,
        build: str | None = None,
    ) -> tuple[dict[str, Value], dict[str, Value]]:
        """Return the entries of the compensation list and those of the axis list.

        Args:
            conventions: Rules of the controller; left out: the defaults.
            existing: Compensation list that will be edited.
            build: Of the controller; left out: the newest.

        Raises:
            ExchangeError: If a compensation is unknown, a unit or sign is none of the
                list, a master is missing, or something does not fit into the list.
        """
        rules = conventions or Conventions()
        self._refuse_unknown()
        tables = [n for n in self.models if kind(n).holder == "compensation"]
        compensation = dict[str, Value]()
        machine = dict[str, Value](entries_of_activation(tables))
        for name in tables:
            model = self.models[name]
            machine |= kind(name).entries.beside(model, self.models.keys())
        target = ListTarget(existing, build=build, rules=rules)
        for name in sorted(self.models):
            model = self._in_list_units(name, rules)
            masters = self.masters.get(name, ())
            entries = kind(name).entries.to_list(model, masters, target)
            (compensation if name in tables else machine).update(entries)
        return compensation, machine

    def _in_list_units(self, name: str, rules: Conventions) -> Any:
        """Return a model whose values and sign are those of the list, or raise."""
        model, entries = self.models[name], kind(name).entries
        sign = float(getattr(rules, f"{name}_sign", 0.0))
        if sign:
            found = f"a model with sign {model.sign:+g}"
            expected = f"sign {sign:+g}, as the controller applies entries"
            expected += f" (conventions.{name}_sign)"
            expect(model.sign == sign, entries.value, found, expected)
        stated = self.units.get(name)
        unit = ModelUnit(stated) if isinstance(stated, str) else stated
        return entries.in_list_units(model, unit)

    def _refuse_unknown(self) -> None:
        """Raise at a model that is none of its compensation, and at masters that are none."""
        models_of = {record.name: record.entries.models for record in kinds()}
        for name in sorted(self.models):
            fits = isinstance(self.models[name], models_of.get(name, ()))
            listing = ", ".join(f"{k} ({v[0].__name__})" for k, v in models_of.items())
            found = f"a {type(self.models[name]).__name__} as {name}"
            expect(fits, f"axis {self.axis}", found, f"one of {listing}")
        for field in ("masters", "units"):
            surplus = ", ".join(sorted({*getattr(self, field)} - {*self.models}))
            expected = f"some of its models, {', '.join(self.models)}"
            expect(not surplus, f"{field} of axis {self.axis}", surplus, expected)
        for name in filter(lambda name: kind(name).table, sorted(self.masters)):
            axes = self.masters[name]
            others = len({self.axis, *axes}) == 1 + len(axes)
            where = f"masters of the {name} of axis {self.axis}"
            expect(others, where, ", ".join(map(str, axes)), "other axes, each once")


def load_model(
    *lists: str | Path | ListFile,
    conventions: Conventions | None = None,
    increment: Increments = None,
    modulo: Ranges | None = None,
) -> AxisModels:
    """Return the models of all compensations that the lists of one axis switch on.

    Without an axis list everything in the compensation list is.

    Args:
        lists: Compensation list, axis list, or both.
        conventions: Rules of the controller; left out: the defaults.
        increment: mm or ° per encoder increment, for lists with ``unit 0``.
        modulo: Range in ° by axis number, for the axes that turn.

    Raises:
        OSError: If a file cannot be read.
        ExchangeError: If a list makes no table, or the lists are those of several axes.
    """
    rules = conventions or Conventions()
    listings = [
        listing if isinstance(listing, ListFile) else ListFile.read(Path(listing))
        for listing in lists
    ]
    machine = machine_lists(listings)
    numbers = sorted({*machine.compensation, *machine.machine})
    sources = ", ".join(listing.source for listing in listings) or "no list"
    expected = "compensation list and axis list of one axis"
    expect(len(numbers) == 1, sources, f"lists of the axes {numbers}", expected)
    reading = Reading(rules, increment, modulo or {})
    uses = {use.name: use for use in machine.in_use(rules)}
    entries = {name: use.kind.entries for name, use in uses.items()}
    named = ((n, entries[n].named_masters(use.listing)) for n, use in uses.items())
    masters = {name: axes for name, axes in named if axes}
    currents = [name for name, use in uses.items() if use.kind.adds_current]
    return AxisModels(
        axis=numbers[0],
        models={name: use.model(reading) for name, use in uses.items()},
        masters=masters,
        units={name: entries[name].units[0] for name in currents},
    )


def write_lists(
    models: AxisModels | Sequence[AxisModels],
    out: str | Path,
    *,
    lists: Mapping[int, str | Path | Sequence[str | Path]] | None = None,
    conventions: Conventions | None = None,
    build: str | None = None,
) -> tuple[Path, ...]:
    """Write models into lists as they stand: no hold-out, no gate; `Fit.write` has those.

    Args:
        models: Of one axis or several.
        out: Folder; made where it is missing. Each file is replaced as a whole; what
            one held before, and is none of `lists`, is kept in ``kept/``.
        lists: Existing lists by axis number: they are edited, all else in them stays.
        conventions: Rules of the controller; left out: the defaults.
        build: Of the controller; left out: the newest.

    Returns:
        The files: ``achskw<number>.lis``, and ``achsmds<number>.lis`` where an axis list
        was given, else ``achsmds<number>.add.lis`` with the entries to add to it.

    Raises:
        OSError: If a file cannot be read or written.
        ExchangeError: As `AxisModels.to_entries`; nothing is written then.
    """
    drafts: list[ListFile] = []
    given_models = list(models) if isinstance(models, Sequence) else [models]
    for axis_models in given_models:
        name, example = type(axis_models).__name__, "AxisModels(1, {'cross': …})"
        expect(isinstance(axis_models, AxisModels), "models", name, example)
    numbers = [axis_models.axis for axis_models in given_models]
    for number in numbers:
        natural = isinstance(number, Integral) and number >= 1
        expect(natural, "axis", repr(number), "its logical number, 1 or more")
    once = len({*numbers}) == len(numbers)
    expect(once, "models", f"axes {numbers}", "one AxisModels per axis")
    surplus = {*(lists or {})} - {*numbers}
    expect(not surplus, "lists", f"axes {sorted(surplus)}", f"some of {numbers}")
    given_files: set[Path] = set()
    for number, axis_models in zip(numbers, given_models, strict=True):
        stated = (lists or {}).get(number, ())
        files = [stated] if isinstance(stated, str | Path) else stated
        given_files |= {Path(file).resolve() for file in files}
        existing_lists = machine_lists([ListFile.read(Path(file)) for file in files])
        existing = existing_lists.compensation.get(number)
        entries, axis_entries = axis_models.to_entries(
            conventions=conventions, existing=existing, build=build
        )
        if entries:
            title = f"Compensation list of axis {number}, written by axcomp"
            drafts.append(with_tables(existing, number, entries, title).listing)
        machine = existing_lists.machine.get(number)
        if axis_entries and machine is not None:
            machine = machine.merge(axis_entries)
            drafts.append(dataclasses.replace(machine, source=axis_file(number)))
        elif axis_entries:
            drafts.append(to_add(number, axis_entries))
        _refuse_other_rules(axis_models, drafts, conventions)
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    for draft in drafts:
        target = folder / draft.source
        write = write_atomically if target.resolve() in given_files else write_keeping
        write(target, draft.dumps())
    return tuple(folder / draft.source for draft in drafts)


def _refuse_other_rules(
    axis_models: AxisModels, lists: Sequence[ListFile], conventions: Conventions | None
) -> None:
    """Raise where lists, read back, make a model of other rules than the one written."""
    # A list holds values; what a controller does outside a table, or at rest, is its own.
    rules = conventions or Conventions()
    for use in machine_lists(lists).in_use(rules):
        model = axis_models.models.get(use.name)
        if model is None or use.axis != axis_models.axis:
            continue
        back = use.model(Reading(rules))
        for rule in use.kind.entries.rules:
            own, read = getattr(model, rule), getattr(back, rule)
            where = f"the {use.name} of axis {use.axis}"
            expected = f"{read}, as the controller (or conventions) has it"
            expect(own == read, where, f"{rule} = {own}, which no list holds", expected)

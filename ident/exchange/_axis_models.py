"""The models of one axis ↔ its lists: `axcomp.load_model` and `axcomp.write_lists`."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, final

import equinox as eqx

from ...data.files import write_atomically
from ...data.lists import ListFile, Value, new_list
from ...models import (
    Backlash,
    Conventions,
    Cross,
    Crosstalk,
    FrictionCompensation,
    FrictionTable,
    Leadscrew,
    LegacyCrosstalk,
    Plane,
    TemperatureLine,
)
from . import _axis_list
from ._controller import Reading, model_of
from ._cross import cross_master, entries_of_cross
from ._crosstalk import entries_of_crosstalk
from ._errors import ExchangeError
from ._friction import entries_of_friction
from ._identity import Increments
from ._leadscrew import entries_of_leadscrew
from ._machine_lists import PREFIXES, machine_lists
from ._modulo import Ranges
from ._plane import entries_of_plane

_NOTHING: Mapping[str, Any] = MappingProxyType({})


@final
@dataclasses.dataclass(frozen=True)
class ModelUnit:
    """The unit of the values of a model, where it is not that of the library.

    Attributes:
        name: ``"mm"``, ``"deg"``, ``"list"``, ``"A"``, ``"Nm"`` …
        size: What one unit of the list is in it: for currents the rated current times the
            share of it that one unit of ``out`` is. None where nobody said.
    """

    name: str
    size: float | None = None


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
        compensation: dict[str, Value] = {}
        machine: dict[str, Value] = {}
        tables = [name for name in self.models if name in PREFIXES]
        machine |= _axis_list.entries_of_activation(tables)
        screw = self.models.get("leadscrew")
        if isinstance(screw, Leadscrew) and screw.bilateral:
            if "backlash" in self.models:
                raise ExchangeError(
                    where=_axis_list.ACTIVATION["backlash"],
                    found="a backlash beside a leadscrew table for both directions",
                    expected="one of the two: the table contains the backlash",
                )
            machine[_axis_list.ACTIVATION["backlash"]] = 0
        options: dict[str, Any] = {"existing": existing, "build": build}
        for name in sorted(self.models):
            model = self._in_list_units(name, rules)
            if isinstance(model, Cross):
                (master,) = self._masters(name, 1)
                compensation |= entries_of_cross(model, master, **options)
            elif isinstance(model, Plane):
                first, second = self._masters(name, 2)
                pair = first, second
                compensation |= entries_of_plane(model, pair, rules, **options)
            elif isinstance(model, Leadscrew):
                compensation |= entries_of_leadscrew(model, **options)
            elif isinstance(model, FrictionCompensation):
                compensation |= entries_of_friction(model, **options)
            elif isinstance(model, Backlash):
                machine |= _axis_list.entries_of_backlash(model, rules)
            elif isinstance(model, TemperatureLine):
                machine |= _axis_list.entries_of_temperature(model)
            else:
                masters = self.masters.get(name, ())
                compensation |= entries_of_crosstalk(model, masters)
        return compensation, machine

    def _masters(self, name: str, count: int) -> tuple[int, ...]:
        masters = self.masters.get(name, ())
        if len(masters) != count:
            raise ExchangeError(
                where=f"masters of {name}",
                found=f"{len(masters)} axis numbers",
                expected=f"{count}: masters={{'{name}': (…)}}",
            )
        return masters

    def _in_list_units(self, name: str, rules: Conventions) -> Any:
        """Return a model whose values and sign are those of the list, or raise."""
        kind = _KINDS.get(name)
        model: Any = self.models[name]
        if kind is None or type(model) not in kind.models:
            known = ", ".join(
                f"{k} ({v.models[0].__name__})" for k, v in _KINDS.items()
            )
            raise ExchangeError(
                where=f"axis {self.axis}",
                found=f"a {type(model).__name__} as {name}",
                expected=f"one of {known}",
            )
        sign = float(getattr(rules, f"{name}_sign", 0.0))
        if sign and model.sign != sign:
            raise ExchangeError(
                where=kind.key,
                found=f"a model with sign {model.sign:+g}",
                expected=f"sign {sign:+g}, as the controller applies entries"
                f" (conventions.{name}_sign)",
            )
        usual = "no stated unit" if name == "friction" else kind.units[0]
        given = self.units.get(name, usual)
        unit = ModelUnit(given) if isinstance(given, str) else given
        if unit.name in kind.units:
            return model
        if name == "friction" and unit.size and isinstance(model.law, FrictionTable):
            scaling = model.law.scaling / unit.size
            return eqx.tree_at(lambda friction: friction.law.scaling, model, scaling)
        expected = f"values in {' or '.join(kind.units)}"
        if name == "friction":
            expected = (
                "currents in units of the list (units={'friction': 'list'}), which are"
                " shares of the rated torque, or what one of them is:"
                f" ModelUnit({unit.name!r}, size=rated current · share)"
            )
        raise ExchangeError(kind.key, f"values in {unit.name}", expected)


@dataclasses.dataclass(frozen=True)
class _Kind:
    models: tuple[type, ...]
    key: str
    """Entry that holds the values, for messages."""
    units: tuple[str, ...]
    """Units that its values may have as they stand, the usual one first."""


_LENGTH = ("mm", "deg")
_KINDS = {
    name: _Kind(models, f"{PREFIXES[name]}.{key}", units)
    for name, models, key, units in (
        ("cross", (Cross,), "table[].correction", _LENGTH),
        ("plane", (Plane,), "table[][].correction", _LENGTH),
        ("leadscrew", (Leadscrew,), "table[].pos", _LENGTH),
        ("crosstalk", (Crosstalk, LegacyCrosstalk), "position[]", _LENGTH),
        ("friction", (FrictionCompensation,), "table[].out", ("list",)),
    )
} | {
    "backlash": _Kind((Backlash,), _axis_list.WIDTH, _LENGTH),
    "temperature": _Kind((TemperatureLine,), "lr_param.temp_comp_offset_0", ("mm",)),
}
_STALE = {name: ("table[",) for name in PREFIXES} | {
    "crosstalk": ("table[", "position[", "max_points", "master_", "last_index")
}
"""Entries of a list that go before new ones are written, by their beginnings."""


def models_from_lists(
    lists: Sequence[ListFile],
    *,
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
        ExchangeError: If a list makes no table, or the lists are those of several axes.
    """
    rules = conventions or Conventions()
    machine = machine_lists(lists)
    numbers = sorted({*machine.compensation, *machine.machine})
    if len(numbers) != 1:
        raise ExchangeError(
            where=", ".join(one.source for one in lists) or "no list",
            found=f"lists of the axes {numbers}",
            expected="compensation list and axis list of one axis",
        )
    reading = Reading(rules, increment, modulo or {})
    models: dict[str, Any] = {}
    masters: dict[str, tuple[int, ...]] = {}
    for one in machine.in_use(rules):
        models[one.name] = model_of(one, reading)
        if one.name in ("plane", "crosstalk"):
            masters[one.name] = one.masters
        elif one.name == "cross":
            masters[one.name] = (cross_master(one.listing),)
    return AxisModels(numbers[0], models, masters, {"friction": "list"})


def load_model(
    *lists: str | Path,
    conventions: Conventions | None = None,
    increment: Increments = None,
    modulo: Ranges | None = None,
) -> AxisModels:
    """Return the models of an axis from its list files; see `models_from_lists`.

    Raises:
        OSError: If a file cannot be read.
        ExchangeError: As `models_from_lists`.
    """
    return models_from_lists(
        [ListFile.read(Path(one)) for one in lists],
        conventions=conventions,
        increment=increment,
        modulo=modulo,
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
        out: Folder; made where it is missing. Each file is replaced as a whole.
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
    drafts: dict[str, ListFile] = {}
    for one in [models] if isinstance(models, AxisModels) else models:
        given = (lists or {}).get(one.axis, ())
        files = [given] if isinstance(given, str | Path) else given
        old = machine_lists([ListFile.read(Path(file)) for file in files])
        existing = old.compensation.get(one.axis)
        entries, machine = one.to_entries(
            conventions=conventions, existing=existing, build=build
        )
        if entries:
            name = f"achskw{one.axis}.lis"
            drafts[name] = _with_entries(existing, one.axis, entries)
        if machine and one.axis in old.machine:
            name = f"achsmds{one.axis}.lis"
            drafts[name] = old.machine[one.axis].merge(machine)
        elif machine:
            what = f"Entries to set in achsmds{one.axis}.lis: no whole axis list"
            name = f"achsmds{one.axis}.add.lis"
            drafts[name] = new_list(machine, comment=(what,))
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    for name, draft in drafts.items():
        write_atomically(folder / name, draft.dumps())
    return tuple(folder / name for name in drafts)


def _with_entries(
    existing: ListFile | None, axis: int, entries: Mapping[str, Value]
) -> ListFile:
    """Return a new list, or the existing one whose tables are replaced."""
    head: dict[str, Value] = {"kopf.achs_nr": axis}
    if existing is None:
        what = f"Compensation list of axis {axis}, written by axcomp"
        return new_list(head | dict(entries), comment=(what,))
    begin = tuple(
        f"{prefix}.{part}"
        for kind, prefix in PREFIXES.items()
        if any(name.startswith(f"{prefix}.") for name in entries)
        for part in _STALE[kind]
    )
    there = [entry.name for entry in existing.entries if entry.name.startswith(begin)]
    gone = [name for name in there if name not in entries] if begin else []
    return existing.remove(gone).merge(head | dict(entries))

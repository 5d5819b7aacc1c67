"""The registry of parameters: loaded once from ``parameters.toml``."""

import functools
import pathlib
import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from ..errors import AxcompError
from ._parameter import (
    Alias,
    Change,
    Condition,
    Function,
    Kind,
    Parameter,
    parse_interval,
)

_TUPLES = (
    "values",
    "also",
    "words",
    "unit",
    "numbers",
    "misspelt",
    "semantics",
    "source",
)


class BuildError(AxcompError):
    """A name of a controller build that cannot be read."""

    def __init__(self, build: str) -> None:
        super().__init__(build)
        self.build = build

    def __str__(self) -> str:
        return f"build {self.build!r}: expected a name such as V3.1.3108.4"


class Registry:
    """Every parameter that the manuals name, by name and by id."""

    def __init__(
        self,
        rows: Iterable[Parameter],
        functions: Iterable[Function],
        kinds: Mapping[str, Kind],
    ) -> None:
        """Index the rows; of two with one id or one key, the present one counts."""
        self.rows: tuple[Parameter, ...] = tuple(rows)
        self.functions: tuple[Function, ...] = tuple(functions)
        """The compensations whose tables stand in compensation lists."""
        self.by_key: dict[str, Parameter] = {}
        """Row of a canonical key."""
        self.by_id: dict[str, Parameter] = {}
        """Row of an id; the present one where an id changed its meaning."""
        self.aliases: dict[str, tuple[Parameter, Alias]] = {}
        """Row and alias of every other name."""
        self.ruled: dict[Kind, list[Parameter]] = {}
        """By kind of list: rows that must stand somewhere, or agree with others."""
        self.kinds = dict(kinds)
        for row in sorted(self.rows, key=lambda row: row.generation == "old"):
            if row.key:
                self.by_key.setdefault(row.key, row)
            if row.id:
                self.by_id.setdefault(row.id, row)
            for misspelt in row.misspelt:
                self.by_id.setdefault(misspelt, row)
            for alias in row.aliases:
                self.aliases[alias.name] = (row, alias)
        for row in self.by_key.values():
            if row.needed is not None or row.conditions:
                self.ruled.setdefault(row.kind, []).append(row)

    def canonical(self, key: str) -> str:
        """Return the canonical key of ``key``; an unknown one comes back as it is.

        ``key`` is in lower case with its indices as ``[]``. A name of the older
        crosstalk generation is a parameter of its own and stays.
        """
        entry = self.aliases.get(key)
        return key if entry is None else entry[0].key

    def alias(self, key: str) -> Alias | None:
        """Return what ``key`` is, where it is not the canonical name."""
        entry = self.aliases.get(key)
        return None if entry is None else entry[1]

    def kind(self, key: str) -> Kind:
        """Return the kind of list that an entry of this name belongs to."""
        if (row := self.by_key.get(self.canonical(key))) is not None:
            return row.kind
        for prefix, kind in self.kinds.items():
            if key.startswith(prefix):
                return kind
        return "unknown"


_files = [pathlib.Path(__file__).with_name("parameters.toml")]


def add_parameters(path: pathlib.Path) -> None:
    """Add ``[[parameters]]`` and ``[[functions]]`` of another file to the registry.

    What a name means already, it goes on to mean.
    """
    if path not in _files:
        _files.append(path)
        registry.cache_clear()


@functools.cache
def registry() -> Registry:
    """Return the registry, loaded on first use."""
    data, *others = (tomllib.loads(path.read_text(encoding="utf-8")) for path in _files)
    for table in others:
        data["parameters"] += table.get("parameters", [])
        data["functions"] += table.get("functions", [])
    kinds: dict[str, Kind] = {
        prefix: kind for kind, prefixes in data["kinds"].items() for prefix in prefixes
    }
    rows = [_row(raw, kinds) for raw in data["parameters"]]
    return Registry(rows, map(_function, data["functions"]), kinds)


def _function(raw: dict[str, Any]) -> Function:
    lists = ("signs", "masters", "adaptations")
    return Function(**{**raw, **{name: tuple(raw.get(name, ())) for name in lists}})


def _row(raw: dict[str, Any], kinds: Mapping[str, Kind]) -> Parameter:
    """Return the parameter of one table of the file; misspelt fields are refused."""
    fields = dict(raw)
    key = fields.setdefault("key", "")
    fields.setdefault("id", None)
    fields["type"] = type_name = fields.get("type", "")
    fields["kind"] = next(
        (kind for prefix, kind in kinds.items() if key.startswith(prefix)), "unknown"
    )
    fields["axes"] = tuple(fields.get("axes", ("T", "R", "S")))
    for name in _TUPLES:
        if name in fields:
            fields[name] = tuple(fields[name])
    for name in ("range", "wide_range", "plausible"):
        if name in fields:
            fields[name] = parse_interval(fields[name], type_name)
    for name in ("step", "jump"):
        if name in fields:
            fields[name] = Change(**fields[name])
    fields["conditions"] = tuple(
        Condition(**{**condition, "readings": tuple(condition["readings"])})
        for condition in fields.get("conditions", ())
    )
    fields["aliases"] = tuple(Alias(**alias) for alias in fields.get("aliases", ()))
    return Parameter(**fields)


def parse_build(build: str) -> tuple[int, ...]:
    """Return the numbers of a build, for comparing: V3.1.3079.06 → (3, 1, 3079, 6).

    Raises:
        BuildError: If the name holds something else than numbers and dots.
    """
    parts = build.strip().removeprefix("V").removeprefix("v").split(".")
    if len(parts) < 2 or not all(part.isascii() and part.isdigit() for part in parts):
        raise BuildError(build)
    return tuple(int(part) for part in parts)


def build_has(parameter: Parameter, build: str | None) -> bool:
    """Return whether a build knows the parameter; the newest one where left out."""
    if build is None or parameter.since is None:
        return True
    return parse_build(build) >= parse_build(parameter.since)

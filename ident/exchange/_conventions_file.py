"""The conventions of one machine as a file: written by `verify`, read by every job.

TOML. What stands in ``[verified]``, or before any table, has been settled by a log or a
second measurement of that machine; what stands in ``[assumed]`` holds until then.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...data.toml import TomlError, line_of, read_toml
from ...models import ConventionError, Conventions

_TABLES = ("verified", "assumed")
_IDENTITY = ("machine", "saved_at")
_HEAD = "# How the controller of this machine applies its lists.\n"


@dataclasses.dataclass(frozen=True)
class StoredConventions:
    """The rules of one machine's controller, and which of them are settled.

    Attributes:
        conventions: All rules, defaults included.
        verified: Names of those that a log or a second measurement has settled.
        machine: Id of the machine (``[machine] id`` of its jobs), or None.
        saved_at: Day of the last save as ``2026-11-21``, or None.
    """

    conventions: Conventions = dataclasses.field(default_factory=Conventions)
    verified: frozenset[str] = frozenset()
    machine: str | None = None
    saved_at: str | None = None

    def with_verified(
        self,
        values: Mapping[str, int | str],
        *,
        machine: str | None = None,
        saved_at: str | None = None,
    ) -> "StoredConventions":
        """Return the rules with these settled; what was settled before stays so.

        A rule that is settled anew takes the new value: the controller may have been
        updated.

        Raises:
            ConventionError: If a name is unknown or a value cannot be taken.
        """
        rules = Conventions.from_dict({**self.conventions.to_dict(), **values})
        owner, day = machine or self.machine, saved_at or self.saved_at
        return StoredConventions(rules, self.verified | set(values), owner, day)

    def contradicted(self, values: Mapping[str, int | str]) -> tuple[str, ...]:
        """Return the settled rules that these values would turn."""
        current = self.conventions.to_dict()
        return tuple(
            n for n in values if n in self.verified and current[n] != values[n]
        )

    def saved_over(self, before: str = "") -> bytes:
        """Return a file with these rules: settled ones, and those assumed against the defaults.

        Args:
            before: The file as it is, which reads well: order and comments in it stay; left
                out: there is none.
        """
        import tomlkit  # takes long to load

        document: Any = tomlkit.parse(before if before.strip() else _HEAD)
        if self.machine not in (None, document.get("machine")):
            document["machine"] = self.machine
        if self.saved_at not in (None, str(document.get("saved_at"))):
            document["saved_at"] = tomlkit.value(self.saved_at)
        rules = self.conventions.listing()
        for rule in sorted(rules, key=lambda rule: rule.name not in self.verified):
            name, settled = rule.name, rule.name in self.verified
            held = [key for key in _TABLES if name in document.get(key, ())]
            if not settled and not held and rule.value == rule.default:
                continue
            group = "verified" if settled else "assumed"
            if name not in document and group not in document:
                document[group] = tomlkit.table()
            place = document if name in document else document[group]
            if name not in place:
                place.add(tomlkit.comment(f"{rule.meaning} ({rule.rule})"))
            if place.get(name) != rule.value:
                place[name] = rule.value
            for other in {*held} - {group}:
                del document[other][name]
        return tomlkit.dumps(document).encode()


def read_conventions(path: Path, machine: str | None = None) -> StoredConventions:
    """Return the conventions that a file states, of one machine (its id) or of any.

    Raises:
        TomlError: If it is no TOML, a name is unknown, a value cannot be
            taken, or it belongs to another machine.
        OSError: If it cannot be read.
    """
    text, values = read_toml(path)
    identity = {name: values.pop(name) for name in _IDENTITY if name in values}
    verified = {k: v for k, v in values.items() if k not in _TABLES}
    assumed: dict[str, Any] = {}
    for name in _TABLES:
        table = values.get(name, {})
        if not isinstance(table, dict):
            reason = f"{name}: found {table!r}, expected a table [{name}]"
            raise TomlError(str(path), line_of(text, [name]), reason)
        (verified if name == "verified" else assumed).update(table)
    try:
        conventions = Conventions.from_dict({**assumed, **verified})
    except ConventionError as error:
        tables = [[name] for name in _TABLES if error.name in values.get(name, ())]
        line = line_of(text, [*next(iter(tables), []), error.name])
        raise TomlError(str(path), line, str(error)) from None
    owner = identity.get("machine")
    if owner is not None and not isinstance(owner, str):
        reason = f"machine: found {owner!r}, expected the id of a machine in quotes"
        raise TomlError(str(path), line_of(text, ["machine"]), reason)
    if machine is not None and owner not in (None, machine):
        reason = f"found the conventions of machine {owner!r}, expected {machine!r}"
        raise TomlError(str(path), line_of(text, ["machine"]), reason)
    saved = identity.get("saved_at")
    return StoredConventions(
        conventions, frozenset(verified), owner, None if saved is None else str(saved)
    )

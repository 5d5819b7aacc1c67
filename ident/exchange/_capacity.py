"""How many entries a table may have, and from which build that can be changed."""

import dataclasses
from typing import final

from ...data.lists import ListFile, build_has, registry
from ...models import Conventions
from ._units import expect


@final
@dataclasses.dataclass(frozen=True)
class ListTarget:
    """The list that entries are written for.

    Attributes:
        existing: Compensation list that will be edited; 0 in it stands for the default.
        max_points: Wanted size of the memory, or None to write it only where needed.
        build: Of the controller, or None for the newest.
        rules: Of the controller.
    """

    existing: ListFile | None = None
    max_points: int | None = None
    build: str | None = None
    rules: Conventions = dataclasses.field(default_factory=Conventions)

    def max_points_entry(
        self, prefix: str, needed: int, fits_default: bool
    ) -> dict[str, int | str]:
        """Return the entry ``max_points`` to write; none where it stays as it is.

        It is written only where it must be: its change asks for a restart.

        Args:
            prefix: Structure in the list.
            needed: Smallest value that holds the table under every reading of the manuals.
            fits_default: Whether the table fits without the entry, in every build.

        Raises:
            ExchangeError: If the build lacks the parameter but the table needs it, or the
                user asks for less than the table needs.
        """
        name, size = f"{prefix}.max_points", self.max_points
        expected = f"at least {needed} for this table"
        expect(size is None or size >= needed, name, size, expected)
        stated = None if self.existing is None else self.existing.integer(name)
        enough = stated >= needed if stated else fits_default
        if size is None and not enough:
            size = needed
        if size is None or size == stated:
            return {}
        words = f"a table that needs {needed} on build {self.build}"
        expected = "a table within the fixed size (max_points: V3.1.3079.06 on)"
        expect(build_has(registry().by_key[name], self.build), name, words, expected)
        return {name: size}


ANY_LIST = ListTarget()
"""A new list, for the newest build."""


_MOST = 4_000_000
"""Values of a table that is read; no controller has the memory for as many."""


def refuse_huge(count: int, where: str) -> None:
    """Raise at a size that only a mistyped list states, before it fills the memory."""
    expect(count <= _MOST, where, f"{count} values", f"at most {_MOST}")

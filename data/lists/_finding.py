"""What a check of lists says: one finding per thing found, in the file's own words."""

import dataclasses
from typing import Literal, TypeAlias

Level: TypeAlias = Literal["error", "warning", "info"]
"""How much a finding matters.

``error``: the kernel refuses it, or it breaks every reading of the manuals.
``warning``: it keeps only one of two contradictory statements, or is likely a mistake.
``info``: worth knowing; never fails a check.
"""


@dataclasses.dataclass(frozen=True, slots=True)
class Finding:
    """One thing found in a list; the fields are those of ``axcomp check --json``."""

    file: str
    """The list as it was named to the reader."""
    line: int
    """1-based line, or 1 where the finding concerns the whole file."""
    column: int
    """1-based column."""
    level: Level
    id: str | None
    """Id of the parameter, such as ``P-COMP-00016``; None where it has none."""
    number: int | None
    """Error number that the controller reports, where it is known."""
    message: str
    found: str
    """What the list holds."""
    expected: str
    """What the manuals ask for."""

    def __str__(self) -> str:
        """Return the finding as one line that editors can jump to."""
        notes = [self.id] if self.id else []
        if self.number is not None:
            notes.append(f"controller error {self.number}")
        tail = f" ({', '.join(notes)})" if notes else ""
        position = f"{self.file}:{self.line}:{self.column}"
        text = f"{position}: {self.level}: {self.message}{tail}"
        # A stray control character must not break the line, or move the cursor.
        return text if text.isprintable() else "".join(map(_printable, text))


def _printable(character: str) -> str:
    return character if character.isprintable() else repr(character)[1:-1]

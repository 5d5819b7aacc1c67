"""What a list holds: entries, columns of a table, and remarks on the text."""

import dataclasses
import functools

from ._values import parse_integer


@dataclasses.dataclass(frozen=True, slots=True)
class Entry:
    """One entry of a list, as it stands in its line."""

    name: str
    """Canonical name with indices: ``kw.crosscomp2.table[0][1].correction``."""
    written: str
    """The name as it stands in the file."""
    value: str
    """Text of the value, without comment and quotes; empty where there is none."""
    line: int
    """1-based line."""
    column: int
    """1-based column of the name."""
    value_column: int
    """1-based column of the value, or of the place where it is missing."""
    key: str
    """Canonical name with blank indices: ``kw.crosscomp2.table[][].correction``."""
    indices: tuple[int, ...]
    quoted: bool = False
    """Whether the value stands in quotes; a number never does."""


@dataclasses.dataclass(frozen=True, slots=True)
class TextRemark:
    """An anomaly of the text that does not stop the reader."""

    line: int
    column: int
    code: str
    """One of `RemarkCode`."""
    text: str
    """What stands there."""


@dataclasses.dataclass(frozen=True)
class Rows:
    """All entries of one key, in file order, as parallel lists.

    A table of 50 000 entries is a handful of lists here, not 50 000 objects: whoever
    looks at every value of a table should look at these.
    """

    key: str
    indices: list[tuple[int, ...]]
    """Per row; the empty tuple where the key has no index."""
    texts: list[str]
    """Text of each value."""
    lines: list[int]
    """1-based line of each row."""
    plain: bool
    """Whether every text is a decimal integer of at most 18 digits."""

    @functools.cached_property
    def integers(self) -> list[int | None]:
        """Value of each row in list units; None where it is not a decimal integer."""
        if self.plain:
            return list(map(int, self.texts))
        return [parse_integer(text) for text in self.texts]

    @functools.cached_property
    def last(self) -> dict[tuple[int, ...], int]:
        """Row that counts for each index: the last one (semantics S-08)."""
        return dict(zip(self.indices, range(len(self.indices)), strict=True))

"""Lines of NC programs: what a compensation was, is, and is to be again ([001] p.94-95)."""

import dataclasses
from collections.abc import Iterable
from typing import final

from ...kinds import kinds

AXIS_WORD = "[ABCQU-Z][A-Za-z0-9_]{0,15}"
"""Axis in an NC program, as a pattern (P-CHAN-00006 of the channel parameters)."""
WORD_SHAPE = "A, B, C, Q or U to Z, then up to 15 letters and digits"
_STEP = 10


@final
@dataclasses.dataclass(frozen=True)
class CompState:
    """The state of one compensation of one axis in an NC program.

    Attributes:
        word: Of the axis.
        keyword: Of the NC command COMP.
    """

    word: str
    keyword: str

    @property
    def memory(self) -> str:
        """Variable of the program that holds the former state."""
        return f"V.L.WAS_{self.word}_{self.keyword}".upper()

    @property
    def active(self) -> str:
        """Variable of the controller: 1 where it is active."""
        return f"V.A.{self.keyword}_COMP_ACTIVE.{self.word}"

    @property
    def keep(self) -> str:
        """The block that keeps the state."""
        return f"{self.memory} = {self.active}"

    def where_it_was(self, *, on: bool, block: str) -> tuple[str, str, str]:
        """Return the blocks that carry out a block only where it was on (or was off)."""
        return f"$IF {self.memory} {'==' if on else '!='} 1", block, "$ENDIF"


def declared(states: Iterable[CompState]) -> list[str]:
    """Return the lines that declare the variables of former states."""
    memory, used = [], set()
    for state in states:
        memory.append(f"{state.memory} = 0")
        used.add(state.keyword)
    notes = [
        f"; {each.keyword} is known from build {each.build} on: delete its blocks before."
        for each in kinds()
        if each.build and each.keyword in used
    ]
    return [*notes, "#VAR", *memory, "#ENDVAR"] if memory else []


def numbered(lines: Iterable[str]) -> str:
    """Return a program; a line that begins with N and a blank gets its block number."""
    program, number = [], _STEP
    for line in lines:
        is_block = line.startswith("N ")
        program.append(f"N{number}{line[1:]}" if is_block else line)
        number += _STEP * is_block
    return "\n".join([*program, ""])

"""A small interpreter of NC programs: what the manuals say of each line, and nothing else."""

import dataclasses
import re
from collections.abc import Iterator

KEYWORDS = {"BACKLASH", "CROSS", "PLANE", "LEAD", "TEMP", "FRICT", "CROSSTALK"}


@dataclasses.dataclass
class Machine:
    """Axes by word; which compensations are initialised and active, as (word, keyword)."""

    axes: set[str]
    initialised: set[tuple[str, str]]
    active: set[tuple[str, str]]
    position: dict[str, float] = dataclasses.field(default_factory=dict)
    messages: list[str] = dataclasses.field(default_factory=list)
    halts: int = 0
    at_halts: list[set[tuple[str, str]]] = dataclasses.field(default_factory=list)
    """What was active at each halt."""
    moved: bool = False
    synchronised: bool = False
    switched: list[tuple[str, str, str]] = dataclasses.field(default_factory=list)

    def run(self, text: str) -> None:
        """Carry out a program; an unknown line, word or variable is an error."""
        assert text.isascii()
        numbers = [int(each) for each in re.findall(r"^N(\d+)", text, re.M)]
        assert numbers == sorted(set(numbers)), "block numbers ascend"
        variables: dict[str, float] = {}
        inside: list[bool] = []
        declaring = ended = False
        for block in _blocks(text):
            assert not ended, f"{block!r} after M30"
            if block in ("#VAR", "#ENDVAR"):
                declaring = block == "#VAR"
            elif declaring:
                name, value = (part.strip() for part in block.split("="))
                assert re.fullmatch(r"V\.L\.\w+", name), block
                variables[name] = float(value)
            elif found := re.fullmatch(r"\$IF (\S+) (==|!=) (\S+)", block):
                # Both sides are read in a branch that is not taken as well: they exist.
                left, right = (
                    self._value(each, variables) for each in (found[1], found[3])
                )
                inside.append((left == right) == (found[2] == "=="))
            elif block == "$ELSE":
                inside[-1] = not inside[-1]
            elif block == "$ENDIF":
                inside.pop()
            else:
                ended = self._do(block, variables, carried_out=all(inside))
        assert ended, "M30 is missing"
        assert not inside, "$ENDIF is missing"

    def _do(self, block: str, variables: dict[str, float], carried_out: bool) -> bool:
        """Check a block, and carry it out; return whether the program ends with it."""
        if block == "M30":
            assert carried_out
            return True
        if block == "M00":
            self.halts += carried_out
            self.at_halts += [set(self.active)] * carried_out
        elif block == "#CHANNEL INIT [CMDPOS]":
            self.synchronised = True
        elif found := re.fullmatch(r'#MSG \["([^"]*)"\]', block):
            self.messages += [found[1]] if carried_out else []
        elif found := re.fullmatch(r"(V\.L\.\w+) = (\S+)", block):
            assert found[1] in variables, f"{block}: not declared"
            value = self._value(found[2], variables)
            variables[found[1]] = value if carried_out else variables[found[1]]
        elif found := re.fullmatch(r"(\w+)\[COMP (.*)\]", block):
            self._compensate(found[1], found[2].split(), carried_out)
        elif re.match(r"G0?4 ", block):
            assert re.fullmatch(r"G0?4 \d+", block), block
        elif block.startswith("G90 "):
            self._move(block)
        else:
            raise AssertionError(block)
        return False

    def _compensate(self, word: str, words: list[str], carried_out: bool) -> None:
        assert word in self.axes, f"no axis {word}"
        command, *rest = words
        # [001] p.94: NO_MOVE comes last.
        assert "NO_MOVE" not in rest[:-1]
        keywords = [each for each in rest if each != "NO_MOVE"]
        assert set(keywords) <= KEYWORDS, words
        assert command in ("ON", "OFF", "OFF_ALL")
        assert bool(keywords) == (command != "OFF_ALL")
        if not carried_out:
            return
        if "NO_MOVE" not in rest:
            self.moved = True
        for keyword in keywords or KEYWORDS:
            self.switched.append((command, word, keyword))
            if command == "ON":
                assert (word, keyword) in self.initialised, f"{keyword} of {word}"
                self.active.add((word, keyword))
            else:
                self.active.discard((word, keyword))

    def _move(self, block: str) -> None:
        words = re.findall(r"(\w+)=(-?[\d.]+)", block)
        names = [name for name, _ in words]
        assert names, block
        assert len(set(names)) == len(names), f"{block}: an axis twice"
        assert set(names) <= self.axes, block
        self.position |= {name: float(value) for name, value in words}
        self.moved = True

    def _value(self, text: str, variables: dict[str, float]) -> float:
        if text in ("TRUE", "1", "0"):
            return float(text != "0")
        if text in variables:
            return variables[text]
        found = re.fullmatch(r"V\.A\.([A-Z]+)_COMP_(INIT|ACTIVE)\.(\w+)", text)
        assert found is not None, text
        assert found[1] in KEYWORDS, text
        assert found[3] in self.axes, f"{text}: no axis {found[3]}"
        # [001] p.95 has no such variable of backlash.
        assert (found[1], found[2]) != ("BACKLASH", "INIT")
        known = self.initialised if found[2] == "INIT" else self.active
        return float((found[3], found[1]) in known)


def _blocks(text: str) -> Iterator[str]:
    for line in text.splitlines():
        block = re.sub(r"^N\d+ ", "", line.split(";")[0]).strip()
        if block and not block.startswith("%"):
            yield block

"""What headings of columns, and cells before rows, say of the run and its direction."""

import dataclasses
import itertools
import re
from collections.abc import Mapping, Sequence

from ._header import Name, bare_role, parse_name
from ._roles import find_role
from ._words import (
    AXIS,
    DIRECTIONS,
    RUNS,
    direction_of,
    is_leg,
    kind_said,
    kinds_in,
    pieces,
    says_correction,
    says_nothing,
)

# "pos" is a position above a column, and a positive direction in a cell.
_NO_HEADING = frozenset(("pos", "neg", "–"))
_TOKENS = re.compile(r"->|<-|[^\W\d_]+|\d+|[^\w\s.,;:#|/()\[\]]")
_LETTERS = {"f": 1, "v": 1, "b": -1, "r": -1}
"""Directions by the letters of runs, where they stand in pairs."""
_READINGS = ("actual", "error")
_OTHERS = frozenset(
    "lag current velocity acceleration temperature direction time".split()
)
"""What readings of a run are; kinds whose columns are none, in whatever direction."""


@dataclasses.dataclass(frozen=True)
class Heading:
    """What the heading of a column of a wide table says of its readings.

    Attributes:
        run: Number of the run.
        direction: +1 or −1.
        kind: ``error`` or ``actual``.
        named: It says more than a number.
        axis: The axis whose readings they are, or the letter of a run.
    """

    run: int | None
    direction: int | None
    kind: str | None
    named: bool
    axis: str | None = None


def heading(text: str) -> Heading | None:
    """Return the run and the direction that a heading names, with nothing else in it.

    ``Lauf 1 vorwärts``, ``up 2``, ``1 ↑``, ``Run 3 (+)``, ``-2``; None for all others.
    """
    text = re.sub(r"(?<=[^\W\d_])[-_](?=\d)", " ", parse_name(text).stem.casefold())
    run: int | None = None
    words: set[int] = set()
    signs: set[int] = set()
    kind: str | None = None
    named = linear = letter = False
    axis: str | None = None
    for token in _TOKENS.findall(text):
        if token in DIRECTIONS and token not in _NO_HEADING:
            (signs if token in "+-−" else words).add(DIRECTIONS[token])
        elif token.isdecimal() and run is None:
            run = int(token)
        elif token in RUNS:
            named = True
        elif (said := kind_said(token)) in ("error", "actual"):
            kind = said
        elif re.fullmatch("[xyzabcuvw]", token):
            axis, linear = token.upper(), token in "xyz"
        elif said is None and len(token) == 1 and token.isalpha():
            letter = True  # of a run, beside its number and a direction: "R1 +"
        elif said != "direction" and not says_nothing([token]):
            return None
    directions = words or signs  # "Lauf 1 - hin" holds a dash and no sign
    if len(directions) > 1 or (run is None and not directions):
        return None
    run_of_letter = not linear and run is not None and directions  # "V1+"
    if letter and not run_of_letter:
        return None
    if axis and not (named or words or run_of_letter):
        return None  # "B 1" and "X+" are names of axes and of their ends
    side, named = next(iter(directions), None), named or bool(directions) or bool(kind)
    return Heading(run, side, kind, named, axis)


def other_direction(
    names: Sequence[Name], headings: Mapping[int, Heading]
) -> tuple[str, dict[int, Heading]] | None:
    """Return the one unknown word that can only name the other direction, and its columns.

    ``Hub 1 [µm]``, ``Hub 2 [µm]`` beside ``Rücklauf 1 [µm]``, ``Rücklauf 2 [µm]``: the same
    runs in the same unit. None where there is no such word.
    """
    sides = {item.direction for item in headings.values()}
    side = sides.pop()
    if sides or side is None:
        return None
    units = {names[at].unit for at in headings}
    runs = sorted(item.run or 0 for item in headings.values())
    families: dict[str, dict[int, int]] = {}
    for at, name in enumerate(names):
        words = pieces(name.stem.casefold())
        numbers = [int(word) for word in words if word.isdecimal()]
        others = [word for word in words if not word.isdecimal()]
        unknown = len(numbers) == len(others) == 1 and kind_said(others[0]) is None
        if at not in headings and unknown and {name.unit} == units:
            families.setdefault(others[0], {})[at] = numbers[0]
    for word, columns in families.items():
        if sorted(columns.values()) == runs:
            kind = next(iter(headings.values())).kind
            return word, {
                at: Heading(run, -side, kind, True) for at, run in columns.items()
            }
    return None


def numbered(headings: Mapping[int, Heading]) -> dict[int, Heading]:
    """Return headings with a run each; those without are counted per direction."""
    counts: dict[int | None, int] = {}
    numbered = {}
    for at, item in headings.items():
        counts[item.direction] = counts.get(item.direction, 0) + 1
        run = counts[item.direction] if item.run is None else item.run
        numbered[at] = dataclasses.replace(item, run=run)
    return numbered


def looks_like_names(cells: Sequence[str]) -> bool:
    """Whether words can only be names: each a role, a heading of a run, or with a unit."""
    names = [parse_name(cell) for cell in cells]
    return all(
        name.unit is not None
        or find_role(name.name) is not None
        or bare_role(name) is not None
        or heading(name.header) is not None
        or re.fullmatch(r"[xyzabcuvw]|d[xyz]", name.name.casefold())
        for name in names
    )


def spelled(names: Sequence[Name]) -> Sequence[Name]:
    """Return names that say run and direction where pairs of them differ in their direction only.

    ``F1`` and ``B1``, ``Pos 1`` and ``Neg 1``, ``Anzeige vor 1`` and ``Anzeige zurück 1``: alone
    such a name may say something else.
    """
    families: dict[tuple[str, ...], dict[int, int]] = {}
    for at, name in enumerate(names):
        tokens = _TOKENS.findall(name.stem.casefold())
        numbers = [int(token) for token in tokens if token.isdecimal()]
        if len(numbers) == 1 and heading(name.header) is None:
            words = tuple(token for token in tokens if not token.isdecimal())
            families.setdefault(words, {})[numbers[0]] = at
    result = list(names)
    for there, back in itertools.permutations(families, 2):
        pairs = [*zip(there, back, strict=False)]
        differ = [pair for pair in pairs if pair[0] != pair[1]]
        alike = [word for word, other in pairs if word == other]
        if (
            families[there].keys() != families[back].keys()
            or len(there) != len(back)
            or [tuple(map(_side, pair)) for pair in differ] != [(1, -1)]
            or _OTHERS & {*kinds_in({*alike})}
            or says_correction(" ".join(alike))
        ):
            continue
        leg = differ[0][0] in _LETTERS or is_leg(differ[0][0])
        kind = kind_said(" ".join(alike))
        said = [word for word in alike if re.fullmatch(AXIS, word)]
        said += [kind] * (kind in _READINGS)
        for words, way in (
            (there, "fwd" if leg else "up"),
            (back, "back" if leg else "down"),
        ):
            for run, at in families[words].items():
                header = " ".join([f"Run {run} {way}", *said])
                result[at] = dataclasses.replace(names[at], stem=header, header=header)
    return result


def _side(word: str) -> int | None:
    return _LETTERS.get(word) or direction_of(word)


def with_first(
    headings: Sequence[Heading | None], kinds: Sequence[str | None]
) -> list[Heading | None]:
    """Return headings, one more where ``Reading`` stands before ``Reading 2``, ``Reading 3``."""
    result = list(headings)
    for kind in _READINGS:
        first = [
            at for at, each in enumerate(kinds) if each == kind and headings[at] is None
        ]
        runs = [
            item.run
            for item in headings
            if item and item.kind == kind and not item.direction and item.run
        ]
        lowest = min(runs, default=0)
        in_turn = sorted(runs) == [*range(lowest, lowest + len(runs))]
        # From 1 on where names were made to differ: "Reading.1".
        if len(first) == 1 and in_turn and lowest in (1, 2):
            result[first[0]] = Heading(lowest - 1, None, kind, True)
    return result


def named_axis(item: Heading, along: str | None) -> str | None:
    """Return the axis that a heading names; A, B, C and the like may be letters of runs."""
    linear = item.axis in ("X", "Y", "Z")
    return item.axis if linear or item.axis == along else None

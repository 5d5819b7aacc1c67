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
    is_mean,
    kind_said,
    kinds_in,
    says_correction,
    says_nothing,
)

# "pos" is a position above a column, and a positive direction in a cell.
_NO_HEADING = frozenset(("pos", "neg", "–"))
_TOKENS = re.compile(r"->|<-|[^\W\d_]+|\d+|[^\w\s.,;:#|/()\[\]]")
_LETTERS = frozenset("fb fr vr hr pn ud".split())
"""Letters of runs in + and − direction, where they stand in pairs."""
_BY_LETTER, _LETTERS_BACK = frozenset("fvh"), frozenset("br")
"""Those of the way there, and of the way back."""
_READINGS = ("actual", "error")
_OTHERS = frozenset(
    "lag current velocity acceleration temperature direction time".split()
)
"""What readings of a run are; kinds whose columns are none, in whatever direction."""

_Family = tuple[tuple[str, ...], str | None]
"""Words and unit of a name but for its number."""


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


def spelled(names: Sequence[Name]) -> tuple[Sequence[Name], tuple[str, ...]]:
    """Return names that say run and direction where pairs differ in their direction only.

    ``F1`` and ``B1``, ``Pos 1`` and ``Neg 1``, ``Anzeige vor 1`` and ``Anzeige zurück 1``: alone
    such a name may say something else. Beside one known direction an unknown word in its place,
    for the same runs in the same unit, names the other one: ``Hub 1``, ``Rücklauf 1``.

    Returns:
        The names, and what had to be taken for granted, one sentence each.
    """
    families: dict[_Family, dict[int, int]] = {}
    for at, name in enumerate(names):
        # "Error_1_N" is no force beside "Error_1_P".
        letter = re.fullmatch(r".*\d_[A-Za-z]", name.name)
        text, unit = name.name if letter else name.stem, name.unit
        unit = None if name.doubtful else unit
        tokens = _TOKENS.findall(text.casefold())
        numbers = {int(token) for token in tokens if token.isdecimal()}
        if len(numbers) == 1 and not is_mean(name.header):
            words = tuple(token for token in tokens if not token.isdecimal())
            families.setdefault((words, unit), {})[numbers.pop()] = at
    result, remarks = list(names), []
    pairs = {
        (one, other): pair
        for one, other in itertools.permutations(families, 2)
        if one[1] == other[1] and families[one].keys() == families[other].keys()
        if (pair := _pair_of(one[0], other[0])) is not None
    }
    for (one, other), pair in pairs.items():
        mates = sum({one, other} & {*each} != set() for each in pairs)
        known = [heading(names[at].header) for at in families[one].values()]
        sure = all(each and each.direction for each in known) and mates == 1
        if pair.unknown and not sure:
            continue
        ways = ("fwd", "back") if pair.leg else ("up", "down")
        said = [word for word in pair.alike if re.fullmatch(AXIS, word)]
        kind = kind_said(" ".join(pair.alike))
        said += [kind] if kind in _READINGS else []
        for family, way in zip((one, other), ways[:: pair.side], strict=True):
            for run, at in families[family].items():
                header = " ".join([f"Run {run} {way}", *said])
                result[at] = dataclasses.replace(names[at], stem=header, header=header)
        if pair.unknown:
            remarks.append(
                f"The columns of '{pair.unknown}' have the runs and the unit of those in the"
                f" other direction: they are taken for the {'−' if pair.side > 0 else '+'}"
                " direction."
            )
    return result, tuple(remarks)


@dataclasses.dataclass(frozen=True)
class _Pair:
    """Two names that differ in their direction only.

    Attributes:
        side: Direction of the first, ±1.
        leg: They name the way there and back, whichever way that goes.
        alike: Words of both.
        unknown: Word of the second where it is no known direction, else empty.
    """

    side: int
    leg: bool
    alike: tuple[str, ...]
    unknown: str = ""


def _pair_of(one: Sequence[str], other: Sequence[str]) -> _Pair | None:
    """Return how the words of two names differ, or None: not in their direction only."""
    common, own, others = [], [], [*other]
    for word in one:
        if word in others:
            others.remove(word)
            common.append(word)
        else:
            own.append(word)
    alike = tuple(common)
    if _OTHERS & {*kinds_in({*alike})} or says_correction(" ".join(alike)):
        return None
    if len(own) > 1 or len(others) != 1:
        return None
    word, behind = "".join(own), others[0]
    side, way = direction_of(word), direction_of(behind)
    if word + behind in _LETTERS or (side, way) == (1, -1):
        return _Pair(1, word in _BY_LETTER or is_leg(word), alike)
    if not own:  # "Abw 1" beside "Abw 1 R"
        back = (behind in _LETTERS_BACK or way == -1) and alike
        return (
            _Pair(1, True, alike)
            if back and not any(map(direction_of, alike))
            else None
        )
    if side is None or way is not None or kind_said(behind) is not None:
        return None
    return _Pair(side, is_leg(word), alike, behind)


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

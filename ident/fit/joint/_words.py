"""What may be moved between effects, and what rows cannot tell, in words.

What is special about an effect it says itself (`AbstractEffect.remedy`, `Component.rule` and
the like); here these words become sentences.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from typing import final

import numpy as np
from jaxtyping import Bool

from .._identifiable import Shared
from ._design import Design
from ._effect import TABLES, AbstractEffect, Component, Rank, in_a_row
from ._identified import PART, Identified

_NAMED = 4
"""Values that are named; more are counted."""


@final
@dataclasses.dataclass(frozen=True)
class Gauge:
    """What may be moved between effects without changing their sum: harmless.

    Attributes:
        effects: Names of those between which it may be moved.
        sentence: That, in words.
        rule: How it was fixed, in words.
    """

    effects: tuple[str, ...]
    sentence: str
    rule: str


@final
@dataclasses.dataclass(frozen=True)
class Confusion:
    """What these data cannot tell apart, whatever the errors are.

    Attributes:
        effects: Names of the two (or of one alone, where no reading shows it).
        parameters: What is therefore not known, in words; not all of a long table.
        correlation: Of what the two do to the readings, −1 to 1; 0 where one stands alone.
        sentence: What it is, and what to measure to tell them apart.
    """

    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    correlation: float
    sentence: str


def words_of(
    axes: Iterable[Identified],
) -> tuple[tuple[Gauge, ...], tuple[Confusion, ...]]:
    """Return the freedoms of all axes, and what their rows cannot tell."""
    known = list(axes)
    gauges = tuple(gauge for axis in known for gauge in _gauges(axis))
    return gauges, tuple(words for axis in known for words in _confusions(axis))


def _gauges(known: Identified) -> Iterator[Gauge]:
    """Yield the freedoms of the sum, and the rules that fix them."""
    level, freedoms = known.freedoms
    parts = known.design.stated
    if level:
        members = [parts[k] for k in level]
        names = (*(part.owner for part in members), f"datum of {known.design.axis}")
        rules = "; ".join(dict.fromkeys(part.level for part in members))
        if known.design.aside:
            rules += ", without those that contradict the others"
        rule = f"The datum keeps the constant: {rules}."
        yield _gauge("A constant may", names, rule)
    for freedom in freedoms:
        simple, other = (parts[k] for k in freedom.members)
        rule = f"The {simple.owner} carries it; {other.rule}."
        what = _exchanged(simple, other, freedom.count)
        yield _gauge(f"{what} may", (simple.owner, other.owner), rule)
    for pair in known.nearly:
        first, second = (parts[k] for k in pair.members)
        rule = "Their smoothness shares it out; give both tables the same nodes for a rule."
        what = f"A curve{_over(first, second)} may almost"
        how = ": their nodes differ, and their sum changes a little only."
        yield _gauge(what, (first.owner, second.owner), rule, how)


def _gauge(
    what: str,
    names: Sequence[str],
    rule: str,
    how: str = " without changing their sum.",
) -> Gauge:
    sentence = f"{what} be moved between {_the(names)}{how}"
    return Gauge(tuple(dict.fromkeys(names)), sentence, rule)


def _exchanged(simple: Component, other: Component, count: int) -> str:
    shared, over = simple.shared or other.shared, _over(simple, other)
    if shared:
        return shared
    if over and {simple.rank, other.rank} <= TABLES:
        return f"{'A straight line' if count == 1 else 'Any curve'}{over}"
    return "A shape that both can follow" if count == 1 else f"{count} shapes"


def _over(simple: Component, other: Component) -> str:
    """Return over which axes both go, if over any."""
    common = [axis for axis in simple.masters if axis in other.masters]
    return f" over {in_a_row(common)}" if common else ""


def _confusions(known: Identified) -> Iterator[Confusion]:
    """Yield what the rows cannot tell, and what to measure."""
    paired = {k for pair in known.confused for k in pair.members}
    for k, component in enumerate(known.design.stated):
        if component.effect is not None and k not in paired:
            yield from _unseen(component, component.effect, known)
    yield from (_pair(pair, known.design) for pair in known.confused)


def _unseen(
    component: Component, effect: AbstractEffect, known: Identified
) -> Iterator[Confusion]:
    """Yield what no reading shows of one component of an effect."""
    missing = ~known.design.reached[component.places]
    what = f"a part of the {component.owner}"
    if effect.table_effect is not None:
        # Nodes here and there that were not measured are marked, and no confusion.
        branches = effect.table_effect.branches
        whole = missing.reshape(branches, -1).all(axis=1)
        missing = np.repeat(whole, missing.size // branches)
        what = f"the {component.owner} in {'positive' if missing[0] else 'negative'} direction"
    elif not missing.any():
        missing = known.hidden[component.places]
    if missing.all():
        what = f"the {component.owner}"
    if missing.any():
        parameters = _parameters(component, known.design, missing)
        sentence = f"No reading shows {what}: {effect.worded(effect.remedy)}"
        yield Confusion((component.owner,), parameters, 0.0, sentence)


def _pair(pair: Shared, design: Design) -> Confusion:
    parts = [design.stated[k] for k in pair.members]
    names = tuple(dict.fromkeys(component.owner for component in parts))
    parameters: list[str] = []
    for component, size in zip(parts, pair.sizes, strict=True):
        parameters += _parameters(component, design, size > PART)
    both = [component.name for component in parts] if len(names) == 1 else names
    sentence = (
        f"These readings cannot tell {_the(both)} apart "
        f"(correlation {pair.correlation:.4f}): {_remedy(parts)}"
    )
    return Confusion(names, tuple(parameters), pair.correlation, sentence)


def _parameters(
    component: Component, design: Design, confounded: Bool[np.ndarray, " p"]
) -> tuple[str, ...]:
    """Return confounded values in words: some of them by name."""
    if component.effect is None:
        return ()
    places = design.places_of(component.owner).tolist()
    where = dict(zip(places, component.effect.labels, strict=True))
    names = [where[int(place)] for place in component.places[confounded]]
    if len(names) == len(component.places) > 1:
        return (f"all values of the {component.name}",)
    if len(names) > _NAMED:
        names = [*names[: _NAMED - 1], f"{len(names) - _NAMED + 1} more"]
    return tuple(f"{component.name}: {name}" for name in names)


def _remedy(parts: Sequence[Component]) -> str:
    """Return what happened and what to measure; the least simple effect knows best."""
    axes = [axis for part in parts for axis in part.masters]
    ranks = {part.rank for part in parts}
    for part in sorted(parts, key=lambda part: part.rank):
        others = {None, *(other.rank for other in parts if other is not part)}
        if part.effect is not None:
            for rank, words in part.effect.remedies.items():
                if rank in others:
                    return part.effect.worded(words, axes)
    names = in_a_row(axes)
    if Rank.RUNS in ranks:
        return (
            f"the position of {names} changed together with the runs (or with the time). "
            "Within each run go to several positions of each, the same in all runs."
        )
    if Rank.DATUM in ranks:
        return f"{names} stood still. Move over the whole table."
    remedy = f"{names} moved together. Move each of them while the others stand still."
    narrow, wide = sorted((parts[0], parts[-1]), key=lambda part: len(part.masters))
    lines = TABLES - {Rank.BILATERAL}
    if ranks <= lines and set(narrow.masters) < set(wide.masters):
        remedy += (
            f" Where they did, the {wide.owner} holds all that goes over"
            f" {in_a_row(narrow.masters)} alone: leave the {narrow.owner} out."
        )
    return remedy


def _the(names: Sequence[str]) -> str:
    return in_a_row([f"the {name}" for name in names])

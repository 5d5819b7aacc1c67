"""What may be moved between effects, and what rows cannot tell, in words."""

import dataclasses
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Bool

from .._identifiable import Shared
from ._crosstalk import Crosstalk
from ._design import Component, Design
from ._identified import PART, Identified
from ._tables import AbstractTable
from ._temperature import Temperature

_NAMED = 4
"""Values that are named; more are counted."""
_TABLES = {"leadscrew", "cross", "plane"}


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
    """What these data cannot tell apart, whatever the errors are: what is lost is not known.

    Attributes:
        effects: Names of the two (or of one alone, where no reading shows it).
        parameters: What is lost, in words; not all of a long table.
        correlation: Of what the two do to the readings, −1 to 1; 0 where one stands alone.
        sentence: What it is, and what to measure to tell them apart.
    """

    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    correlation: float
    sentence: str


def gauges_of(known: Identified) -> tuple[Gauge, ...]:
    """Return the freedoms of the sum, and the rules that fix them."""
    level, freedoms = known.freedoms
    parts = known.design.stated
    result = [_constant([parts[k] for k in level], known.design)] if level else []
    result += [_between(each, known.design) for each in freedoms]
    result += [_nearly(each, known.design) for each in known.nearly]
    return tuple(result)


def _constant(parts: Sequence[Component], design: Design) -> Gauge:
    names = (*map(_called, parts), f"datum of {design.axis}")
    kinds = [part.kind for part in parts]
    rules = []
    if any(kind not in ("runs", "temperature offset") for kind in kinds):
        rules.append("every table has mean zero over the readings")
    if "temperature offset" in kinds:
        rules.append(_at_reference(design))
    if "runs" in kinds:
        rules.append("the run effects sum up to zero")
    return Gauge(
        tuple(dict.fromkeys(names)),
        f"A constant may be moved between {_the(names)} without changing their sum.",
        f"The datum keeps the constant: {'; '.join(rules)}.",
    )


def _between(freedom: Shared, design: Design) -> Gauge:
    simple, other = (design.stated[k] for k in freedom.members)
    names = (_called(simple), _called(other))
    if other.kind == "plane":
        rule = (
            f"the {names[1]} has mean zero over the readings along every line that the "
            "other can follow"
        )
    elif other.kind.startswith("temperature"):
        rule = _at_reference(design)
    elif other.kind == "leadscrew" and simple.kind == "backlash":
        rule = f"the {names[1]} has the same mean in both directions"
    else:
        rule = f"the {names[1]} has none of it"
    what = _exchanged(simple, other, freedom.count, design)
    return Gauge(
        names,
        f"{what} may be moved between {_the(names)} without changing their sum.",
        f"The {names[0]} carries it; {rule}.",
    )


def _exchanged(simple: Component, other: Component, count: int, design: Design) -> str:
    kinds, common = {simple.kind, other.kind}, _common(simple, other, design)
    if "backlash" in kinds:
        return "A constant difference between the directions"
    if "temperature coefficient" in kinds:
        return f"A straight line over {' and '.join(common) or 'the axis'}"
    if common and kinds <= _TABLES:
        over = " and ".join(common)
        return f"{'A straight line' if count == 1 else 'Any curve'} over {over}"
    return "A shape that both can follow" if count == 1 else f"{count} shapes"


def _nearly(pair: Shared, design: Design) -> Gauge:
    first, second = (design.stated[k] for k in pair.members)
    names, common = (_called(first), _called(second)), _common(first, second, design)
    over = f" over {' and '.join(dict.fromkeys(common))}" if common else ""
    return Gauge(
        names,
        f"A curve{over} may almost be moved between {_the(names)}: their nodes "
        "differ, and their sum changes a little only.",
        "Their smoothness shares it out; give both tables the same nodes for a rule.",
    )


def _common(one: Component, other: Component, design: Design) -> list[str]:
    """Return the axes on which both depend."""
    axes = []
    for part in (one, other):
        effect = design.effects[part.effect]
        own = () if isinstance(effect, AbstractTable) else (effect.axis,)
        axes.append(() if part.effect < 0 else (*effect.masters, *own))
    return [axis for axis in axes[0] if axis in axes[1]]


def _at_reference(design: Design) -> str:
    effect = next(e for e in design.effects if isinstance(e, Temperature))
    return f"the temperature corrects nothing at {effect.reference_temperature:g} °C"


def confusions_of(known: Identified) -> tuple[Confusion, ...]:
    """Return what the rows cannot tell, and what to measure."""
    paired = {k for pair in known.confused for k in pair.members}
    hidden = [
        _unseen(part, known)
        for k, part in enumerate(known.design.stated)
        if part.effect >= 0 and k not in paired
    ]
    pairs = [_pair(pair, known.design) for pair in known.confused]
    return (*(each for each in hidden if each is not None), *pairs)


def _unseen(part: Component, known: Identified) -> Confusion | None:
    """Return what no reading shows of one component; None where all is well."""
    design = known.design
    missing = ~design.reached[part.places]
    effect = design.effects[part.effect]
    if isinstance(effect, AbstractTable):
        # Nodes here and there that were not measured are marked, and no confusion.
        ways = effect.table_effect.branches
        whole = missing.reshape(ways, -1).all(axis=1)
        missing = np.repeat(whole, missing.size // ways)
    elif not missing.any():
        missing = known.hidden[part.places]
    if not missing.any():
        return None
    name = _called(part)
    what = f"the {name}" if missing.all() else f"a part of the {name}"
    remedy = f"move {_and(effect.masters)} over the whole table."
    if part.kind == "leadscrew" and not missing.all():
        what = f"the {name} in {'positive' if missing[0] else 'negative'} direction"
    if part.kind == "backlash":
        what = f"the {name}, all were taken in one direction"
    if part.kind in ("backlash", "leadscrew"):
        remedy = f"measure {effect.axis} in both directions."
    elif isinstance(effect, Crosstalk):
        remedy = f"accelerate and slow down {effect.master} in both directions"
        if effect.adaptation:
            remedy += f", at several places of {_and(effect.adaptation)}"
        remedy += "."
    elif isinstance(effect, Temperature):
        sensors = _and(effect.sensor_names)
        remedy = f"measure {effect.axis} at two temperatures of {sensors} at least."
    elif part.kind == "delay":
        remedy = f"move {effect.axis} at several speeds."
    return Confusion(
        (name,),
        _parameters(part, design, missing),
        0.0,
        f"No reading shows {what}: {remedy}",
    )


def _pair(pair: Shared, design: Design) -> Confusion:
    parts = [design.stated[k] for k in pair.members]
    names = tuple(dict.fromkeys(map(_called, parts)))
    parameters: list[str] = []
    for part, size in zip(parts, pair.sizes, strict=True):
        if part.effect >= 0:
            parameters += _parameters(part, design, size > PART)
    both = [part.name for part in parts] if len(names) == 1 else names
    return Confusion(
        names,
        tuple(parameters),
        pair.correlation,
        f"These readings cannot tell {_the(both)} apart "
        f"(correlation {pair.correlation:.4f}): {_remedy(parts, design)}",
    )


def _parameters(
    part: Component, design: Design, lost: Bool[np.ndarray, " p"]
) -> tuple[str, ...]:
    """Return the lost values in words: some of them by name."""
    every, labels = design.places_of(part.effect), design.effects[part.effect].labels
    where = dict(zip(every.tolist(), labels, strict=True))
    names = [where[int(place)] for place in part.places[lost]]
    if len(names) == len(part.places) > 1:
        return (f"all values of the {part.name}",)
    if len(names) > _NAMED:
        names = [*names[: _NAMED - 1], f"{len(names) - _NAMED + 1} more"]
    return tuple(f"{part.name}: {name}" for name in names)


def _remedy(parts: Sequence[Component], design: Design) -> str:
    """Return what happened and what to measure."""
    kinds = {part.kind for part in parts}
    effects = [design.effects[part.effect] for part in parts if part.effect >= 0]
    axes = _and([axis for effect in effects for axis in effect.masters])
    sensors = [name for effect in effects for name in effect.sensor_names]
    fast = [each.master for each in effects if isinstance(each, Crosstalk)]
    if sensors:
        return _remedy_of_heat(kinds, f"the temperature of {_and(sensors)}", axes)
    if fast:
        return (
            f"the acceleration of {_and(fast)} never varied by itself. Accelerate and "
            "slow down in both directions, and stand still as well."
        )
    if "delay" in kinds:
        return (
            f"the speed of {axes} never varied by itself. Move at several speeds in both "
            "directions."
        )
    if {"backlash", "datum"} <= kinds:
        return "all readings were taken in one direction. Measure in both directions."
    if {"backlash", "runs"} <= kinds:
        return "each run went one way. Measure both directions within each run."
    if "backlash" in kinds:
        return (
            "the direction changed together with the position. Approach the same positions "
            "from both sides."
        )
    if "runs" in kinds:
        return (
            f"the position of {axes} changed together with the runs (or with the time). "
            "Repeat the same positions in several runs, in another order."
        )
    if "datum" in kinds:
        return f"{axes} stood still. Move over the whole table."
    return f"{axes} moved together. Move each of them while the others stand still."


def _remedy_of_heat(kinds: set[str], what: str, axes: str) -> str:
    if kinds <= {"temperature offset", "temperature coefficient"}:
        return (
            f"at each temperature {axes} stood at one position only. Measure each "
            "temperature at several positions."
        )
    if kinds & _TABLES:
        return (
            f"{what} changed together with the position of {axes}. Measure the same "
            "positions again at another temperature."
        )
    if "runs" in kinds:
        return (
            f"{what} changed together with the runs (or with the time). Let it rise and "
            "fall within a run, or repeat a temperature in another run."
        )
    if "datum" in kinds:
        return f"{what} did not change. Measure at two temperatures at least."
    return f"{what} changed together with the other. Vary it while the other stays as it is."


def _called(part: Component) -> str:
    """Return what a component is called where pairs are named: its effect."""
    return part.name.removeprefix("offset of the ").removeprefix("coefficient of the ")


def _the(names: Sequence[str]) -> str:
    return _and([f"the {name}" for name in names])


def _and(names: Sequence[str]) -> str:
    names = list(dict.fromkeys(names))
    if len(names) < 2:
        return names[0] if names else "the axis"
    return f"{', '.join(names[:-1])} and {names[-1]}"

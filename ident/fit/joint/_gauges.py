"""What may be moved between effects, in words."""

import numpy as np
from jaxtyping import Float

from ._design import Component, Design
from ._result import Gauge
from ._rules import Rules, priority
from ._tables import CrossEffect, LeadscrewEffect, PlaneEffect
from ._temperature import TemperatureEffect

_ROUNDING = 1e-12
"""Information, relative to what is typical, that is rounding only."""
_SAME = 1.0 - 1e-7
"""Correlation of two shapes from which on they are one."""


def gauges_of(design: Design, rules: Rules) -> tuple[Gauge, ...]:
    """Return the freedoms of the sum, pair by pair, and the rules that fix them."""
    white = [_whitener(rules.matrix[own, own]) for own in rules.slices]
    parts = [family.component for family in rules.shapes]
    datum = next(k for k, part in enumerate(parts) if part.kind == "datum")

    def shared(first: int, second: int) -> int:
        block = rules.matrix[rules.slices[first], rules.slices[second]]
        small = white[first].T @ block @ white[second]
        if not small.size:
            return 0
        return int((np.linalg.svd(small, compute_uv=False) > _SAME).sum())

    level = [k for k in range(len(parts)) if k != datum and shared(k, datum)]

    def extra(first: int, second: int) -> int:
        return shared(first, second) - int(first in level and second in level)

    def simpler(first: int, second: int) -> bool:
        """Tell whether a third, simpler one carries what the two share."""
        least = max(priority(parts[k], design) for k in (first, second))
        return any(
            extra(first, third) > 0 and extra(third, second) > 0
            for third in range(len(parts))
            if priority(parts[third], design) > least and third != datum
        )

    result = []
    if level:
        result.append(_constant([parts[k] for k in level], parts[datum], design))
    for second in range(len(parts)):
        for first in range(second):
            if datum in (first, second):
                continue
            count = extra(first, second)
            if count > 0 and not simpler(first, second):
                pair = sorted(
                    (parts[first], parts[second]),
                    key=lambda part: -priority(part, design),
                )
                result.append(_between(pair[0], pair[1], count, design))
    return tuple(result)


def almost(first: Component, second: Component, design: Design) -> Gauge:
    """Return what two tables over one master can nearly exchange, their nodes being others."""
    names = (called(first), called(second))
    common = [
        axis for axis in _inputs(first, design) if axis in _inputs(second, design)
    ]
    over = f" over {' and '.join(dict.fromkeys(common))}" if common else ""
    return Gauge(
        names,
        f"A curve{over} may almost be moved between {_listed(list(names))}: their nodes "
        "differ, and their sum changes a little only.",
        "Their smoothness shares it out; give both tables the same nodes for a rule.",
    )


def _whitener(
    matrix: Float[np.ndarray, "m m"], typical: float = 0.0
) -> Float[np.ndarray, "m r"]:
    """Return columns that make information a unit matrix, what has none left out.

    Args:
        matrix: Information.
        typical: Beside which nothing but rounding is none.
    """
    diagonal = np.diag(matrix)
    some = diagonal > max(_ROUNDING * typical, 0.0)
    scale = np.where(some, np.sqrt(np.maximum(diagonal, 0.0)), 1.0)
    matrix = np.where(np.outer(some, some), matrix, 0.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    good = values > 1e-9
    return np.asarray(vectors[:, good] / scale[:, None] / np.sqrt(values[good]))


def _constant(parts: list[Component], datum: Component, design: Design) -> Gauge:
    names = [called(part) for part in parts]
    rules = []
    if any(part.kind not in ("runs",) and "offset" not in part.kind for part in parts):
        rules.append("every table has mean zero over the readings")
    if any(part.kind == "temperature offset" for part in parts):
        rules.append(_at_reference(design))
    if any(part.kind == "runs" for part in parts):
        rules.append("the run effects sum up to zero")
    return Gauge(
        effects=tuple(dict.fromkeys((*names, datum.name))),
        sentence=(
            f"A constant may be moved between {_listed([*names, datum.name])} without "
            "changing their sum."
        ),
        rule=f"The datum keeps the constant: {'; '.join(rules)}.",
    )


def _between(simple: Component, other: Component, count: int, design: Design) -> Gauge:
    names = (called(simple), called(other))
    what = _what(simple, other, count, design)
    sentence = f"{what} may be moved between {_listed(list(names))} without changing their sum."
    rule = f"The {called(simple)} carries it"
    if other.kind == "plane":
        rule += (
            f"; the {called(other)} has mean zero over the readings along every line that "
            "the other can follow."
        )
    elif other.kind.startswith("temperature"):
        rule += f"; {_at_reference(design)}."
    elif other.kind == "leadscrew":
        rule += (
            f"; the {called(other)} has the same mean in both directions."
            if simple.kind == "backlash"
            else f"; the {called(other)} has none of it."
        )
    else:
        rule += f"; the {called(other)} has none of it."
    return Gauge(names, sentence, rule)


def _what(simple: Component, other: Component, count: int, design: Design) -> str:
    if "backlash" in (simple.kind, other.kind):
        return "A constant difference between the directions"
    common = [
        axis for axis in _inputs(simple, design) if axis in _inputs(other, design)
    ]
    if "temperature coefficient" in (simple.kind, other.kind):
        return f"A straight line over {' and '.join(common) or 'the axis'}"
    if common and {simple.kind, other.kind} <= {"leadscrew", "cross", "plane"}:
        shape = "straight line" if count == 1 else "curve"
        return f"{'A' if count == 1 else 'Any'} {shape} over {' and '.join(common)}"
    return "A shape that both can follow" if count == 1 else f"{count} shapes"


def _inputs(part: Component, design: Design) -> tuple[str, ...]:
    if part.effect < 0:
        return ()
    effect = design.effects[part.effect]
    if isinstance(effect, LeadscrewEffect | CrossEffect | PlaneEffect):
        return effect.masters
    return (*effect.masters, effect.axis)


def _at_reference(design: Design) -> str:
    for effect in design.effects:
        if isinstance(effect, TemperatureEffect):
            return (
                "the temperature corrects nothing at "
                f"{effect.reference_temperature:g} °C"
            )
    return "the temperature corrects nothing at its reference temperature"


def called(part: Component) -> str:
    """Return what a component is called where pairs are named: its effect."""
    return part.name.removeprefix("offset of the ").removeprefix("coefficient of the ")


def _listed(names: list[str]) -> str:
    names = [f"the {name}" for name in dict.fromkeys(names)]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"

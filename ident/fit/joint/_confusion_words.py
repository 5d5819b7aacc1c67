"""What data cannot tell, in words: the pair, what is lost, and what to measure."""

import numpy as np
from jaxtyping import Bool, Float

from ._confused import _PART, LostPair, Told
from ._crosstalk import CrosstalkEffect
from ._design import Component, Design
from ._gauges import called
from ._result import Confusion
from ._tables import LeadscrewEffect
from ._temperature import TemperatureEffect

_NAMED = 4
"""Values that are named; more are counted."""
_TABLES = {"leadscrew", "cross", "plane"}


def confusions_of(
    design: Design, told: Told, reached: Bool[np.ndarray, " n"]
) -> tuple[Confusion, ...]:
    """Return what the data cannot tell, in words."""
    result = [_alone(part, design, told, reached) for part in design.components]
    said = [each for each in result if each is not None]
    said += [_pair(pair, design) for pair in told.lost]
    return tuple(said)


def _alone(
    part: Component, design: Design, told: Told, reached: Bool[np.ndarray, " n"]
) -> Confusion | None:
    """Return what no reading shows of one component; None where all is well."""
    if part.effect < 0:
        return None
    missing = ~reached[part.places]
    effect = design.effects[part.effect]
    if part.kind in _TABLES:
        if isinstance(effect, LeadscrewEffect) and effect.bilateral:
            ways = missing.reshape(2, -1).all(axis=1)
            missing = np.repeat(ways, missing.size // 2)
        elif not missing.all():
            # Nodes here and there that were not measured are marked, and no confusion.
            return None
    elif not missing.any():
        missing = told.inner[part.places]
    if not missing.any() or any(part in pair.parts for pair in told.lost):
        return None
    name = called(part)
    return Confusion(
        effects=(name,),
        parameters=_parameters(part, design, missing),
        correlation=0.0,
        sentence=f"No reading shows {_what(part, missing, name)}: {_more(part, design)}",
    )


def _what(part: Component, missing: Bool[np.ndarray, " p"], name: str) -> str:
    if part.kind == "leadscrew" and not missing.all():
        way = "positive" if missing[0] else "negative"
        return f"the {name} in {way} direction"
    if part.kind == "backlash":
        return f"the {name}, all were taken in one direction"
    return f"the {name}" if missing.all() else f"a part of the {name}"


def _more(part: Component, design: Design) -> str:
    """Return what to measure so that a component shows at all."""
    effect = design.effects[part.effect]
    if part.kind in ("backlash", "leadscrew"):
        return f"measure {effect.axis} in both directions."
    if isinstance(effect, CrosstalkEffect):
        return (
            f"accelerate and slow down {effect.master} in both directions"
            + (
                f", at several places of {_and(effect.adaptation)}"
                if effect.adaptation
                else ""
            )
            + "."
        )
    if isinstance(effect, TemperatureEffect):
        return f"measure {effect.axis} at two temperatures of {_and(effect.sensor_names)} at least."
    if effect.compensation == "delay":
        return f"move {effect.axis} at several speeds."
    return f"move {_and(effect.masters)} over the whole table."


def _pair(pair: LostPair, design: Design) -> Confusion:
    names = tuple(dict.fromkeys(called(part) for part in pair.parts))
    parameters: list[str] = []
    for part in pair.parts:
        if part.effect >= 0:
            parameters += _parameters(part, design, pair.values[part.places] > _PART)
    both = [part.name for part in pair.parts] if len(names) == 1 else list(names)
    how = f" (correlation {pair.correlation:.4f})"
    return Confusion(
        effects=names,
        parameters=tuple(parameters),
        correlation=pair.correlation,
        sentence=(
            f"These readings cannot tell {_and(tuple(f'the {name}' for name in both))} apart"
            f"{how}: {_remedy(pair.parts, design)}"
        ),
    )


def _parameters(
    part: Component, design: Design, lost: Bool[np.ndarray, " p"]
) -> tuple[str, ...]:
    """Return the lost values in words: some of them by name."""
    labels = _labels(part, design)
    names = [labels[k] for k in np.flatnonzero(lost)]
    if len(names) == len(labels) and len(names) > 1:
        return (f"all values of the {part.name}",)
    if len(names) > _NAMED:
        names = [*names[: _NAMED - 1], f"{len(names) - _NAMED + 1} more"]
    return tuple(f"{part.name}: {name}" for name in names)


def _labels(part: Component, design: Design) -> tuple[str, ...]:
    every = design.labels[part.effect]
    places = design.places_of(part.effect)
    where = {int(place): label for place, label in zip(places, every, strict=True)}
    return tuple(where[int(place)] for place in part.places)


def _remedy(parts: tuple[Component, ...], design: Design) -> str:
    """Return what happened and what to measure."""
    kinds = {part.kind for part in parts}
    effects = [design.effects[part.effect] for part in parts if part.effect >= 0]
    axes = tuple(dict.fromkeys(axis for effect in effects for axis in effect.masters))
    warm = [effect for effect in effects if isinstance(effect, TemperatureEffect)]
    fast = [effect for effect in effects if isinstance(effect, CrosstalkEffect)]
    if warm:
        return _warm_remedy(kinds, warm, axes)
    if fast:
        return (
            f"the acceleration of {_and(tuple(each.master for each in fast))} never varied "
            "by itself. Accelerate and slow down in both directions, and stand still as well."
        )
    if "delay" in kinds:
        return (
            f"the speed of {_and(axes)} never varied by itself. Move at several speeds in "
            "both directions."
        )
    if "backlash" in kinds:
        if "datum" in kinds:
            return (
                "all readings were taken in one direction. Measure in both directions."
            )
        if "runs" in kinds:
            return "each run went one way. Measure both directions within each run."
        return (
            "the direction changed together with the position. Approach the same positions "
            "from both sides."
        )
    if "runs" in kinds:
        return (
            f"the position of {_and(axes)} changed together with the runs (or with the "
            "time). Repeat the same positions in several runs, in another order."
        )
    if "datum" in kinds:
        return f"{_and(axes)} stood still. Move over the whole table."
    return (
        f"{_and(axes)} moved together. Move each of them while the others stand still."
    )


def _warm_remedy(
    kinds: set[str], warm: list[TemperatureEffect], axes: tuple[str, ...]
) -> str:
    sensors = tuple(dict.fromkeys(name for each in warm for name in each.sensor_names))
    what = f"the temperature of {_and(sensors)}"
    if kinds <= {"temperature offset", "temperature coefficient"}:
        return (
            f"at each temperature {_and(axes)} stood at one position only. Measure each "
            "temperature at several positions."
        )
    if kinds & _TABLES:
        return (
            f"{what} changed together with the position of {_and(axes)}. Measure the same "
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


def _and(names: tuple[str, ...]) -> str:
    names = tuple(dict.fromkeys(names))
    if len(names) < 2:
        return names[0] if names else "the axis"
    return f"{', '.join(names[:-1])} and {names[-1]}"


def undetermined(
    design: Design, told: Told, reached: Bool[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return the unknowns that are not known, and those of them that are confused."""
    confused: Float[np.ndarray, " n"] = np.zeros(len(reached))
    for pair in told.lost:
        confused = np.maximum(confused, pair.values)
    lost = (confused > _PART) & reached
    for part in design.components:
        if part.prior is None:
            # In a table neighbours bridge what no reading tells; a law has none.
            lost[part.places] |= (told.inner & reached)[part.places]
    for part in design.components:
        if part.kind.startswith("temperature") and lost[part.places].any():
            # What the rule put to zero is no more known than the rest of the law.
            lost[part.places] = True
    return lost | told.inner | ~reached, lost

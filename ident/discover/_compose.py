"""From terms to compensations: what contains what, and what the controller has once."""

import dataclasses
from collections.abc import Collection, Iterator, Mapping

from ._terms import FOREIGN, HEAT, PUSHES, Kind, Term


@dataclasses.dataclass(frozen=True)
class Need:
    """A compensation, and the terms that it takes away.

    Attributes:
        compensation: As the job file calls it.
        terms: Parts of the error.
        masters: Axes that it depends on.
        sensor: The one temperature that it follows, or None.
        keys: What the job file says of it.
        words: What is special about it, or nothing.
    """

    compensation: str
    terms: tuple[Term, ...]
    masters: tuple[str, ...] = ()
    sensor: str | None = None
    keys: Mapping[str, object] = dataclasses.field(default_factory=dict)
    words: str = ""


@dataclasses.dataclass(frozen=True)
class Beyond:
    """Terms that no compensation takes away, and why."""

    terms: tuple[Term, ...]
    sentence: str


@dataclasses.dataclass(frozen=True)
class Composition:
    """Compensations for one axis, and what they leave."""

    needs: tuple[Need, ...]
    beyond: tuple[Beyond, ...]


def compose(sizes: Mapping[Term, float], turning: Collection[str] = ()) -> Composition:
    """Return the fewest compensations that hold all chosen terms of an axis.

    Args:
        sizes: Contribution of each chosen term, mm or ° rms.
        turning: Axes that go round, over which there is no plane.
    """
    needs: list[Need] = [*_along_itself(sizes)]
    beyond: list[Beyond] = []
    for part in (_over_others(sizes, turning), _by_heat(sizes), _by_pushes(sizes)):
        for each in part:
            if isinstance(each, Need):
                needs.append(each)
            else:
                beyond.append(each)
    beyond += [_foreign(term) for term in sizes if term.kind in FOREIGN]
    return Composition(tuple(needs), tuple(beyond))


def _of(sizes: Mapping[Term, float], *kinds: Kind) -> tuple[Term, ...]:
    """Return the terms of some kinds, the largest first."""
    mine = [term for term in sizes if term.kind in kinds]
    return tuple(sorted(mine, key=lambda term: -sizes[term]))


def _along_itself(sizes: Mapping[Term, float]) -> Iterator[Need]:
    own = _of(sizes, Kind.OWN)
    turn = _of(sizes, Kind.REVERSAL)
    both = _of(sizes, Kind.OWN_REVERSAL)
    if both:
        words = "Its two directions differ along the travel, so one table for each"
        words += " takes the lost motion as well: no backlash beside it."
        yield Need(
            "leadscrew", (*own, *turn, *both), keys={"bilateral": True}, words=words
        )
        return
    if own:
        yield Need("leadscrew", own)
    if turn:
        yield Need("backlash", turn)


def _over_others(
    sizes: Mapping[Term, float], turning: Collection[str]
) -> Iterator[Need | Beyond]:
    lines = list(_of(sizes, Kind.LINE))
    surfaces = _of(sizes, Kind.SURFACE)
    round_about = {line.masters[0] for line in lines[:2]} & set(turning)
    if not surfaces and len(lines) > 1 and not round_about:
        pair = tuple(sorted((lines[0].masters[0], lines[1].masters[0])))
        words = f"It is a sum of a part over {pair[0]} and one over {pair[1]}; an axis"
        words += " has one cross table only, so a plane holds both."
        yield Need(
            "plane", tuple(lines[:2]), pair, keys={"masters": list(pair)}, words=words
        )
        lines = lines[2:]
    for k, term in enumerate(surfaces):
        inside = tuple(line for line in lines if line.masters[0] in term.masters)
        if k == 0:
            lines = [line for line in lines if line not in inside]
            yield Need(
                "plane",
                (term, *inside),
                term.masters,
                keys={"masters": list(term.masters)},
            )
        else:
            yield Beyond((term,), f"{_start(term)}: an axis has one plane only.")
    for k, term in enumerate(lines):
        if k == 0:
            keys = {"master": term.masters[0]}
            yield Need("cross", (term,), term.masters, keys=keys)
        else:
            yield Beyond((term,), f"{_start(term)}: an axis has one cross table only.")


def _by_heat(sizes: Mapping[Term, float]) -> Iterator[Need]:
    terms = _of(sizes, *HEAT)
    if not terms:
        return
    sensors = {
        "offset" if term.kind is Kind.HEAT_OFFSET else "coefficient": term.sensor
        for term in terms
    }
    names = dict.fromkeys(sensors.values())
    slow = [f"{t.sensor} by about {_time(t.lag)}" for t in terms if t.lag > 0]
    words = ""
    if slow:
        words = f"It lags behind {' and '.join(dict.fromkeys(slow))}."
    one = next(iter(names)) if len(names) == 1 else None
    keys: dict[str, object] = {"sensors": sensors}
    if one is not None and "coefficient" in sensors:
        keys = {"sensor": one}
    yield Need("temperature", terms, (), one, keys, words)


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds / 60:.2g} min"


def _by_pushes(sizes: Mapping[Term, float]) -> Iterator[Need | Beyond]:
    terms = _of(sizes, *PUSHES)
    masters = list(dict.fromkeys(term.masters[0] for term in terms))
    weight = {
        name: sum(sizes[term] ** 2 for term in terms if term.masters[0] == name)
        for name in masters
    }
    masters.sort(key=lambda name: -weight[name])
    for k, master in enumerate(masters):
        mine = tuple(term for term in terms if term.masters[0] == master)
        if k > 0:
            why = "an axis has one crosstalk list, with one master, only."
            yield Beyond(mine, f"{_start(mine[0])}: {why}")
            continue
        places = dict.fromkeys(name for term in mine for name in term.masters[1:])
        adaptation = tuple(places)[:2]
        keys: dict[str, object] = {"master": master, "mode": 1 + len(adaptation)}
        if len(adaptation) == 1:
            keys["adaptation"] = adaptation[0]
        elif adaptation:
            keys["adaptation"] = list(adaptation)
        if any(term.kind is Kind.PUSH_WAY for term in mine):
            keys["velocity_dependent"] = True
        words = f"Mode {1 + len(adaptation)}"
        words += (
            f", adapted to the position of {' and '.join(adaptation)}."
            * bool(adaptation)
            or "."
        )
        yield Need("crosstalk", mine, (master, *adaptation), None, keys, words)


def _start(term: Term) -> str:
    return term.words[0].upper() + term.words[1:]


_WHY = {
    Kind.SPEED: "as a delay between instrument and encoder does: following error and"
    " delay are never compensated. Align the clocks, or measure at standstill.",
    Kind.SPEED_OTHER: "and the controller has no compensation over a velocity.",
    Kind.PULL: "as a yielding drive does: crosstalk needs another axis as master.",
    Kind.REVERSAL_OTHER: "and backlash follows the direction of its own axis only.",
    Kind.OWN_LINE: "and a plane cannot have the compensated axis as a master.",
    Kind.MEMORY: "like a spring that winds up: hysteresis with memory, where the"
    " controller knows the direction only.",
    Kind.HEAT_LINE: "and temperature compensation is along the own axis only.",
    Kind.GROWTH: "as heat makes it: no recorded temperature follows it. Record the"
    " temperature of scale and screw.",
}


def _foreign(term: Term) -> Beyond:
    return Beyond((term,), f"{_start(term)}, {_WHY[term.kind]}")

"""What an error may depend on, and which compensations hold it.

Terms are of compensations and of what the controller has none for; compensations are composed
of the terms that were found.
"""

import dataclasses
import enum
from collections.abc import Collection, Iterator, Mapping


@dataclasses.dataclass(frozen=True)
class Facts:
    """What is known of a kind of terms.

    Attributes:
        words: Name of a term in a sentence, to be filled in.
        factors: Functions whose products are its features (`_features`): name of the
            functions, what they are of (``axis``, ``sensor``, number of a master), and how
            many there are at most.
        compensation: As the job file calls it; None where the controller has none.
        why: What is to be said where the controller has none, or a list cannot hold it.
    """

    words: str
    factors: tuple[tuple[str, str | int, int], ...]
    compensation: str | None = None
    why: str = ""


class Kind(enum.Enum):
    """How a term depends on what was recorded."""

    OWN = Facts("leadscrew of {axis}", (("line", "axis", 48),), "leadscrew")
    REVERSAL = Facts("backlash of {axis}", (("way", "axis", 1),), "backlash")
    OWN_REVERSAL = Facts(
        "bilateral leadscrew of {axis}", (("way", "axis", 1), ("line", "axis", 24))
    )
    LINE = Facts("cross of {axis} over {first}", (("line", 0, 48),), "cross")
    SURFACE = Facts(
        "plane of {axis} over {both}", (("line", 0, 10), ("line", 1, 10)), "plane"
    )
    HEAT_OFFSET = Facts(
        "temperature offset of {axis} by {sensor}",
        (("heat", "sensor", 2),),
        "temperature",
    )
    HEAT_SLOPE = Facts(
        "temperature coefficient of {axis} by {sensor}",
        (("middle", "axis", 1), ("heated", "sensor", 2)),
        "temperature",
    )
    HEAT_CHANGE = Facts(
        "temperature coefficient of {axis} by {sensor}",
        (("middle", "axis", 1), ("heat", "sensor", 2)),
    )
    PUSH = Facts("crosstalk of {axis} from {first}", (("push", 0, 4),), "crosstalk")
    PUSH_WAY = Facts(
        "crosstalk of {axis} from {first} by direction",
        (("sign", 0, 1), ("push", 0, 4)),
    )
    PUSH_PLACE = Facts(
        "crosstalk of {axis} from {first}, adapted to {rest}",
        (("push", 0, 2), ("line", 1, 4)),
    )
    PUSH_PLACES = Facts(
        "crosstalk of {axis} from {first}, adapted to {rest}",
        (("push", 0, 2), ("line", 1, 4), ("line", 2, 4)),
    )
    SPEED = Facts(
        "error of {axis} that follows its velocity",
        (("speed", "axis", 1), ("aging", "axis", 2)),
        why="as a delay between instrument and encoder does: following error and delay are"
        " never compensated. Align the clocks, or measure at standstill.",
    )
    SPEED_OTHER = Facts(
        "error of {axis} that follows the velocity of {first}",
        (("speed", 0, 1),),
        why="and the controller has no compensation over a velocity.",
    )
    PULL = Facts(
        "error of {axis} that follows its own acceleration",
        (("pull", "axis", 1),),
        why="as a yielding drive does: crosstalk needs another axis as master.",
    )
    REVERSAL_OTHER = Facts(
        "jump of {axis} where {first} reverses",
        (("way", 0, 1),),
        why="and backlash follows the direction of its own axis only.",
    )
    OWN_LINE = Facts(
        "error of {axis} over {axis} that changes with {first}",
        (("line", "axis", 6), ("line", 0, 6)),
        why="and a plane cannot have the compensated axis as a master.",
    )
    MEMORY = Facts(
        "error of {axis} that builds up after its reversal",
        (("way", "axis", 1), ("memory", "axis", 3)),
        why="like a spring that winds up: hysteresis with memory, where the controller"
        " knows the direction only.",
    )
    HEAT_LINE = Facts(
        "error of {axis} over {first} that grows with {sensor}",
        (("middle", 0, 1), ("heat", "sensor", 1)),
        why="and temperature compensation is along the own axis only.",
    )
    GROWTH = Facts(
        "error of {axis} over {axis} that grows with time",
        (("middle", "axis", 1), ("time", "axis", 1)),
        why="as heat makes it: no recorded temperature follows it. Record the temperature"
        " of scale and screw.",
    )
    INERTIA = Facts("inertia of {axis}", (("pull", "axis", 1),))
    COULOMB = Facts("Coulomb", (("sign", "axis", 1),), "friction")
    VISCOUS = Facts("viscous", (("speed", "axis", 1),), "friction")
    DRAG = Facts("square of the velocity", (("drag", "axis", 1),), "friction")
    STRIBECK = Facts("Stribeck", (("slow", "axis", 1),), "friction")
    VISCOUS_WAY = Facts(
        "direction-dependent viscous friction of {axis}",
        (("magnitude", "axis", 1),),
        why="a friction list has one curve for both directions.",
    )
    LOAD_PLACE = Facts(
        "position-dependent load of {axis}",
        (("line", "axis", 12),),
        why="weight or cogging is no friction, and a list has no position.",
    )
    COULOMB_PLACE = Facts(
        "position-dependent friction of {axis}",
        (("sign", "axis", 1), ("line", "axis", 12)),
        why="a friction list knows the velocity only.",
    )
    COULOMB_HEAT = Facts(
        "friction of {axis} that changes with {sensor}",
        (("sign", "axis", 1), ("heat", "sensor", 1)),
        why="a friction list knows the velocity only. Record it warm.",
    )


HEAT = (Kind.HEAT_OFFSET, Kind.HEAT_SLOPE)
PUSHES = (Kind.PUSH, Kind.PUSH_WAY, Kind.PUSH_PLACE, Kind.PUSH_PLACES)


@dataclasses.dataclass(frozen=True)
class Term:
    """One term of the error (or current) of an axis.

    Attributes:
        kind: Of what it is a function.
        axis: Axis whose error it is part of.
        masters: Other axes that it depends on; of crosstalk first the one that accelerates,
            then those whose positions adapt it.
        sensor: Temperature that it follows.
        lag: Seconds by which it follows its sensor; of Stribeck friction its velocity, as a
            share of the fastest.
    """

    kind: Kind
    axis: str
    masters: tuple[str, ...] = ()
    sensor: str | None = None
    lag: float = 0.0

    @property
    def facts(self) -> Facts:
        """What is known of all terms of its kind."""
        return self.kind.value

    @property
    def words(self) -> str:
        """Its name in a sentence."""
        return self.facts.words.format(
            axis=self.axis,
            sensor=self.sensor,
            first=self.masters[0] if self.masters else "",
            both=" and ".join(self.masters),
            rest=" and ".join(self.masters[1:]),
        )

    @property
    def start(self) -> str:
        """Its name at the start of a sentence."""
        return self.words[0].upper() + self.words[1:]

    def owner(self, whose: str | int) -> str:
        """Return the axis or sensor that a factor is of."""
        if isinstance(whose, int):
            return self.masters[whose]
        if whose == "axis":
            return self.axis
        assert self.sensor is not None  # candidates give every such term one
        return self.sensor


@dataclasses.dataclass(frozen=True, eq=False)
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


def compose(
    sizes: Mapping[Term, float], turning: Collection[str] = ()
) -> tuple[list[Need], list[Beyond]]:
    """Return the fewest compensations that hold all chosen terms of an axis, and the rest.

    Args:
        sizes: Contribution of each chosen term, mm or ° rms.
        turning: Axes that go round, over which there is no plane.
    """
    parts = [
        *_along_itself(sizes),
        *_over_others(sizes, turning),
        *_by_heat(sizes),
        *_by_pushes(sizes),
        *_foreign(sizes),
    ]
    needs = [each for each in parts if isinstance(each, Need)]
    return needs, [each for each in parts if isinstance(each, Beyond)]


def _of(sizes: Mapping[Term, float], *kinds: Kind) -> tuple[Term, ...]:
    """Return the terms of some kinds, the largest first."""
    mine = [term for term in sizes if term.kind in kinds]
    return tuple(sorted(mine, key=lambda term: -sizes[term]))


def _foreign(sizes: Mapping[Term, float]) -> Iterator[Beyond]:
    for term in sizes:
        if term.facts.why:
            yield Beyond((term,), f"{term.start}, {term.facts.why}")


def _along_itself(sizes: Mapping[Term, float]) -> Iterator[Need]:
    own, turn = _of(sizes, Kind.OWN), _of(sizes, Kind.REVERSAL)
    both = _of(sizes, Kind.OWN_REVERSAL)
    if both:
        words = (
            "Its two directions differ along the travel, so one table for each takes the"
            " lost motion as well: no backlash beside it."
        )
        keys = {"bilateral": True}
        yield Need("leadscrew", (*own, *turn, *both), keys=keys, words=words)
        return
    if own:
        yield Need("leadscrew", own)
    if turn:
        yield Need("backlash", turn)


def _over_others(
    sizes: Mapping[Term, float], turning: Collection[str]
) -> Iterator[Need | Beyond]:
    lines, surfaces = _of(sizes, Kind.LINE), _of(sizes, Kind.SURFACE)
    first = [line.masters[0] for line in lines[:2]]
    if not surfaces and len(first) > 1 and not {*first} & set(turning):
        pair = tuple(sorted(first))
        words = (
            f"It is a sum of a part over {pair[0]} and one over {pair[1]}; an axis has one"
            " cross table only, so a plane holds both."
        )
        yield Need("plane", lines[:2], pair, keys={"masters": list(pair)}, words=words)
        lines = lines[2:]
    for term in surfaces[:1]:
        inside = tuple(line for line in lines if line.masters[0] in term.masters)
        lines = tuple(line for line in lines if line not in inside)
        keys: dict[str, object] = {"masters": list(term.masters)}
        yield Need("plane", (term, *inside), term.masters, keys=keys)
    for term in surfaces[1:]:
        yield Beyond((term,), f"{term.start}: an axis has one plane only.")
    for term in lines[:1]:
        yield Need("cross", (term,), term.masters, keys={"master": term.masters[0]})
    for term in lines[1:]:
        yield Beyond((term,), f"{term.start}: an axis has one cross table only.")


def _by_heat(sizes: Mapping[Term, float]) -> Iterator[Need]:
    terms = _of(sizes, *HEAT)
    if not terms:
        return
    sensors = {
        "offset" if term.kind is Kind.HEAT_OFFSET else "coefficient": term.sensor
        for term in terms
    }
    slow = [f"{t.sensor} by about {_time(t.lag)}" for t in terms if t.lag > 0]
    words = f"It lags behind {' and '.join(dict.fromkeys(slow))}." if slow else ""
    one = terms[0].sensor if len(set(sensors.values())) == 1 else None
    keys: dict[str, object] = {"sensors": sensors}
    if one is not None and "coefficient" in sensors:
        keys = {"sensor": one}
    yield Need("temperature", terms, (), one, keys, words)


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds / 60:.2g} min"


def _by_pushes(sizes: Mapping[Term, float]) -> Iterator[Need | Beyond]:
    terms, weight = _of(sizes, *PUSHES), dict[str, float]()
    for term in terms:
        name = term.masters[0]
        weight[name] = weight.get(name, 0.0) + sizes[term] ** 2
    for k, master in enumerate(sorted(weight, key=lambda name: -weight[name])):
        mine = tuple(term for term in terms if term.masters[0] == master)
        if k > 0:
            why = "an axis has one crosstalk list, with one master, only."
            yield Beyond(mine, f"{mine[0].start}: {why}")
            continue
        places = dict.fromkeys(name for term in mine for name in term.masters[1:])
        adaptation = list(places)[:2]
        keys: dict[str, object] = {"master": master, "mode": 1 + len(adaptation)}
        words = f"Mode {1 + len(adaptation)}"
        if adaptation:
            keys["adaptation"] = adaptation if len(adaptation) > 1 else adaptation[0]
            words += f", adapted to the position of {' and '.join(adaptation)}"
        if any(term.kind is Kind.PUSH_WAY for term in mine):
            keys["velocity_dependent"] = True
        yield Need("crosstalk", mine, (master, *adaptation), None, keys, f"{words}.")

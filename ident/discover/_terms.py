"""What an error may depend on, and which compensations hold it.

Compensations are composed of the terms that were found.
"""

import dataclasses
import enum
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property, partial
from typing import Literal


@dataclasses.dataclass(frozen=True)
class Facts:
    """What is known of a kind of terms.

    Attributes:
        words: Name of a term in a sentence, to be filled in.
        functions: Factors whose products are its features, each as ``name owner most``: what
            it is of (the axis, the sensor, the first master, …) and how many functions there
            are at most, one where nothing is said.
        compensation: As the job file calls it; None where the controller has none.
        why: What follows its name where the controller has none, or a list cannot hold it.
        part: Of what it is a term; ``late``: of an error in which others were found.
    """

    words: str
    functions: str
    compensation: str | None = None
    why: str = ""
    part: Literal["error", "heat", "late", "current"] = "error"

    @property
    def factors(self) -> list[tuple[str, str, int]]:
        """Name, owner and largest number of functions of each factor."""
        parts = [f"{factor} 1".split() for factor in self.functions.split(" x ")]
        return [(name, owner, int(limit)) for name, owner, limit, *_ in parts]


_Heat, _Late, _Drive = (partial(Facts, part=p) for p in ("heat", "late", "current"))


class Kind(enum.Enum):
    """How a term depends on what was recorded."""

    OWN = Facts("leadscrew of {axis}", "line axis 48", "leadscrew")
    REVERSAL = Facts("backlash of {axis}", "way axis", "backlash")
    OWN_REVERSAL = Facts("bilateral leadscrew of {axis}", "way axis x line axis 24")
    LINE = Facts("cross of {axis} over {first}", "line first 48", "cross")
    SURFACE = Facts(
        "plane of {axis} over {all}", "line first 10 x line second 10", "plane"
    )
    HEAT_OFFSET = _Heat(
        "temperature offset of {axis} by {sensor}", "heat sensor 2", "temperature"
    )
    HEAT_SLOPE = _Heat(
        "temperature coefficient of {axis} by {sensor}",
        "middle axis x heat sensor 2",
        "temperature",
    )
    HEAT_CHANGE = _Heat(
        "temperature coefficient of {axis} by {sensor}", "middle axis x heat sensor 2"
    )
    PUSH = Facts("crosstalk of {axis} from {first}", "push first 4", "crosstalk")
    PUSH_WAY = Facts(
        "crosstalk of {axis} from {first} by direction", "sign first x push first 4"
    )
    PUSH_PLACE = Facts(
        "crosstalk of {axis} from {first}, adapted to {rest}",
        "push first 2 x line second 4",
    )
    PUSH_PLACES = _Late(
        "crosstalk of {axis} from {first}, adapted to {rest}",
        "push first 2 x line second 4 x line third 4",
    )
    SPEED = Facts(
        "error of {axis} that follows its velocity",
        "speed axis x aging axis 2",
        why=", as a delay between instrument and encoder does: following error and delay are"
        " never compensated. Align the clocks, or measure at standstill.",
    )
    PULL = Facts(
        "error of {axis} that follows its own acceleration",
        "pull axis",
        why=", as a yielding drive does: crosstalk needs another axis as master.",
    )
    MEMORY = Facts(
        "error of {axis} that builds up after its reversal",
        "way axis x memory axis 3",
        why=", like a spring that winds up: hysteresis with memory, where the controller"
        " knows the direction only.",
    )
    SPEED_OTHER = Facts(
        "error of {axis} that follows the velocity of {first}",
        "speed first",
        why=", and the controller has no compensation over a velocity.",
    )
    REVERSAL_OTHER = Facts(
        "jump of {axis} where {first} reverses",
        "way first",
        why=", and backlash follows the direction of its own axis only.",
    )
    OWN_LINE = Facts(
        "error of {axis} over {axis} that changes with {first}",
        "line axis 6 x line first 6",
        why=", and a plane cannot have the compensated axis as a master.",
    )
    GROWTH = _Late(
        "error of {axis} over {axis} that grows with time",
        "middle axis x time axis",
        why=", as heat makes it: no recorded temperature follows it. Record the temperature"
        " of scale and screw.",
    )
    HEAT_LINE = _Late(
        "error of {axis} over {first} that grows with {sensor}",
        "middle first x heat sensor",
        why=", and temperature compensation is along the own axis only.",
    )
    INERTIA = _Drive("inertia of {axis}", "pull axis")
    COULOMB = _Drive("Coulomb", "sign axis", "friction")
    VISCOUS = _Drive("viscous", "speed axis", "friction")
    DRAG = _Drive("square of the velocity", "drag axis", "friction")
    VISCOUS_WAY = _Drive(
        "direction-dependent viscous friction of {axis}",
        "magnitude axis",
        why=": a friction list has one curve for both directions.",
    )
    LOAD_PLACE = _Drive(
        "position-dependent load of {axis}",
        "line axis 12",
        why=": weight or cogging is no friction, and a list has no position.",
    )
    COULOMB_PLACE = _Drive(
        "position-dependent friction of {axis}",
        "sign axis x line axis 12",
        why=": a friction list knows the velocity only.",
    )
    COULOMB_HEAT = _Drive(
        "friction of {axis} that changes with {sensor}",
        "sign axis x heat sensor",
        why=": a friction list knows the velocity only. Record it warm.",
    )
    COULOMB_TIME = _Late(
        "friction of {axis} that changes over the recording",
        "sign axis x time axis",
        why=": a friction list has no time. Run the axis warm first, and record it then.",
    )
    STRIBECK = _Drive("Stribeck", "sign axis x slow axis 4", "friction")


CHANNELS = {
    "line": "position",
    "middle": "position",
    "way": "direction",
    "push": "acceleration",
    "pull": "acceleration",
    **dict.fromkeys(("sign", "speed", "drag", "magnitude", "slow"), "velocity"),
}
"""What must have been recorded, and have changed, for a factor."""
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
        lag: Seconds by which it follows its sensor.
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

    @cached_property
    def owners(self) -> Mapping[str, str]:
        """Axes and sensor that its factors are of."""
        masters = dict(zip(("first", "second", "third"), self.masters, strict=False))
        return {"axis": self.axis, "sensor": self.sensor or "", **masters}

    @property
    def words(self) -> str:
        """Its name in a sentence."""
        return self.facts.words.format(
            **self.owners,
            all=" and ".join(self.masters),
            rest=" and ".join(self.masters[1:]),
        )


@dataclasses.dataclass(frozen=True, eq=False)
class Need:
    """A compensation and the terms that it takes away, or terms that none takes away.

    Attributes:
        compensation: As the job file calls it; None where the controller has none left.
        terms: Parts of the error.
        masters: Axes that it depends on.
        sensor: The one temperature that it follows, or None.
        keys: What the job file says of it.
        words: What is special about it, or why there is no compensation, or nothing.
    """

    compensation: str | None
    terms: tuple[Term, ...]
    masters: tuple[str, ...] = ()
    sensor: str | None = None
    keys: Mapping[str, object] = dataclasses.field(default_factory=dict)
    words: str = ""

    @property
    def lead(self) -> Term:
        """The first of its terms, which says of what kind it is."""
        return self.terms[0]

    def growth_alone(self) -> "Need":
        """Return a temperature effect without the shift of the whole axis."""
        terms = tuple(each for each in self.terms if each.kind is Kind.HEAT_SLOPE)
        left = "How far the whole axis shifts with it is left to the drift."
        words, sensor = f"{self.words} {left}".strip(), terms[0].sensor
        keys = {"sensors": {"coefficient": sensor}}
        return Need(self.compensation, terms, self.masters, sensor, keys, words)


def compose(sizes: Mapping[Term, float], turning: Collection[str] = ()) -> list[Need]:
    """Return the fewest compensations that hold terms of these sizes, and what none holds.

    There is no plane over axes that are turning.
    """
    law = tuple(t for t in sizes if t.facts.part == "current" and t.facts.compensation)
    words = ", ".join(term.words for term in law)
    return [
        *_along_itself(sizes),
        *_over_others(sizes, turning),
        *_by_heat(sizes),
        *_by_pushes(sizes),
        *([Need("friction", law, words=f"{words}.")] if law else []),
        *(_unmatched(term, term.facts.why) for term in sizes if term.facts.why),
    ]


def _unmatched(term: Term, reason: str, *others: Term) -> Need:
    words = term.words[0].upper() + term.words[1:] + reason
    return Need(None, (term, *others), term.masters, words=words)


def _of(sizes: Mapping[Term, float], *kinds: Kind) -> tuple[Term, ...]:
    """Return the terms of some kinds, the largest first."""
    terms = [term for term in sizes if term.kind in kinds]
    return tuple(sorted(terms, key=lambda term: -sizes[term]))


def _along_itself(sizes: Mapping[Term, float]) -> Iterator[Need]:
    offset, reversal = _of(sizes, Kind.OWN), _of(sizes, Kind.REVERSAL)
    separate = _of(sizes, Kind.OWN_REVERSAL)
    if separate:
        words = (
            "Its two directions differ along the travel, so one table for each takes the"
            " lost motion as well: no backlash beside it."
        )
        keys = {"bilateral": True}
        yield Need("leadscrew", (*offset, *reversal, *separate), keys=keys, words=words)
        return
    if offset:
        yield Need("leadscrew", offset)
    if reversal:
        yield Need("backlash", reversal)


def _over_others(
    sizes: Mapping[Term, float], turning: Collection[str]
) -> Iterator[Need]:
    lines, surfaces = _of(sizes, Kind.LINE), _of(sizes, Kind.SURFACE)
    pair = tuple(sorted(line.masters[0] for line in lines[:2]))
    if surfaces:
        contained = [line for line in lines if line.masters[0] in surfaces[0].masters]
        lines = tuple(line for line in lines if line not in contained)
        masters = surfaces[0].masters
        keys: dict[str, object] = {"masters": list(masters)}
        yield Need("plane", (surfaces[0], *contained), masters, keys=keys)
    elif len(pair) > 1 and not {*pair} & {*turning}:
        words = (
            f"It is a sum of a part over {pair[0]} and one over {pair[1]}; an axis has one"
            " cross table only, so a plane holds both."
        )
        yield Need("plane", lines[:2], pair, keys={"masters": list(pair)}, words=words)
        lines = lines[2:]
    for term in surfaces[1:]:
        yield _unmatched(term, ": an axis has one plane only.")
    for term in lines[:1]:
        yield Need("cross", (term,), term.masters, keys={"master": term.masters[0]})
    for term in lines[1:]:
        yield _unmatched(term, ": an axis has one cross table only.")


def _by_heat(sizes: Mapping[Term, float]) -> Iterator[Need]:
    terms = _of(sizes, *HEAT)
    if not terms:
        return
    sensors = dict[str, str | None]()
    grows = {term.sensor for term in terms if term.kind is Kind.HEAT_SLOPE}
    for term in terms:
        name = "offset" if term.kind is Kind.HEAT_OFFSET else "coefficient"
        # Of two offsets that of the growth's sensor is where the growth turns.
        if name not in sensors or (name == "offset" and sensors[name] in grows):
            sensors[name] = term.sensor
    lags = dict[str | None, float]()
    for term in terms:
        # The larger one of two tells more of the lag.
        lags.setdefault(term.sensor, term.lag)
    slow = [f"{name} by about {_time(lag)}" for name, lag in lags.items() if lag > 0]
    words = f"It lags behind {' and '.join(slow)}." if slow else ""
    sensor = terms[0].sensor if len(set(sensors.values())) == 1 else None
    keys: dict[str, object] = {"sensors": sensors}
    if sensor is not None and "coefficient" in sensors:
        keys = {"sensor": sensor}
    yield Need("temperature", terms, (), sensor, keys, words)


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds / 60:.2g} min"


def _by_pushes(sizes: Mapping[Term, float]) -> Iterator[Need]:
    terms, square = _of(sizes, *PUSHES), dict[str, float]()
    for term in terms:
        name = term.masters[0]
        square[name] = square.get(name, 0.0) + sizes[term] ** 2
    for k, master in enumerate(sorted(square, key=lambda name: -square[name])):
        members = tuple(term for term in terms if term.masters[0] == master)
        if k > 0:
            reason = ": an axis has one crosstalk list, with one master, only."
            yield _unmatched(members[0], reason, *members[1:])
            continue
        places = dict.fromkeys(name for term in members for name in term.masters[1:])
        adaptation = list(places)[:2]
        keys: dict[str, object] = {"master": master, "mode": 1 + len(adaptation)}
        words = f"Mode {1 + len(adaptation)}"
        if adaptation:
            keys["adaptation"] = adaptation if len(adaptation) > 1 else adaptation[0]
            words += f", adapted to the position of {' and '.join(adaptation)}"
        if any(term.kind is Kind.PUSH_WAY for term in members):
            keys["velocity_dependent"] = True
        yield Need("crosstalk", members, (master, *adaptation), None, keys, f"{words}.")

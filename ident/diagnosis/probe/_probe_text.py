"""A probe in words: what to go to and to read, what follows from it, and an NC program."""

import dataclasses
from collections.abc import Mapping, Sequence

from ...kinds import kind, kinds
from ._nc import CompState, declared, numbered
from ._probe import Outcome, Probe, ProbeAxis, Probed, number_text, places_text

_FEED = 1000
"""mm/min."""
_LOG = "M00 ; Start the log of positions and offsets here."
_BEGIN = "M00 ; Is all of that so, and the way free? Next: motion."


@dataclasses.dataclass(frozen=True)
class ProbeStep:
    """One reading of a probe.

    Attributes:
        axis: Name of the axis that the gauge stands on.
        compensation: Which one is read.
        start: Positions in mm or ° by axis name where the table says nothing.
        end: Positions by axis name where the plateau is.
        keyword: Of the NC command COMP.
        moving: It acts only while an axis accelerates.
        steady: It is seen while an axis moves slowly at a steady speed.
        checks: What to look at before, in words.
        readings: Names of the logged values that show the same.
        outcomes: What may be seen.
        channel: Of the axis.
        elsewhere: Channel of each axis that another channel moves, by name.
        partners: Other axis of its gantry, by name: nobody moves or switches one alone.
    """

    axis: str
    compensation: str
    start: Mapping[str, float]
    end: Mapping[str, float]
    keyword: str
    moving: bool
    steady: bool
    checks: tuple[str, ...]
    readings: tuple[str, ...]
    outcomes: tuple[Outcome, ...]
    channel: int
    elsewhere: Mapping[str, int]
    partners: Mapping[str, str]

    @property
    def both(self) -> tuple[str, ...]:
        """The axis, and its partner in a gantry."""
        return (self.axis, *filter(None, [self.partners.get(self.axis)]))

    @property
    def on(self) -> str:
        """The NC commands that switch it on, at once."""
        return " ".join(f"{word}[COMP ON {self.keyword}]" for word in self.both)

    @property
    def off(self) -> str:
        """The NC commands that switch all off, at once."""
        return " ".join(f"{word}[COMP OFF_ALL]" for word in self.both)

    @property
    def sentence(self) -> str:
        """What to do, in words."""
        pairs = (f"{one} and {other}" for one, other in self.partners.items())
        words = f" ({', '.join(pairs)}: always both axes of a gantry together)"
        return self._sentence + words * bool(self.partners)

    @property
    def _sentence(self) -> str:
        logged, on = " or ".join(self.readings), self.on
        if self.steady:
            return (
                f"{self.axis}, {self.compensation}: {' '.join(self.checks)} Then switch it on"
                f" ({on}), go slowly and at a steady speed from {places_text(self.start)} to"
                f" {places_text(self.end)} and back, and log {logged} with the velocity."
            )
        if self.moving:
            return (
                f"{self.axis}, {self.compensation}: switch it on ({on}), go from"
                f" {places_text(self.start)} to {places_text(self.end)} and back as fast as it"
                f" goes, and log {logged} with velocity and acceleration."
            )
        return (
            f"{self.axis}, {self.compensation}: switch all off ({self.off}), come from"
            f" {places_text(self.start)} to {places_text(self.end)}, set the gauge on"
            f" {self.axis} to zero, switch it on ({on}) and read the gauge, or log {logged}."
        )


def probe_steps(probe: Probe) -> tuple[ProbeStep, ...]:
    """Return what to read, compensation by compensation."""
    return tuple(_step(table, probe.axes) for table in probe.tables)


def _step(one: Probed, axes: Mapping[int, ProbeAxis]) -> ProbeStep:
    axis, facts = axes[one.axis], kind(one.name)
    masters = [axes[master] for master in one.masters]
    start, end = facts.probe.places(axis, masters)
    shown = (f"{facts.variable}.{axis.name}", facts.channel)
    unit = f"the unit is not {'0.0001°' if axis.rotary else '0.1 µm'}"
    if facts.probe.plateaus:
        unit += ": look at kw.*.unit and at the increments of the axis"
    return ProbeStep(
        axis=axis.name,
        compensation=one.name,
        start=start,
        end=end,
        keyword=facts.keyword,
        moving="acceleration" in facts.follows,
        steady="velocity" in facts.follows,
        checks=facts.probe.checks,
        readings=tuple(name for name in shown if name is not None),
        outcomes=(
            *facts.probe.outcomes(one, axis, masters),
            *(
                [Outcome("ten times as much, or a tenth of it", unit)]
                * (not facts.adds_current)
            ),
            Outcome(
                "nothing at all",
                "not active: look at the activation in the axis list, and at homing",
            ),
        ),
        channel=axis.channel,
        elsewhere={m.name: m.channel for m in masters if m.channel != axis.channel},
        partners={m.name: m.partner for m in (axis, *masters) if m.partner},
    )


def probe_text(probe: Probe) -> str:
    """Return all of it as a text to be read at the machine."""
    lines = [
        "Probe: one plateau of 10 µm (0.01°) per compensation.",
        "",
        "Keep the lists that are loaded now. Load the probe lists, add the entries of"
        " achsmds*.add.lis to the axis lists, reference the axes, move slowly.",
        "A gauge shows what really moves; a log shows what the controller says that it"
        " adds. Where both differ in sign, the gauge is right.",
        "",
    ]
    for k, step in enumerate(probe_steps(probe), start=1):
        lines.append(f"{k}. {step.sentence}")
        lines += [f"   {outcome.seen}: {outcome.means}." for outcome in step.outcomes]
        lines.append("")
    lines += [*probe.remarks, *[""] * bool(probe.remarks)]
    lines += [
        "With a log of all positions and these values while all are on (the second part of the"
        " program): axcomp verify LISTS --log LOG.csv --save MACHINE.conventions.toml",
        "A drive may count the other way round: where the log has drive_position, move each"
        " compensated axis once by a few mm while it runs, the gauge away.",
        "Afterwards load the lists that you kept.",
        "",
    ]
    return "\n".join(lines)


def probe_programs(probe: Probe) -> dict[str, str]:
    """Return the NC programs that go through all of it, one per channel, by file name.

    They rest for a second at each place. First each compensation is switched on at its place,
    for a gauge; then all are on over the same ways, for a log, which tells only what is on all
    the time. At their end every compensation is on or off as it was before.
    """
    steps = probe_steps(probe)
    channels = sorted({step.channel for step in steps})
    return {
        "probe.nc" if len(channels) == 1 else f"probe_{channel}.nc": _program(
            [step for step in steps if step.channel == channel]
        )
        for channel in channels
    }


def _program(steps: Sequence[ProbeStep]) -> str:
    blocks: list[str] = []
    for step in steps:
        blocks += [f"; {step.axis}: {step.compensation}", step.off]
        on = step.on
        way, before = "G00" if step.moving else "G01", step.moving or step.steady
        rest = "G04 1"
        blocks += [*_way("G01", step, step.start), rest]
        if before:
            blocks += [on]
        blocks += [*_way(way, step, step.end), rest]
        if not before:
            blocks += [on, rest]
        blocks += [*_way(way, step, step.start), rest]
    blocks += ["; All on, for the log", *dict.fromkeys(step.on for step in steps), _LOG]
    for step in steps:
        way = "G00" if step.moving else "G01"
        for mode, places in (("G01", step.start), (way, step.end), (way, step.start)):
            blocks += [*_way(mode, step, places), "G04 1"]
    blocks += ["M00 ; Stop the log."]
    words = dict.fromkeys(word for step in steps for word in step.both)
    states = [CompState(word, facts.keyword) for word in words for facts in kinds()]
    after = [
        "; As it was",
        *{frozenset(step.both): step.off for step in steps}.values(),
    ]
    for state in states:
        on = f"{state.word}[COMP ON {state.keyword}]"
        after += state.where_it_was(on=True, block=on)
    kept = (state.keep for state in states)
    return numbered(
        [
            "; Probe: first for a gauge, then for a log. Check the way first.",
            "; It goes to positions of the axes in mm or degrees: G71, no zero offset, no tool",
            "; offset, no transformation. Probe lists loaded, all axes referenced, drives on.",
            *declared(states),
            *(
                block if block.startswith(";") else f"N {block}"
                for block in (_BEGIN, *kept, *blocks, *after, "M30")
            ),
        ]
    )


def _way(way: str, step: ProbeStep, places: Mapping[str, float]) -> list[str]:
    """Return the blocks that lead to a place.

    A person leads axes of other channels, and those of a gantry, whose program moves one only.
    """
    led = {
        name: f"{name} of channel {step.elsewhere[name]}"
        if name in step.elsewhere
        else f"{name} and {step.partners[name]} together to"
        for name in places
        if name in step.elsewhere or name in step.partners
    }
    own = {name: at for name, at in places.items() if name not in led}
    other = {words: places[name] for name, words in led.items()}
    blocks = [f"M00 ; Lead {places_text(other)}."] if other else []
    return blocks + ([_block(way, own)] if own else [])


def _block(way: str, places: Mapping[str, float]) -> str:
    words = " ".join(f"{name}={number_text(value)}" for name, value in places.items())
    return f"G90 {way} {words}" + f" F{_FEED}" * (way == "G01")

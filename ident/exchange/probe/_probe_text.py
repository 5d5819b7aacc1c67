"""A probe in words: what to go to and to read, what follows from it, and an NC program."""

import dataclasses
from collections.abc import Mapping

from ...kinds import kind, kinds
from ._probe import Outcome, Probe, ProbeAxis, Probed, number_text, places_text

_FEED = 1000
"""mm/min."""


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

    @property
    def sentence(self) -> str:
        """What to do, in words."""
        logged = " or ".join(self.readings)
        on = f"{self.axis}[COMP ON {self.keyword}]"
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
            f"{self.axis}, {self.compensation}: switch all off ({self.axis}[COMP"
            f" OFF_ALL]), come from {places_text(self.start)} to {places_text(self.end)}, set the"
            f" gauge on {self.axis} to zero, switch it on ({on}) and read the gauge, or"
            f" log {logged}."
        )


def probe_steps(probe: Probe) -> tuple[ProbeStep, ...]:
    """Return what to read, compensation by compensation."""
    return tuple(_step(one, probe.axes) for one in probe.tables)


def _step(one: Probed, axes: Mapping[int, ProbeAxis]) -> ProbeStep:
    axis, found = axes[one.axis], kind(one.name)
    masters = [axes[master] for master in one.masters]
    start, end = found.probe.places(axis, masters)
    shown = (f"{found.variable}.{axis.name}", found.channel)
    unit = f"the unit is not {'0.0001°' if axis.rotary else '0.1 µm'}"
    if found.probe.plateaus:
        unit += ": look at kw.*.unit and at the increments of the axis"
    return ProbeStep(
        axis=axis.name,
        compensation=one.name,
        start=start,
        end=end,
        keyword=found.keyword,
        moving=found.probe.moving,
        steady=found.probe.steady,
        checks=found.probe.checks,
        readings=tuple(name for name in shown if name is not None),
        outcomes=(
            *found.probe.outcomes(one, axis, masters),
            *(
                [Outcome("ten times as much, or a tenth of it", unit)]
                * found.probe.lengths
            ),
            Outcome(
                "nothing at all",
                "not active: look at the activation in the axis list, and at homing",
            ),
        ),
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
        lines += [f"   {one.seen}: {one.means}." for one in step.outcomes]
        lines.append("")
    lines += [
        "With a log of all positions and these values: axcomp verify LISTS --log LOG.csv"
        " --save MACHINE.conventions.toml",
        "Afterwards load the lists that you kept.",
        "",
    ]
    return "\n".join(lines)


def probe_program(probe: Probe) -> str:
    """Return an NC program that goes through all of it, resting for a second each time.

    At its end every compensation is on or off as it was before.
    """
    lines = ["; Probe: log positions and offsets while this runs. Check the way first."]
    blocks: list[str] = []
    for step in probe_steps(probe):
        blocks += [f"; {step.axis}: {step.compensation}", f"{step.axis}[COMP OFF_ALL]"]
        on = f"{step.axis}[COMP ON {step.keyword}]"
        way, before = "G00" if step.moving else "G01", step.moving or step.steady
        rest = "G04 1"
        blocks += [_block("G01", step.start), rest]
        if before:
            blocks += [on]
        blocks += [_block(way, step.end), rest]
        if not before:
            blocks += [on, rest]
        blocks += [_block(way, step.start), rest]
    words = dict.fromkeys(step.axis for step in probe_steps(probe))
    was = {
        (word, one.keyword): f"V.L.WAS_{word}_{one.keyword}".upper()
        for word in words
        for one in kinds()
    }
    lines += ["#VAR", *(f"{memory} = 0" for memory in was.values()), "#ENDVAR"]
    before_all = [
        f"{memory} = V.A.{keyword}_COMP_ACTIVE.{word}"
        for (word, keyword), memory in was.items()
    ]
    after_all = ["; As it was", *(f"{word}[COMP OFF_ALL]" for word in words)]
    for (word, keyword), memory in was.items():
        after_all += [f"$IF {memory} == 1", f"{word}[COMP ON {keyword}]", "$ENDIF"]
    number = 10
    for block in (*before_all, *blocks, *after_all, "M30"):
        if block.startswith(";"):
            lines.append(block)
            continue
        lines.append(f"N{number} {block}")
        number += 10
    return "\n".join([*lines, ""])


def _block(way: str, places: Mapping[str, float]) -> str:
    words = " ".join(f"{name}={number_text(value)}" for name, value in places.items())
    return f"G90 {way} {words}" + f" F{_FEED}" * (way == "G01")

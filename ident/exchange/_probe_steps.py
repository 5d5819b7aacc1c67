"""A probe in words: where to go, what to read, and what each outcome means."""

import dataclasses
from collections.abc import Mapping

from ..kinds import kind
from ._probe import Outcome, Probe, ProbeAxis, Probed, places_text


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

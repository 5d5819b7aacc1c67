"""A probe in words: where to go, what to read, and what each outcome means."""

import dataclasses
from collections.abc import Mapping

from ...models import Conventions
from ._probe import FIRST, QUADRANTS, SECOND, Probe, ProbeAxis, Probed

READINGS = {
    "cross": ("V.A.CROSS_COMP_CURR", "CROSSC::actual_offset"),
    "plane": ("V.A.PLANE_COMP_CURR", "CC2::correction"),
    "leadscrew": ("V.A.LEAD_COMP_CURR", "LSEC::sum epsilon"),
    "crosstalk": ("V.A.CROSSTALK_COMP_CURR", "CROSSTALK::end_offset"),
    "temperature": ("V.A.TEMP_COMP_CURR", "TEMPC::actual_offset"),
    "backlash": ("V.A.BACKLASH_COMP_CURR", "BC::actual backlash"),
}
"""Where the controller shows what it adds: NC variable (mm) and object (increments)."""
KEYWORDS = {"leadscrew": "LEAD", "temperature": "TEMP"}
"""Of the NC command COMP, where it is not the name in capitals."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One thing that may be seen, and what follows from it.

    Attributes:
        seen: In words, with units.
        means: In words.
        conventions: What it settles, by name of the convention.
    """

    seen: str
    means: str
    conventions: Mapping[str, int | str] = dataclasses.field(default_factory=dict)


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
        readings: Names of the logged values that show the same.
        outcomes: What may be seen.
    """

    axis: str
    compensation: str
    start: Mapping[str, float]
    end: Mapping[str, float]
    keyword: str
    moving: bool
    readings: tuple[str, ...]
    outcomes: tuple[Outcome, ...]

    @property
    def sentence(self) -> str:
        """What to do, in words."""
        logged = " or ".join(self.readings)
        on = f"{self.axis}[COMP ON {self.keyword}]"
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
    axis = axes[one.axis]
    masters = [axes[master] for master in one.masters]
    places = {"plane": (FIRST, SECOND), "cross": (SECOND,), "leadscrew": (FIRST,)}
    start = {m.name: m.at(0.0) for m in masters}
    end = {
        m.name: m.at(0.5 * sum(between))
        for m, between in zip(masters, places.get(one.name, ()), strict=False)
    } or {m.name: m.at(10.0) for m in masters}
    if one.name == "backlash":
        # Down, against the direction in which nothing is added.
        start, end = {axis.name: axis.at(6.0)}, {axis.name: axis.at(5.0)}
    if one.name == "crosstalk":
        outcomes = _of_crosstalk(axis, masters[0], one.acceleration)
    else:
        outcomes = _OUTCOMES[one.name](axis, masters)
    table = one.name in places
    unit = ": look at kw.*.unit and at the increments of the axis" if table else ""
    keyword = KEYWORDS.get(one.name, one.name.upper())
    variable, thing = READINGS[one.name]
    return ProbeStep(
        axis=axis.name,
        compensation=one.name,
        start=start,
        end=end,
        keyword=keyword,
        moving=one.name == "crosstalk",
        readings=(f"{variable}.{axis.name}", thing),
        outcomes=(
            *outcomes,
            Outcome(
                "ten times as much, or a tenth of it",
                f"the unit is not {'0.0001°' if axis.rotary else '0.1 µm'}{unit}",
            ),
            Outcome(
                "nothing at all",
                "not active: look at the activation in the axis list, and at homing",
            ),
        ),
    )


def _of_cross(axis: ProbeAxis, masters: list[ProbeAxis]) -> tuple[Outcome, ...]:
    (master,) = masters
    between = [master.at(float(tenths)) for tenths in SECOND]
    there = f"{number_text(between[0])} to {number_text(between[1])}"
    if axis.at(0.0) <= between[0] and between[1] <= axis.at(10.0):
        seen = (
            f"nothing on {axis.name}, but {master.name} moves by {_big(axis)} when"
            f" {axis.name} stands at {there}"
        )
    else:
        seen = (
            f"nothing on {axis.name}, which does not reach {there}, and a list of"
            f" {master.name} with the number of {axis.name} as its master acts on"
            f" {axis.name}"
        )
    return (
        *_signs(axis, "cross_sign", entry="offset"),
        Outcome(
            seen,
            "the list belongs to the master axis and names its slave",
            {"cross_list": "master"},
        ),
    )


def _of_plane(axis: ProbeAxis, masters: list[ProbeAxis]) -> tuple[Outcome, ...]:
    first, second = masters
    swapped = (
        f"{first.name} at {number_text(first.at(0.5 * sum(SECOND)))} and {second.name} at"
        f" {number_text(second.at(0.5 * sum(FIRST)))}"
    )
    return (
        *_signs(axis, "plane_sign", entry="offset"),
        Outcome(
            f"nothing there, but {_big(axis)} with {swapped}",
            "the first index of the table counts along master 1",
            {"plane_index": "ij"},
        ),
    )


def _of_leadscrew(axis: ProbeAxis, masters: list[ProbeAxis]) -> tuple[Outcome, ...]:
    del masters
    return _signs(axis, "leadscrew_sign", entry="error")


def _of_crosstalk(axis: ProbeAxis, master: ProbeAxis, rate: int) -> tuple[Outcome, ...]:
    first, second, third, fourth = (f"{1000 * value:g}" for value in QUADRANTS)
    name = master.name
    return (
        Outcome(
            f"+{first} µm for a > 0, v > 0; +{second} for a > 0, v < 0;"
            f" +{third} for a < 0, v > 0; +{fourth} for a < 0, v < 0 of {name} (in"
            f" proportion to a, up to {rate} mm/s²)",
            "the sign of a decides; entries are added as they stand",
            {"crosstalk_accelerate": "sign", "crosstalk_sign": 1},
        ),
        Outcome(
            f"+{fourth} µm for a > 0, v < 0 and +{second} for a < 0, v < 0",
            "it counts whether the speed grows or shrinks",
            {"crosstalk_accelerate": "speed", "crosstalk_sign": 1},
        ),
        Outcome(
            f"+{first} µm for a > 0 and +{third} for a < 0, whichever way {name} moves",
            f"the direction of {axis.name} decides, which stands",
            {"crosstalk_velocity": "slave"},
        ),
        Outcome(
            "the same with the other sign",
            f"entries are subtracted from {axis.name}",
            {"crosstalk_sign": -1},
        ),
    )


def _of_temperature(axis: ProbeAxis, masters: list[ProbeAxis]) -> tuple[Outcome, ...]:
    del masters
    rise = 1e-3 * axis.slope * (axis.at(10.0) - axis.at(0.0))
    return (
        Outcome(
            f"+{10 + rise:.3g} µm (10 of the offset, {rise:.2g} of the slope)",
            "the line is added as it stands; the coefficient is in µm/m",
            {"temperature_sign": 1},
        ),
        Outcome(
            f"−{10 + rise:.3g} µm", "the line is subtracted", {"temperature_sign": -1}
        ),
        Outcome("10 µm and something else", "the coefficient has another unit"),
    )


def _of_backlash(axis: ProbeAxis, masters: list[ProbeAxis]) -> tuple[Outcome, ...]:
    del masters
    return (
        Outcome(
            f"−{_big(axis)}, and nothing when it is done coming from below",
            "moving up is the reference; moving down the backlash is taken off",
            {"backlash_reference": 1},
        ),
        Outcome(
            f"nothing, and +{_big(axis)} when it is done coming from below",
            "moving down is the reference",
            {"backlash_reference": -1},
        ),
    )


_OUTCOMES = {
    "cross": _of_cross,
    "plane": _of_plane,
    "leadscrew": _of_leadscrew,
    "temperature": _of_temperature,
    "backlash": _of_backlash,
}


def _signs(axis: ProbeAxis, convention: str, entry: str) -> tuple[Outcome, Outcome]:
    size = _big(axis)
    kept = f"entries are offsets: {axis.name} moves by what stands in the list"
    turned = f"entries are errors: the controller subtracts them from {axis.name}"
    default = getattr(Conventions, convention)
    plus = Outcome(f"+{size}", kept, {convention: 1})
    minus = Outcome(f"−{size}", turned, {convention: -1})
    assert default == (1 if entry == "offset" else -1)
    return (plus, minus) if default == 1 else (minus, plus)


def _big(axis: ProbeAxis) -> str:
    return "0.01°" if axis.rotary else "10 µm"


def number_text(value: float) -> str:
    """Return a position without needless digits."""
    return f"{value:.10g}"


def places_text(places: Mapping[str, float]) -> str:
    """Return positions by axis as they are read aloud."""
    return ", ".join(f"{name} {number_text(value)}" for name, value in places.items())

"""Units of measurement files and their exact conversion to mm, °, s and °C."""

import dataclasses
import difflib
import math
import re
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from ._errors import UnitError


@dataclasses.dataclass(frozen=True)
class Unit:
    """A unit of one dimension.

    Attributes:
        name: As written in jobs.
        dimension: ``length``, ``angle``, ``velocity``, … ; values of one dimension
            share a library unit.
        numerator: Library units per unit, times `denominator`. One of both is 1 where
            that can be, so converting rounds once.
        denominator: See `numerator`.
        zero: The library's zero in this unit, as of kelvin and °F.
    """

    name: str
    dimension: str
    numerator: int | float = 1
    denominator: int = 1
    zero: float = 0.0

    def to_library(
        self, values: Float[np.ndarray, " t"], increment: float | None = None
    ) -> Float[np.ndarray, " t"]:
        """Return values of this unit in the library unit of its dimension.

        Args:
            values: In this unit.
            increment: mm or ° per encoder increment; needed for ``inc`` and its rates.
        """
        if self.dimension.startswith("increment"):
            if increment is None:
                msg = "a value in increments needs the axis's increment in mm or °"
                raise ValueError(msg)
            return values * increment
        return (values - self.zero) * self.numerator / self.denominator


_RADIAN = 180.0 / math.pi
_BASE = (
    Unit("mm", "length"),
    Unit("um", "length", 1, 1_000),
    Unit("0.1um", "length", 1, 10_000),
    Unit("m", "length", 1_000),
    Unit("in", "length", 127, 5),  # 25.4 mm
    Unit("deg", "angle"),
    Unit("rad", "angle", _RADIAN),
    Unit("0.0001deg", "angle", 1, 10_000),
    Unit("inc", "increments"),
)
_RATES = {
    "length": ("velocity", "acceleration"),
    "angle": ("angular velocity", "angular acceleration"),
}
_RATES["increments"] = ("increments per s", "increments per s2")


def _all_units() -> Iterable[Unit]:
    yield from _BASE
    for unit in _BASE:
        first, second = _RATES[unit.dimension]
        yield dataclasses.replace(unit, name=f"{unit.name}/s", dimension=first)
        yield dataclasses.replace(unit, name=f"{unit.name}/s2", dimension=second)
    yield Unit("mm/min", "velocity", 1, 60)
    yield Unit("m/min", "velocity", 50, 3)
    yield Unit("in/min", "velocity", 127, 300)
    yield Unit("deg/min", "angular velocity", 1, 60)
    yield Unit("rpm", "angular velocity", 6)
    yield Unit("nm", "length", 1, 1_000_000)
    yield Unit("0.01mm", "length", 1, 100)
    yield Unit("0.1mm", "length", 1, 10)
    yield Unit("cm", "length", 10)
    yield Unit("dm", "length", 100)
    yield Unit("ft", "length", 1_524, 5)
    yield Unit("thou", "length", 127, 5_000)
    yield Unit("uin", "length", 127, 5_000_000)
    yield Unit("mdeg", "angle", 1, 1_000)
    yield Unit("arcmin", "angle", 1, 60)
    yield Unit("arcsec", "angle", 1, 3_600)
    yield Unit("gon", "angle", 9, 10)
    yield Unit("mrad", "angle", _RADIAN, 1_000)
    yield Unit("urad", "angle", _RADIAN, 1_000_000)
    yield Unit("s", "time")
    yield Unit("ms", "time", 1, 1_000)
    yield Unit("min", "time", 60)
    yield Unit("h", "time", 3_600)
    yield Unit("degC", "temperature")
    yield Unit("degF", "temperature", 5, 9, zero=32.0)
    yield Unit("K", "temperature", zero=273.15)
    yield Unit("A", "current")
    yield Unit("V", "voltage")
    yield Unit("N", "force")
    yield Unit("Nm", "torque")
    for name, dimension in (("A", "current"), ("V", "voltage")):
        yield Unit(f"d{name}", dimension, 1, 10)
        yield Unit(f"m{name}", dimension, 1, 1_000)
    yield Unit("%", "ratio")
    yield Unit("raw", "drive units")


UNITS: dict[str, Unit] = {unit.name: unit for unit in _all_units()}

LIBRARY_UNIT: dict[str, str] = {
    unit.dimension: unit.name
    for unit in UNITS.values()
    if (unit.numerator, unit.denominator, unit.zero) == (1, 1, 0.0)
    and not unit.dimension.startswith("increments")
}
"""Unit inside the library, by dimension (increments become lengths or angles)."""


# Spellings met in files, folded to the names above. Micro comes as two code points.
_FOLDS = (
    ("\N{MICRO SIGN}", "u"),
    ("\N{GREEK SMALL LETTER MU}", "u"),
    ("°C", "degC"),
    ("°F", "degF"),
    ("°", "deg"),
    ("²", "2"),
    ("^", ""),
    (" ", ""),
    ("·", ""),
    ("*", ""),
)
_PART = re.compile(r"^(?:1/10|0,)(0*)1?(?=[a-z])")
"""A tenth, a hundredth … of a unit as ``1/100`` and ``0,01``."""
_ALIASES = {
    alias: name
    for name, aliases in {
        "degC": "C",
        "degF": "F",
        "deg": "degree degrees grad",
        "mdeg": "0.001deg millidegree millidegrees",
        "arcmin": "arcminutes arcmins arc-min minutesofarc Winkelminuten Bogenminuten",
        "arcsec": "arcseconds arcsecs arcs arc-sec asec secondsofarc '' ″ Winkelsekunden"
        " Bogensekunden",
        "um": "micron microns micrometer micrometre micrometers micrometres Mikrometer"
        " 0.001mm 1e-3mm my Mikron",
        "nm": "nanometer nanometers nanometre nanometres Nanometer",
        "mm": "millimeter millimetre millimeters Millimeter",
        "0.01mm": "10um",
        "cm": "centimeter centimetre centimeters centimetres Zentimeter",
        "in": "inch inches Zoll pouce pouces",
        "ft": "feet foot Fuß",
        "thou": "mil mils 0.001in 0.001inch",
        "uin": "microinch microinches uinch",
        "s": "sec",
        "min": "minute minutes Minuten",
        "h": "hr hrs hours Stunden",
        "%": "percent",
        "inc": "increments increment incs Inkremente counts cts pulses Impulse",
        "Nm": "N.m",
        "mm/s": "mm/sec",
        "in/min": "ipm",
        "rpm": "1/min U/min rev/min",
    }.items()
    for alias in aliases.split()
}
# Case is forgiven where no other unit can be meant ("nm" must never become Nm).
_CASELESS = {
    name.lower(): UNITS[found].name
    for name, found in (*zip(UNITS, UNITS, strict=True), *_ALIASES.items())
    if name not in {"Nm", "nm", "m", "s", "h", "K", "A", "V", "N", "C", "F"}
}


FOREIGN = frozenset("f \" ' ppm ppb um/m mm/m nm/m yd div digit digits steps".split())
"""Units that files use and the library does not convert; a default would be wrong.

``"`` is inches of a length or seconds of an angle; ppm and µm/m are no lengths.
"""


def is_foreign(text: str) -> bool:
    """Whether a text is a unit that the library knows and does not convert."""
    return _folded(text).casefold() in FOREIGN


def find_unit(text: str) -> Unit | None:
    """Return the unit that a text names, also as ``µm``, ``°``, ``mm/s²``, or None."""
    text = _folded(text)
    text = _ALIASES.get(text, text)
    return UNITS.get(text) or UNITS.get(_CASELESS.get(text.lower(), ""))


def _folded(text: str) -> str:
    for old, new in _FOLDS:
        text = text.replace(old, new)
    return _PART.sub(lambda part: f"0.{part[1]}1", text)


def unit(text: str, dimensions: Iterable[str], source: str, what: str) -> Unit:
    """Return the named unit, which must be of one of the dimensions.

    Args:
        text: As written in a job or a header.
        dimensions: Dimensions that fit the role.
        source: File, for the message.
        what: Role or column, for the message.

    Raises:
        UnitError: If the unit is unknown or of another dimension; names the accepted
            ones and the nearest.
    """
    allowed = set(dimensions)
    result = find_unit(text)
    if result is not None and result.dimension in allowed:
        return result
    accepted = [name for name, unit in UNITS.items() if unit.dimension in allowed]
    # To "yd" and "ppm" no unit is near, and one that looks alike would be wrong.
    close = "" if is_foreign(text) else nearest(text, accepted)
    raise UnitError(source, what, text, accepted, close)


def nearest(text: str, names: Iterable[str]) -> str:
    """Return the name most like a text; the first one where none is."""
    choices = list(names)
    close = difflib.get_close_matches(text, choices, n=1, cutoff=0.3)
    return close[0] if close else choices[0]

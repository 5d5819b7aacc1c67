"""Units of measurement files and their exact conversion to mm, °, s and °C."""

import dataclasses
import difflib
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from ._errors import UnitError


@dataclasses.dataclass(frozen=True)
class Unit:
    """A unit of one dimension; one side of the ratio is 1, so converting rounds once.

    Attributes:
        name: As written in jobs.
        dimension: ``length``, ``angle``, ``velocity``, … ; values of one dimension
            share a library unit.
        numerator: Library units per unit, times `denominator`.
        denominator: See `numerator`.
    """

    name: str
    dimension: str
    numerator: int = 1
    denominator: int = 1

    def to_library(
        self, values: Float[np.ndarray, " t"], increment: float | None = None
    ) -> Float[np.ndarray, " t"]:
        """Return values of this unit in the library unit of its dimension.

        Args:
            values: In this unit.
            increment: mm or ° per encoder increment; needed for ``inc`` and its rates.
        """
        if self.dimension.startswith("increment"):
            return values * _known(increment)
        if self.name.startswith("rad"):
            degrees: np.ndarray = np.rad2deg(values)
            return degrees
        if self.name == "K":
            return values - _ZERO_CELSIUS
        if self.numerator != 1:
            return values * float(self.numerator)
        return values / float(self.denominator)

    def from_library(
        self, values: Float[np.ndarray, " t"], increment: float | None = None
    ) -> Float[np.ndarray, " t"]:
        """Return values of the library unit in this unit; inverse of `to_library`."""
        if self.dimension.startswith("increment"):
            return values / _known(increment)
        if self.name.startswith("rad"):
            radians: np.ndarray = np.deg2rad(values)
            return radians
        if self.name == "K":
            return values + _ZERO_CELSIUS
        if self.numerator != 1:
            return values / float(self.numerator)
        return values * float(self.denominator)


_ZERO_CELSIUS = 273.15

_BASE = (
    Unit("mm", "length"),
    Unit("um", "length", 1, 1_000),
    Unit("0.1um", "length", 1, 10_000),
    Unit("m", "length", 1_000),
    Unit("deg", "angle"),
    Unit("rad", "angle"),
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
    yield Unit("arcsec", "angle", 1, 3_600)
    yield Unit("s", "time")
    yield Unit("ms", "time", 1, 1_000)
    yield Unit("degC", "temperature")
    yield Unit("K", "temperature")
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
    "length": "mm",
    "angle": "deg",
    "velocity": "mm/s",
    "angular velocity": "deg/s",
    "acceleration": "mm/s2",
    "angular acceleration": "deg/s2",
    "time": "s",
    "temperature": "degC",
    "current": "A",
    "voltage": "V",
    "force": "N",
    "torque": "Nm",
    "ratio": "%",
    "drive units": "raw",
}
"""Unit inside the library, by dimension (increments become lengths or angles)."""

# Spellings met in files, folded to the names above. Micro comes as two code points.
_FOLDS = (
    ("\N{MICRO SIGN}", "u"),
    ("\N{GREEK SMALL LETTER MU}", "u"),
    ("°C", "degC"),
    ("°", "deg"),
    ("²", "2"),
    ("^", ""),
    (" ", ""),
    ("·", ""),
    ("*", ""),
)
_ALIASES = {
    "C": "degC",
    "degree": "deg",
    "degrees": "deg",
    "grad": "deg",
    **dict.fromkeys(("arcseconds", "arcsecs", "''", "″", "Winkelsekunden"), "arcsec"),
    **dict.fromkeys(("micron", "microns", "micrometer", "micrometre"), "um"),
    **dict.fromkeys(("micrometers", "micrometres", "Mikrometer"), "um"),
    **dict.fromkeys(("millimeter", "millimetre", "millimeters", "Millimeter"), "mm"),
    "sec": "s",
    "percent": "%",
    "increments": "inc",
    "N.m": "Nm",
    "mm/sec": "mm/s",
}
# Case is forgiven where no other unit can be meant ("nm" must never become Nm).
_CASELESS = {
    name.lower(): name
    for name in UNITS
    if name not in {"Nm", "m", "s", "K", "A", "V", "N"}
}


FOREIGN = frozenset(
    ("in", "inch", "inches", "zoll", '"', "mil", "thou", "ft", "f", "°f", "degf")
)
"""Units that files use and the library does not convert; a default would be wrong."""


def find_unit(text: str) -> Unit | None:
    """Return the unit that a text names, also as ``µm``, ``°``, ``mm/s²``, or None."""
    for old, new in _FOLDS:
        text = text.replace(old, new)
    text = _ALIASES.get(text, text)
    return UNITS.get(text) or UNITS.get(_CASELESS.get(text.lower(), ""))


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
    found = find_unit(text)
    if found is not None and found.dimension in allowed:
        return found
    accepted = [name for name, unit in UNITS.items() if unit.dimension in allowed]
    # To "in" and "mil" no unit is near, and one that looks alike would be wrong.
    close = accepted[0] if text.casefold() in FOREIGN else nearest(text, accepted)
    raise UnitError(source, what, text, accepted, close)


def nearest(text: str, names: Iterable[str]) -> str:
    """Return the name most like a text; the first one where none is."""
    choices = list(names)
    close = difflib.get_close_matches(text, choices, n=1, cutoff=0.3)
    return close[0] if close else choices[0]


def _known(increment: float | None) -> float:
    if increment is None:
        msg = "a value in increments needs the axis's increment in mm or °"
        raise ValueError(msg)
    return increment

"""How lengths and errors are shown: µm, mm for positions, true minus signs."""

import dataclasses
import math
from collections.abc import Iterable, Sequence

from ...data.units import small_unit


@dataclasses.dataclass(frozen=True)
class Scale:
    """Display units of one fit.

    Attributes:
        position: Unit of positions as shown.
        error: Unit of errors as shown.
        factor: Multiplies a value in library units (mm or °) to show it as an error.
    """

    position: str
    error: str
    factor: float = 1000.0

    def shown(self, value: float, *, signed: bool = False) -> str:
        """Return an error in library units for reading, with its unit."""
        return f"{self.figure(value, signed=signed)} {self.error}"

    def figure(self, value: float, *, signed: bool = False) -> str:
        """Return an error in library units for reading.

        Currents come in units of very different size: three significant digits.
        """
        if self.factor == 1.0:
            return _with_minus(f"{value:.3g}") if math.isfinite(value) else "–"
        return number(value * self.factor, signed=signed)


def scale_of(unit: str) -> Scale:
    """Return the display units for an error in ``mm``, ``deg`` or a unit of current."""
    if unit not in {"mm", "deg"}:
        return Scale("mm/s", unit, 1.0)
    return Scale("mm" if unit == "mm" else "°", small_unit(unit))


def number(value: float, *, signed: bool = False) -> str:
    """Return an error for reading: one decimal, two below 1, with a true minus sign."""
    if not math.isfinite(value):
        return "–"
    size = abs(value)
    digits = 0 if size >= 999.5 else 1 if size >= 0.995 else 2
    return _with_minus(f"{value:{'+' if signed else ''}.{digits}f}")


def place(value: float) -> str:
    """Return a position for reading, without trailing zeros."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return _with_minus(text)


def spot(names: Sequence[str], places: Iterable[float], units: Sequence[str]) -> str:
    """Return where axes stand, in words; a unit that all share stands once."""
    every = [f"{name} = {place(at)}" for name, at in zip(names, places, strict=True)]
    if len({*units}) == 1:
        every[-1] += f" {units[0]}"
        return ", ".join(every)
    return ", ".join(f"{one} {unit}" for one, unit in zip(every, units, strict=True))


def count(value: int, noun: str, plural: str | None = None) -> str:
    """Return ``"1 node"``, ``"12 nodes"``, with thin spaces in large numbers."""
    word = noun if value == 1 else plural or f"{noun}s"
    return f"{grouped(value)} {word}"


def left_out_words(value: int, noun: str = "wild reading") -> str:
    """Return that so many are not in a picture, to stand behind its caption."""
    if not value:
        return ""
    return f" {value} {noun}{' is' if value == 1 else 's are'} left out of the picture."


def grouped(value: int) -> str:
    """Return a whole number with a narrow no-break space between the thousands."""
    return f"{value:,}".replace(",", "\u202f")


def percent(share: float) -> str:
    """Return a share as a percentage that never rounds up to all or down to nothing."""
    if not math.isfinite(share):
        return "–"
    value = 100 * share
    if 0 < value < 0.1:
        return "less than 0.1 %"
    if 99.9 < value < 100:
        return "more than 99.9 %"
    digits = 0 if value in (0.0, 100.0) or 10 <= value < 99 else 1
    return f"{value:.{digits}f} %"


def _with_minus(text: str) -> str:
    bare = text.lstrip("+-").replace(".", "").strip("0")
    if not bare:  # "-0.00" would read as a sign that is not there
        text = text.lstrip("+-")
    return text.replace("-", "−")
